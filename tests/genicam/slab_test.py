#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""A slab through slabd-genicam has the same points and items to the bit as the same scans by files: with Aravis' own fake camera,
and with the test device under loss. Usage: slab_test.py BUILD_FOLDER [unittest's arguments]

The environment's GENICAM_POINTS is "quarter" (default) or "full", GENICAM_PROGRAMS the build folder of slabd and slabctl
if it is another one."""

import json
import os
import pathlib
import random
import re
import shutil
import subprocess
import sys
import time
import unittest

import numpy as np

import camera_device
import peers

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "places"))
from ports import alone, own_port  # noqa: E402

BUILD = None
SOURCE = pathlib.Path(__file__).resolve().parents[2]
POINTS = os.environ.get("GENICAM_POINTS", "quarter")
SLAB_S = 900.0


class Line:
    """A daemon with its own ports, and the emulated line on it."""

    def __init__(self, folder, scanner):
        self.folder = folder
        folder.mkdir()
        self.programs = pathlib.Path(os.environ.get("GENICAM_PROGRAMS", BUILD))
        group = f"239.255.{random.randint(20, 220)}.{random.randint(20, 220)}:{own_port()}"
        text = f"""[line]
simulation = true
[plc]
listen = "127.0.0.1:{own_port()}"
[robot]
lcm_url = "udpm://{group}?ttl=0"
interface = "lo"
stale_ms = 1000
gap_ms = 1000
[scanner]
SCANNER
[storage]
db = "{folder}/slabd.db"
spool_dir = "{folder}/spool"
[recipes]
dir = "{SOURCE}/recipes"
[cell]
T_base_slab = [1800.0, 0.0, 300.0, 1.0, 0.0, 0.0, 0.0]
[calibration]
T_flange_scanner = [0.0, 80.0, 150.0, 1.0, 0.0, 0.0, 0.0]
station_sigma_mm = 0.02
station_sigma_deg = 0.001
[control]
socket = "{folder}/control.sock"
"""
        # The emulated scanner of the second one has a folder that the daemon does not use.
        drop = f'drop_dir = "{folder}/drop"'
        self.config, self.others = folder / "slabd.toml", folder / "line.toml"
        self.config.write_text(text.replace("SCANNER", scanner or drop))
        self.others.write_text(text.replace("SCANNER", drop))
        for name in ("drop/request", "drop/inbox"):
            (folder / name).mkdir(parents=True, exist_ok=True)
        self.daemon = peers.Process(self.programs / "daemon/slabd", "--config", self.config)
        peers.until(lambda: self.state() not in ("", "recover"), "the daemon is ready")

    def slabctl(self, *command):
        done = subprocess.run([self.programs / "cli/slabctl", *command], capture_output=True, text=True, check=False)
        return done.stdout

    def slabctl_status(self, *command):
        done = subprocess.run([self.programs / "cli/slabctl", *command], capture_output=True, text=True, check=False)
        return done.returncode, done.stdout + done.stderr

    def state(self):
        text = self.slabctl("status", "--config", self.config, "--json")
        return json.loads(text)["state"] if text.startswith("{") else ""

    def inspect(self, watch=lambda: False):
        """Runs one slab, and calls `watch` meanwhile; its document."""
        line = peers.Process(self.programs / "cli/slabctl", "simulate", "--config", self.others, "--points", POINTS,
                             "--slab-no", "1", "--seed", "5", "--move-s", "0", "--scans-per-block", "10")
        peers.until(lambda: watch() or line.program.poll() is not None, "the slab ends", SLAB_S)
        line.end()
        self.output = line.text()
        text = self.slabctl("show", "1", "--config", self.config, "--json")
        return json.loads(text) if text.startswith("{") else {}

    def scans(self):
        return sorted((self.folder / "spool").rglob("*.ply"))

    def end(self):
        return self.daemon.end()


def checksums(slab):
    """CRC-32C of the points that were measured, by station."""
    return {block["station"]: block["points_crc32c"] for block in slab["blocks"] if block["valid"]}


class Slab(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.folder = peers.Folder()
        cls.addClassCleanup(cls.folder.held.cleanup)
        files = Line(cls.folder.path / "files", None)
        slab = files.inspect()
        cls.files_output = files.output
        files.end()
        cls.truth = checksums(slab)
        cls.scans = cls.folder.path / "scans"
        cls.scans.mkdir()
        for path in files.scans():
            os.link(path, cls.scans / path.name)
        assert len(list(cls.scans.iterdir())) == 18, cls.files_output

    def repeat(self, daemon, camera):
        """Has the camera send its frame again if the PLC repeats a SCAN: between its begin and the request the robot must
        stand still for half a second."""
        begun = [re.search(r"station (\d+): scan \d+ begins", text) for text in daemon.lines]
        stations = [found[1] for found in begun if found]
        if len(stations) - len(set(stations)) > self.repeated:
            self.repeated += 1
            camera.tell("again")
        return False

    def through(self, camera, name, camera_address, **keys):
        self.repeated = 0
        port = own_port()
        line = Line(self.folder.path / name, f'backend = "tcp"\nlisten = "127.0.0.1:{port}"\ntimeout_s = 11')
        config = self.folder.config(port, address=camera_address, emulated=True, timeout_s=9, **keys)
        gateway = peers.Process(pathlib.Path(BUILD) / "gateway/genicam/slabd-genicam", "--config", config)
        try:
            gateway.wait_for("connected to slabd")
            gateway.wait_for("camera ")
            began = time.monotonic()
            slab = line.inspect(lambda: self.repeat(line.daemon, camera))
            seconds = time.monotonic() - began
            usage = pathlib.Path(f"/proc/{gateway.program.pid}/status").read_text()
            memory = [row for row in usage.splitlines() if row.startswith("VmHWM")][0]
            print(f"{name}: slab in {seconds:.0f} s, {self.repeated} scans repeated, gateway {memory}", file=sys.stderr)
            log = line.output + "\n" + gateway.text() + "\n" + line.daemon.text()
            self.assertEqual(checksums(slab), self.truth, log)
            # The poses of two runs differ by their noise. The same poses with the scans from files in place of those
            # from the camera must give every figure of the slab again, to the bit.
            for path in line.scans():
                shutil.copyfile(self.scans / f"{path.name[:2]}-1.ply", path)
            status, text = line.slabctl_status("replay", "1", "--verify", "--config", line.config)
            print(f"{name}: {text.strip().splitlines()[-1]}", file=sys.stderr)
            self.assertEqual(status, 0, text)
            self.assertEqual(sum("trigger" in text for text in camera.lines), 18 + self.repeated, log)
        finally:
            gateway.end()
            camera.end()
            line.end()

    def test_through_the_device_with_parts_loss_and_disorder(self):
        camera = peers.device(self.scans, "--multipart", "--loss", "0.02", "--reorder", "40", "--duplicate", "0.01")
        self.through(camera, "device", peers.ADDRESS)

    def test_through_aravis_own_fake_camera(self):
        width, height, _ = camera_device.read_ply(min(self.scans.iterdir()))
        raw = []
        for path in sorted(self.scans.iterdir()):
            raw.append(self.folder.path / (path.stem + ".raw"))
            raw[-1].write_bytes(np.ascontiguousarray(camera_device.read_ply(path)[2], "<f4").tobytes())
        # The fake camera listens at 127.0.0.1 only, and its port is fixed: one at a time on a computer.
        with alone("fake-camera"):
            camera = peers.Process(pathlib.Path(BUILD) / "tests/genicam/genicam_fake_camera",
                                   pathlib.Path(__file__).with_name("fake_camera.xml"), width, height, *raw, stdin=True)
            camera.wait_for("ready")
            # It never sends a packet again, and sends as fast as it can.
            self.through(camera, "fake", "127.0.0.1", packet_size=9000)


if __name__ == "__main__":
    BUILD = sys.argv.pop(1)
    unittest.main(verbosity=2)
