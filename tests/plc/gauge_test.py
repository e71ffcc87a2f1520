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
from line import PASS, ROOT, Box, Plc, own_port, wait_for, wire_for  # noqa: E402

from pymodbus.datastore import ModbusSequentialDataBlock, ModbusServerContext, ModbusSlaveContext  # noqa: E402
from pymodbus.server import StartTcpServer  # noqa: E402

NO_GAUGE, NOT_SCANNED = 114, 402
NOT_REACHABLE = 4  # exit status of slabctl
WAIT_S = 120  # for anything that takes a second on a free computer

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
valid_s = 60
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

        def arrived():
            # Again, because a write may be lost; values with a known number have no effect.
            self.plc.wire.write(40, words)
            return self.seq_of("length_left") == self.seq

        wait_for(arrived, WAIT_S, "the PLC's values")

    def seq_of(self, name):
        """Number of the gauge's newest value; -1: slabd has not answered. The PLC cycles on meanwhile."""
        with self.plc.cycling():
            code, out = self.box.slabctl("gauge", "list", "--config", self.box.config, "--json")
        return next(gauge["seq"] for gauge in json.loads(out)["gauges"] if gauge["name"] == name) if code == 0 else -1

    def until_width_is_new(self):
        """Until slabd has a value of the instrument that was read after now: the next one may be on its way already."""
        known = []

        def is_new():
            seq = self.seq_of("width")
            if seq >= 0:
                known.append(seq)
            return known and known[-1] >= known[0] + 2

        wait_for(is_new, WAIT_S, "two values of the instrument")

    def send_hub(self, slab_no, value=200.1):
        self.seq += 1
        self.socket.sendto(f"thickness {value} {self.seq} {slab_no}\n".encode(), ("127.0.0.1", self.udp))
        wait_for(lambda: self.seq_of("thickness") == self.seq, WAIT_S, "the hub's value")

    def measure_master(self, name, value):
        if name == "width":
            self.instrument.show(round(1000 * value))
            self.until_width_is_new()
        elif name == "thickness":
            self.send_hub(0, value)
        else:
            self.write_plc(0, **{name.removeprefix("length_"): round(1000 * value)})

    def check(self, name, value, passes=True):
        """The gauge measures its master, and the check takes the value that has arrived. Again if slabd did not answer
        in time."""
        for _ in range(4):
            self.measure_master(name, value)
            with self.plc.cycling():
                code, out, err = self.box.slabctl_and_errors("gauge", "check", name, "--config", self.box.config)
            if code != NOT_REACHABLE:
                break
        assert code == (0 if passes else 1), out + err

    def check_all(self):
        for name, value in (("length_left", 5600.02), ("length_right", 5601.49), ("width", 2500.05),
                            ("thickness", 199.97)):
            self.check(name, value)

    def begin(self, slab_no):
        self.plc.begin(slab_no, f"G-{slab_no}")

    def end(self, slab_no):
        """Ends the slab, none of whose blocks was scanned; returns reason and states of the gauges."""
        seq = self.plc.end(slab_no)
        self.plc.until(lambda: (slab_no, 0, seq) in self.plc.results, 60, "the slab's record")
        record = self.plc.results[(slab_no, 0, seq)]
        assert record[6] != PASS
        self.plc.until(lambda: self.plc.block.IR[20] == 0, 30, "no record waiting")
        with self.plc.cycling():
            _, out = self.box.slabctl("show", f"no:{slab_no}", "--db", f"{self.box.dir}/slabd.db", "--json")
        slab = json.loads(out)
        assert slab["reason"] == record[7], (slab["reason"], record[7])
        return record[7], {gauge["name"]: gauge["state"] for gauge in slab["gauges"]}

    def all_gauges(self, slab_no):
        self.write_plc(slab_no)
        self.send_hub(slab_no)
        self.until_width_is_new()


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
    line.until_width_is_new()
    expect(line.end(3), NO_GAUGE, length_left="other_slab", thickness="other_slab", width="ok")

    line.begin(4)  # ... or come late
    line.write_plc(3)
    line.send_hub(3)
    line.until_width_is_new()
    expect(line.end(4), NO_GAUGE, length_left="other_slab", thickness="other_slab")

    line.begin(5)  # in metres, and another dimension
    line.write_plc(5, left=5_600)
    line.send_hub(5, value=2500.1)
    line.until_width_is_new()
    expect(line.end(5), NO_GAUGE, length_left="not_plausible", length_right="ok", thickness="not_plausible")

    line.begin(6)  # the PLC names the slab after it has written the sequence number
    line.write_plc(5)
    line.plc.wire.write(73, [0, 6])
    line.send_hub(6)
    line.until_width_is_new()
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
    line.until_width_is_new()
    expect(line.end(8), NO_GAUGE, width="missing", length_left="ok")
    line.instrument.show(2_500_000)

    line.begin(9)  # a power cut between gauge and SLAB_END
    line.all_gauges(9)
    line.box.kill()
    line.box.start()
    line.plc.until(lambda: line.plc.block.xReady, 60, "READY after the restart")
    line.until_width_is_new()
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
