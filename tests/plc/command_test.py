#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""A slab by hand, `slabctl plc command`, with a real slabd in each of the three roles; and what it refuses.

  command_test.py --build build/release [--role server|client|rtu]"""
import argparse
import os
import sys

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
from line import Box, Plc, wait_for, wire_for  # noqa: E402


LINE = """[line]
id_pattern = '(?:(?:HAND|PLC)-[0-9]+(?:-M[0-9]+)?)?'
mould_from_id = '-M([0-9]+)$'
"""


def ask(box, status, *words):
    """The output of one command by hand, which must end with this exit status."""
    device = ["--device", box.pty[1]] if box.role == "rtu" else []
    code, out, err = box.slabctl_and_errors("plc", "command", *words, "--config", box.config, *device)
    assert code == status, f"{words}: exit status {code}, expected {status}\n{out}{err}"
    return out + err


def by_hand(box):
    assert "no slab is open" in ask(box, 6, "SCAN", "3")
    assert "only SCAN has a station" in ask(box, 2, "SLAB_END", "3")
    assert "SCAN needs the station" in ask(box, 2, "SCAN")
    assert "needs --slab-no and --slab-type" in ask(box, 2, "SLAB_BEGIN")
    assert "106: " in ask(box, 6, "SLAB_BEGIN", "--slab-no", "7", "--slab-type", "99"), "slabd's refusal is shown"

    begin = ("--slab-no", "7", "--slab-type", "5600", "--slab-id")
    assert "108: " in ask(box, 6, "SLAB_BEGIN", *begin, "HAND-X"), "[line] id_pattern"
    assert "113: " in ask(box, 6, "SLAB_BEGIN", *begin, "HAND-7-M12", "--mould", "13"), "[line] mould_from_id"
    assert "108: " in ask(box, 6, "SLAB_BEGIN", *begin, "HAND-7-M12", "--second-chip", "HAND-8-M12")
    begun = ask(box, 0, "slab-begin", *begin, "HAND-7-M12", "--second-chip", "HAND-7-M12")
    assert "slab 7 is open, type 5600" in begun, begun
    assert box.status()["slab"]["mould"] == 12, box.status()["slab"]
    assert "slab 7 is open; end it first" in ask(box, 6, "SLAB_BEGIN", "--slab-no", "8", "--slab-type", "5600")
    box.order("station 3", "standing 3")
    scanned = ask(box, 0, "scan", "3")
    assert "ACQUIRED after" in scanned and "slab 7 block 3: pass" in scanned, scanned
    box.order("station 4", "standing 4")
    assert "slab 7 block 5: " not in ask(box, 6, "SCAN", "5"), "the robot is over another block"
    ended = ask(box, 1, "SLAB_END")
    assert "slab 7: not measured" in ended, ended

    ask(box, 0, "SLAB_BEGIN", "--slab-no", "8", "--slab-type", "5600")
    aborted = ask(box, 0, "SLAB_ABORT")
    assert "slab 8: aborted" in aborted, aborted
    assert box.status()["slab"] is None


def with_a_plc(box):
    """A PLC that commands keeps the line, and its results stay its own."""
    plc = Plc(wire_for(box))
    plc.begin(9, "PLC-9")
    with plc.cycling():
        assert "a PLC commands" in ask(box, 6, "SCAN", "3")
    # The PLC scans and goes before it has stored the result.
    plc.stores = False
    plc.scan(box, 3, 9)
    plc.wire.close()
    wait_for(lambda: box.status()["results_pending"] > 0, 60, "the result")
    assert "a result waits for the PLC" in ask(box, 6, "SLAB_END")
    assert box.status()["results_pending"] > 0
    taken = ask(box, 1, "SLAB_END", "--take-results")
    assert "slab 9 block 3: pass" in taken and "slab 9: not measured" in taken, taken


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--build", required=True)
    parser.add_argument("--role", default="server")
    options = parser.parse_args()
    box = Box(os.path.abspath(options.build), options.role)
    with open(box.config, "a", encoding="utf-8") as config:
        config.write(LINE)
    try:
        box.start()
        box.stand_by(1)
        box.order("slab 1", "slab 1")
        by_hand(box)
        if options.role == "server":
            with_a_plc(box)
    except BaseException:
        print(box.log()[-4000:], file=sys.stderr)
        raise
    finally:
        box.close()


if __name__ == "__main__":
    main()
