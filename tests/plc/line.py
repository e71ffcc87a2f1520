# SPDX-License-Identifier: Apache-2.0
"""A line around a real slabd: its folder and configuration, robot and scanner (slabctl simulate --stand-by), and a PLC
made of pymodbus and the function block of docs/plc. Nothing of the PLC's side shares code with slabd."""
import contextlib
import json
import logging
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time

from pymodbus.client import ModbusSerialClient, ModbusTcpClient
from pymodbus.datastore import ModbusSequentialDataBlock, ModbusServerContext, ModbusSlaveContext
from pymodbus.exceptions import ModbusException
from pymodbus.server import ServerStop, StartTcpServer

sys.path.insert(0, os.path.join(os.path.dirname(os.path.dirname(os.path.abspath(__file__))), "places"))
from ports import own_port  # noqa: E402
from st_block import Block  # noqa: E402

logging.disable(logging.ERROR)  # pymodbus logs every reconnection; its timeout= must be whole seconds

ROOT = os.path.dirname(os.path.dirname(os.path.dirname(os.path.abspath(__file__))))
SLAB_BEGIN, SCAN, SLAB_END, SLAB_ABORT = 1, 2, 3, 4
PASS, FAIL = 1, 2
STATIONS = 18
NO_ANSWER = 9999  # an order that the function block has given up


class Box:
    """One slabd with everything of its own."""

    def __init__(self, build, role, scanner=None, peers_scanner=None, user=None):
        """`scanner`, `peers_scanner`: the [scanner] table of slabd and of robot and scanner, where they are not to meet
        in one folder; {dir} is replaced by the box's. `user`: slabd runs as this uid."""
        self.build, self.role, self.user, self.one_folder = build, role, user, peers_scanner is None
        self.dir = tempfile.mkdtemp(prefix="slabd-plc-")
        self.port, lcm_port = own_port(), own_port()
        self.daemon = self.peers = self.socat = None
        self.pty = [os.path.join(self.dir, "line-slabd"), os.path.join(self.dir, "line-plc")]
        plc = {"server": f'listen = "127.0.0.1:{self.port}"',
               "client": f'connect = "127.0.0.1:{self.port}"\npoll_ms = 20',
               "rtu": f'device = "{self.pty[0]}"\nparity = "none"\nunit_id = 17'}[role]
        common = f"""[plc]
role = "{role}"
{plc}
[robot]
lcm_url = "udpm://239.255.78.{lcm_port % 250 + 2}:{lcm_port}?ttl=0"
interface = "lo"
window_ms = 100
samples_min = 5
dwell_ms = 0
stale_ms = 1000
gap_ms = 1000
[storage]
db = "{self.dir}/slabd.db"
spool_dir = "{self.dir}/spool"
spool_budget_gb = 3
[recipes]
dir = "{ROOT}/recipes"
[cell]
T_base_slab = [1800.0, 0.0, 300.0, 1.0, 0.0, 0.0, 0.0]
[calibration]
T_flange_scanner = [0.0, 80.0, 150.0, 1.0, 0.0, 0.0, 0.0]
station_sigma_mm = 0.02
station_sigma_deg = 0.001
[control]
socket = "{self.dir}/control.sock"
[scanner]
"""
        drop = 'drop_dir = "{dir}/drop"'
        self.config, self.peers_config = (self.write(name, common + table.replace("{dir}", self.dir) + "\n") for name, table
                                          in (("slabd.toml", scanner or drop), ("peers.toml", peers_scanner or drop)))
        if user is not None:
            shutil.chown(self.dir, user)
        if role == "rtu":
            self.cable()

    def write(self, name, text):
        path = os.path.join(self.dir, name)
        with open(path, "w", encoding="utf-8") as file:
            file.write(text)
        return path

    def cable(self):
        self.socat = subprocess.Popen(["socat"] + [f"pty,raw,echo=0,link={end}" for end in self.pty],
                                      stderr=subprocess.DEVNULL)
        wait_for(lambda: all(os.path.exists(end) for end in self.pty), 60, "socat")

    def start(self):
        with open(os.path.join(self.dir, "slabd.err"), "a", encoding="utf-8") as log:
            self.daemon = subprocess.Popen([f"{self.build}/daemon/slabd", "--config", self.config], stderr=log,
                                           user=self.user)
        wait_for(lambda: os.path.exists(f"{self.dir}/control.sock") and self.status() is not None, 60, "slabd")

    def stand_by(self, slabs, defects=()):
        command = [f"{self.build}/cli/slabctl", "simulate", "--config", self.peers_config, "--points", "quarter", "--stand-by",
                   "--move-s", "0.05", "--slabs", str(slabs)]
        for defect in defects:
            command += ["--defect", defect]
        if self.one_folder:
            wait_for(lambda: os.path.isdir(f"{self.dir}/drop/request"), 60, "the drop folder")
        self.peers = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)

    def order(self, text, expected):
        self.peers.stdin.write(text + "\n")
        self.peers.stdin.flush()
        answer = self.peers.stdout.readline().strip()
        assert answer == expected, f"{text}: {answer!r}"

    def slabctl_and_errors(self, *arguments):
        done = subprocess.run([f"{self.build}/cli/slabctl", *arguments], capture_output=True, text=True, check=False)
        return done.returncode, done.stdout, done.stderr

    def slabctl(self, *arguments):
        return self.slabctl_and_errors(*arguments)[:2]

    def status(self):
        """None if slabd has not answered ten times: next to other work slabctl may give up."""
        for _ in range(10):
            code, out = self.slabctl("status", "--socket", f"{self.dir}/control.sock", "--json")
            if code == 0:
                return json.loads(out)
            time.sleep(0.1)
        return None

    def log(self):
        with open(os.path.join(self.dir, "slabd.err"), encoding="utf-8") as file:
            return file.read()

    def kill(self):
        self.daemon.kill()
        self.daemon.wait()
        os.unlink(f"{self.dir}/control.sock")

    def close(self):
        for process in (self.peers, self.daemon, self.socat):
            if process is not None and process.poll() is None:
                process.send_signal(signal.SIGTERM)
                process.wait()
        shutil.rmtree(self.dir, ignore_errors=True)


