#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""Logins, decisions and pins on the page in a real browser, against web/page/test/server.mjs. Options as of page_test.py."""
import json
import time
import unittest
import urllib.request

from page_test import SMALL_TARGETS, Browser, By, Keys

SUBMIT = "form button[type=submit]"
# Small targets of a form also count.
TARGETS = SMALL_TARGETS.replace("'button,", "'button,textarea,")
KEPT = "[...document.querySelectorAll('.facts bdi')].some((e) => e.innerText === 'complaint 17')"


class Login(Browser):
    def setUp(self):
        self.driver.delete_all_cookies()
        super().setUp()

    def field(self, name):
        return self.driver.find_element(By.NAME, name)

    def press(self, css, index=0):
        self.driver.find_elements(By.CSS_SELECTOR, css)[index].click()

    def log_in(self, name="mei", password="right"):
        for field, text in (("name", name), ("password", password)):
            self.field(field).clear()
            self.field(field).send_keys(text)
        self.press(SUBMIT)

    def choose(self, index):
        """By index: Preact writes no value="scrap" when it equals the text."""
        self.driver.execute_script("arguments[0].selectedIndex = arguments[1];"
                                   "arguments[0].dispatchEvent(new Event('change', {bubbles: true}))", self.field("decision"), index)

    def text(self, css):
        return self.driver.execute_script("return [...document.querySelectorAll(arguments[0])].map((e) => e.innerText).join('|')", css)

    def count(self, css):
        return self.driver.execute_script("return document.querySelectorAll(arguments[0]).length", css)

    def usable(self, where):
        self.assertLessEqual(self.driver.execute_script("return document.documentElement.scrollWidth - innerWidth"), 0, where)
        self.assertEqual(self.driver.execute_script(TARGETS), [], where)
        self.accessible(where)
        self.assertEqual(self.ask("reports=1"), [], where)

    def picture(self, name, size):
        self.shot(name)
        self.size(size)

    def wait_focus(self, name, message):
        self.wait("return document.activeElement.name === arguments[0]", message, name)

    def decide_elsewhere(self, key, decision):
        """Another browser records a decision about the slab `key`."""
        def post(path, body, cookie):
            return urllib.request.urlopen(urllib.request.Request(
                self.base + "/api/v1" + path, json.dumps(body).encode(), {"Content-Type": "application/json", "Cookie": cookie}))
        with post("/login", {"name": "mei", "password": "right"}, "") as answer:
            cookie = answer.headers["Set-Cookie"].split(";")[0]
        with post(f"/slabs/{key}/disposition", {"decision": decision, "reason": "seen at the line", "authority": "Li Wei"}, cookie) as answer:
            self.assertEqual(json.load(answer)["schema"], "slabd.web_done/1")

    def wait_decisions(self, count, message):
        self.wait("return document.querySelectorAll('.dispositions li').length === arguments[0]", message, count)

    def decide(self, language, size):
        self.wait_focus("decision", "the first field without a value has the focus")
        self.choose(4)
        self.field("reason").send_keys("crack" + Keys.ENTER + "too deep")
        self.assertEqual(self.field("reason").get_attribute("value"), "crack too deep")
        self.assertEqual(self.field("authority").get_attribute("value"), "mei")
        self.press(SUBMIT)
        self.wait("return document.activeElement.tagName === 'H3'", "confirmation")
        self.usable("confirmation")
        self.picture(f"confirm-{language}-{size}", size)
        self.set(refuse="503")
        self.press(".form > .buttons button")
        self.wait("return document.querySelector('.panel > .trouble')", "refused")
        self.set(refuse="")
        self.press(".form > .buttons button", 1)
        self.wait_focus("decision", "back")
        self.assertEqual(self.field("reason").get_attribute("value"), "crack too deep")
        self.press(SUBMIT)
        self.wait("return document.activeElement.tagName === 'H3'", "confirmation")
        self.press(".form > .buttons button")
        self.wait_decisions(3, "recorded")
        self.assertIn("disposition 3 of slab 55: scrap", self.text("main [role=status]"))
        self.assertEqual(self.field("reason").get_attribute("value"), "")

    def pin(self, language, size):
        form = self.driver.find_elements(By.CSS_SELECTOR, "main form")[-1]
        form.find_element(By.NAME, "reason").send_keys("complaint 17", Keys.TAB, Keys.ENTER)
        self.wait(f"return {KEPT}", "pinned")
        self.wait("return document.activeElement.tagName === 'BUTTON'", "focus")
        self.usable("pinned")
        self.picture(f"done-{language}-{size}", size)
        self.driver.switch_to.active_element.send_keys(Keys.ENTER)
        self.wait(f"return !{KEPT}", "unpinned")

    def test_a_user_logs_in_decides_and_pins(self):
        for language in ("en", "zh"):
            for size in ("panel", "phone"):
                with self.subTest(f"{language} {size}"):
                    self.driver.delete_all_cookies()
                    self.ask("reset=1")
                    self.size(size)
                    self.open("/slabs/55", language)
                    self.usable("without a login")
                    self.press(".account a")
                    self.wait("return location.pathname === '/login'", "login")
                    self.assertIn("to=%2Fslabs%2F55", self.driver.current_url)
                    self.press(SUBMIT)
                    self.wait_focus("name", "no name")
                    self.log_in("mei", "wrong")
                    self.wait("return document.querySelector('.trouble') && document.activeElement.name === 'password'", "wrong")
                    self.usable("login")
                    self.picture(f"login-{language}-{size}", size)
                    self.log_in()
                    self.wait("return location.pathname === '/slabs/55' && document.querySelector('select[name=decision]')", "slab")
                    self.usable("slab")
                    self.picture(f"slab-quality-{language}-{size}", size)
                    self.press(SUBMIT)
                    self.wait("return document.querySelector('form [role=alert]')", "no decision")
                    self.decide(language, size)
                    self.pin(language, size)
                    self.open("/slabs/60", language)
                    self.assertEqual(self.count("select[name=decision]"), 0, "a slab that passed")
                    self.press(".account button")
                    self.wait("return document.querySelector('.account a')", "logged out")

    def test_a_draft_survives_a_login_that_ends(self):
        self.set(second="1")
        self.open("/login?to=/slabs/55")
        self.log_in()
        self.wait("return document.querySelector('input[name=second]')", "second person")
        self.choose(1)
        self.field("reason").send_keys("burr")
        self.field("second").send_keys("mei")
        self.press(SUBMIT)
        self.wait_focus("second", "two persons must decide")
        self.field("second").send_keys(" 2")
        self.press(SUBMIT)
        self.wait("return document.activeElement.tagName === 'H3'", "confirmation")
        self.driver.delete_all_cookies()
        self.press(".form > .buttons button")
        self.wait("return document.querySelector('.account a') && !document.querySelector('select[name=decision]')", "the login has ended")
        self.press(".account a")
        self.wait("return document.querySelector('input[name=password]')", "login")
        self.log_in()
        self.wait("return document.querySelector('[name=reason]')?.value === 'burr' && "
                  "document.querySelector('[name=second]').value === 'mei 2'", "draft")

    def test_a_decision_from_another_browser_is_shown_before_the_next_one_is_recorded(self):
        self.open("/login?to=/slabs/55")
        self.log_in()
        self.wait("return document.querySelector('select[name=decision]')", "the form")
        self.choose(4)
        self.field("reason").send_keys("crack")
        self.press(SUBMIT)
        self.wait("return document.activeElement.tagName === 'H3'", "confirmation")
        self.decide_elsewhere(55, "hold")
        self.press(".form > .buttons button")
        self.wait("return document.querySelector('.panel > .trouble')?.innerText.includes('meanwhile')", "not recorded")
        self.wait_decisions(3, "the other decision")
        self.wait_focus("decision", "the form again")
        self.assertEqual(self.field("reason").get_attribute("value"), "crack")
        self.usable("another decision")
        self.press(SUBMIT)
        self.wait("return document.activeElement.tagName === 'H3'", "confirmation")
        self.assertEqual(self.count(".panel > .trouble"), 0)
        self.press(".form > .buttons button")
        self.wait_decisions(4, "recorded")
        self.assertIn("disposition 4 of slab 55: scrap", self.text("main [role=status]"))

    def test_a_decision_from_another_browser_appears(self):
        self.open("/slabs/55")
        self.wait_decisions(2, "the slab")
        self.decide_elsewhere(55, "scrap")
        self.wait_decisions(3, "a slab of the live page")
        self.open("/slabs")
        self.wait("return document.querySelector('tbody tr') !== null", "the list")
        self.decide_elsewhere(58, "rework")
        self.wait("return [...document.querySelectorAll('tbody tr')].some((e) => e.innerText.includes('C3-4158') && e.innerText.includes('rework'))",
                  "the list")
        self.open("/slabs/30")
        self.wait_decisions(2, "an older slab")
        self.decide_elsewhere(30, "hold")
        self.driver.execute_script("document.dispatchEvent(new Event('visibilitychange'))")
        self.wait_decisions(3, "the page was hidden meanwhile")

    def test_a_reason_is_typed_while_the_slab_ends(self):
        self.set(ended="0")
        self.open("/login?to=/slabs/55")
        self.log_in()
        self.wait("return document.querySelector('main form [name=reason]')", "the form")
        self.field("reason").send_keys("complaint 1")
        self.wait_renewed("/slabs/55/pin", 2)
        self.set(ended="1")
        self.wait("return document.querySelector('select[name=decision]')", "the slab has ended")
        self.driver.switch_to.active_element.send_keys("7")
        self.assertEqual(self.driver.execute_script("return [...document.querySelectorAll('[name=reason]')].map((e) => e.value)"),
                         ["", "complaint 17"])

    def test_a_viewer_reads_and_guessing_is_slowed_down(self):
        self.open("/login?to=//evil.example")
        self.log_in("wei")
        self.wait("return location.pathname === '/' && document.querySelector('.account-name')", "live page, not another server")
        self.open("/slabs/55")
        self.assertEqual(self.count("main form"), 0)
        self.assertIn("role quality", self.text("main p.quiet"))
        self.open("/login")
        self.assertIn("reads only", self.text("main p"))
        for _ in range(6):
            self.log_in("mei", "wrong")
            self.wait("return document.querySelector('form button').ariaDisabled === 'false' && document.querySelector('.trouble')", "answer")
        self.wait("return document.querySelector('.trouble').innerText.includes('30 s')", "wait")

    def test_a_login_that_the_browser_does_not_send_back_is_explained(self):
        self.set(cookie="0")
        for language, words in (("en", "allow cookies"), ("zh", "Cookie")):
            self.driver.delete_all_cookies()
            self.open("/login?to=/slabs/55", language)
            self.log_in()
            self.wait("return document.querySelector('form .trouble')", "the login does not come back")
            self.assertIn(words, self.text("form .trouble"))
            self.assertEqual(self.text(".account-name"), "")
            self.usable("cookie refused")

    def test_without_a_login_nothing_is_shown_if_it_is_required(self):
        self.set(required="1")
        for language in ("en", "zh"):
            for path in ("/", "/slabs/55", "/?kiosk=1", "/trends/seat_slope"):
                self.driver.get(self.base + path + ("&" if "?" in path else "?") + f"lang={language}")
                self.wait("return document.querySelector('input[name=password]')", path)
                time.sleep(3.2)  # the page would be grey by now
                self.wait("return document.body.dataset.stale === 'false' && !document.querySelector('.band')", f"{path}: no band")
                self.assertEqual(self.count("main h1"), 1)
                self.usable(path)
        self.driver.get(self.base + "/about?lang=en")
        self.wait("return document.querySelector('.licences')?.textContent.length > 100", "about")
        self.driver.get(self.base + "/slabs/55?lang=en")
        self.wait("return document.querySelector('input[name=password]')", "login")
        self.log_in("wei")
        self.wait("return location.pathname === '/slabs/55' && document.querySelector('.slab-verdict') && "
                  "document.body.dataset.stale === 'false' && !document.querySelector('.band-stale')", "slab")
        self.set(status="silent")
        self.wait("return document.querySelector('.band-stale')", "stale")
        self.set(status="live")
        self.wait("return !document.querySelector('.band-stale')", "fresh")
        self.driver.delete_all_cookies()
        self.wait("return document.querySelector('input[name=password]')", "the login has ended")
        self.assertEqual(self.text(".band"), "")
        self.driver.execute_script("fetch('/api/v1/login', {method: 'POST', headers: {'Content-Type': 'application/json'},"
                                   "body: JSON.stringify({name: 'mei', password: 'right'})})")
        self.wait("return document.querySelector('.slab-verdict') && document.querySelector('.account-name')", "another tab logs in")

    def test_without_accounts_the_page_offers_no_login(self):
        self.set(users="0")
        self.open("/login")
        self.assertIn("not possible", self.text("main"))
        self.assertEqual(self.text(".account"), "")
        self.open("/slabs/55")
        self.assertNotIn("role quality", self.text("main"))


if __name__ == "__main__":
    unittest.main()
