# SPDX-License-Identifier: Apache-2.0
"""Processes and the other end of the scan stream that the tests of slabd-genicam share."""

import json
import os
import pathlib
import signal
import socket
import struct
import subprocess
import sys
import tempfile
import threading
import time

import numpy as np

HERE = pathlib.Path(__file__).resolve().parent
# Every test process has loopback addresses of its own, because the port of GigE Vision is fixed.
ADDRESS = f"127.{77 + os.getpid() // 62500 % 100}.{os.getpid() // 250 % 250 + 1}.{os.getpid() % 250 + 1}"
WAIT_S = float(os.environ.get("GENICAM_WAIT_S", "60"))  # for anything that takes less than a second on an idle machine


def until(condition, what, seconds=WAIT_S):
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        found = condition()
        if found:
            return found
        time.sleep(0.02)
    raise AssertionError(f"not within {seconds} s: {what}")


class Process:
    """A program whose output is collected line by line."""

    def __init__(self, *command, stdin=False):
        self.lines = []
        self.program = subprocess.Popen([str(c) for c in command], stdin=subprocess.PIPE if stdin else subprocess.DEVNULL,
                                        stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, bufsize=1)
        self.reader = threading.Thread(target=self.read, daemon=True)
        self.reader.start()

    def read(self):
        for line in self.program.stdout:
            self.lines.append(line.rstrip("\n"))

    def text(self):
        return "\n".join(self.lines)

    def wait_for(self, text, after=0, seconds=WAIT_S):
        def found():
            return any(text in line for line in self.lines[after:])
        until(lambda: found() or (self.program.poll() is not None and not self.reader.is_alive()), text, seconds)
        if not found():
            raise AssertionError(f"{text!r} is not in:\n{self.text()}")

    def tell(self, line):
        at = len(self.lines)
        self.program.stdin.write(line + "\n")
        self.program.stdin.flush()
        self.wait_for("set ", at)

    def kill(self):
        self.program.send_signal(signal.SIGKILL)
        self.program.wait()

    def end(self):
        if self.program.stdin:
            self.program.stdin.close()  # ends Aravis' fake camera
        if self.program.poll() is None:
            self.program.terminate()
            try:
                self.program.wait(20)
            except subprocess.TimeoutExpired:
                self.kill()
        self.reader.join(5)
        self.program.stdout.close()
        return self.program.returncode


def device(frames, *options, address=ADDRESS):
    started = Process(sys.executable, HERE / "camera_device.py", "--address", address, "--frames", frames, *options,
                      stdin=True)
    started.wait_for("ready")
    return started


def write_ply(path, width, height, points):
    head = (f"ply\nformat binary_little_endian 1.0\ncomment unit mm\ncomment organized width {width} height {height}\n"
            f"element vertex {width * height}\nproperty float x\nproperty float y\nproperty float z\nend_header\n")
    pathlib.Path(path).write_bytes(head.encode() + np.ascontiguousarray(points, "<f4").tobytes())


def surface(number, width, height):
    """An inclined plane with noise and missing points; each number is another exposure."""
    rng = np.random.default_rng(number)
    x, y = np.meshgrid(np.linspace(-50, 50, width), np.linspace(-40, 40, height))
    points = np.stack([x, y, 600 + 0.1 * x + number + rng.normal(0, 0.02, x.shape)], -1).reshape(-1, 3)
    points[rng.random(width * height) < 0.05] = np.nan
    return points.astype("<f4")


def same_points(a, b):
    """True if the same points are missing and all others have the same bits."""
    missing = ~np.isfinite(a).all(axis=1)
    return a.shape == b.shape and (missing == ~np.isfinite(b).all(axis=1)).all() and \
        np.array_equal(a[~missing].view("u4"), b[~missing].view("u4"))


class Slabd:
    """slabd's end of the scan stream: one request at a time."""

    def __init__(self):
        self.listener = socket.create_server(("127.0.0.1", 0))
        self.listener.settimeout(WAIT_S)
        self.port = self.listener.getsockname()[1]
        self.link = None
        self.cmd_seq = 0

    def connect(self):
        self.link, _ = self.listener.accept()
        self.link.settimeout(WAIT_S)

    def close(self):
        if self.link:
            self.link.close()
        self.listener.close()

    def ask(self, have_points=0, timeout_ms=30_000, again=False, extended=False):
        self.cmd_seq += 0 if again else 1
        line = {"schema": "slabd.scan_request/1", "session": 7, "cmd_seq": self.cmd_seq, "slab_id": "S-1", "station": 4,
                "have_points": have_points, "timeout_ms": timeout_ms}
        if extended:
            line["gateway"] = 2
        self.link.sendall((json.dumps(line) + "\n").encode())

    def receive(self, count):
        data = bytearray()
        while len(data) < count:
            piece = self.link.recv(min(count - len(data), 1 << 20))
            if not piece:
                raise EOFError
            data += piece
        return bytes(data)

    def scan_of_one_of(self, requests=6):
        """Header and points of the first request that is not refused, as a PLC repeats a SCAN."""
        for number in range(requests):
            self.ask(timeout_ms=60_000, extended=True)
            head = self.receive(64)
            if struct.unpack_from("<I", head, 36)[0] & 2 == 0:
                return self.scan(head)
            self.receive(struct.unpack_from("<I", head, 24)[0])
        raise AssertionError(f"{number + 1} requests were refused")

    def scan(self, head=None):
        """The header's fields and the points that follow."""
        head = head or self.receive(64)
        fields = struct.unpack("<8sHHHHIIIIIIQIQI", head)
        names = ("magic", "version", "bytes", "session", "cmd_seq", "width", "height", "count", "first", "unit", "flags",
                 "utime", "points_crc", "reserved", "crc")
        header = dict(zip(names, fields))
        points = np.frombuffer(self.receive(12 * (header["count"] - header["first"])), "<f4").reshape(-1, 3)
        return header, points

    def refusal(self):
        """Code and reason of a refusal."""
        fields = struct.unpack("<8sHHHHIIIIIIQIQI", self.receive(64))
        assert fields[10] & 2, fields
        return fields[5], self.receive(fields[7]).decode()

    def nothing(self, seconds):
        """True if nothing arrives for this time."""
        self.link.settimeout(seconds)
        try:
            self.link.recv(1)
        except TimeoutError:
            return True
        finally:
            self.link.settimeout(WAIT_S)
        return False


class Folder:
    def __init__(self):
        self.held = tempfile.TemporaryDirectory(prefix="slabd-genicam-")
        self.path = pathlib.Path(self.held.name)

    def frames(self, count, width, height):
        folder = self.path / "frames"
        folder.mkdir(exist_ok=True)
        for number in range(1, count + 1):
            write_ply(folder / f"{number:02}.ply", width, height, surface(number, width, height))
        return folder

    def config(self, port, address=ADDRESS, **keys):
        lines = ["[genicam]", f'camera = "{address}"', f'slabd = "127.0.0.1:{port}"']
        for key, value in keys.items():
            lines.append(f"{key} = " + (f'"{value}"' if isinstance(value, str) else str(value).lower()))
        path = self.path / "genicam.toml"
        path.write_text("\n".join(lines) + "\n")
        return path
