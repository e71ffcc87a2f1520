#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""docs/robot/publish_pose.py: slabctl accepts every pose that it publishes.

  publish_pose_test.py SLABCTL
"""
import json
import os
import pathlib
import subprocess
import sys
import tempfile
import unittest

SOURCE = pathlib.Path(__file__).resolve().parents[2]
SLABCTL = sys.argv.pop(1)


class PublishPose(unittest.TestCase):
    def test_every_pose_is_accepted(self):
        group, port = f"239.255.79.{os.getpid() % 250 + 2}", str(20000 + os.getpid() % 5000)
        with tempfile.TemporaryDirectory() as folder:
            config = pathlib.Path(folder, "slabd.toml")
            config.write_text(
                f'[plc]\nlisten = "127.0.0.1:15020"\n[robot]\nlcm_url = "udpm://{group}:{port}?ttl=0"\ninterface = "lo"\n'
                f'[scanner]\ndrop_dir = "{folder}/drop"\n[storage]\ndb = "{folder}/slabd.db"\nspool_dir = "{folder}/spool"\n'
                f'[recipes]\ndir = "{SOURCE}/recipes"\n[control]\nsocket = "{folder}/control.sock"\n'
                "[cell]\nT_base_slab = [1800.0, 0.0, 300.0, 1.0, 0.0, 0.0, 0.0]\n"
                "[calibration]\nT_flange_scanner = [0.0, 80.0, 150.0, 1.0, 0.0, 0.0, 0.0]\n")
            publisher = subprocess.Popen(["/usr/bin/python3", SOURCE / "docs/robot/publish_pose.py", group, port])
            try:
                seen = subprocess.run(["timeout", "5", SLABCTL, "robot", "monitor", "--config", config, "--json"],
                                      capture_output=True, text=True, timeout=60, check=False)
            finally:
                publisher.kill()
                publisher.wait()
        poses, _ = json.JSONDecoder().raw_decode(seen.stdout)
        self.assertGreater(poses["accepted"], 20, seen.stdout + seen.stderr)
        self.assertTrue(poses["measured"] and poses["stopped"], seen.stdout)
        for refused in ("foreign", "malformed", "not_unit", "not_finite", "out_of_reach", "wrong_sender", "time_unit"):
            self.assertEqual(poses[refused], 0, seen.stdout)


if __name__ == "__main__":
    unittest.main()
