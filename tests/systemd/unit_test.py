#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""What the service manager thinks of our units, without one running.

Every directive is known and every value good; the exposure stays below its limits; the user and the folders are made, and
what cleans folders never touches a scan.
"""
import argparse
import os
import re
import subprocess
import sys
import tempfile
import unittest

ROOT = os.path.dirname(os.path.dirname(os.path.dirname(os.path.abspath(__file__))))
SYSTEMD = os.path.join(ROOT, "systemd")
OPTIONS = argparse.Namespace(build="")


def read(name):
    with open(os.path.join(SYSTEMD, name), encoding="utf-8") as file:
        return file.read()


def run(*command):
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    return done.returncode, done.stdout + done.stderr


class Units(unittest.TestCase):
    def setUp(self):
        self.folder = tempfile.TemporaryDirectory()
        self.addCleanup(self.folder.cleanup)

    def unit(self, name, text):
        """The unit as installed, with programs that exist here."""
        for program, built in (("slabd-kuka-bridge", "kuka/slabd-kuka-bridge"), ("slabctl", "cli/slabctl"),
                               ("slabd", "daemon/slabd")):
            path = os.path.join(OPTIONS.build, built)
            text = re.sub(rf"=/usr/bin/{program}(?=\s)", f"={path}", text)
        path = os.path.join(self.folder.name, name)
        with open(path, "w", encoding="utf-8") as file:
            file.write(text)
        return path

    def exposure(self, name, text):
        path = self.unit(name, text)
        _, out = run("systemd-analyze", "security", "--offline=true", path)
        found = re.search(r"Overall exposure level for \S+: ([0-9.]+)", out)
        self.assertIsNotNone(found, out)
        return float(found.group(1))

    def test_every_directive_is_known(self):
        names = [n for n in os.listdir(SYSTEMD) if n.endswith((".service", ".timer"))]
        paths = [self.unit(name, read(name)) for name in names]
        code, out = run("systemd-analyze", "verify", "--man=no", *paths)
        self.assertEqual((code, out), (0, ""))

    def test_what_the_pages_show_for_the_service_manager_has_no_comment_behind_a_value(self):
        # It would belong to the value: what is copied from there must work.
        pages = [os.path.join(ROOT, "docs", n) for n in os.listdir(os.path.join(ROOT, "docs")) if n.endswith(".md")]
        pages += [os.path.join(SYSTEMD, n) for n in os.listdir(SYSTEMD) if not n.endswith(".toml")]
        shown = 0
        for page in pages:
            with open(page, encoding="utf-8") as file:
                for line in file:
                    if re.match(r"[\s#]*[A-Za-z]+=", line):
                        shown += 1
                        self.assertNotRegex(line.strip().lstrip("#"), r"\s#", page)
        self.assertGreater(shown, 50)

    def test_a_wrong_directive_is_noticed(self):
        path = self.unit("slabd.service", read("slabd.service") + "\n[Service]\nProtectSytem=strict\n")
        _, out = run("systemd-analyze", "verify", "--man=no", path)
        self.assertIn("ProtectSytem", out)

    def test_exposure_without_serial_line_and_real_time(self):
        self.assertLessEqual(self.exposure("slabd.service", read("slabd.service")), 1.2)

    def test_exposure_with_the_serial_line(self):
        text = read("slabd.service") + read("slabd-serial.conf")
        self.assertLessEqual(self.exposure("slabd.service", text), 1.6)

    def test_exposure_of_the_bridge(self):
        self.assertLessEqual(self.exposure("slabd-kuka-bridge.service", read("slabd-kuka-bridge.service")), 1.6)

    def test_exposure_of_what_the_timers_start(self):
        for name in ("slabd-backup.service", "slabd-metrics.service"):
            self.assertLessEqual(self.exposure(name, read(name)), 1.6, name)

    def test_figures_that_were_written_are_no_failed_unit(self):
        # 3: written, with a configuration that cannot be used; 4: written, and the daemon does not answer.
        found = re.search(r"^SuccessExitStatus=(.*)$", read("slabd-metrics.service"), re.MULTILINE)
        self.assertEqual(found.group(1).split(), ["3", "4"])

    def test_a_slack_unit_has_a_higher_exposure(self):
        text = read("slabd.service").replace("ProtectSystem=strict", "ProtectSystem=no")
        self.assertGreater(self.exposure("slabd.service", text), 1.2)

    def test_the_user_and_the_folders_are_made(self):
        os.makedirs(os.path.join(self.folder.name, "etc"))
        code, out = run("systemd-sysusers", f"--root={self.folder.name}", os.path.join(SYSTEMD, "slabd.sysusers.conf"))
        self.assertEqual(code, 0, out)
        with open(os.path.join(self.folder.name, "etc/passwd"), encoding="utf-8") as file:
            self.assertIn("slabd:", file.read())
        code, out = self.tmpfiles("--create")
        self.assertEqual(code, 0, out)
        for folder in ("", "drop", "spool"):
            mode = os.stat(os.path.join(self.folder.name, "var/lib/slabd", folder)).st_mode & 0o7777
            self.assertEqual(mode, 0o2770, folder)

    def tmpfiles(self, *verbs):
        # Names of users come from the scratch root's own files.
        return run("systemd-tmpfiles", f"--root={self.folder.name}", *verbs, os.path.join(SYSTEMD, "slabd.tmpfiles.conf"))

    def test_old_scans_are_never_cleaned_away(self):
        os.makedirs(os.path.join(self.folder.name, "etc"))
        run("systemd-sysusers", f"--root={self.folder.name}", os.path.join(SYSTEMD, "slabd.sysusers.conf"))
        self.tmpfiles("--create")
        kept = []
        for place in ("spool/7/01-1.ply", "drop/stray/x.ply", "drop/inbox/7-3.ply", "slabd.db", "backups/slabd-1.db"):
            path = os.path.join(self.folder.name, "var/lib/slabd", place)
            os.makedirs(os.path.dirname(path), exist_ok=True)
            with open(path, "w", encoding="utf-8") as file:
                file.write("evidence")
            os.utime(path, (0, 0))  # of 1970
            kept.append(path)
        self.tmpfiles("--clean", "--remove", "--create")
        for path in kept:
            self.assertTrue(os.path.exists(path), path)
        for line in read("slabd.tmpfiles.conf").splitlines():
            if not line.startswith("#"):
                self.assertEqual(line.split()[5], "-", "an age: " + line)


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("--build", required=True)
    OPTIONS, rest = parser.parse_known_args()
    OPTIONS.build = os.path.abspath(OPTIONS.build)
    unittest.main(argv=[sys.argv[0], *rest])
