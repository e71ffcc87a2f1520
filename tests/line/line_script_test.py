#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""script/line: the emulated line runs until it is interrupted, continues its history, and rejects wrong arguments.

  line_script_test.py BUILD   BUILD: folder with daemon/slabd and cli/slabctl
"""
import pathlib
import re
import subprocess
import sys
import tempfile
import unittest

SOURCE = pathlib.Path(__file__).resolve().parents[2]
BUILD = sys.argv.pop(1)
# Drawing a slab takes half a minute on a free computer, and many times that next to other tests.
PATIENCE_S = 1500


class Line(unittest.TestCase):
    def setUp(self):
        self.folder = tempfile.TemporaryDirectory()
        self.addCleanup(self.folder.cleanup)
        self.line = pathlib.Path(self.folder.name, "line")

    def start(self, *arguments):
        line = subprocess.Popen(
            [SOURCE / "script/line", "--programs", BUILD, "--folder", self.line, "--quick", "--pause", "0", *arguments],
            stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, start_new_session=True)
        self.addCleanup(self.end, line)
        return line

    @staticmethod
    def end(line):
        if line.poll() is None:
            subprocess.run(["kill", "-TERM", "--", f"-{line.pid}"], check=False)
            line.wait()

    def test_one_slab_then_the_history_continues_until_an_interrupt(self):
        first = self.start("--slabs", "1")
        text, _ = first.communicate(timeout=PATIENCE_S)
        self.assertEqual(first.returncode, 0, text)
        self.assertIn("== Slab 1 ==", text)
        self.assertRegex(text, r"The page, in a browser: http://127\.0\.0\.1:\d+/")
        config = self.line / "slabd.toml"
        self.assertIn(f"status --watch --config {config}", text)

        again = self.start()
        read = ""
        for line in again.stdout:
            read += line
            if re.match(r"== Slab \d+", line):
                break
        self.assertTrue(read.endswith("== Slab 2 ==\n"), read)
        subprocess.run(["kill", "-INT", "--", f"-{again.pid}"], check=True)
        text, _ = again.communicate(timeout=PATIENCE_S)
        self.assertIn("The line has ended.", text)
        self.assertEqual(again.returncode, 0, text)
        # The daemon was stopped with it.
        self.assertEqual(subprocess.run(["pgrep", "-f", str(config)], capture_output=True, check=False).returncode, 1)

    def test_wrong_arguments_are_named(self):
        for arguments, named in ((["--slabs", "two"], "--slabs two"), (["--fast"], "--fast"), (["--pause"], "--pause")):
            ended = subprocess.run([SOURCE / "script/line", *arguments], capture_output=True, text=True, check=False)
            self.assertEqual(ended.returncode, 2)
            self.assertIn(named, ended.stderr)
        pathlib.Path(self.folder.name, "other").write_text("not a line")
        other = subprocess.run([SOURCE / "script/line", "--programs", BUILD, "--folder", self.folder.name],
                               capture_output=True, text=True, check=False)
        self.assertEqual(other.returncode, 2)
        self.assertIn("not a folder of an earlier run", other.stderr)


if __name__ == "__main__":
    unittest.main()
