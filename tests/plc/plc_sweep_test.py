#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""Every moment of the handshake times everything that can happen to it, on a real line.

Moments: an order prepared, written, accepted, being carried out, acquired; its record shown, stored, acknowledged. At
each of them the PLC loses its memory, slabd is killed and started again, or the link is silent for three seconds with
the old connection left half open. What the PLC does afterwards is exactly what docs/PLC.md requires: wait for
READY, read STATION_MASK, and give the order again where the station is missing. No operator.

Two slabs are driven through all of it. The emulated slab has its slope planted on block 4: a scan taken for another
station, taken twice or lost would show in the verdicts.

  plc_sweep_test.py --build build/release [--role server|client|rtu] [--fault plc|slabd|link]

Exit status 0: every promise held."""
import argparse
import os
import sys
import time

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
from line import FAIL, PASS, SCAN, SLAB_BEGIN, SLAB_END, STATIONS, Box, MemoryWire, Plc, wire_for  # noqa: E402

ACCEPTED, ACQUIRING, ACQUIRED, DONE = 1, 2, 3, 4
SCAN_MOMENTS = ("prepared", "written", "accepted", "acquiring", "acquired", "shown", "stored", "acknowledged")
SLAB_MOMENTS = ("prepared", "written", "accepted", "done")
FAULTS = ("plc", "slabd", "link")
BAD_BLOCK = 4
SILENCE_S = 3.0
GIVEN_UP = 405  # slabd ended while it measured: scan the station again
# The next status also counts if a status is gone before the PLC read it.
MAY_BE_MEASURING = ("accepted", "acquiring", "acquired")


class Moment(Exception):
    """The moment that was waited for is now."""


class Watched(Plc):
    """The PLC's cycle with a trap in it. What is stored survives its death; the block's variables do not."""

    def __init__(self, wire, stored):
        super().__init__(wire, period=0.005)
        self.results = stored
        self.trap = None
        self.trap_order = None  # (cmd, station) of the trap

    def cycle(self):
        image = self.wire.read()
        fb = self.block
        if image is not None:
            self.inputs["IR"] = image
        fb(xLinkOk=image is not None, **self.inputs)
        self.inputs["xStored"] = False
        if fb.xWriteCommand:
            self.spring("prepared")
        if fb.xWriteControl:
            self.wire.write(0, fb.HR[0:4])
        if fb.xWriteCommand:
            self.wire.write(10, fb.HR[10:40])
            self.spring("written")
        if image is not None and image[10] == fb.HR[39] and fb.HR[39] != 0 and fb.HR[38] == image[9]:
            for status, moment in ((ACCEPTED, "accepted"), (ACQUIRING, "acquiring"), (ACQUIRED, "acquired"),
                                   (DONE, "done")):
                # A status may be gone before it was read; then the next one counts.
                if status <= image[11] <= DONE:
                    self.spring(moment)
        if fb.xNewResult:
            record = list(fb.awRecord)
            key = (record[4] << 16 | record[5], record[3], record[2])
            self.spring("shown", record[3])
            known = self.results.setdefault(key, record)
            assert known[6] == record[6] and known[7] == record[7], f"a record changed: {known} {record}"
            self.spring("stored", record[3])
            self.inputs["xStored"] = True
        elif fb.xWriteControl and fb.HR[2] != 0:
            self.spring("acknowledged", fb.awRecord[3])
        self.cycles += 1
        time.sleep(self.period)

    def spring(self, moment, station=None):
        if self.trap != moment:
            return
        cmd, wanted = self.trap_order
        fb = self.block
        if station is not None:
            if station != wanted:
                return
        elif fb.HR[10] != cmd or fb.HR[11] != wanted:
            return
        self.trap = None
        raise Moment()


class Line:
    def __init__(self, box):
        self.box = box
        self.stored = {}
        self.wire = wire_for(box)
        self.plc = Watched(self.wire, self.stored)
        self.faults = 0

    # ---- faults

    def plc_dies(self):
        last = self.plc.block.HR[3]
        self.wire.close()
        self.wire = wire_for(self.box, last)
        self.plc = Watched(self.wire, self.stored)

    def slabd_dies(self):
        self.box.kill()
        self.box.start()

    def link_breaks(self):
        role, wire = self.box.role, self.wire
        end = time.monotonic() + SILENCE_S
        abandoned = None
        if role == "server":  # half open: not closed, but silent
            abandoned, wire.client = wire.client, None
            make, wire.make = wire.make, self.no_connection
        elif role == "client":
            memory = wire.memory
            wire.close()
            wire.read = lambda: None
        else:
            self.box.socat.terminate()
            self.box.socat.wait()
        while time.monotonic() < end:
            self.plc.cycle()
        if role == "server":
            wire.make = make
        elif role == "client":
            self.wire = self.plc.wire = MemoryWire(self.box.port, memory=memory)
        else:
            self.box.cable()
        return abandoned

    @staticmethod
    def no_connection():
        raise OSError("the cable is out")

    def happen(self, fault):
        self.faults += 1
        return {"plc": self.plc_dies, "slabd": self.slabd_dies, "link": self.link_breaks}[fault]()

    # ---- reactions of the PLC's program

    def ready(self):
        self.plc.inputs["xExecute"] = False
        self.plc.cycle()
        self.plc.until(lambda: self.plc.block.xReady, 60, "READY")

    def scanned(self, station):
        image = self.plc.block.IR
        return bool((image[18] << 16 | image[19]) >> (station - 1) & 1)

    def attempt(self, cmd, station, slab_no):
        fb = self.plc.block
        text = f"SW-{slab_no}".encode().ljust(32, b"\0")
        self.plc.inputs.update(xExecute=True, uiCmd=cmd, uiStation=station, uiSlabType=5600, udSlabNo=slab_no,
                               awSlabId=[text[i] << 8 | text[i + 1] for i in range(0, 32, 2)])
        self.plc.until(lambda: fb.xDone or fb.xError, 90, f"order {cmd} of station {station}")

    def carry_out(self, cmd, station, slab_no, finished, moment=None, fault=None):
        """Gives the order until what it is for is so; on the way the fault happens once, at its moment."""
        if moment is not None:
            self.plc.trap, self.plc.trap_order = moment, (cmd, station)
        for _ in range(6):
            try:
                self.ready()
                if finished():
                    break
                self.attempt(cmd, station, slab_no)
            except Moment:
                self.happen(fault)
        else:
            raise AssertionError(f"order {cmd} of station {station} was never carried out: {self.plc.block.IR[:30]}")
        if self.plc.trap is not None:  # the record comes when the robot is on its way
            try:
                self.plc.until(lambda: False, 60, "the record")
            except Moment:
                self.happen(fault)
                self.ready()
        assert self.plc.trap is None, f"station {station}: the moment \"{moment}\" never came"

    def record_of_slab(self, slab_no):
        return next((record for key, record in self.stored.items() if key[0] == slab_no and key[1] == 0), None)

    def scan_again_if_given_up(self, station, slab_no, moment, fault):
        """Measuring takes milliseconds, next to other work longer: slabd may have been killed in the middle of it. Not by
        another fault, nor before there was a scan, nor when the record had been shown."""
        def last():
            return next((r for key, r in reversed(self.stored.items()) if key[:2] == (slab_no, station)), None)
        self.plc.until(lambda: last() is not None, 60, f"the record of station {station}")
        before = last()
        if before[7] == GIVEN_UP:
            assert fault == "slabd" and moment in MAY_BE_MEASURING, f"station {station}: given up by {fault}, {moment}"
            self.ready()
            self.attempt(SCAN, station, slab_no)
            self.plc.until(lambda: last() is not before, 60, f"another record of station {station}")

    def slab(self, number, faults):
        slab_no = 100 + number
        plans = [(m, f) for f in faults for m in SCAN_MOMENTS]
        opened = lambda: bool(self.plc.block.IR[5] & 16) and self.plc.block.IR[15] == slab_no  # noqa: E731
        self.box.order(f"slab {number}", f"slab {number}")
        begin = SLAB_MOMENTS[(number - 1) % len(SLAB_MOMENTS)]
        self.carry_out(SLAB_BEGIN, 0, slab_no, opened, begin, faults[0])
        for station in range(1, STATIONS + 1):
            self.box.order(f"station {station}", f"standing {station}")
            moment, fault = plans[(station - 1) % len(plans)]
            self.carry_out(SCAN, station, slab_no, lambda s=station: self.scanned(s), moment, fault)
            self.scan_again_if_given_up(station, slab_no, moment, fault)
        end = SLAB_MOMENTS[number % len(SLAB_MOMENTS)]
        self.carry_out(SLAB_END, 0, slab_no, lambda: not opened(), end, faults[-1])
        self.plc.until(lambda: self.record_of_slab(slab_no) is not None and self.plc.block.IR[20] == 0, 60,
                       "the slab's record")
        assert self.record_of_slab(slab_no)[6] == FAIL == self.plc.block.IR[106], "the planted slope"
        records = {key[1]: record[6] for key, record in self.stored.items() if key[0] == slab_no and key[1] != 0}
        assert set(records) == set(range(1, STATIONS + 1)), f"records of {sorted(records)}"
        wrong = {s: v for s, v in records.items() if (v == PASS) == (s == BAD_BLOCK)}
        assert not wrong, f"verdicts {wrong}"
        attempts = [self.plc.block.IR[68 + 2 * s] & 255 for s in range(1, STATIONS + 1)]
        return attempts


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--build", required=True)
    parser.add_argument("--role", choices=("server", "client", "rtu"), default="server")
    parser.add_argument("--fault", choices=FAULTS, action="append", help="only this; default: each in a slab of its own")
    options = parser.parse_args()
    faults = options.fault or FAULTS
    box = Box(os.path.abspath(options.build), options.role)
    try:
        box.start()
        box.stand_by(len(faults), [f"slope={BAD_BLOCK}:1/35"])
        line = Line(box)
        for number, fault in enumerate(faults, 1):
            before = line.faults
            attempts = line.slab(number, (fault,))
            print(f"{options.role}, {fault}: {line.faults - before} times, scans given a second time: "
                  f"{sum(a > 1 for a in attempts)}, verdicts as planted", flush=True)
        line.wire.close()
    except BaseException:
        print(box.log()[-6000:], file=sys.stderr)
        raise
    finally:
        box.close()


if __name__ == "__main__":
    main()
