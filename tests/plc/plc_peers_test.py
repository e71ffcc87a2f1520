#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""slabd and an independent PLC in each of the three roles: whole slabs, power losses, attacks on the port.

  plc_peers_test.py --build build/release [--role server|client|rtu] [--slabs N] [--case slabs|losses|linkdown|attacks]
                    [--scl]

Figures go to stdout. Exit status 0: every promise held."""
import argparse
import json
import os
import resource
import socket
import statistics
import struct
import subprocess
import sys
import threading
import time

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
from line import FAIL, PASS, ROOT, SCAN, STATIONS, Box, Plc, wire_for  # noqa: E402
from scl_block import siemens  # noqa: E402
from st_block import Block  # noqa: E402


def say(text):
    print(text, flush=True)


def memory_kb(box):
    return box.status()["memory"]["rss_kb"]


# ---- whole slabs --------------------------------------------------------------------------------------------------


MOULD = 12


def block_of_map_1_0(box):
    """FB_SLABD.st as for map 1.0: it writes 0 to HR 34 and 35, which were reserved."""
    with open(os.path.join(ROOT, "docs/plc/FB_SLABD.st"), encoding="utf-8") as file:
        text = file.read()
    for line in ("HR[34] := uiMouldNow;", "HR[35] := uiSecondChipNow;"):
        assert line in text
        text = text.replace(line, "")
    path = os.path.join(box.dir, "FB_SLABD_1_0.st")
    with open(path, "w", encoding="utf-8") as file:
        file.write(text)
    return Block(path)


def slabs(box, count, block=None):
    box.start()
    box.stand_by(count)
    wire = wire_for(box)
    # With role "client" a PLC of map 1.0, with the others one of map 1.1.
    of_1_0 = box.role == "client"
    plc = Plc(wire, block=block_of_map_1_0(box) if of_1_0 else block)
    plc.inputs["uiMould"] = MOULD
    started = time.monotonic()
    memory = []
    for number in range(1, count + 1):
        verdict = plc.slab(box, number, 1000 + number)
        assert verdict == PASS, f"slab {number}: verdict {verdict}"
        assert plc.stations_stored(1000 + number) == set(range(1, STATIONS + 1))
        memory.append(memory_kb(box))
    took = time.monotonic() - started
    code, out = box.slabctl("history", "--config", box.config, "--json")
    assert code == 0, out
    moulds = [slab["mould"] for slab in json.loads(out)["slabs"]]
    assert moulds == [None if of_1_0 else MOULD] * count, moulds
    with plc.cycling():
        monitor(box)
        if box.role == "server":
            mbpoll(box)
        status = box.status()["links"]["plc"]
    assert status["alive"] and status["malformed"] == 0 and status["exceptions"] == 0, status
    assert max(memory) - memory[0] < 4096, f"memory grew: {memory}"
    say(f"{box.role}: {count} slabs passed in {took:.0f} s, {plc.cycles} PLC cycles, {status['frames']} frames, "
        f"memory after the first slab {memory[0]} kB, at most {max(memory)} kB, "
        f"daemon CPU {cpu_s(box.daemon.pid):.1f} s")
    wire.close()


def cpu_s(pid):
    with open(f"/proc/{pid}/stat", encoding="ascii") as file:
        fields = file.read().rsplit(")", 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def monitor(box):
    """slabctl plc monitor sees what the PLC sees, in words."""
    for _ in range(10):  # next to other work an answer may be later than the monitor waits
        code, out = box.slabctl("plc", "monitor", "--config", box.config, "--once", "--json")
        if code == 0:
            break
    assert code == 0, out
    seen = json.loads(out)
    assert seen["map_ok"] and seen["schema"] == "slabd.plc_monitor/1", seen
    words = {entry["name"]: entry["value"] for entry in seen["registers"]}
    assert words["SLAB_VERDICT"] == "1 pass" and words["PLC_LINK_OK"] == "1", words


def mbpoll(box):
    out = subprocess.run(["mbpoll", "-m", "tcp", "-a", "1", "-p", str(box.port), "-0", "-r", "0", "-c", "4", "-t", "3:hex", "-1",
                          "-o", "10", "127.0.0.1"], capture_output=True, text=True, check=True).stdout
    for word in ("0x534C", "0x0101", "0x1234", "0x5678"):
        assert word in out, out


# ---- losses -------------------------------------------------------------------------------------------------------


def losses(box):
    """Either side dies in the middle of a slab, and a connection is left half open; the line continues by the rules."""
    box.start()
    box.stand_by(2, ["slope=4:1/35"])
    wire = wire_for(box)
    plc = Plc(wire)
    box.order("slab 1", "slab 1")
    plc.begin(7, "LOSS")
    for station in range(1, 4):
        plc.scan(box, station, 7)

    # slabd dies during a scan: the PLC detects the silence, slabd returns with another session, and no command is
    # repeated.
    session = plc.block.IR[9]
    box.order("station 4", "standing 4")
    plc.inputs.update(xExecute=True, uiCmd=SCAN, uiStation=4)
    plc.until(lambda: plc.block.uiStep in (6, 7, 8), 60, "the SCAN to begin")
    box.kill()
    box.start()
    plc.until(lambda: plc.block.xDone or plc.block.xError, 60, "the order's end")
    plc.inputs["xExecute"] = False
    plc.cycle()
    plc.until(lambda: plc.block.xReady and plc.block.IR[9] != session, 60, "the next session")
    scanned = plc.block.IR[18] << 16 | plc.block.IR[19]
    assert scanned & 7 == 7, "what was acquired is still there"
    for station in (4, 5):
        if not scanned >> (station - 1) & 1:
            plc.scan(box, station, 7)

    # The PLC dies and loses its memory. A late frame from before is void, and the slab continues.
    session = plc.block.IR[9]
    last, old = plc.block.HR[3], list(plc.block.HR)
    wire.close()
    wire = wire_for(box, last)
    plc = Plc(wire)
    plc.until(lambda: plc.block.xReady and plc.block.IR[9] != session, 60, "the session of the new life")
    ack = plc.block.IR[10]
    old[39] = ack + 1
    wire.write(10, old[10:40])
    plc.until(lambda: plc.block.IR[26] == 102 and plc.block.IR[27] == ack + 1, 60, "the late frame to be refused")
    assert plc.block.IR[10] == ack, "and not carried out"

    if box.role == "server":  # half open: the old connection is silent and is never closed
        wire.client, abandoned = None, wire.client
        for _ in range(3):
            plc.cycle()
    if box.role == "rtu":  # the cable is pulled
        box.socat.terminate()
        box.socat.wait()
        for _ in range(10):
            plc.cycle()
        box.cable()
    verdict = plc.slab(box, 1, 7, continued=True)
    assert verdict == FAIL, f"the planted slope: verdict {verdict}"
    failed = {key[1] for key, record in plc.results.items() if key[1] != 0 and record[6] == FAIL}
    assert failed <= {4}, failed
    if box.role == "server":
        abandoned.close()
    say(f"{box.role}: slabd killed in a scan, PLC restarted, link broken: the slab went on and failed on block 4 alone, "
        f"{plc.block.IR[21]} refusals")
    wire.close()


def link_down(box):
    """The network goes down for five seconds in the middle of a slab. Needs a network namespace of its own:
    unshare -rn tests/plc/plc_peers_test.py --build build/release --case linkdown"""

    def ip(*words):
        subprocess.run(["ip", *words], check=True)

    def link_up():
        ip("link", "set", "lo", "up")
        ip("route", "replace", "239.255.0.0/16", "dev", "lo")

    assert not [line for line in open("/proc/net/route", encoding="ascii") if "00000000" in line.split()[1:2]], \
        "this would take a real network down: run it under unshare -rn"
    link_up()
    box.start()
    box.stand_by(1)
    wire = wire_for(box)
    plc = Plc(wire)
    box.order("slab 1", "slab 1")
    plc.begin(9, "LINK")
    for station in range(1, 4):
        plc.scan(box, station, 9)
    session = plc.block.IR[9]
    ip("link", "set", "lo", "down")
    down = time.monotonic()
    while time.monotonic() - down < 5:
        plc.cycle()
    link_up()
    begun = time.monotonic()
    plc.until(lambda: plc.block.xReady and plc.block.IR[9] != session, 60, "the line to resume")
    resumed = time.monotonic() - begun
    assert plc.slab(box, 1, 9, continued=True) == PASS
    say(f"{box.role}: link down for 5 s in a slab, resumed {resumed:.1f} s after it came back, the slab passed")
    wire.close()


# ---- attacks ------------------------------------------------------------------------------------------------------

READ = struct.pack(">HHHBBHH", 1, 0, 6, 1, 4, 0, 110)
# A slow answer is in the median. Only a connection that slabd has closed or forgotten counts as dropped.
ANSWER_S = 30


class Attack(threading.Thread):
    def __init__(self, port):
        super().__init__(daemon=True)
        self.port, self.stop, self.count = port, threading.Event(), 0

    def connect(self):
        return socket.create_connection(("127.0.0.1", self.port), 2)

    def run(self):
        while not self.stop.is_set():
            self.count += 1
            try:
                self.once()
            except OSError:
                pass  # disconnected: retry


class WrongLength(Attack):
    def once(self):
        with self.connect() as s:
            s.sendall(READ[:4] + struct.pack(">H", 10) + READ[6:] + READ)
            s.settimeout(0.5)
            while s.recv(4096):
                pass


class WrongProtocol(Attack):
    def once(self):
        with self.connect() as s:
            s.sendall(READ[:2] + b"\0\7" + READ[4:])
            s.settimeout(0.5)
            s.recv(16)


class Drip(Attack):
    def once(self):
        with self.connect() as s:
            for byte in READ:
                s.sendall(bytes([byte]))
                if self.stop.wait(0.2):
                    return


class Pipeline(Attack):
    def once(self):
        with self.connect() as s:
            s.settimeout(2)
            for _ in range(20):
                s.sendall(READ * 50)
                left = 50 * 229
                while left > 0:
                    got = len(s.recv(min(65536, left)))
                    if got == 0:
                        return
                    left -= got


class IllegalFunctions(Attack):
    def once(self):
        with self.connect() as s:
            s.settimeout(1)
            for function in (7, 17, 43, 1, 8, 90):
                s.sendall(struct.pack(">HHHBB", 3, 0, 2, 1, function))
                s.recv(64)


class Flood(Attack):
    """A thousand at once, all of them from an allowed address."""

    def once(self):
        sockets = []
        for _ in range(1000):
            s = socket.socket()
            s.setblocking(False)
            s.connect_ex(("127.0.0.1", self.port))
            sockets.append(s)
        self.stop.wait(0.2)
        for s in sockets:
            s.close()


def latencies(port, seconds, answers=400):
    """Round trips of one well-behaved client, in ms; a dropped connection is opened again and counted."""
    times, drops = [], 0
    client = socket.create_connection(("127.0.0.1", port), ANSWER_S)
    end = time.monotonic() + seconds
    while time.monotonic() < end and len(times) < answers:
        try:
            begun = time.perf_counter()
            client.sendall(READ)
            got = 0
            while got < 229:
                piece = len(client.recv(4096))
                if piece == 0:
                    raise OSError
                got += piece
            times.append((time.perf_counter() - begun) * 1000)
        except OSError:
            drops += 1
            client = socket.create_connection(("127.0.0.1", port), ANSWER_S)
        time.sleep(0.01)
    client.close()
    return times, drops


def attacks(box, seconds):
    box.start()
    # 1,000 sockets here; the daemon itself never has more than 8 of them open.
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (max(soft, min(4096, hard)), hard))
    quiet, _ = latencies(box.port, seconds)
    before_kb = memory_kb(box)  # the buffers are resident by now
    say(f"quiet: median {statistics.median(quiet):.2f} ms, worst {max(quiet):.2f} ms")
    worst = 0.0
    for kind in (WrongLength, WrongProtocol, Drip, Pipeline, IllegalFunctions, Flood):
        attack = kind(box.port)
        attack.start()
        times, drops = latencies(box.port, seconds)
        attack.stop.set()
        attack.join(10)
        added = statistics.median(times) - statistics.median(quiet)
        worst = max(worst, added)
        say(f"{kind.__name__}: {attack.count} times; median +{added:.2f} ms, worst {max(times):.2f} ms, {drops} dropped")
        assert added < 10, f"{kind.__name__} costs other clients {added:.1f} ms"
        assert drops == 0, f"{kind.__name__} pushed a client that speaks off the line"
        assert max(times) < 10_000, f"{kind.__name__} starved a client for {max(times) / 1000:.1f} s"
    after_kb = memory_kb(box)
    link = box.status()["links"]["plc"]
    notes = box.log().count("PLC link:")
    say(f"memory {before_kb} kB before, {after_kb} kB after; {link['malformed']} malformed, {link['late']} late, "
        f"{link['displaced']} displaced, {link['exceptions']} refused; {notes} lines in the log")
    assert after_kb - before_kb < 2048, "memory grew"
    assert link["malformed"] > 0 and link["displaced"] > 0 and link["exceptions"] > 0, link
    assert box.daemon.poll() is None


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--build", required=True)
    parser.add_argument("--role", choices=("server", "client", "rtu"), default="server")
    parser.add_argument("--case", choices=("slabs", "losses", "linkdown", "attacks"), default="slabs")
    parser.add_argument("--slabs", type=int, default=2)
    parser.add_argument("--seconds", type=float, default=2.0, help="of each attack")
    parser.add_argument("--scl", action="store_true", help="slabs: with the function block of docs/plc/siemens")
    options = parser.parse_args()
    box = Box(os.path.abspath(options.build), options.role)
    try:
        if options.case == "slabs":
            slabs(box, options.slabs, siemens().instance("FB_SLABD") if options.scl else None)
        elif options.case == "losses":
            losses(box)
        elif options.case == "linkdown":
            link_down(box)
        else:
            attacks(box, options.seconds)
    except BaseException:
        sys.stderr.write(box.log()[-6000:])
        raise
    finally:
        box.close()


if __name__ == "__main__":
    main()
