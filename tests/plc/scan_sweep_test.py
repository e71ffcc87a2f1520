#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""Every fault of the scanner's side at every step of a slab, on a real line.

Between slabd and the emulated scanner sits one that misbehaves: it passes requests on, takes the scans, and delivers
them as the case requires. Every third block has its slope planted, and whatever it delivers that is not the answer shows a
block of the other kind: a verdict taken from the wrong scan shows. A case must give the code its row of the table
allows, and whatever happened, the same SCAN given again must then work, and the slab end with the planted verdicts.

  scan_sweep_test.py --build build/release --backend drop|tcp [--quick]

Exit status 0: every promise held."""
import argparse
import os
import shutil
import subprocess
import sys
import time

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
from line import FAIL, PASS, SCAN, SLAB_ABORT, STATIONS, Box, Plc, own_port, wait_for, wire_for  # noqa: E402
from scan_faults import BEFORE, BEGIN, END, MEASURING, DropScanner, StreamScanner, file_cases, stream_cases  # noqa: E402

NOT_MEASURED = 3
NO_POSES = (202, 203)  # the robot's poses came late, next to other work: the fault has not been tried
NOBODY = 65534
BAD_BLOCKS = range(3, STATIONS + 1, 3)


def spoiled(scan):
    """The same block in other bytes, so that the points do not identify the scan."""
    data = bytearray(scan)
    for i in range(len(data) - 4 * (len(data) // 8), len(data) - 4, 3988):
        data[i] ^= 1
    return bytes(data)


class Sweep:
    def __init__(self, box, scanner):
        self.box, self.scanner = box, scanner
        self.plc = Plc(wire_for(box), period=0.005)
        self.good = self.bad = b""
        self.done, self.repeats, self.number = 0, 0, 0

    def arm(self, case, step, station):
        s = self.scanner
        s.poison = self.good if station in BAD_BLOCKS else self.bad
        image = self.plc.block.IR
        s.next_name = f"{image[9]}-{self.plc.block.HR[39] % 65535 + 1}"
        s.case, s.step = case, step
        if step in (BEGIN, BEFORE, MEASURING, END) and case.do:
            case.do(s)

    def disarm(self, case):
        self.scanner.case = self.scanner.step = None
        if case.heal:
            case.heal(self.scanner)
            time.sleep(0.1)

    def until_scanned(self, station, slab_no):
        for _ in range(5):
            code, _ = self.plc.order(SCAN, station, slab_no)
            if code == 0:
                return
            self.repeats += 1
            time.sleep(0.3)
        raise AssertionError(f"station {station}: code {code} although nothing is wrong any more")

    def check(self, case, step, code):
        assert code in case.codes[step], f"{case.name}, {step}: code {code}, allowed {case.codes[step]}"
        self.done += 1

    def scan(self, station, slab_no, case=None, step=None):
        self.box.order(f"station {station}", f"standing {station}")
        if case is None:
            return self.until_scanned(station, slab_no)
        if step == MEASURING:
            self.until_scanned(station, slab_no)
            self.arm(case, step, station)
            self.plc.until(lambda: any(key[:2] == (slab_no, station) for key in self.plc.results), 60, "the record")
            self.disarm(case)
            return self.check(case, step, 0)
        before = self.strays() if case.refused else 0
        for _ in range(4):
            self.arm(case, step, station)
            code, _ = self.plc.order(SCAN, station, slab_no)
            self.disarm(case)
            if code not in NO_POSES:
                break
        self.check(case, step, code)
        assert not case.refused or self.strays() > before, f"{case.name}: nothing was refused"
        if code != 0:
            self.until_scanned(station, slab_no)

    def strays(self):
        return self.box.status()["links"]["scanner"]["strays"]

    def begin(self, slab_no):
        self.number += 1
        self.box.order(f"slab {self.number}", f"slab {self.number}")  # a separate scan each time
        self.plc.begin(slab_no, f"SC-{slab_no}")

    def end(self, slab_no):
        seq = self.plc.end(slab_no)
        self.plc.until(lambda: (slab_no, 0, seq) in self.plc.results, 60, "the slab's record")
        return self.plc.results[(slab_no, 0, seq)][6]

    def fetch_poison(self):
        """One scan of each kind, spoiled, for whatever is delivered and is not an answer."""
        self.begin(900)
        for station, name in ((1, "good"), (BAD_BLOCKS[0], "bad")):
            self.scan(station, 900)
            setattr(self, name, spoiled(self.scanner.last))
        code, _ = self.plc.order(SLAB_ABORT, slab_no=900)
        assert code == 0, code

    def slab(self, slab_no, plans):
        """A whole slab, a case a station."""
        self.begin(slab_no)
        for station in range(1, STATIONS + 1):
            self.scan(station, slab_no, *(plans[station - 1] if station <= len(plans) else ()))
        verdict = self.end(slab_no)
        records = {}
        for key, record in self.plc.results.items():
            if key[0] == slab_no and key[1] != 0 and key[2] >= records.get(key[1], (0,))[0]:
                records[key[1]] = (key[2], record[6])
        wrong = {s: v for s, (_, v) in records.items() if v in (PASS, FAIL) and (v == FAIL) != (s in BAD_BLOCKS)}
        assert not wrong and len(records) == STATIONS, f"verdicts {wrong} of {sorted(records)}"
        last = {s: v for s, (_, v) in records.items()}
        assert all(v == (FAIL if s in BAD_BLOCKS else PASS) for s, v in last.items()), f"final verdicts {last}"
        assert verdict == FAIL, f"slab verdict {verdict}"

    def short_slab(self, slab_no, case, step):
        """A fault around SLAB_BEGIN or SLAB_END, one block between them."""
        if step == BEGIN:
            self.arm(case, step, 1)
        self.begin(slab_no)
        if step == BEGIN:
            self.disarm(case)
        self.scan(1, slab_no)
        if step == END:
            self.arm(case, step, 1)
        verdict = self.end(slab_no)
        if step == END:
            self.disarm(case)
        assert verdict == NOT_MEASURED, f"{case.name}, {step}: verdict {verdict} of a slab with one block"
        block = [r[6] for key, r in self.plc.results.items() if key[:2] == (slab_no, 1)]
        assert block[-1] == PASS, f"{case.name}, {step}: block verdicts {block}"
        self.done += 1


def spread(plans, count):
    """So many of all, evenly."""
    return [plans[i * len(plans) // count] for i in range(count)] if len(plans) > count else plans


def run(options, small_disk):
    root = os.geteuid() == 0
    listen = own_port()
    extra = {}
    if options.backend == "tcp":
        slabd = own_port()
        common = 'backend = "tcp"\nlisten = "127.0.0.1:{}"\nallow = ["127.0.0.1", "127.0.0.2"]\n'
        extra = {"scanner": common.format(slabd) + "timeout_s = 8", "peers_scanner": common.format(listen)}
    else:
        extra = {"scanner": 'drop_dir = "{dir}/drop"\ntimeout_s = 10', "peers_scanner": 'drop_dir = "{dir}/sim"'}
    box = Box(os.path.abspath(options.build), "server", user=NOBODY if root else None, **extra)
    mounted = False
    try:
        for name in ("drop", "sim", "sim/request", "sim/inbox"):
            os.mkdir(os.path.join(box.dir, name))
        if small_disk:
            subprocess.run(["mount", "-t", "tmpfs", "-o", "size=120m", "tmpfs", f"{box.dir}/drop"], check=True)
            mounted = True
        if root:
            os.chmod(box.dir, 0o755)
            shutil.chown(f"{box.dir}/drop", NOBODY)
        box.start()
        scanner = StreamScanner(box, listen, slabd) if options.backend == "tcp" else DropScanner(box)
        scanner.start()
        box.stand_by(100, [f"slope={k}:1/35" for k in BAD_BLOCKS])
        sweep = Sweep(box, scanner)
        sweep.fetch_poison()
        cases = stream_cases() if options.backend == "tcp" else file_cases(root, small_disk)
        if small_disk:
            cases = [case for case in cases if case.name == "a full disk"]
        plans = [(case, step) for case in cases for step in case.codes if step not in (BEGIN, END)]
        ends = [(case, step) for case in cases for step in case.codes if step in (BEGIN, END)]
        if options.quick:
            plans, ends = spread(plans, STATIONS), spread(ends, 2)
        slab_no = 100
        for case, step in ends:
            slab_no += 1
            sweep.short_slab(slab_no, case, step)
        while plans:
            slab_no += 1
            sweep.slab(slab_no, plans[:STATIONS])
            plans = plans[STATIONS:]
        assert scanner.error is None, scanner.error
        wait_for(lambda: box.status() is not None, 60, "slabd")
        print(f"{options.backend}{', a disk of its own' if small_disk else ''}: {sweep.done} faults, {slab_no - 100} slabs, "
              f"{sweep.repeats} further repeats, every code as allowed, every verdict as planted", flush=True)
        scanner.stop = True
        sweep.plc.wire.close()
    except BaseException:
        print(box.log()[-6000:], file=sys.stderr)
        raise
    finally:
        if mounted:
            subprocess.run(["umount", "-l", f"{box.dir}/drop"], check=False)
        box.close()


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--build", required=True)
    parser.add_argument("--backend", choices=("drop", "tcp"), required=True)
    parser.add_argument("--quick", action="store_true", help="one slab, cases spread over the table")
    parser.add_argument("--full-disk", action="store_true", help="only what a drop folder on a full disk does")
    options = parser.parse_args()
    if not options.full_disk:
        run(options, False)
    if options.backend == "drop" and not options.quick:
        if os.geteuid() == 0:
            run(options, True)
        else:
            print("not tried: a full disk (mounting one needs root), no permission", flush=True)


if __name__ == "__main__":
    main()
