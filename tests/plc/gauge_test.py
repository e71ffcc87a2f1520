#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""Gauges with a real slabd: an instrument made of pymodbus, a hub that sends datagrams, the registers of the PLC. A
value of another slab, an exchanged, late, old or lost one never counts: reason 114, and never a pass.

  gauge_test.py --build build/release [--role server|client]"""
import argparse
import json
import os
import shutil
import socket
import struct
import subprocess
import sys
import threading
import time

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
from line import PASS, ROOT, SLAB_BEGIN, SLAB_END, Box, Plc, own_port, wire_for  # noqa: E402

from pymodbus.datastore import ModbusSequentialDataBlock, ModbusServerContext, ModbusSlaveContext  # noqa: E402
from pymodbus.server import StartTcpServer  # noqa: E402

NO_GAUGE, NOT_SCANNED = 114, 402

GAUGES = """
[[gauge]]
name = "length_left"
unit = "mm"
source = "plc:40"
u = 0.08
master = {{ value = 5600.0, u = 0.02, every_h = 12, limit = 0.1 }}
[[gauge]]
name = "length_right"
unit = "mm"
source = "plc:42"
u = 0.08
master = {{ value = 5601.5, u = 0.02, every_h = 12, limit = 0.1 }}
[[gauge]]
name = "width"
unit = "mm"
source = "modbus:127.0.0.1:{modbus}/7/120"
scale = 0.001
u = 0.05
valid_s = 3
master = {{ value = 2500.0, u = 0.02, every_h = 12, limit = 0.1 }}
[[gauge]]
name = "thickness"
unit = "mm"
source = "udp:{udp}"
u = 0.05
master = {{ value = 200.0, u = 0.02, every_h = 12, limit = 0.1 }}
"""

ITEMS = """
[items.slab_length]
formula = "mean(length_left, length_right)"
nominal = 5600
tolerance = 3.0
required = true
confirmed = false
[items.slab_width]
formula = "mean(width)"
nominal = 2500
tolerance = 3.0
required = true
confirmed = false
[items.slab_thickness]
formula = "mean(thickness)"
nominal = 200
tolerance = 3.0
required = true
confirmed = false
"""


def serve_instrument(port):
    """A Modbus server at one address, in its own process: pymodbus serves one port in each. Shows the um of stdin."""
    memory = ModbusSequentialDataBlock(0, [0] * 200)
    context = ModbusServerContext(slaves={7: ModbusSlaveContext(hr=memory, zero_mode=True)}, single=False)
    threading.Thread(target=StartTcpServer, daemon=True,
                     kwargs={"context": context, "address": ("127.0.0.1", port), "allow_reuse_address": True}).start()
    for line in sys.stdin:
        memory.setValues(120, list(struct.unpack(">HH", struct.pack(">i", int(line)))))
        print("shown", flush=True)


class Instrument:
    def __init__(self, port):
        self.process = subprocess.Popen([sys.executable, os.path.abspath(__file__), "--instrument", str(port)],
                                        stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)

    def show(self, um):
        self.process.stdin.write(f"{um}\n")
        self.process.stdin.flush()
        assert self.process.stdout.readline().strip() == "shown"

    def close(self):
        self.process.kill()
        self.process.wait()


class Line:
    """The gauges around one slabd."""

    def __init__(self, box, modbus, udp):
        self.box, self.udp = box, udp
        self.instrument = Instrument(modbus)
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.plc, self.seq = None, int(time.time()) & 0x7FFF
        self.instrument.show(2_500_000)

    def connect(self, sync_last=0):
        self.plc = Plc(wire_for(self.box, sync_last))

    def write_plc(self, slab_no, left=5_600_100, right=5_600_300):
        self.seq = self.seq % 65535 + 1
        words = [0] * 35
        for i, um in enumerate((left, right)):
            words[2 * i], words[2 * i + 1] = struct.unpack(">HH", struct.pack(">i", um))
        words[32], words[33], words[34] = self.seq, slab_no >> 16, slab_no & 0xFFFF
        self.plc.wire.write(40, words)
        self.wait()  # as a client slabd reads the memory twice before it takes it

    def wait(self, seconds=0.5):
        """Lets the PLC cycle on."""
        end = time.monotonic() + seconds
        self.plc.until(lambda: time.monotonic() > end, seconds + 5, "time")

    def send_hub(self, slab_no, value=200.1, seq=None):
        self.seq += 1
        self.socket.sendto(f"thickness {value} {seq or self.seq} {slab_no}\n".encode(), ("127.0.0.1", self.udp))

    def check(self, name, value, passes=True):
        """The gauge measures its master, and the check takes the value that has arrived."""
        if name == "width":
            self.instrument.show(round(1000 * value))
            self.wait(1.2)
        elif name == "thickness":
            self.send_hub(0, value)
            self.wait()
        else:
            self.write_plc(0, **{name.removeprefix("length_"): round(1000 * value)})
        with subprocess.Popen([f"{self.box.build}/cli/slabctl", "gauge", "check", name, "--config", self.box.config],
                              stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True) as check:
            self.plc.until(lambda: check.poll() is not None, 60, "the check")
            assert check.returncode == (0 if passes else 1), check.stdout.read()

    def check_all(self):
        for name, value in (("length_left", 5600.02), ("length_right", 5601.49), ("width", 2500.05),
                            ("thickness", 199.97)):
            self.check(name, value)

    def begin(self, slab_no):
        code, _ = self.plc.order(SLAB_BEGIN, slab_no=slab_no, slab_id=f"G-{slab_no}")
        assert code == 0, f"SLAB_BEGIN: code {code}"

    def end(self, slab_no):
        """Ends the slab, none of whose blocks was scanned; returns reason and states of the gauges."""
        code, seq = self.plc.order(SLAB_END, slab_no=slab_no)
        assert code == 0, f"SLAB_END: code {code}"
        self.plc.until(lambda: (slab_no, 0, seq) in self.plc.results, 60, "the slab's record")
        record = self.plc.results[(slab_no, 0, seq)]
        assert record[6] != PASS
        self.plc.until(lambda: self.plc.block.IR[20] == 0, 30, "no record waiting")
        code, out = self.box.slabctl("show", f"no:{slab_no}", "--db", f"{self.box.dir}/slabd.db", "--json")
        slab = json.loads(out)
        assert slab["reason"] == record[7], (slab["reason"], record[7])
        return record[7], {gauge["name"]: gauge["state"] for gauge in slab["gauges"]}

    def all_gauges(self, slab_no):
        self.write_plc(slab_no)
        self.send_hub(slab_no)
        self.wait(1.2)  # slabd asks the instrument twice a second


def expect(found, reason, **states):
    assert found[0] == reason, found
    for name, state in states.items():
        assert found[1][name] == state, (name, found)


def run(line):
    line.connect()
    line.begin(1)
    line.all_gauges(1)
    expect(line.end(1), NO_GAUGE, length_left="unchecked", width="unchecked", thickness="unchecked")
    line.check_all()

    line.begin(2)
    line.all_gauges(2)
    expect(line.end(2), NOT_SCANNED, length_left="ok", length_right="ok", width="ok", thickness="ok")

    line.begin(3)  # the PLC and the hub are silent: values of the slab before
    line.wait(1.2)
    expect(line.end(3), NO_GAUGE, length_left="other_slab", thickness="other_slab", width="ok")

    line.begin(4)  # ... or come late
    line.write_plc(3)
    line.send_hub(3)
    line.wait(1.2)
    expect(line.end(4), NO_GAUGE, length_left="other_slab", thickness="other_slab")

    line.begin(5)  # in metres, and another dimension
    line.write_plc(5, left=5_600)
    line.send_hub(5, value=2500.1)
    line.wait(1.2)
    expect(line.end(5), NO_GAUGE, length_left="not_plausible", length_right="ok", thickness="not_plausible")

    line.begin(6)  # the PLC names the slab after it has written the sequence number
    line.write_plc(5)
    line.plc.wire.write(73, [0, 6])
    line.send_hub(6)
    line.wait(1.2)
    expect(line.end(6), NO_GAUGE, length_left="other_slab", thickness="ok")

    # Exchanged cables: the left gauge reads the master of the right one, which is 1.5 mm larger.
    line.check("length_left", 5601.49, passes=False)
    line.begin(7)
    line.all_gauges(7)
    expect(line.end(7), NO_GAUGE, length_left="check_failed", length_right="ok")
    line.check_all()

    line.begin(8)  # an instrument without a number
    line.instrument.show(-(1 << 31))
    line.write_plc(8)
    line.send_hub(8)
    line.wait(1.2)
    expect(line.end(8), NO_GAUGE, width="missing", length_left="ok")
    line.instrument.show(2_500_000)

    line.begin(9)  # a power cut between gauge and SLAB_END
    line.all_gauges(9)
    line.box.kill()
    line.box.start()
    line.plc.until(lambda: line.plc.block.xReady, 60, "READY after the restart")
    line.wait(1.2)
    expect(line.end(9), NO_GAUGE, length_left="missing", thickness="missing", width="ok")

    line.begin(10)
    line.all_gauges(10)
    expect(line.end(10), NOT_SCANNED, length_left="ok", width="ok", thickness="ok")


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--build")
    parser.add_argument("--role", default="server")
    parser.add_argument("--instrument", type=int)
    options = parser.parse_args()
    if options.instrument:
        serve_instrument(options.instrument)
        return
    box = Box(os.path.abspath(options.build), options.role)
    modbus, udp = own_port(), own_port()
    recipes = os.path.join(box.dir, "recipes")
    shutil.copytree(os.path.join(ROOT, "recipes"), recipes)
    with open(os.path.join(recipes, "p5600.toml"), "a", encoding="utf-8") as recipe:
        recipe.write(ITEMS)
    with open(box.config, encoding="utf-8") as config:
        text = config.read().replace(f'dir = "{ROOT}/recipes"', f'dir = "{recipes}"')
    with open(box.config, "w", encoding="utf-8") as config:
        config.write(text + GAUGES.format(modbus=modbus, udp=udp))
    line = Line(box, modbus, udp)
    try:
        box.start()
        run(line)
    except BaseException:
        print(box.log()[-4000:], file=sys.stderr)
        raise
    finally:
        line.instrument.close()
        box.close()


if __name__ == "__main__":
    main()
