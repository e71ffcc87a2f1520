#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""The page of slabd-web in a real browser while the emulated line inspects slabs.

  page_line_test.py BUILD [--shots FOLDER]    BUILD: folder with daemon/slabd, cli/slabctl and web/slabd-web

Exit status 77 (skipped) if a package of script/apt-packages-browser is missing.
"""
import json
import os
import pathlib
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import unittest
import urllib.request

SOURCE = pathlib.Path(__file__).resolve().parents[2]
# Drawing a slab takes half a minute on a free computer, and many times that next to other tests.
PATIENCE_S = 900
BLOCKS = 18

try:
    from selenium import webdriver
    from selenium.webdriver.chrome.options import Options
    from selenium.webdriver.chrome.service import Service
except ImportError:
    print("SKIP: python3-selenium is not installed", file=sys.stderr)
    sys.exit(77)

SHOTS = ""
if "--shots" in sys.argv:
    at = sys.argv.index("--shots")
    SHOTS = sys.argv[at + 1]
    del sys.argv[at:at + 2]

VERDICTS = """
return [...document.querySelectorAll('[data-block]')].map((e) => [Number(e.dataset.block), e.dataset.verdict]);
"""


class PageOnALine(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.folder = tempfile.TemporaryDirectory()
        cls.line_folder = pathlib.Path(cls.folder.name, "line")
        cls.line = subprocess.Popen(
            [SOURCE / "script/line", "--programs", BUILD, "--folder", cls.line_folder, "--quick", "--pause", "15"],
            stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, start_new_session=True)
        cls.base = ""
        for text in cls.line.stdout:
            found = re.search(r"The page, in a browser: (http://\S+)/", text)
            if found:
                cls.base = found.group(1)
                break
        options = Options()
        options.binary_location = shutil.which("chromium")
        for argument in ("--headless=new", "--no-sandbox", "--disable-dev-shm-usage", "--lang=en"):
            options.add_argument(argument)
        options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
        cls.driver = webdriver.Chrome(service=Service(shutil.which("chromedriver")), options=options)
        cls.driver.set_window_size(1920, 1080)

    @classmethod
    def tearDownClass(cls):
        cls.driver.quit()
        os.killpg(cls.line.pid, signal.SIGTERM)
        cls.line.communicate()
        cls.folder.cleanup()

    def setUp(self):
        self.early = []

    def slabctl(self, *arguments):
        command = [pathlib.Path(BUILD, "cli/slabctl"), *arguments, "--config", self.line_folder / "slabd.toml"]
        return subprocess.run(command, capture_output=True, text=True, check=True).stdout

    def get(self, path):
        with urllib.request.urlopen(self.base + path) as answer:
            return answer.read()

    def open(self, path, ready):
        """Loads the page again if it is not ready after 30 s, then after 60 s and so on: next to other tests one of its
        requests may have been given up. Other faults of an earlier load count in no_fault()."""
        begun, patience_s = time.monotonic(), 30
        while time.monotonic() - begun < PATIENCE_S:
            self.early += [text for text in self.severe() if "status of 5" not in text and "net::ERR" not in text]
            self.driver.get(self.base + path)
            loaded = time.monotonic()
            while time.monotonic() - loaded < patience_s:
                if self.driver.execute_script(f"return {ready}"):
                    return
                time.sleep(0.1)
            patience_s = min(2 * patience_s, PATIENCE_S - (time.monotonic() - begun))
        self.shot("late")
        self.fail(f"not within {PATIENCE_S} s: {path}: {ready}")

    def until(self, condition, what, limit_s=PATIENCE_S):
        begun = time.monotonic()
        while time.monotonic() - begun < limit_s:
            value = condition()
            if value:
                return value
            time.sleep(0.1)
        self.shot("late")
        self.fail(f"not within {limit_s} s: {what}")
        return None

    def shot(self, name):
        if SHOTS:
            self.driver.save_screenshot(os.path.join(SHOTS, f"line_{name}.png"))

    def severe(self):
        return [entry["message"] for entry in self.driver.get_log("browser") if entry["level"] == "SEVERE"]

    def no_fault(self):
        self.assertEqual(self.early + self.severe(), [], "no violation of the Content-Security-Policy, no error of a script")

    def stale(self):
        return self.driver.execute_script("return document.body.dataset.stale")

    def test_1_a_slab_comes_in_block_by_block(self):
        self.open("/", "document.querySelector('[data-block]') !== null && document.body.dataset.stale === 'false'")
        counts = set()
        opened_late = None

        def judged():
            nonlocal opened_late
            states = self.driver.execute_script(VERDICTS)
            count = sum(verdict != "none" for _, verdict in states)
            if opened_late is None:
                opened_late = count > 2
            if opened_late:  # the page was opened after a part of this slab: the next one counts
                opened_late = count > 2
                return False
            counts.add(count)
            if count == 9:
                self.shot("half")
            return count == BLOCKS

        self.until(judged, "18 blocks with a verdict")
        self.assertGreaterEqual(len(counts), 4, f"seen on the way: {sorted(counts)}")
        # Both are read at one moment, because the line goes on with the next slab. If the verdict is missed between two
        # slabs, that of the next slab counts.
        verdict, link = self.until(lambda: self.driver.execute_script(
            "const big = document.querySelector('.big[data-slab-verdict]:not(.big-open):not(.big-stale)');"
            "const link = document.querySelector('.slab-name a');"
            "return big && link ? [big.dataset.slabVerdict, link.getAttribute('href')] : null"), "the slab's verdict")
        rows = json.loads(self.slabctl("history", "--json"))["slabs"]
        stored = next(row for row in rows if row["key"] == int(link.rsplit("/", 1)[1]))
        self.assertEqual(verdict, stored["verdict"])
        self.shot("slab")
        self.no_fault()

    def test_2_figures_are_those_of_slabctl(self):
        slabs = json.loads(self.slabctl("history", "--json"))["slabs"]
        key = next(slab["key"] for slab in reversed(slabs) if slab["ended"])
        self.assertEqual(json.loads(self.get(f"/api/v1/slabs/{key}")),
                         json.loads(self.slabctl("show", f"key:{key}", "--json")))
        terminal = self.slabctl("show", f"key:{key}", "--block", "4")
        self.open(f"/slabs/{key}/blocks/4", "document.querySelectorAll('tbody tr').length > 8")
        page = self.driver.execute_script("return document.body.innerText")
        items = re.findall(r"^(\w+) \[\w+\] .*?(-?\d+\.\d{2,})\b", terminal, re.MULTILINE)
        figures = set(re.findall(r"-?\d+\.\d{3,4}", page))
        for line in terminal.splitlines():
            if re.match(r"(seat_slope|jaw_|casing_spacing|casing_prot)", line):
                for figure in re.findall(r"(?<![\d.])-?\d+\.\d{3,4}(?![\d])", line):
                    self.assertIn(figure, figures, line)
                    items.append(figure)
        self.assertGreater(len(items), 10, terminal)
        self.no_fault()

    def test_3_every_page_works_on_the_line(self):
        key = json.loads(self.slabctl("history", "--json"))["slabs"][-1]["key"]
        for path, ready in (("/slabs", "document.querySelector('tbody tr') !== null"),
                            (f"/slabs/{key}", "document.querySelector('a.tile') !== null"),
                            (f"/slabs/{key}/blocks/4", "document.querySelector('.heat') !== null"),
                            ("/trends", "document.querySelector('table') !== null"),
                            ("/trends/seat_slope", "document.querySelector('canvas, svg') !== null"),
                            ("/calibration", "document.querySelector('main table, main dl') !== null"),
                            ("/line", "document.querySelector('main table') !== null"),
                            ("/about", "document.querySelector('main h1') !== null")):
            self.open(path, ready)
            time.sleep(1.5)
            self.shot(path.strip("/").replace("/", "_"))
            self.no_fault()
        self.assertTrue(self.get(f"/api/v1/slabs/{key}/report.pdf").startswith(b"%PDF"))

    def test_4_two_slabs_are_compared(self):
        def ended():
            return [slab["key"] for slab in json.loads(self.slabctl("history", "--json"))["slabs"] if slab["ended"]]
        self.until(lambda: len(ended()) >= 2, "a second slab")
        b, a = ended()[:2]
        comparison = json.loads(self.get(f"/api/v1/compare?a={a}&b={b}"))
        self.assertEqual(comparison["schema"], "slabd.comparison/1")
        self.assertTrue(comparison["emulated"])
        self.open(f"/compare?a={a}&b={b}", "document.querySelectorAll('a.tile').length >= 36")
        self.shot("compare")
        self.no_fault()

    def test_5_a_killed_daemon_is_never_shown_as_current(self):
        self.open("/", "document.body.dataset.stale === 'false'")
        daemon = subprocess.run(["pgrep", "-f", f"slabd --config {self.line_folder}/slabd.toml"], capture_output=True,
                                text=True, check=True).stdout.split()[0]
        os.kill(int(daemon), signal.SIGKILL)
        begun = time.monotonic()
        self.until(lambda: self.stale() == "true", "grey", 30)
        print(f"grey {time.monotonic() - begun:.1f} s after the kill", file=sys.stderr)
        self.shot("killed")
        def unreachable():
            status = json.loads(self.get("/api/v1/status"))
            return status if status["reachable"] is False else None
        status = self.until(unreachable, "the server reports that the daemon is not reachable", 120)
        self.assertNotEqual(status["trouble"], "")


if __name__ == "__main__":
    for program in ("chromium", "chromedriver"):
        if shutil.which(program) is None:
            print(f"SKIP: {program} is not installed", file=sys.stderr)
            sys.exit(77)
    BUILD = os.path.abspath(sys.argv.pop(1))
    unittest.main(verbosity=2)
