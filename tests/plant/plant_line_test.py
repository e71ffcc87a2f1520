#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""The whole line with slabd-plant beside it: slabs are measured while the parts are killed, and all arrives.

  plant_line_test.py BUILD     BUILD: folder with daemon/slabd, cli/slabctl and plant/slabd-plant

Exit status 77 (skipped) if no PostgreSQL server is installed.
"""
import json
import os
import pathlib
import random
import shutil
import signal
import sqlite3
import subprocess
import sys
import tempfile
import time
import unittest

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))
from server import Server  # noqa: E402

SOURCE = pathlib.Path(__file__).resolve().parents[2]
BUILD = pathlib.Path(sys.argv.pop(1)).resolve()
PATIENCE_S = 1200


class PlantOnALine(unittest.TestCase):
    def setUp(self):
        self.server = Server()
        self.addCleanup(self.server.close)
        self.folder = pathlib.Path(tempfile.mkdtemp(prefix="slabd-line-"))
        self.addCleanup(shutil.rmtree, self.folder, True)
        self.config = self.folder / "slabd.toml"
        # script/emulated-line writes the configuration and starts this instead of slabd.
        self.starter = self.folder / "start"
        self.starter.write_text(f'#!/bin/sh\ncat >>"$2" <<END\n[plant]\ndsn = "{self.server.dsn()}"\nline = "hall-1"\n'
                                f'alarm_h = 0.1\nEND\nexec {BUILD}/daemon/slabd "$@"\n')
        self.starter.chmod(0o755)
        shell = (f'. script/emulated-line; start_line {self.folder} {self.starter} {BUILD}/cli/slabctl; '
                 'echo "$line_daemon"; trap - EXIT; read -r _')
        self.shell = subprocess.Popen(["bash", "-c", shell], cwd=SOURCE, stdin=subprocess.PIPE, stdout=subprocess.PIPE,
                                      text=True, start_new_session=True)
        self.daemon = int(self.shell.stdout.readline())
        self.addCleanup(self.stop)
        self.sender = None
        subprocess.run([BUILD / "plant/slabd-plant", "--config", self.config, "--init"], check=True,
                       stdout=subprocess.DEVNULL)
        self.slab_no = 0

    def stop(self):
        for pid in (self.daemon, self.sender.pid if self.sender else 0):
            if pid:
                try:
                    os.kill(pid, signal.SIGKILL)
                except ProcessLookupError:
                    pass
        os.killpg(self.shell.pid, signal.SIGKILL)
        self.shell.communicate()

    def start_daemon(self):
        with open(self.folder / "slabd.log", "a") as log:
            process = subprocess.Popen([BUILD / "daemon/slabd", "--config", self.config], stderr=log)
        self.daemon = process.pid
        self.until(lambda: self.status().get("state", "recover") not in ("init", "recover"), "the database is open")
        return process

    def start_sender(self):
        self.sender = subprocess.Popen([BUILD / "plant/slabd-plant", "--config", self.config],
                                       stderr=subprocess.DEVNULL)

    def slabctl(self, *arguments, status=(0,)):
        done = subprocess.run([BUILD / "cli/slabctl", *arguments, "--config", self.config], capture_output=True,
                              text=True)
        self.assertIn(done.returncode, status, done.stdout + done.stderr)
        return done.stdout

    def answer(self, *arguments):
        """Empty if slabd has not answered in time."""
        try:
            return self.slabctl(*arguments)
        except AssertionError:
            return ""

    def status(self):
        return json.loads(self.answer("status", "--json") or "{}")

    def plant(self):
        return self.status().get("plant") or {}

    def simulate(self, *more):
        self.slab_no += 1
        return subprocess.Popen(
            [BUILD / "cli/slabctl", "simulate", "--config", self.config, "--points", "quarter", "--slab-no",
             str(self.slab_no), "--slab-id", f"PLANT-{self.slab_no}", "--seed", str(self.slab_no), *more],
            stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)

    def until(self, condition, what):
        begun = time.monotonic()
        while time.monotonic() - begun < PATIENCE_S:
            value = condition()
            if value:
                return value
            time.sleep(0.2)
        self.fail(f"not within {PATIENCE_S} s: {what}\n" + (self.folder / "slabd.log").read_text()[-2000:])
        return None

    def outbox(self):
        with sqlite3.connect(f"file:{self.folder}/slabd.db?mode=ro", uri=True) as db:
            return {tuple(row) for row in db.execute(
                "SELECT uuid, seq FROM outbox JOIN epoch ON epoch.n = outbox.epoch").fetchall()}

    def inbox(self):
        return {(epoch, int(seq)) for epoch, seq in
                self.server.run("SELECT replace(epoch::text, '-', ''), seq FROM plant.inbox")}

    def test_slabs_arrive_while_parts_are_killed(self):
        chance = random.Random(3)
        # 1. A slab is measured without a sender: it waits in the outbox, and status and metrics say so.
        slab = self.simulate()
        self.assertLessEqual(slab.wait(PATIENCE_S), 1)

        def backlog():
            plant = self.plant()
            return plant if plant.get("unsent", 0) > 0 else None

        plant = self.until(backlog, "the backlog is shown")
        self.assertEqual((plant["line"], plant["late"]), ("hall-1", False))
        self.until(lambda: "slabd_plant_unsent " in self.answer("metrics"), "the backlog is a metric")
        # 2. The sender starts: all arrives, and slabd notes it.
        self.start_sender()
        self.until(lambda: self.inbox() == self.outbox(), "the first slab is there")
        self.until(lambda: self.plant().get("unsent") == 0, "slabd has noted it")
        # 3. While the second slab is measured, server, sender and slabd are killed.
        slab = self.simulate()
        for victim in ("sender", "server", "sender", "server"):
            time.sleep(chance.uniform(0.5, 3.0))
            if victim == "sender":
                self.sender.kill()
                self.sender.wait()
                self.start_sender()
            else:
                self.server.kill()
                time.sleep(chance.uniform(0.0, 2.0))
                self.server.start()
        self.assertLessEqual(slab.wait(PATIENCE_S), 1, "the inspection does not notice")
        slab = self.simulate()
        self.until(lambda: (self.status().get("slab") or {}).get("id") == "PLANT-3", "the third slab is open")
        time.sleep(chance.uniform(0.0, 3.0))
        os.kill(self.daemon, signal.SIGKILL)
        slab.kill()
        slab.wait()
        process = self.start_daemon()
        # The emulated PLC aborts the slab that the kill left open.
        slab = self.simulate()
        self.assertLessEqual(slab.wait(PATIENCE_S), 1)
        self.until(lambda: self.inbox() == self.outbox(), "all rows are there")
        self.until(lambda: self.plant().get("unsent") == 0, "slabd has noted them")
        verdicts = {row["slab_id"]: row["verdict"] for row in
                    json.loads(self.slabctl("history", "--json"))["slabs"] if row["verdict"]}
        there = dict(self.server.run("SELECT slab_id, verdict FROM plant.v_slab"))
        for slab_id, verdict in there.items():
            self.assertEqual(verdict, verdicts[slab_id], slab_id)
        self.assertEqual(len(there), 4)
        # 4. Starts and faults are events.
        self.assertGreaterEqual(int(self.server.one("SELECT count(*) FROM plant.event WHERE kind = 'started'")), 2)
        done = subprocess.run([BUILD / "plant/slabd-plant", "--config", self.config, "--check"], capture_output=True,
                              text=True)
        self.assertEqual(done.returncode, 0, done.stdout + done.stderr)
        process.terminate()
        self.assertEqual(process.wait(60), 0)


if __name__ == "__main__":
    unittest.main(verbosity=2)
