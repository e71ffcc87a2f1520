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
        for program, built in (("slabd-kuka-bridge", "gateway/kuka/slabd-kuka-bridge"), ("slabd-web", "web/slabd-web"),
                               ("slabd-plant", "plant/slabd-plant"),
                               ("slabd-genicam", "gateway/genicam/slabd-genicam"),
                               ("slabctl", "cli/slabctl"),
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
        # slabd-genicam is left out where Aravis is not installed.
        built = os.path.exists(os.path.join(OPTIONS.build, "gateway/genicam/slabd-genicam"))
        names = [n for n in os.listdir(SYSTEMD) if n.endswith((".service", ".timer")) and (built or "genicam" not in n)]
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

    def test_exposure_of_the_cameras_gateway(self):
        self.assertLessEqual(self.exposure("slabd-genicam.service", read("slabd-genicam.service")), 1.6)

    def test_exposure_of_the_page(self):
        self.assertLessEqual(self.exposure("slabd-web.service", read("slabd-web.service")), 1.6)

    def test_exposure_of_the_sender_to_the_plant(self):
        self.assertLessEqual(self.exposure("slabd-plant.service", read("slabd-plant.service")), 1.6)

    def test_exposure_of_what_the_timers_start(self):
        for name in ("slabd-archive.service", "slabd-backup.service", "slabd-metrics.service"):
            self.assertLessEqual(self.exposure(name, read(name)), 1.6, name)

    def test_figures_that_were_written_are_no_failed_unit(self):
        # 3: written, with a configuration that cannot be used; 4: written, and the daemon does not answer.
        found = re.search(r"^SuccessExitStatus=(.*)$", read("slabd-metrics.service"), re.MULTILINE)
        self.assertEqual(found.group(1).split(), ["3", "4"])

    def test_a_refused_backup_is_repeated_and_one_that_leaves_a_copy_is_not(self):
        unit, service = read("slabd-backup.service").split("[Service]\n")
        for line in ("StartLimitIntervalSec=2h", "StartLimitBurst=6"):
            self.assertIn(line, unit.splitlines())
        for line in ("Restart=on-failure", "RestartSec=5min", "RestartPreventExitStatus=3 4"):
            self.assertIn(line, service.splitlines())

    def test_a_slack_unit_has_a_higher_exposure(self):
        text = read("slabd.service").replace("ProtectSystem=strict", "ProtectSystem=no")
        self.assertGreater(self.exposure("slabd.service", text), 1.2)

    # Mode and group of each folder below /var/lib/slabd.
    FOLDERS = {"": (0o2751, "slabd"), "spool": (0o2750, "slabd"), "backups": (0o2750, "slabd"),
               "changes": (0o2770, "slabd"), "drop": (0o2770, "slabd-scan"), "drop/inbox": (0o2770, "slabd-scan"),
               "drop/request": (0o2770, "slabd-scan"), "drop/stray": (0o2770, "slabd-scan")}

    def state(self, *place):
        return os.path.join(self.folder.name, "var/lib/slabd", *place)

    def number(self, name, table="group"):
        """Of a user or a group of the scratch root."""
        with open(os.path.join(self.folder.name, "etc", table), encoding="utf-8") as file:
            found = re.search(rf"^{name}:[^:]*:(\d+):", file.read(), re.MULTILINE)
        self.assertIsNotNone(found, name)
        return int(found.group(1))

    def install(self):
        os.makedirs(os.path.join(self.folder.name, "etc"), exist_ok=True)
        code, out = run("systemd-sysusers", f"--root={self.folder.name}", os.path.join(SYSTEMD, "slabd.sysusers.conf"))
        self.assertEqual(code, 0, out)
        code, out = self.tmpfiles("--create")
        self.assertEqual(code, 0, out)

    def expect_folders(self):
        for folder, (mode, group) in self.FOLDERS.items():
            status = os.stat(self.state(folder))
            self.assertEqual(oct(status.st_mode & 0o7777), oct(mode), folder)
            self.assertEqual(status.st_uid, self.number("slabd", "passwd"), folder)
            self.assertEqual(status.st_gid, self.number(group), folder)

    def test_the_user_the_groups_and_the_folders_are_made(self):
        self.install()
        self.expect_folders()
        with open(os.path.join(self.folder.name, "etc/group"), encoding="utf-8") as file:
            self.assertRegex(file.read(), r"(?m)^slabd-scan:[^:]*:\d+:slabd$", "slabd reads what the scanner software writes")

    def test_the_scanner_software_reaches_its_folder_and_nothing_else_and_a_reader_writes_nothing(self):
        self.install()
        os.chmod(self.folder.name, 0o711)
        for place, group, mode in (("slabd.db", "slabd", 0o640), ("spool/1.ply", "slabd", 0o640),
                                   ("drop/request/7-1.json", "slabd-scan", 0o660)):
            with open(self.state(place), "w", encoding="utf-8") as file:
                file.write("x")
            os.chown(self.state(place), self.number("slabd", "passwd"), self.number(group))
            os.chmod(self.state(place), mode)
        nobody = 65534

        def can(group, right, place):
            return subprocess.run(["test", right, self.state(place)], user=nobody, group=nobody,
                                  extra_groups=[self.number(group)], check=False).returncode == 0

        for place in ("drop/inbox", "drop/stray", "drop/request", "drop/request/7-1.json"):
            self.assertTrue(can("slabd-scan", "-w", place), place)
            self.assertFalse(can("slabd", "-w", place), place)
        for place in ("slabd.db", "spool", "spool/1.ply", "backups", "changes", ""):
            self.assertFalse(can("slabd-scan", "-r", place), place)
            self.assertFalse(can("slabd-scan", "-w", place), place)
        for place in ("slabd.db", "spool", "spool/1.ply", "backups", ""):
            self.assertTrue(can("slabd", "-r", place), place)
            self.assertFalse(can("slabd", "-w", place), place)
        self.assertTrue(can("slabd", "-w", "changes"), "calibrations are handed to the daemon there")

    def test_the_unit_runs_with_the_groups_and_the_folder_mode_of_these_files(self):
        text = read("slabd.service")
        self.assertIn("\nSupplementaryGroups=slabd-scan\n", text)
        self.assertIn("\nStateDirectoryMode=2751\n", text)
        self.assertIn("\nRuntimeDirectoryMode=0750\n", text, "the socket is for group slabd alone")

    def old_installation(self):
        """As an older slabd and root's commands left it, with open modes and files of root."""
        os.makedirs(os.path.join(self.folder.name, "etc"))
        with open(os.path.join(self.folder.name, "etc/group"), "w", encoding="utf-8") as file:
            file.write("slabd:x:777:anna\n")
        with open(os.path.join(self.folder.name, "etc/passwd"), "w", encoding="utf-8") as file:
            file.write("slabd:x:777:777::/var/lib/slabd:/usr/sbin/nologin\n")
        files = {"slabd.db": 777, "slabd.db-wal": 777, "slabd.db-shm": 777, "slabd.db.writer": 0, "spool/7/01-1.ply": 777,
                 "backups/slabd-1.db": 0, "slabd.db.quarantine-1/slabd.db": 777, "drop/stray/x.ply": 777,
                 "changes/1.json": 777}
        for place, owner in files.items():
            os.makedirs(os.path.dirname(self.state(place)), exist_ok=True)
            with open(self.state(place), "w", encoding="utf-8") as file:
                file.write("evidence")
            os.chown(self.state(place), owner, 777)
            os.chmod(self.state(place), 0o664)
        for folder, _, _ in os.walk(self.state()):
            os.chown(folder, 777, 777)
            os.chmod(folder, 0o2770)
        return files

    def test_an_upgrade_closes_what_an_older_version_left_open(self):
        files = self.old_installation()
        script = os.path.join(self.folder.name, "postinst")
        with open(os.path.join(ROOT, "debian/slabd.postinst"), encoding="utf-8") as text:
            lines = text.read()
        self.assertIn("\n#DEBHELPER#\n", lines)
        with open(script, "w", encoding="utf-8") as file:
            file.write(lines.replace("#DEBHELPER#", ""))
        self.install()
        for _ in range(2):  # a second time changes nothing
            done = subprocess.run(["sh", script, "configure", "0.1.0"], capture_output=True, text=True, check=False,
                                  env={**os.environ, "DPKG_ROOT": self.folder.name})
            self.assertEqual((done.returncode, done.stdout, done.stderr), (0, "", ""))
            self.expect_folders()
            for place in files:
                status = os.stat(self.state(place))
                self.assertEqual(status.st_uid, 777, place)
                with open(self.state(place), encoding="utf-8") as file:
                    self.assertEqual(file.read(), "evidence", place)
                if place.startswith("drop/"):
                    self.assertEqual(status.st_gid, self.number("slabd-scan"), place)
                elif not place.startswith("changes/"):
                    self.assertEqual(oct(status.st_mode & 0o7777), oct(0o640), place)
            for folder in ("spool/7", "slabd.db.quarantine-1"):
                self.assertEqual(os.stat(self.state(folder)).st_mode & 0o022, 0, folder)

    def test_an_upgrade_follows_no_link_and_leaves_a_file_with_two_names(self):
        self.old_installation()
        victim = os.path.join(self.folder.name, "victim")
        with open(victim, "w", encoding="utf-8") as file:
            file.write("mine")
        os.chmod(victim, 0o666)
        os.symlink(victim, self.state("slabd.db-journal"))
        os.link(victim, self.state("spool/7/second.ply"))
        script = os.path.join(self.folder.name, "postinst")
        with open(os.path.join(ROOT, "debian/slabd.postinst"), encoding="utf-8") as text, \
                open(script, "w", encoding="utf-8") as file:
            file.write(text.read().replace("#DEBHELPER#", ""))
        self.install()
        subprocess.run(["sh", script, "configure", "0.1.0"], check=True,
                       env={**os.environ, "DPKG_ROOT": self.folder.name})
        status = os.stat(victim)
        self.assertEqual((status.st_uid, oct(status.st_mode & 0o777)), (0, oct(0o666)))

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
