#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""The publishers of docs/robot send the message of hal/robot/flange_pose.lcm. Needs lcm-gen (liblcm-bin)."""
import os
import re
import socket
import struct
import subprocess
import sys
import tempfile
import unittest

ROOT = os.path.dirname(os.path.dirname(os.path.dirname(os.path.dirname(os.path.abspath(__file__)))))
FOLDER = os.path.join(ROOT, "docs/robot")


def fingerprint():
    """As the bindings of lcm-gen compute it."""
    with tempfile.TemporaryDirectory() as folder:
        message = os.path.join(ROOT, "hal/robot/flange_pose.lcm")
        subprocess.run(["lcm-gen", "-x", "--cpp-hpath", folder, message], check=True)
        with open(os.path.join(folder, "slabd/flange_pose_t.hpp"), encoding="utf-8") as file:
            number = int(re.search(r"hash = 0x([0-9a-f]+)LL", file.read()).group(1), 16)
    return (number << 1) & 0xFFFFFFFFFFFFFFFF | number >> 63


class Publishers(unittest.TestCase):
    def test_python_sends_the_message(self):
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as link:
            link.bind(("127.0.0.1", 0))
            link.settimeout(30)
            program = subprocess.Popen([sys.executable, os.path.join(FOLDER, "publish_pose.py"), "127.0.0.1",
                                        str(link.getsockname()[1])])
            try:
                first, second = link.recv(2000), link.recv(2000)
            finally:
                program.kill()
                program.wait()
        self.assertEqual(first[:20], b"LC02\0\0\0\0FLANGE_POSE\0")
        self.assertEqual(len(first), 20 + 92)
        members = struct.unpack(">QqqihhI3d4d", first[20:])
        self.assertEqual(members[0], fingerprint())
        self.assertEqual(members[3:6], (0, 0, 0), "seq, base_id, tool_id")
        self.assertAlmostEqual(sum(q * q for q in members[10:]), 1.0)
        self.assertEqual(struct.unpack(">i", second[44:48]), (1,), "seq")

    def test_they_are_short_and_marked_as_emulated(self):
        for name, flags in (("publish_pose.py", "MEASURED | STOPPED | EMULATED"), ("publish_pose.cpp", "1 | 2 | 16")):
            with open(os.path.join(FOLDER, name), encoding="utf-8") as file:
                text = file.read()
            self.assertIn(flags, text)
            self.assertLessEqual(text.count("\n"), 30)
        with open(os.path.join(FOLDER, "README.md"), encoding="utf-8") as file:
            self.assertIn(f"0x{fingerprint():X}", file.read())


if __name__ == "__main__":
    unittest.main()