def wait_for(done, seconds, what):
    end = time.monotonic() + seconds
    while not done():
        assert time.monotonic() < end, f"waited {seconds} s for {what}"
        time.sleep(0.02)


# ---- three ways to transfer the registers ------------------------------------------------------------------------


class MasterWire:
    """The PLC asks: Modbus/TCP client, or master of a serial line."""

    def __init__(self, make, unit):
        self.make, self.unit, self.client = make, unit, None

    def read(self):
        try:
            if self.client is None:
                self.client = self.make()
                if not self.client.connect():
                    raise ModbusException("no connection")
            answer = self.client.read_input_registers(0, 110, slave=self.unit)
            if answer.isError():
                raise ModbusException(str(answer))
            return list(answer.registers)
        except (ModbusException, OSError):
            self.drop()
            return None

    def write(self, first, values):
        try:
            if self.client is not None and self.client.write_registers(first, values, slave=self.unit).isError():
                self.drop()
        except (ModbusException, OSError):
            self.drop()

    def sync_last(self):
        for _ in range(100):
            if self.read() is not None:
                answer = self.client.read_holding_registers(3, 1, slave=self.unit)
                if not answer.isError():
                    return answer.registers[0]
            time.sleep(0.1)
        raise AssertionError("slabd does not answer")

    def drop(self):
        if self.client is not None:
            self.client.close()
        self.client = None

    close = drop


class MemoryWire:
    """slabd polls: the registers are in the PLC's own memory, served by pymodbus."""

    def __init__(self, port, sync_last=0, memory=None):
        self.memory = memory or ModbusSequentialDataBlock(0, [0] * 1200)
        self.sync = sync_last
        context = ModbusServerContext(slaves=ModbusSlaveContext(hr=self.memory, zero_mode=True), single=True)
        self.thread = threading.Thread(target=StartTcpServer, daemon=True,
                                       kwargs={"context": context, "address": ("127.0.0.1", port),
                                               "allow_reuse_address": True})
        self.thread.start()
        self.beat, self.beat_at = None, time.monotonic()

    def read(self):
        image = self.memory.getValues(1000, 110)
        if image[4] != self.beat:
            self.beat, self.beat_at = image[4], time.monotonic()
        return image if time.monotonic() - self.beat_at < 2.5 else None  # slabd's heartbeat is the link

    def write(self, first, values):
        self.memory.setValues(first, list(values))

    def sync_last(self):
        return self.sync

    def close(self):
        ServerStop()
        self.thread.join()


def wire_for(box, sync_last=0):
    if box.role == "client":
        return MemoryWire(box.port, sync_last)
    if box.role == "rtu":
        return MasterWire(lambda: ModbusSerialClient(box.pty[1], baudrate=115200, parity="N", timeout=1, retries=0), 17)
    return MasterWire(lambda: ModbusTcpClient("127.0.0.1", port=box.port, timeout=1, retries=0), 1)


# ---- the PLC ------------------------------------------------------------------------------------------------------


