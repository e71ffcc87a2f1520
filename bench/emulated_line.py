# SPDX-License-Identifier: Apache-2.0
"""A real slabd with an emulated line in a folder of its own, for the benches that need stored slabs."""
import pathlib
import random
import signal
import socket
import subprocess

SOURCE = pathlib.Path(__file__).resolve().parents[1]
# Settings that every program needs; a history without a daemon has no more.
STORE = """
[plc]
listen = "127.0.0.1:{plc}"
[storage]
db = "slabd.db"
spool_dir = "spool"
[recipes]
dir = "{recipes}"
[cell]
T_base_slab = [1800.0, 0.0, 300.0, 1.0, 0.0, 0.0, 0.0]
[control]
socket = "control.sock"
"""
LINE = """
[line]
simulation = true
[robot]
lcm_url = "udpm://239.255.{a}.{b}:{port}?ttl=0"
interface = "lo"
[scanner]
drop_dir = "drop"
[calibration]
T_flange_scanner = [0.0, 80.0, 150.0, 1.0, 0.0, 0.0, 0.0]
station_sigma_mm = 0.02
station_sigma_deg = 0.001
"""


def free_port():
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


def store_settings(plc=1):
    return STORE.format(plc=plc, recipes=SOURCE / "recipes")


def line_settings():
    """A line with a port and a multicast group of its own."""
    return store_settings(free_port()) + LINE.format(a=random.randint(20, 220), b=random.randint(20, 220),
                                                     port=random.randint(40000, 60000))


def start_slabd(build, config, log_path):
    with open(log_path, "w", encoding="utf-8") as log:
        return subprocess.Popen([build / "daemon/slabd", "--config", config], stderr=log)


def stop(process):
    process.send_signal(signal.SIGTERM)
    process.wait(60)
