# SPDX-License-Identifier: Apache-2.0
"""A PostgreSQL 15 server of a test's own on loopback, and a proxy that treats connections badly."""
import os
import pathlib
import pwd
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "places"))
from ports import own_port  # noqa: E402

PROGRAMS = next((path for path in sorted(pathlib.Path("/usr/lib/postgresql").glob("*/bin"), reverse=True)
                 if (path / "initdb").exists()), None)
if PROGRAMS is None:
    print("SKIP: no PostgreSQL server is installed (script/apt-packages-postgres)", file=sys.stderr)
    sys.exit(77)


def as_user():
    """The server refuses to run as root, so root starts it as the user daemon."""
    if os.getuid() != 0:
        return {}
    user = pwd.getpwnam("daemon")
    return {"user": user.pw_uid, "group": user.pw_gid, "extra_groups": []}


def children(pid):
    """Processes that a process has started and that have not ended. Their parent is readable for every user, their folder
    only with special rights."""
    found = []
    for stat in pathlib.Path("/proc").glob("[0-9]*/stat"):
        try:
            state, parent = stat.read_text().rsplit(")", 1)[1].split()[:2]
        except OSError:  # ended meanwhile
            continue
        if int(parent) == pid and state not in "ZX":
            found.append(int(stat.parent.name))
    return found


class Server:
    """`size_mb`: its files lie on a disk of this size, which needs the rights to mount one."""

    def __init__(self, size_mb=0):
        self.folder = tempfile.mkdtemp(prefix="slabd-plant-")
        self.port = own_port()
        self.disk = pathlib.Path(self.folder, "disk")
        self.disk.mkdir()
        self.data = self.disk / "data"
        self.log = pathlib.Path(self.folder, "log")
        self.log.touch()
        self.mounted = False
        if size_mb:
            subprocess.run(["mount", "-t", "tmpfs", "-o", f"size={size_mb}m", "tmpfs", self.disk], check=True)
            self.mounted = True
        if os.getuid() == 0:
            user = pwd.getpwnam("daemon")
            for path in (self.folder, self.disk, self.log):
                os.chown(path, user.pw_uid, user.pw_gid)
        self.process = None
        subprocess.run([PROGRAMS / "initdb", "-D", self.data, "-A", "trust", "-U", "admin", "--no-locale", "-E", "UTF8",
                        "--no-sync"], check=True, stdout=subprocess.DEVNULL, cwd="/", **as_user())
        self.start()
        self.run("CREATE DATABASE plant", "postgres")

    def launch(self):
        with open(self.log, "ab") as log:
            self.process = subprocess.Popen(
                [PROGRAMS / "postgres", "-D", self.data, "-p", str(self.port), "-k", self.folder,
                 "-c", "listen_addresses=127.0.0.1", "-c", "max_wal_size=64MB", "-c", "min_wal_size=32MB"],
                stdout=log, stderr=log, cwd="/", start_new_session=True, **as_user())

    def wait(self):
        """Until it accepts connections. If it has ended, it is started again."""
        for _ in range(1200):
            if self.process.poll() is not None:
                self.launch()
            if subprocess.run([PROGRAMS / "pg_isready", "-q", "-h", "127.0.0.1", "-p", str(self.port)]).returncode == 0:
                return
            time.sleep(0.1)
        raise RuntimeError(self.log.read_text()[-2000:])

    def start(self):
        self.launch()
        self.wait()

    def kill(self):
        """As a power cut of the server: no process of it ends in order."""
        # Each process has a session of its own. The first one starts all others; while it is stopped, none is added.
        pid = self.process.pid
        os.kill(pid, signal.SIGSTOP)
        end = time.monotonic() + 300
        while left := children(pid):
            if time.monotonic() > end:
                raise RuntimeError(f"the server's processes {left} do not end")
            for child in left:
                os.kill(child, signal.SIGKILL)
            time.sleep(0.05)
        os.kill(pid, signal.SIGKILL)
        self.process.wait()
        pathlib.Path(self.data, "postmaster.pid").unlink(missing_ok=True)

    def close(self):
        if self.process is not None and self.process.poll() is None:
            self.kill()
        if self.mounted:
            subprocess.run(["umount", self.disk], check=True)
        shutil.rmtree(self.folder, ignore_errors=True)

    def dsn(self, user="admin", port=0):
        return f"host=127.0.0.1 port={port or self.port} user={user} dbname=plant"

    def run(self, sql, database="plant", user="admin"):
        """Rows of one statement as lists of texts."""
        done = subprocess.run(["psql", "-h", "127.0.0.1", "-p", str(self.port), "-U", user, "-d", database, "-X", "-q",
                               "-A", "-t", "-F", "\t", "-v", "ON_ERROR_STOP=1", "-c", sql], capture_output=True,
                              text=True)
        if done.returncode != 0:
            raise RuntimeError(done.stderr)
        return [line.split("\t") for line in done.stdout.splitlines()]

    def one(self, sql, **how):
        rows = self.run(sql, **how)
        return rows[0][0] if rows else None


class Proxy:
    """Forwards connections; `treat(bytes so far)` says of each piece: pass, cut, stall or half (closed one way)."""

    def __init__(self, port, treat):
        self.target = port
        self.treat = treat
        self.listener = socket.create_server(("127.0.0.1", 0))
        self.port = self.listener.getsockname()[1]
        self.connections = 0
        threading.Thread(target=self.accept, daemon=True).start()

    def accept(self):
        while True:
            try:
                near, _ = self.listener.accept()
            except OSError:
                return
            self.connections += 1
            try:
                far = socket.create_connection(("127.0.0.1", self.target))
            except OSError:
                near.close()
                continue
            for source, sink in ((near, far), (far, near)):
                threading.Thread(target=self.pump, args=(source, sink), daemon=True).start()

    def pump(self, source, sink):
        total = 0
        try:
            while data := source.recv(16384):
                total += len(data)
                fate = self.treat(total)
                if fate == "stall":
                    time.sleep(0.3)
                if fate == "half":
                    sink.shutdown(socket.SHUT_WR)
                    continue
                if fate == "cut":
                    break
                sink.sendall(data)
        except OSError:
            pass
        for one in (source, sink):
            try:
                one.shutdown(socket.SHUT_RDWR)
            except OSError:
                pass
        source.close()  # the other direction has its own thread, which closes the other one

    def close(self):
        self.listener.close()