class Plc:
    """Cycles the function block; a program written as plain calls runs on top."""

    def __init__(self, wire, period=0.01, block=None):
        self.wire, self.period = wire, period
        self.block = block or Block(os.path.join(ROOT, "docs/plc/FB_SLABD.st"))
        self.inputs = {"uiSyncLast": wire.sync_last(), "xEnable": True, "xExecute": False, "xStored": False}
        self.stores = True  # False: shown results stay unread
        self.results = {}  # stored records by (slab, station, CMD_SEQ)
        self.cycles = 0
        self.longest_s = 0.0  # of a cycle

    def cycle(self):
        began = time.monotonic()
        self.cycle_once()
        self.longest_s = max(self.longest_s, time.monotonic() - began)

    def cycle_once(self):
        image = self.wire.read()
        fb = self.block
        if image is not None:
            self.inputs["IR"] = image
        fb(xLinkOk=image is not None, **self.inputs)
        self.inputs["xStored"] = False
        if fb.xWriteControl:
            self.wire.write(0, fb.HR[0:4])
        if fb.xWriteCommand:
            self.wire.write(10, fb.HR[10:40])
        if fb.xNewResult and self.stores:
            record = list(fb.awRecord)
            self.results[(record[4] << 16 | record[5], record[3], record[2])] = record
            self.inputs["xStored"] = True
        self.cycles += 1
        time.sleep(self.period)

    @contextlib.contextmanager
    def cycling(self):
        """The PLC goes on in a thread of its own during the block, as beside another program."""
        stop = threading.Event()

        def run():
            while not stop.is_set():
                self.cycle()

        thread = threading.Thread(target=run)
        thread.start()
        try:
            yield
        finally:
            stop.set()
            thread.join()

    def until(self, done, seconds, what):
        end = time.monotonic() + seconds
        while not done():
            assert time.monotonic() < end, f"waited {seconds} s for {what}; step {self.block.uiStep}, " \
                f"code {self.block.uiCode}, IR {self.block.IR[:30]}"
            self.cycle()

    def order(self, cmd, station=0, slab_no=0, slab_id=""):
        """Carries one order out; returns (0 or code, CMD_SEQ)."""
        fb = self.block
        self.until(lambda: fb.xReady, 60, "READY")
        text = slab_id.encode().ljust(32, b"\0")
        self.inputs.update(xExecute=True, uiCmd=cmd, uiStation=station, uiSlabType=5600, udSlabNo=slab_no,
                           awSlabId=[text[i] << 8 | text[i + 1] for i in range(0, 32, 2)])
        self.until(lambda: fb.xDone or fb.xError, 90, f"order {cmd}")
        code = 0 if fb.xDone else fb.uiCode or NO_ANSWER
        seq = fb.HR[39]
        self.inputs["xExecute"] = False
        self.cycle()
        return code, seq

    def is_open(self, slab_no):
        image = self.block.IR
        return bool(image[5] & 16) and image[14] << 16 | image[15] == slab_no

    def begin_or_end(self, cmd, slab_no, slab_id=""):
        """As order(), for SLAB_BEGIN and SLAB_END. An order without an answer, as next to other work, is given again if
        slabd has not carried it out."""
        for _ in range(4):
            self.longest_s = 0.0
            code, seq = self.order(cmd, slab_no=slab_no, slab_id=slab_id)
            if code != NO_ANSWER:
                break
            print(f"order {cmd} of slab {slab_no} had no answer; the longest cycle took {self.longest_s:.2f} s")
            assert self.longest_s > 0.3 or os.getloadavg()[0] > 2 * os.cpu_count(), \
                "an order without an answer on a free computer"
            self.until(lambda: self.block.xReady, 60, "READY")
            if self.is_open(slab_no) == (cmd == SLAB_BEGIN):
                return 0, seq
        return code, seq

    def begin(self, slab_no, slab_id):
        code, _ = self.begin_or_end(SLAB_BEGIN, slab_no, slab_id)
        assert code == 0, f"SLAB_BEGIN {slab_no}: code {code}"

    def end(self, slab_no):
        """Returns CMD_SEQ, by which the slab's record is found."""
        code, seq = self.begin_or_end(SLAB_END, slab_no)
        assert code == 0, f"SLAB_END {slab_no}: code {code}"
        return seq

    def scan(self, box, station, slab_no):
        box.order(f"station {station}", f"standing {station}")
        for _ in range(4):
            code, seq = self.order(SCAN, station, slab_no)
            if code == 0:
                return seq
        raise AssertionError(f"station {station}: code {code}")

    def slab(self, box, number, slab_no, continued=False):
        """One whole slab; returns its verdict."""
        box.order(f"slab {number}", f"slab {number}")
        if not continued:
            self.begin(slab_no, f"PY-{slab_no}")
        for station in range(1, STATIONS + 1):
            mask = self.block.IR[18] << 16 | self.block.IR[19]
            if not (continued and mask >> (station - 1) & 1):
                self.scan(box, station, slab_no)
        seq = self.end(slab_no)
        self.until(lambda: (slab_no, 0, seq) in self.results, 60, "the slab's record")
        record = self.results[(slab_no, 0, seq)]
        assert record[1] == 2 and record[0] == record[33], record
        self.until(lambda: self.block.IR[20] == 0, 30, "no record waiting")
        assert self.block.IR[106] == record[6], "the record and IR 106 agree"
        return record[6]

    def stations_stored(self, slab_no):
        return {key[1] for key in self.results if key[0] == slab_no and key[1] != 0}
