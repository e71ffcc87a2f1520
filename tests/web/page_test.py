#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""The page in a real browser, against web/page/test/server.mjs: recorded documents and the security headers of slabd-web.

    tests/web/page_test.py [--shots FOLDER] [--axe FILE] [unittest's arguments]

Needs the packages of script/apt-packages-browser; exit status 77 (skipped) if one of them is missing. axe/axe.min.js is
axe-core 4.14.1 (MPL-2.0).
"""
import json
import os
import shutil
import subprocess
import sys
import time
import unittest
import urllib.parse
import urllib.request

ROOT = os.path.dirname(os.path.dirname(os.path.dirname(os.path.abspath(__file__))))
sys.path.insert(0, os.path.join(ROOT, "tests", "places"))
from ports import own_port  # noqa: E402

PAGE = os.path.join(ROOT, "web", "page")
SIZES = {"wide": (1920, 1080), "panel": (1280, 800), "phone": (390, 844)}
PAGES = {"live": "/", "slabs": "/slabs", "slab": "/slabs/55", "block": "/slabs/55/blocks/4", "trends": "/trends/seat_slope",
         "moulds": "/moulds?mould=3", "plant": "/plant?id=C3-4155", "drafts": "/drafts", "draft": "/drafts/p4925", "calibration": "/calibration", "line": "/line", "compare": "/compare?a=55&b=60", "about": "/about"}
ATTACK = '<img src=x onerror="document.title=1">'
CONTROL = "A\x00\x1b[31mB\u202eC\u200bD"
WIDE = "轨道板" * 10 + "轨道"
# Longest wait for something that comes within seconds on a free computer. How fast the page turns grey is tested with a
# false clock in web/page/test/stale.test.mjs.
LIMIT_S = 120
# A document of a slab that has not ended is renewed every 5 s.
QUIET_S = 8

try:
    from selenium import webdriver
    from selenium.webdriver.chrome.options import Options
    from selenium.webdriver.chrome.service import Service
    from selenium.webdriver.common.by import By
    from selenium.webdriver.common.keys import Keys
except ImportError:
    print("SKIP: python3-selenium is not installed", file=sys.stderr)
    sys.exit(77)


def option(name, default):
    if name not in sys.argv:
        return default
    at = sys.argv.index(name)
    value = sys.argv[at + 1]
    del sys.argv[at:at + 2]
    return value


SHOTS = option("--shots", "")
AXE = option("--axe", os.path.join(os.path.dirname(os.path.abspath(__file__)), "axe", "axe.min.js"))

# Focusable elements that are shown. A group of radio buttons would count as one; the page has none.
FOCUSABLE = """
return [...document.querySelectorAll('a[href],button,select,input,summary,[tabindex="0"]')].filter(
  (e) => !e.disabled && e.checkVisibility({visibilityProperty: true, contentVisibilityAuto: true}));
"""
FOCUS = """
const e = document.activeElement, s = getComputedStyle(e);
return {index: arguments[0].indexOf(e), tag: e.tagName, outline: s.outlineStyle !== 'none' && parseFloat(s.outlineWidth) >= 2};
"""
SMALL_TARGETS = """
return [...document.querySelectorAll('button,select,input,nav a,a.tile,a.button,summary,.row-link')].filter((e) => {
  const box = (e.closest('label.field-check') ?? e).getBoundingClientRect();
  return box.width > 0 && (box.height < 43.5 || (box.width < 43.5 && !e.classList.contains('row-link')));
}).map((e) => e.outerHTML.slice(0, 120) + ' ' + JSON.stringify(e.getBoundingClientRect()));
"""
# Elements of a verdict whose ground or text is not grey.
COLOURED = """
const spread = (colour) => { const [r, g, b] = colour.match(/[\\d.]+/g).map(Number); return Math.max(r, g, b) - Math.min(r, g, b); };
return [...document.querySelectorAll('[data-verdict], [data-slab-verdict], main .verdict')].filter((e) => {
  const style = getComputedStyle(e);
  return spread(style.backgroundColor) > 24 || spread(style.color) > 24;
}).map((e) => e.outerHTML.slice(0, 100) + getComputedStyle(e).backgroundColor + getComputedStyle(e).color);
"""
# Counts in window.dimmed how often a part of the page is shown as loading.
WATCH_DIMMED = """
window.dimmed = 0;
new MutationObserver((changes) => { window.dimmed += changes.filter((one) => one.target.classList.contains('loading')).length; })
  .observe(document.querySelector('main'), {subtree: true, attributes: true, attributeFilter: ['class']});
"""
# Collects in window.said what is announced.
WATCH_SAID = """
window.said = [];
const status = document.querySelector('[role=status][aria-live=polite]');
new MutationObserver(() => window.said.push(status.textContent)).observe(status, {subtree: true, childList: true, characterData: true});
"""
# Clocks that run 20 times slower: no answer becomes old while the browser waits for the processor, and the page does not
# take this for a sleep. A constant is added to that of the computer.
SLOW_CLOCKS = """{
const [monotonic, wall] = [performance.now.bind(performance), Date.now];
const begin = wall();
performance.now = () => monotonic() / 20;
Date.now = () => begin + %d + (wall() - begin) / 20;
}"""
STOP_CLOCKS = "const [monotonic, wall] = [performance.now(), Date.now()]; performance.now = () => monotonic; Date.now = () => wall;"
FRESH = "return document.body.dataset.stale === 'false'"
STALE = "return document.body.dataset.stale === 'true'"
BAND = "document.querySelector('.slab-verdict')"


class Browser(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.server = subprocess.Popen(["node", os.path.join(PAGE, "test", "server.mjs")], stdout=subprocess.PIPE, text=True)
        cls.base = cls.server.stdout.readline().strip()
        options = Options()
        options.binary_location = shutil.which("chromium")
        for argument in ("--headless=new", "--no-sandbox", "--disable-dev-shm-usage", "--enable-unsafe-swiftshader",
                         "--force-prefers-reduced-motion", "--lang=en"):
            options.add_argument(argument)
        options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
        cls.driver = webdriver.Chrome(service=Service(shutil.which("chromedriver"), port=own_port()), options=options)
        with open(AXE, encoding="utf-8") as file:
            cls.axe = file.read()

    @classmethod
    def tearDownClass(cls):
        cls.driver.quit()
        cls.server.terminate()
        cls.server.wait()
        cls.server.stdout.close()

    def setUp(self):
        self.ask("reset=1")
        self.logs()
        self.ask("reports=1")
        self.size("panel")

    def ask(self, query):
        with urllib.request.urlopen(f"{self.base}/_test?{query}") as answer:
            return json.load(answer)

    def set(self, **values):
        self.ask(urllib.parse.urlencode(values))

    def logs(self):
        return [entry["message"] for entry in self.driver.get_log("browser") if entry["level"] == "SEVERE"]

    def size(self, name):
        width, height = SIZES[name]
        self.driver.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", {
            "width": width, "height": height, "deviceScaleFactor": 1, "mobile": name == "phone"})

    def until(self, done, message):
        """Waits until done() is true."""
        end = time.monotonic() + LIMIT_S
        while True:
            last = time.monotonic() > end  # read before done(), so that a process that was paused still looks once
            if done():
                return
            if last:
                self.fail(f"{message}: not within {LIMIT_S} s")
            time.sleep(0.05)

    def wait(self, script, message, *arguments):
        """Waits until `script` returns true."""
        self.until(lambda: self.driver.execute_script(script, *arguments), message)

    def slow_clocks(self, added_ms=0):
        """SLOW_CLOCKS in the pages that this test opens from now on."""
        script = self.driver.execute_cdp_cmd("Page.addScriptToEvaluateOnNewDocument", {"source": SLOW_CLOCKS % added_ms})
        self.addCleanup(self.driver.execute_cdp_cmd, "Page.removeScriptToEvaluateOnNewDocument", script)

    def open(self, path, language="en"):
        self.driver.get(self.base + path + ("&" if "?" in path else "?") + f"lang={language}")
        self.wait("return document.body.dataset.stale === 'false' && !document.querySelector('[aria-busy=true]') && "
                  "document.querySelector('h1') !== null", f"{path} is loaded")

    def asked(self, path):
        """Requests for the document at `path` since the page was opened."""
        return self.driver.execute_script("return performance.getEntriesByType('resource').filter((entry) => "
                                          "new URL(entry.name).pathname === `/api/v1${arguments[0]}`).length", path)

    def wait_renewed(self, path, more=1):
        """Waits until the document at `path` was asked for `more` times again."""
        for count in range(self.asked(path) + 1, self.asked(path) + 1 + more):
            self.until(lambda: self.asked(path) >= count, f"{path} comes again")

    def wait_quiet(self, paths, message):
        """Waits until no document at `paths` is requested during QUIET_S; returns how often each was."""
        end = time.monotonic() + LIMIT_S
        before = None
        while before != (now := [self.asked(path) for path in paths]):
            self.assertLess(time.monotonic(), end, f"{message}: {before}, {now}")
            before = now
            time.sleep(QUIET_S)
        return now

    def turn_by_keyboard(self, keys):
        """Sends `keys` to the surface; its picture changes."""
        frame = self.driver.find_element(By.CLASS_NAME, "surface-frame")
        frame.send_keys(Keys.SHIFT)  # it has the focus, and an outline, before the first picture
        before = None

        def is_drawn():
            nonlocal before
            time.sleep(0.5)
            last, before = before, frame.screenshot_as_png
            return before == last

        self.until(is_drawn, "the surface is drawn")
        frame.send_keys(*keys)
        self.until(lambda: frame.screenshot_as_png != before, "the surface turns")

    def stale(self):
        return self.driver.execute_script("return document.body.dataset.stale")

    def shot(self, name):
        if not SHOTS:
            return
        os.makedirs(SHOTS, exist_ok=True)
        size = self.driver.execute_script("return [innerWidth, Math.min(4000, document.documentElement.scrollHeight), innerHeight]")
        self.driver.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", {
            "width": size[0], "height": max(size[1], size[2]), "deviceScaleFactor": 1, "mobile": size[0] < 600})
        time.sleep(0.3)
        self.driver.save_screenshot(os.path.join(SHOTS, f"{name}.png"))

    def clean(self, where):
        """No report of the content security policy and no error in the console."""
        self.assertEqual(self.ask("reports=1"), [], where)
        self.assertEqual(self.logs(), [], where)

    def accessible(self, where):
        self.driver.execute_script(self.axe)
        result = self.driver.execute_async_script("axe.run(document, {resultTypes: ['violations']}).then(arguments[0])")
        found = [f"{one['id']}: {one['help']}: {[node['html'][:160] for node in one['nodes'][:3]]}" for one in result["violations"]]
        self.assertEqual(found, [], where)


class EveryPage(Browser):
    def test_every_page_in_both_languages_and_three_sizes(self):
        for size in SIZES:
            for language in ("en", "zh"):
                for name, path in PAGES.items():
                    where = f"{name} {language} {size}"
                    with self.subTest(where):
                        self.size(size)
                        self.open(path, language)
                        self.assertEqual(self.driver.execute_script("return document.documentElement.lang"), language)
                        overflow = self.driver.execute_script("return document.documentElement.scrollWidth - innerWidth")
                        self.assertLessEqual(overflow, 0, "the page is wider than the screen")
                        self.assertEqual(self.driver.execute_script(SMALL_TARGETS), [], "touch targets of 44 px")
                        self.clean(where)
                        self.accessible(where)
                        self.ask("reports=1")  # those of axe itself
                        self.logs()
                        self.shot(f"{name}-{language}-{size}")

    def test_every_theme_has_enough_contrast(self):
        for theme in ("dark", "contrast"):
            self.open("/")
            self.driver.execute_script("localStorage.setItem('slabd-theme', arguments[0])", theme)
            self.set(slab="odd")
            try:
                for name, path in PAGES.items():
                    with self.subTest(f"{name} {theme}"):
                        self.open(path)
                        self.assertEqual(self.driver.execute_script("return document.documentElement.dataset.theme"), theme)
                        self.accessible(name)
                        self.shot(f"{name}-{theme}")
            finally:
                self.driver.execute_script("localStorage.clear()")

    def test_the_keyboard_reaches_everything_with_visible_focus(self):
        for name, path in PAGES.items():
            with self.subTest(name):
                self.open(path)
                elements = self.driver.execute_script(FOCUSABLE)
                reached, hidden = set(), []
                body = self.driver.find_element(By.TAG_NAME, "body")
                body.send_keys(Keys.TAB)
                # A date field has several stops.
                for _ in range(len(elements) + 10):
                    now = self.driver.execute_script(FOCUS, elements)
                    if now["index"] == 0 and len(reached) > 1:
                        break
                    if now["index"] >= 0:
                        reached.add(now["index"])
                        if not now["outline"]:
                            hidden.append(now)
                    self.driver.switch_to.active_element.send_keys(Keys.TAB)
                missed = [elements[i].get_attribute("outerHTML")[:120] for i in range(len(elements)) if i not in reached]
                self.assertEqual(missed, [])
                self.assertEqual(hidden, [], "focus is not visible")

    def test_no_request_leaves_the_host(self):
        for path in PAGES.values():
            self.open(path)
            names = self.driver.execute_script("return performance.getEntriesByType('resource').map((entry) => entry.name)")
            self.assertTrue(names)
            self.assertEqual([name for name in names if not name.startswith(self.base + "/")], [])

    def test_an_unknown_address_and_a_document_that_is_not_there(self):
        for path in ("/nothing", "/slabs/9999", "/slabs/55/blocks/7"):
            self.open(path)
            self.accessible(path)
        self.set(database="0")
        for path in PAGES.values():
            self.open(path)
            self.accessible(path)
            self.assertEqual(self.driver.execute_script("return document.querySelectorAll('.v-pass').length && "
                                                        "location.pathname !== '/'"), False)


class LivePage(Browser):
    def blocks(self):
        return self.driver.execute_script("return Object.fromEntries([...document.querySelectorAll('[data-block]')]"
                                          ".map((e) => [e.dataset.block, e.dataset.verdict]))")

    def test_a_slab_comes_in_block_by_block(self):
        self.set(slab="open", done=0)
        self.open("/")
        self.assertEqual(set(self.blocks().values()), {"none"})
        for done in (1, 4, 18):
            self.set(done=done)
            self.wait("return document.querySelectorAll('[data-block]:not([data-verdict=none])').length === arguments[0]",
                      f"{done} blocks", done)
        self.assertEqual(self.blocks()["4"], "fail")
        self.set(slab="fail")
        self.wait("return document.querySelector('[data-slab-verdict]')?.dataset.slabVerdict === 'fail'", "the verdict")

    def test_a_line_with_two_robots_shows_each_of_them(self):
        for language, words in (("en", ("Robot 1", "Robot 2", "Scanner 2", "offline", "Tie of the robots")),
                                ("zh", ("机器人 1", "机器人 2", "扫描仪 2", "离线", "机器人基座关联"))):
            self.set(arms=2)
            for path in ("/", "/line"):
                self.open(path, language)
                text = self.driver.execute_script("return document.body.innerText")
                for word in words:
                    self.assertIn(word, text, f"{path} {language}")
            self.open("/calibration", language)
            self.assertNotIn("he-of-the-second", self.driver.execute_script("return document.body.innerText"))
            self.driver.execute_script("document.querySelector('[data-scanner=\"2\"]').click()")
            self.wait("return document.body.innerText.includes('he-of-the-second')", "the second scanner's calibration")
            self.assertIn("ti-5ad0c2", self.driver.execute_script("return document.body.innerText"))
            self.accessible(f"/calibration of two scanners, {language}")
        self.set(arms=1)
        self.open("/line")
        self.assertNotIn("Robot 1", self.driver.execute_script("return document.body.innerText"))
        self.clean("two robots")

    def test_a_gauge_that_did_not_count_says_why_in_both_languages(self):
        for language, words in (("en", ("length_left", "5600.310", "usable", "of another slab")),
                                ("zh", ("length_left", "5600.310", "可用", "属于另一块板"))):
            self.open("/slabs/55", language)
            self.wait("return document.querySelector('[data-slab-verdict]') !== null", "the slab")
            text = self.driver.execute_script("return document.body.innerText")
            for word in words:
                self.assertIn(word, text)

    def test_grey_whatever_is_silent(self):
        for mode in ("silent", "hang", "garbage", "closed", "gone"):
            with self.subTest(mode):
                self.ask("reset=1")
                self.set(slab="pass")
                self.open("/")
                self.wait("return document.querySelectorAll('.big.v-pass').length === 1", "the verdict")
                self.set(status=mode)
                self.wait(STALE, mode)
                colours = self.driver.execute_script("return [...document.querySelectorAll('.tile')].map((e) => getComputedStyle(e).backgroundColor)")
                self.assertEqual(len(set(colours)), 1, "one grey for all blocks")
                self.assertEqual(self.driver.execute_script("return document.querySelectorAll('.big.v-pass').length"), 0)
                self.assertEqual(self.driver.execute_script(COLOURED), [], "no colour of a verdict on a stale page")
                if mode == "silent":
                    self.accessible("stale")
                    self.shot("stale")
                self.set(status="live")
                self.wait(FRESH, "fresh again")

    def test_grey_when_the_server_is_gone(self):
        other = subprocess.Popen(["node", os.path.join(PAGE, "test", "server.mjs")], stdout=subprocess.PIPE, text=True)
        address = other.stdout.readline().strip()
        self.driver.get(address + "/?lang=en")
        self.wait(FRESH, "loaded")
        other.kill()
        other.wait()
        other.stdout.close()
        self.wait(STALE, "killed")

    def test_a_wrong_clock_of_the_browser_changes_nothing(self):
        for added_ms in (-30_000_000_000, 30_000_000_000):
            with self.subTest(added_ms):
                self.ask("reset=1")
                self.slow_clocks(added_ms)
                self.open("/")
                time.sleep(4)
                self.assertEqual(self.stale(), "false")
                self.set(status="silent")
                self.wait(STALE, "silent")
                self.doCleanups()

    def test_a_page_that_slept_believes_nothing(self):
        for name, slept in (("shown again", "document.dispatchEvent(new Event('visibilitychange'))"),
                            ("suspended", "Date.now = () => wall + 8 * 3600e3")):
            with self.subTest(name):
                self.ask("reset=1")
                self.open("/")
                # With clocks that do not run, only the sleep makes the page stale.
                self.driver.execute_script(STOP_CLOCKS)
                self.wait(FRESH, "fresh at this time")
                self.set(status="hang")
                self.assertEqual(self.driver.execute_script(
                    f"const before = document.body.dataset.stale; const wall = Date.now(); {slept}; return before"), "false")
                self.wait(STALE, name)
                self.set(status="live")
                self.wait(FRESH, "an answer after the sleep")

    def test_a_new_verdict_is_announced_once_and_politely(self):
        self.open("/")
        self.driver.execute_script(WATCH_SAID)
        self.assertNotIn("Slab ", self.driver.execute_script("return document.querySelector('[role=status]').textContent"), "nothing when the page is opened")
        self.set(id="NEW-1")
        self.wait("return document.querySelector('main').innerText.includes('NEW-1')", "the new name")
        self.assertNotIn("Slab ", str(self.driver.execute_script("return window.said")), "a new name is not a new verdict")
        self.set(newest="1000 fail")
        self.wait_said("Slab NEW-1: FAIL", 1)

    def be_silent(self):
        self.set(status="silent")
        time.sleep(3)  # from now on every answer is too old
        self.wait(STALE, "stale")

    def wait_said(self, text, count):
        self.wait("return window.said.filter((one) => one === arguments[0]).length === arguments[1]", f"announced: {text}", text, count)

    def test_a_verdict_that_came_while_the_data_was_stale_is_announced_when_it_is_fresh(self):
        self.open("/")
        self.set(id="NEW-1")
        self.driver.execute_script(WATCH_SAID)
        self.be_silent()
        self.set(status="live", newest="1000 fail")
        self.wait_said("Slab NEW-1: FAIL", 1)
        self.be_silent()
        self.set(newest="1001 not_measured")
        self.wait("return document.querySelector('.live-last tbody .verdict').textContent.includes('not measured')", "the row")
        self.assertNotIn("Slab NEW-1: not measured", self.driver.execute_script("return window.said"))
        self.set(status="live")
        self.wait_said("Slab NEW-1: not measured", 1)

    def test_findings_in_another_language_than_the_servers_are_loading_until_they_come(self):
        self.set(slab="whole", database="0")
        self.open("/", "zh")
        findings = "return document.querySelector('.live-findings').innerText"
        self.wait("return document.querySelector('.big.v-fail') !== null", "the verdict")
        self.assertIn("正在加载", self.driver.execute_script(findings))
        self.assertNotIn("没有不合格", self.driver.execute_script(findings))
        self.set(database="1")
        self.wait("return document.querySelectorAll('.live-findings .finding').length === 1", "the findings")
        self.assertNotIn("正在加载", self.driver.execute_script(findings))
        self.set(slab="pass")
        self.wait("return document.querySelector('.live-findings').innerText.includes('没有不合格')", "no findings")

    def test_foreign_text_is_text(self):
        for text, shown in ((ATTACK, ATTACK), (CONTROL, "A␀␛[31mB⟨U+202E⟩C⟨U+200B⟩D"), (WIDE, WIDE)):
            for slab in ("fail", "open"):
                self.set(id=text, slab=slab)
                for path in ("/", "/slabs", "/slabs/55", "/slabs/55/blocks/4", "/?kiosk=1"):
                    for size in ("wide", "phone"):
                        self.size(size)
                        self.open(path)
                        where = f"{shown} {path} {size}"
                        found = self.driver.execute_script("return document.body.innerText.includes(arguments[0])", shown)
                        if path != "/slabs/55/blocks/4":
                            self.assertTrue(found, where)
                        self.assertEqual(self.driver.execute_script("return document.images.length"), 0, where)
                        self.assertNotEqual(self.driver.title, "1")
                        self.assertLessEqual(self.driver.execute_script("return document.documentElement.scrollWidth - innerWidth"), 0, where)
                        self.clean(where)

    def test_kiosk_shows_the_live_page_only(self):
        self.size("wide")
        for slab in ("odd", "open", "none"):
            self.set(slab=slab)
            self.open("/slabs?kiosk=1")
            self.assertEqual(self.driver.execute_script("return document.querySelectorAll('nav, main a').length"), 0)
            self.assertIsNotNone(self.driver.find_element(By.CLASS_NAME, "live"))
            self.accessible("kiosk")
            self.shot(f"kiosk-{slab}")

    def test_a_fault_is_named_with_its_cure(self):
        self.set(fault="504")
        self.open("/")
        self.wait("return document.querySelector('.band-fault') !== null", "the fault")
        band = self.driver.find_element(By.CLASS_NAME, "band-fault").text
        self.assertIn("504", band)
        self.assertIn("set the clock", band)
        self.accessible("fault")


class Stored(Browser):
    def test_a_draft_shows_its_picture_or_that_there_is_none(self):
        self.open("/drafts")
        self.driver.find_element(By.LINK_TEXT, "p4925").click()
        self.wait("const image = document.querySelector('img.draft-picture'); return image !== null && image.naturalWidth > 0",
                  "the picture is drawn")
        self.assertIn("block.jaw_half_distance_mm", self.driver.find_element(By.TAG_NAME, "main").text)
        self.open("/drafts/p5600")
        self.wait("return document.body.textContent.includes('cannot be shown')", "the missing picture is named")
        self.logs()

    def test_links_back_and_forward(self):
        self.open("/slabs")
        self.driver.find_element(By.CSS_SELECTOR, "a.row-link").click()
        self.wait("return /^.slabs.[0-9]+$/.test(location.pathname) && document.querySelector('.tile') !== null", "the slab")
        self.driver.find_element(By.CSS_SELECTOR, "a.tile[data-block='4']").click()
        self.wait("return location.pathname.endsWith('/blocks/4') && document.querySelector('.heat') !== null", "the block")
        self.driver.back()
        self.wait("return document.querySelector('a.tile') !== null", "back to the slab")
        self.driver.back()
        self.wait("return location.pathname === '/slabs' && document.querySelector('.filters') !== null", "back to the list")
        self.driver.forward()
        self.wait("return document.querySelector('a.tile') !== null", "forward to the slab")
        self.clean("history")

    def test_filters_are_in_the_address(self):
        self.open("/slabs?verdict=fail")
        words = self.driver.execute_script("return [...document.querySelectorAll('tbody .verdict')].map((e) => e.innerText.trim())")
        self.assertTrue(words)
        self.assertEqual({word.split()[-1] for word in words}, {"FAIL"})
        field = self.driver.find_element(By.CSS_SELECTOR, "input[type=search]")
        field.send_keys("C3-4155", Keys.ENTER)
        self.wait("return location.search.includes('id=C3-4155') && document.querySelectorAll('tbody tr').length === 1", "one slab")

    def test_fields_have_the_values_of_the_address_after_back(self):
        for path, css, query, before in (("/slabs?verdict=fail", "input[type=search]", "id=C3-4155", ""),
                                         ("/compare?a=55&b=60", "form input[type=text]", "a=59", "55"),
                                         ("/plant?id=C3-4155", "input[type=search]", "id=C3-4159", "C3-4155")):
            with self.subTest(path):
                self.open(path)
                field = self.driver.find_element(By.CSS_SELECTOR, css)
                self.assertEqual(field.get_attribute("value"), before)
                field.clear()
                field.send_keys(query.split("=")[1], Keys.ENTER)
                self.wait("return location.search.includes(arguments[0])", "the new address", query)
                self.driver.back()
                self.wait("return !location.search.includes(arguments[0]) && document.querySelector(arguments[1]).value === arguments[2]",
                          "one step back", query, css, before)

    def test_the_list_is_renewed_when_a_slab_is_judged(self):
        self.open("/slabs")
        self.wait("return document.querySelector('tbody tr') !== null", "the list")
        self.set(id="NEW-2", newest="1000 fail")
        self.wait("return document.querySelector('tbody').innerText.includes('NEW-2')", "the list is renewed")

    def test_the_heat_map_is_read_by_pointer_and_keyboard(self):
        self.open("/slabs/55/blocks/4")
        frame = self.driver.find_element(By.CLASS_NAME, "heat-frame")
        value = self.driver.find_element(By.CLASS_NAME, "heat-value")
        first = value.text
        self.assertRegex(first, r"^x -?[\d.]+ mm, y -?[\d.]+ mm: ")
        frame.send_keys(Keys.ARROW_RIGHT)
        self.wait("return document.querySelector('.heat-value').textContent !== arguments[0]", "moved", first)
        second = value.text
        webdriver.ActionChains(self.driver).move_to_element_with_offset(frame, 20, 30).perform()
        self.wait("return document.querySelector('.heat-value').textContent !== arguments[0]", "pointed", second)

    def test_a_block_of_an_open_slab_is_provisional_and_renewed_until_the_slab_has_ended(self):
        path = "/slabs/55/blocks/4"
        for language, words in (("en", "still open"), ("zh", "未结束")):
            self.set(ended="0")
            self.open(path, language)
            self.assertIn(words, self.driver.execute_script(f"return {BAND}.innerText"))
            self.assertEqual(self.driver.execute_script(f"return {BAND}.dataset.verdict"), "none", "a pass is not final")
            self.assertEqual(self.driver.execute_script(f"return {BAND}.querySelector('.large')"), None)
            self.assertEqual(self.driver.execute_script(
                f"const band = {BAND}; const of = (e) => getComputedStyle(e);"
                "return [of(band).backgroundColor, of(band.querySelector('.verdict')).color === of(band).color]"),
                ["rgba(0, 0, 0, 0)", True])
            self.accessible(f"open slab, {language}")
        self.ask("reports=1")  # those of axe itself
        self.driver.find_element(By.CSS_SELECTOR, "button[aria-pressed=false]").click()
        self.driver.find_element(By.CSS_SELECTOR, "button[aria-expanded]").click()
        self.wait("return document.querySelector('.surface-frame[data-ready=true] canvas') !== null", "the surface")
        self.driver.execute_script(WATCH_DIMMED)
        self.wait_renewed(path, 2)
        self.wait_renewed(f"{path}/map")
        self.logs()
        self.set(database="0")
        self.wait_renewed(path)
        time.sleep(0.5)
        self.assertEqual(self.driver.execute_script("return document.querySelectorAll('main .trouble').length"), 0)
        self.set(database="1", ended="1")
        self.wait(f"return {BAND}.dataset.verdict === 'fail' && {BAND}.querySelector('.large') !== null", "the verdict")
        self.assertNotIn("未结束", self.driver.execute_script(f"return {BAND}.innerText"))
        self.assertEqual(self.driver.execute_script("return window.dimmed"), 0, "a renewal is not shown as loading")
        self.assertEqual(self.driver.execute_script("return [document.querySelectorAll('button[aria-pressed=true]').length > 0, "
                                                    "document.querySelectorAll('.surface-frame canvas').length]"), [True, 1])
        self.wait_quiet((path, f"{path}/map"), "a slab that has ended is not asked for again")
        self.assertEqual(self.ask("reports=1"), [])
        # Only the answers without a database; the last of them may be later than the database.
        self.assertEqual([entry for entry in self.logs() if "status of 503" not in entry], [])

    def test_an_open_slab_is_renewed_until_it_has_ended(self):
        self.set(ended="0")
        self.open("/slabs/55")
        self.assertEqual(self.driver.execute_script(f"return {BAND}.dataset.slabVerdict"), "none")
        self.assertNotIn("within its limits", self.driver.find_element(By.TAG_NAME, "main").text)
        self.driver.execute_script(WATCH_DIMMED)
        self.wait_renewed("/slabs/55")
        self.set(ended="1")
        self.wait(f"return {BAND}.dataset.slabVerdict === 'fail'", "the verdict")
        self.wait("return document.querySelectorAll('.findings .finding').length > 0", "the findings")
        self.assertEqual(self.driver.execute_script("return window.dimmed"), 0, "a renewal is not shown as loading")
        counts = self.wait_quiet(("/slabs/55", "/slabs/55/map", "/slabs/55/pin"), "a slab that has ended is not asked for again")
        self.assertEqual([count > 1 for count in counts], [True, True, True])
        self.clean("open slab")

    def test_maps_of_an_older_attempt_than_the_verdict_are_named(self):
        note = "return document.querySelector('main .warning-line')?.innerText ?? ''"
        for language, words in (("en", "attempt 1, the newest that was measured. The verdict is that of attempt 2"),
                                ("zh", "第 1 次扫描（最近一次有测量结果的扫描）；结论属于第 2 次扫描")):
            self.set(attempts="2")
            self.open("/slabs/55/blocks/4", language)
            self.wait("return document.querySelector('.heat') !== null", "the map")
            self.assertIn(words, self.driver.execute_script(note))
            self.accessible(f"two attempts, {language}")
            self.set(attempts="1")
            self.open("/slabs/55/blocks/4", language)
            self.wait("return document.querySelector('.heat') !== null", "the map")
            self.assertEqual(self.driver.execute_script(note), "")

    def test_the_scale_of_a_comparison_stays_when_another_block_is_chosen(self):
        choose = ("const one = document.querySelectorAll('main select')[arguments[0]]; one.value = arguments[1];"
                  "one.dispatchEvent(new Event('change', {bubbles: true}))")
        self.open("/compare?a=55&b=60")
        for station in ("4", "11"):
            self.driver.execute_script(choose, 0, station)
            self.wait("return document.querySelector('.three .heat-frame')?.ariaLabel.includes(`block ${arguments[0]}.`)",
                      "the maps", station)
            if station == "4":
                self.driver.execute_script(choose, 1, "0.5")
            self.assertEqual(self.driver.execute_script("return document.querySelectorAll('main select')[1].value"), "0.5")
        self.clean("compare")

    def test_the_surface_turns_by_keyboard(self):
        self.open("/slabs/55/blocks/4")
        self.assertEqual(self.driver.execute_script("return performance.getEntriesByType('resource').filter((e) => e.name.includes('three')).length"), 0)
        self.driver.find_element(By.CSS_SELECTOR, "button[aria-expanded]").click()
        self.wait("return document.querySelector('.surface-frame[data-ready=true] canvas') !== null", "the surface")
        self.turn_by_keyboard([Keys.ARROW_LEFT] * 4)
        self.accessible("surface")
        self.clean("surface")
        self.shot("surface")

    def test_the_scan_is_loaded_when_it_is_chosen(self):
        self.slow_clocks()
        self.open("/slabs/55/blocks/4")
        self.driver.find_element(By.CSS_SELECTOR, "button[aria-expanded]").click()
        self.wait("return document.querySelector('.surface-frame[data-ready=true] canvas') !== null", "the surface")
        asked = "return performance.getEntriesByType('resource').filter((e) => e.name.endsWith('/cloud')).length"
        self.assertEqual(self.driver.execute_script(asked), 0)
        self.driver.find_elements(By.CSS_SELECTOR, ".surface [role=group] button")[1].click()
        self.wait("return document.querySelector('.surface-frame').dataset.shown === 'scan'", "the scan")
        self.assertEqual(self.driver.execute_script(asked), 1)
        self.assertRegex(self.driver.find_element(By.CSS_SELECTOR, ".surface .scale").text, r"2830 of \d+ points")
        self.turn_by_keyboard([Keys.ARROW_LEFT])
        self.accessible("scan")
        self.clean("scan")
        self.shot("scan")


if __name__ == "__main__":
    for program in ("chromium", "chromedriver", "node"):
        if shutil.which(program) is None:
            print(f"SKIP: {program} is not installed", file=sys.stderr)
            sys.exit(77)
    unittest.main(verbosity=2)
