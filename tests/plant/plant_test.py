#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""slabd-plant against a real PostgreSQL: what it sends, and what happens when a part fails.

  plant_test.py BUILD     BUILD: folder with plant/slabd-plant and cli/slabctl

Exit status 77 (skipped) if no PostgreSQL server is installed.
"""
import csv
import io
import json
import os
import pathlib
import random
import shutil
import signal
import sqlite3
import subprocess
import sys
import tempfile
import time
import unittest

import jsonschema

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))
from server import Proxy, Server, as_user  # noqa: E402

SOURCE = pathlib.Path(__file__).resolve().parents[2]
BUILD = pathlib.Path(sys.argv.pop(1)).resolve()
SLABS = 60
OK, DIFFERS, UNREACHABLE = 0, 1, 4
INBOX = "SELECT replace(epoch::text, '-', ''), seq, encode(sha256, 'hex') FROM plant.inbox"
SCHEMAS = {schema["$id"]: schema for schema in
           (json.loads(path.read_text()) for path in (SOURCE / "docs/schemas").glob("*.json"))}


def validate(document):
    """Against the schema of its name in docs/schemas."""
    name, version = document["schema"].removeprefix("slabd.").split("/")
    resolver = jsonschema.RefResolver("", {}, store=SCHEMAS)
    jsonschema.Draft202012Validator(SCHEMAS[f"urn:slabd:{name}:{version}"], resolver=resolver).validate(document)


class Line:
    """A stored history and its configuration; no daemon."""

    def __init__(self, server, name, slabs=SLABS, seed=1, days=2):
        self.folder = pathlib.Path(tempfile.mkdtemp(prefix=f"slabd-{name}-"))
        self.db = self.folder / "slabd.db"
        self.config = self.folder / "slabd.toml"
        self.configure(server.dsn(), name)
        subprocess.run([BUILD / "cli/slabctl", "simulate", "history", "--slabs", str(slabs), "--seed", str(seed),
                        "--out", self.db, "--days", str(days), "--recipe", SOURCE / "recipes/p5600.toml"], check=True,
                       stdout=subprocess.DEVNULL)

    def configure(self, dsn, name, more=""):
        self.config.write_text(f"""
[plc]
listen = "127.0.0.1:1"
[storage]
db = "slabd.db"
spool_dir = "spool"
[recipes]
dir = "{SOURCE}/recipes"
[cell]
T_base_slab = [1800.0, 0.0, 300.0, 1.0, 0.0, 0.0, 0.0]
[control]
socket = "control.sock"
[plant]
dsn = "{dsn}"
line = "{name}"
{more}
""")

    def plant(self, *arguments, **how):
        return subprocess.run([BUILD / "plant/slabd-plant", "--config", self.config, *arguments], capture_output=True,
                              text=True, **how)

    def slabctl(self, *arguments):
        return subprocess.run([BUILD / "cli/slabctl", *arguments, "--config", self.config], capture_output=True,
                              text=True, check=True).stdout

    def sql(self, text, *values):
        with sqlite3.connect(self.db) as db:
            return db.execute(text, values).fetchall()

    def rows(self):
        """(epoch, number) of all rows of the outbox."""
        return {(uuid, seq) for uuid, seq in
                self.sql("SELECT uuid, seq FROM outbox JOIN epoch ON epoch.n = outbox.epoch")}

    def close(self):
        shutil.rmtree(self.folder, ignore_errors=True)


class PlantTest(unittest.TestCase):
    def setUp(self):
        self.server = Server()
        self.addCleanup(self.server.close)
        self.line = self.history("hall-1")
        self.run_plant("--init")

    def history(self, name, **how):
        line = Line(self.server, name, **how)
        self.addCleanup(line.close)
        return line

    def run_plant(self, *arguments, line=None, status=OK):
        done = (line or self.line).plant(*arguments)
        self.assertEqual(done.returncode, status, done.stdout + done.stderr)
        return done.stdout + done.stderr

    def make_real(self):
        """Slabs of the history are emulated; from now on those that arrived are counted as if they were of concrete."""
        self.server.run("UPDATE plant.slab SET emulated = false; UPDATE plant.item SET emulated = false")

    def inbox(self):
        return {(epoch, int(seq)) for epoch, seq, _ in self.server.run(INBOX)}

    def assert_complete(self, line=None):
        line = line or self.line
        self.assertEqual({key for key in self.inbox() if key[0] in {epoch for epoch, _ in line.rows()}}, line.rows())
        checked = json.loads(line.plant("--check", "--json").stdout)
        validate(checked)
        self.assertTrue(checked["complete"], checked)
        self.assertEqual(checked["troubles"], 0)

    # ---- what arrives ------------------------------------------------------------------------------------------------

    def test_each_row_of_the_outbox_arrives_once(self):
        self.run_plant("--once")
        self.assert_complete()
        self.assertEqual(self.server.one("SELECT count(*) FROM plant.slab"), str(SLABS))
        self.assertEqual(self.server.one("SELECT count(*) FROM plant.trouble"), "0")
        before = self.server.run(INBOX + " ORDER BY 1, 2")
        self.run_plant("--once")  # no daemon has noted what arrived
        self.assertEqual(self.server.run(INBOX + " ORDER BY 1, 2"), before)

    def test_documents_have_the_form_of_their_schemas(self):
        self.run_plant("--once")
        for kind in self.server.run("SELECT DISTINCT kind FROM plant.inbox"):
            validate(json.loads(self.server.one(f"SELECT doc FROM plant.inbox WHERE kind = '{kind[0]}' LIMIT 1")))

    def test_numbers_are_those_of_the_line_to_the_last_digit(self):
        self.run_plant("--once")
        there = {}
        for key, item, station, to, *numbers in self.server.run(
                "SELECT slab_key, item, station, station_to, value, nominal, lower, upper, u, verdict FROM "
                "plant.v_item"):
            there[int(key), item, int(station), int(to)] = numbers
        found = self.sql_items()
        self.assertGreater(len(found), SLABS * 200)
        self.assertEqual(set(there), set(found))
        for place, numbers in found.items():
            for stored, sent in zip(numbers[:-1], there[place][:-1]):
                self.assertEqual(stored, float(sent) if sent else None, place)
            self.assertEqual(numbers[-1], there[place][-1], place)

    def sql_items(self):
        """The valid items, found without the program under test."""
        rows = self.line.sql("""SELECT slab_key, id, from_station, to_station, value, nominal, lower, upper, U, verdict,
            station FROM item WHERE station = 0 OR attempt = (SELECT max(attempt) FROM attempt a WHERE a.slab_key =
            item.slab_key AND a.station = item.station)""")
        items = {}
        for key, item, station, to, *numbers, of_block in sorted(rows, key=lambda row: row[-1] == 0):
            place = (key, item, of_block or station, to)
            judged = numbers[2] is not None or numbers[3] is not None
            if of_block == 0 and place in items and not judged:
                continue
            items[place] = numbers
        return items

    def test_views_count_as_slabctl_does(self):
        self.run_plant("--once")
        self.make_real()
        rows = json.loads(self.line.slabctl("history", "--limit", "1000", "--json"))["slabs"]
        passed = sum(row["verdict"] == "pass" for row in rows)
        self.assertEqual(self.server.one("SELECT count(*) FROM plant.v_slab WHERE verdict = 'pass'"), str(passed))
        counted = json.loads(self.line.slabctl("yield", "--by", "day", "--json"))
        total = self.server.run("SELECT sum(slabs), sum(passed) FROM plant.v_first_pass_yield")[0]
        groups = [group for group in counted["groups"] if group["group"] != "all"]
        self.assertEqual([int(total[0]), int(total[1])],
                         [sum(group["inspected"] for group in groups), sum(group["passed"] for group in groups)])
        failed = self.server.one("SELECT sum(failed) FROM plant.v_pareto")
        self.assertEqual(int(failed), sum(numbers[-1] == "fail" for numbers in self.sql_items().values()))
        for view in ("v_mould", "v_spc", "v_open_fault"):
            self.server.run(f"SELECT * FROM plant.{view} LIMIT 5")

    def test_the_plant_page_has_its_documents(self):
        self.run_plant("--once")
        overview = json.loads(self.line.plant("--show", "overview", "--days", "3650").stdout)
        validate(overview)
        self.assertEqual(overview["lines"][0]["slabs"], SLABS)
        slab_id = self.server.one("SELECT slab_id FROM plant.slab WHERE verdict <> 'pass' LIMIT 1")
        found = json.loads(self.line.plant("--show", f"slab={slab_id}").stdout)
        validate(found)
        self.assertGreater(len(found["slabs"][0]["items"]), 0)

    def test_decisions_and_checks_follow_their_slab(self):
        key, = self.line.sql("SELECT min(slab_key) FROM slab_result WHERE verdict <> 'pass'")[0]
        self.run_plant("--once")
        self.line.slabctl("disposition", f"key:{key}", "--decision", "rework", "--reason", "seat ground", "--authority",
                          "Li Wei", "--operator", "anna")
        self.run_plant("--once")
        self.assertEqual(self.server.one(f"SELECT disposition FROM plant.v_slab WHERE slab_key = {key}"), "rework")
        self.assert_complete()

    def test_gauges_and_their_checks_follow_their_slab(self):
        with sqlite3.connect(self.line.db) as db:  # as slabd stores them; the history has none
            for key, value, state in ((7, 5600.1234567890123, "ok"), (8, None, "missing")):
                db.execute("INSERT INTO gauge_value VALUES (?, 0, 'length_left', 'plc:40', 'mm', ?, ?, 0.08, 0.06, 3, ?, "
                           "?, 2.5, 0, NULL)", (key, state, value, key, 1_700_000_000_000_000 if value else 0))
            db.execute("INSERT INTO gauge_check VALUES (1, 'length_left', 'mm', 5600.05, 5600.012, 0.02, 0.1, 1, "
                       "1700000000000000, 'anna', 'start of shift', 'plc:40')")
        self.run_plant("--once")
        self.assert_complete()
        asked = "SELECT slab_key, gauge, unit, state, value, u, checked FROM plant.v_gauge ORDER BY slab_key"
        expected = [["7", "length_left", "mm", "ok", "5600.123456789012", "0.08", ""],
                    ["8", "length_left", "mm", "missing", "", "0.08", ""]]
        self.assertEqual(self.server.run(asked), expected)
        for kind, name in (("slab", "plant_slab"), ("gauge_check", "plant_record")):
            document = json.loads(self.server.one(f"SELECT doc FROM plant.inbox WHERE kind = '{kind}' LIMIT 1"))
            self.assertEqual(document["schema"], f"slabd.{name}/1")
            validate(document)
        checks = "SELECT name, passed, value, within, who FROM plant.gauge_check"
        self.assertEqual(self.server.run(checks), [["length_left", "t", "5600.05", "0.1", "anna"]])
        self.server.one("SELECT plant.unfold_all()")
        self.assertEqual(self.server.run(asked), expected)
        self.assertEqual(self.server.one("SELECT count(*) FROM plant.gauge_check"), "1")
        self.reopen(7)
        self.run_plant("--once")
        self.assertEqual(self.server.run(asked), expected[1:])

    def test_months_have_partitions_and_odd_times_do_not_stop_a_line(self):
        self.run_plant("--once")
        self.assertEqual(self.server.one("SELECT count(*) FROM plant.item_other"), "0")
        document = json.loads(self.server.one("SELECT doc FROM plant.inbox WHERE kind = 'slab' LIMIT 1"))
        document["slab_key"] += 100_000
        document["ended_utime_us"] = 7_000_000_000_000_000  # a clock of the year 2191
        epoch = self.server.one("SELECT epoch FROM plant.epoch")
        self.server.run(f"INSERT INTO plant.inbox VALUES ('{epoch}', 999999, 'slab', decode('{'ab' * 32}', 'hex'), "
                        f"$json${json.dumps(document)}$json$)")
        self.assertEqual(self.server.one("SELECT count(*) FROM plant.trouble"), "0")
        self.assertEqual(int(self.server.one("SELECT count(*) FROM plant.item_other")), len(document["items"]))

    def test_a_document_that_cannot_be_unfolded_does_not_hold_up_others(self):
        self.run_plant("--once")
        epoch = self.server.one("SELECT epoch FROM plant.epoch")
        for seq, kind, text in ((900001, "slab", '{"verdict": "pass"}'), (900002, "weather", "{}")):
            self.server.run(f"INSERT INTO plant.inbox VALUES ('{epoch}', {seq}, '{kind}', decode('{'cd' * 32}', "
                            f"'hex'), '{text}')")
        self.assertEqual(self.server.run("SELECT seq FROM plant.trouble ORDER BY seq"), [["900001"], ["900002"]])
        self.assertIn("weather", self.server.one("SELECT why FROM plant.trouble WHERE seq = 900002"))
        self.assertEqual(self.server.one("SELECT plant.unfold_again()"), "0")

    # ---- what goes wrong ---------------------------------------------------------------------------------------------

    def test_without_a_schema_and_with_an_older_one_nothing_is_sent(self):
        self.server.run("UPDATE plant.version SET version = 0")
        self.assertIn("--init", self.run_plant("--once", status=UNREACHABLE))
        self.server.run("DROP SCHEMA plant CASCADE")
        self.assertIn("has no schema", self.run_plant("--once", status=UNREACHABLE))
        self.run_plant("--init")
        self.run_plant("--once")
        self.assert_complete()

    def test_a_newer_schema_takes_what_an_older_line_sends(self):
        self.server.run("UPDATE plant.version SET version = 2")
        self.run_plant("--once")
        self.assert_complete()
        self.assertIn("newer", self.run_plant("--init", status=UNREACHABLE))

    def test_roles_have_the_rights_they_need_and_no_others(self):
        self.server.run("CREATE ROLE line LOGIN; CREATE ROLE office LOGIN")
        self.line.configure(self.server.dsn("line"), "hall-1")
        self.assertIn("GRANT slabd_plant_writer", self.run_plant("--once", status=UNREACHABLE))
        self.assertEqual(self.inbox(), set())
        self.server.run("GRANT slabd_plant_writer TO line; GRANT slabd_plant_reader TO office")
        self.run_plant("--once")
        self.assert_complete()
        self.assertEqual(self.server.one("SELECT count(*) FROM plant.v_slab", user="office"), str(SLABS))
        for user, sql in (("office", "DELETE FROM plant.slab"), ("line", "DELETE FROM plant.inbox"),
                          ("line", "UPDATE plant.slab SET verdict = 'pass'"), ("line", "TRUNCATE plant.item"),
                          ("line", "SELECT plant.unfold_again()"), ("admin", "UPDATE plant.inbox SET kind = 'x'")):
            with self.assertRaises(RuntimeError, msg=f"{user}: {sql}"):
                self.server.run(sql, user=user)

    def test_the_same_number_with_another_content_stops_this_line_only(self):
        self.run_plant("--once")
        twin = self.history("hall-9", seed=5)
        shutil.copy(self.line.db, twin.db)  # a disk image on a second computer
        twin.configure(self.server.dsn(), "hall-1")
        for line, who in ((self.line, "anna"), (twin, "bert")):
            key, = line.sql("SELECT min(slab_key) FROM slab_result WHERE verdict <> 'pass'")[0]
            line.slabctl("disposition", f"key:{key}", "--decision", "hold", "--reason", "look", "--authority", who,
                         "--operator", who)
        self.run_plant("--once")
        before = self.server.run(INBOX + " ORDER BY 1, 2")
        self.assertIn("another content", self.run_plant("--once", line=twin, status=UNREACHABLE))
        self.assertEqual(self.server.run(INBOX + " ORDER BY 1, 2"), before)
        self.assertFalse(json.loads(twin.plant("--check", "--json").stdout)["complete"])

    def test_two_lines_with_one_name_are_told_apart(self):
        self.run_plant("--once")
        other = self.history("hall-1", seed=2)
        self.assertIn("another database", self.run_plant("--once", line=other, status=UNREACHABLE))
        self.assertEqual(self.inbox(), self.line.rows())
        self.run_plant("--once", "--take-over", line=other)  # a new computer for the same line
        self.assertEqual(self.inbox(), self.line.rows() | other.rows())
        self.assertEqual(self.server.run("SELECT name FROM plant.line"), [["hall-1"]])
        self.assertIn("another database", self.run_plant("--once", status=UNREACHABLE), "the old one is not the line's")
        self.run_plant("--once", "--take-over")  # it was a mistake
        self.run_plant("--once")
        self.assertIn("another database", self.run_plant("--once", line=other, status=UNREACHABLE))
        other.configure(self.server.dsn(), "hall-2")
        self.assertIn("already sent as line hall-1", self.run_plant("--once", line=other, status=UNREACHABLE))

    def test_a_restored_backup_goes_on_in_an_epoch_of_its_own(self):
        backup = self.line.folder / "backup.db"
        self.line.slabctl("db", "backup", "--out", backup)
        self.run_plant("--once")
        key, = self.line.sql("SELECT min(slab_key) FROM slab_result WHERE verdict <> 'pass'")[0]
        decide = ("disposition", f"key:{key}", "--decision", "hold", "--authority", "Li Wei", "--operator", "anna",
                  "--reason")
        self.line.slabctl(*decide, "before")
        self.run_plant("--once")
        sent = self.inbox()
        self.line.slabctl("db", "restore", backup, "--reason", "disk", "--operator", "anna", "--lose-calibrations")
        self.line.slabctl(*decide, "after")
        self.run_plant("--once")
        self.assertEqual(len(self.line.sql("SELECT uuid FROM epoch")), 2)
        self.assertEqual(self.inbox(), sent | self.line.rows())
        self.assertTrue(json.loads(self.line.plant("--check", "--json").stdout)["complete"])
        self.assertEqual(self.server.one("SELECT count(*) FROM plant.slab"), str(SLABS), "no slab is there twice")
        self.assertEqual(self.server.one("SELECT count(*) FROM plant.event WHERE kind = 'restored'"), "1")
        # The decisions are those that the line has, also when all is unfolded again.
        decisions = f"SELECT string_agg(reason, ',') FROM plant.disposition WHERE slab_key = {key}"
        self.assertEqual(self.server.one(decisions), "after")
        self.server.run("SELECT plant.unfold_all()")
        self.assertEqual(self.server.one(decisions), "after")
        self.assertEqual(self.server.one("SELECT count(*) FROM plant.trouble"), "0")
        # An old document that is unfolded late brings back no decision.
        self.server.run("INSERT INTO plant.trouble (epoch, seq, why) SELECT epoch, seq, 'too old' FROM plant.inbox "
                        "WHERE kind = 'decided' AND doc::text LIKE '%before%'")
        self.assertEqual(self.server.one("SELECT plant.unfold_again()"), "1")
        self.assertEqual(self.server.one(decisions), "after")

    def test_a_server_set_back_to_before_a_restore_of_the_line_gets_all_rows_again(self):
        backup = self.line.folder / "backup.db"
        key, = self.line.sql("SELECT min(slab_key) FROM slab_result WHERE verdict <> 'pass'")[0]
        decide = ("disposition", f"key:{key}", "--decision", "hold", "--authority", "Li Wei", "--operator", "anna",
                  "--reason")
        self.line.slabctl("db", "backup", "--out", backup)
        for reason in ("one", "two", "three"):
            self.line.slabctl(*decide, reason)
        self.run_plant("--once")
        first = self.line.sql("SELECT uuid FROM epoch")[0][0]
        self.line.slabctl("db", "restore", backup, "--reason", "disk", "--operator", "anna", "--lose-calibrations")
        self.line.slabctl(*decide, "after")
        self.run_plant("--once")
        # The server's backup from before the restore: rows of the first epoch only, and more of them than the line has.
        self.line.sql("UPDATE line SET sent_seq = (SELECT max(seq) FROM outbox)")
        self.server.run("ALTER TABLE plant.inbox DISABLE TRIGGER USER; "
                        f"DELETE FROM plant.inbox WHERE epoch <> '{first}'; "
                        "ALTER TABLE plant.inbox ENABLE TRIGGER USER")
        self.server.run("SELECT plant.unfold_all()")
        self.assertIn("set back", self.run_plant("--once"))
        self.assertEqual(self.inbox() & self.line.rows(), self.line.rows())
        self.assertEqual(
            self.server.one(f"SELECT string_agg(reason, ',') FROM plant.disposition WHERE slab_key = {key}"), "after")

    def reopen(self, key):
        """Adds what slabd writes when it takes the end of a slab back."""
        self.line.sql("DELETE FROM slab_result WHERE slab_key = ?", key)
        self.line.sql("INSERT INTO slab_seal (kind, form, about, slab_no, slab_id, utime_us, rows_sha256, sha256, tables) "
                      "SELECT 'reopened', form, about, slab_no, slab_id, utime_us, rows_sha256, randomblob(32), x'' FROM "
                      "slab_seal WHERE kind = 'slab' AND about = ?", key)

    def assert_is_away(self, key):
        self.assertEqual(self.server.one(f"SELECT count(*) FROM plant.slab WHERE slab_key = {key}"), "0")
        self.assertEqual(self.server.one(f"SELECT count(*) FROM plant.item WHERE slab_key = {key}"), "0")
        self.assertEqual(self.server.one("SELECT count(*) FROM plant.event WHERE kind = 'reopened'"), "1")
        self.assertEqual(self.server.one("SELECT count(*) FROM plant.trouble"), "0")
        self.assertEqual(self.server.one("SELECT count(*) FROM plant.slab"), str(SLABS - 1))

    def test_an_end_that_was_taken_back_takes_the_slab_away(self):
        self.run_plant("--once")
        self.reopen(7)
        self.run_plant("--once")
        self.assert_is_away(7)
        self.assert_complete()

    def test_an_end_that_was_taken_back_after_a_restore_takes_the_slab_away(self):
        backup = self.line.folder / "backup.db"
        self.line.slabctl("db", "backup", "--out", backup)
        self.run_plant("--once")
        self.line.slabctl("db", "restore", backup, "--reason", "disk", "--operator", "anna", "--lose-calibrations")
        self.reopen(8)
        self.run_plant("--once")
        self.assert_is_away(8)

    def test_emulated_slabs_are_not_counted_as_concrete(self):
        self.run_plant("--once")
        self.assertEqual(self.server.one("SELECT count(*) FROM plant.v_slab WHERE emulated"), str(SLABS))
        for view in ("v_first_pass_yield", "v_pareto", "v_mould", "v_spc"):
            self.assertEqual(self.server.one(f"SELECT count(*) FROM plant.{view}"), "0", view)
        line = json.loads(self.line.plant("--show", "overview", "--days", "3650").stdout)["lines"][0]
        self.assertEqual((line["slabs"], line["first"]), (SLABS, 0))
        self.make_real()
        for view in ("v_first_pass_yield", "v_mould", "v_spc"):
            self.assertNotEqual(self.server.one(f"SELECT count(*) FROM plant.{view}"), "0", view)

    def test_a_server_that_was_set_back_is_sent_again_what_it_lost(self):
        self.run_plant("--once")
        self.line.sql("UPDATE line SET sent_seq = (SELECT max(seq) FROM outbox)")
        self.server.run("ALTER TABLE plant.inbox DISABLE TRIGGER USER; DELETE FROM plant.inbox WHERE seq > 40; "
                        "ALTER TABLE plant.inbox ENABLE TRIGGER USER")
        self.assertIn("set back", self.run_plant("--once"))
        self.assert_complete()

    def test_tables_that_lost_rows_are_named_and_made_again(self):
        self.run_plant("--once")
        items = self.server.one("SELECT count(*) FROM plant.item")
        self.server.run("DELETE FROM plant.item; DELETE FROM plant.slab")
        self.assertIn("unfold_all", self.run_plant("--check", status=DIFFERS))
        self.assertEqual(self.server.one("SELECT plant.unfold_all()"), self.server.one("SELECT count(*) FROM plant.inbox"))
        self.assertEqual(self.server.one("SELECT count(*) FROM plant.item"), items)
        self.assert_complete()

    def test_a_role_sends_for_its_own_line_only(self):
        self.server.run("CREATE ROLE one LOGIN; CREATE ROLE two LOGIN; GRANT slabd_plant_writer TO one, two")
        self.line.configure(self.server.dsn("one"), "hall-1")
        self.run_plant("--once")
        epoch = self.server.one("SELECT epoch FROM plant.epoch")
        with self.assertRaises(RuntimeError):
            self.server.run(f"INSERT INTO plant.inbox VALUES ('{epoch}', 900001, 'event', decode('{'cd' * 32}', 'hex'), "
                            "'{}')", user="two")
        self.line.configure(self.server.dsn("two"), "hall-1")
        self.assertIn("sends as role one", self.run_plant("--once", status=UNREACHABLE))
        self.assertIn("slabd_plant_reader", self.run_plant("--show", "overview", status=UNREACHABLE))

    def test_lines_that_begin_at_once_do_not_disturb_each_other(self):
        lines = [self.history(f"hall-{number}", seed=number, days=400) for number in range(2, 7)]
        senders = [subprocess.Popen([BUILD / "plant/slabd-plant", "--config", line.config, "--once"],
                                    stderr=subprocess.PIPE, text=True) for line in lines]
        for sender in senders:
            said = sender.communicate()[1]
            self.assertEqual(sender.returncode, OK, said)
        for line in lines:
            self.assert_complete(line)
        self.assertEqual(self.server.one("SELECT count(*) FROM plant.item_other"), "0")

    def test_a_running_sender_follows_a_restore(self):
        backup = self.line.folder / "backup.db"
        self.line.slabctl("db", "backup", "--out", backup)
        sender = subprocess.Popen([BUILD / "plant/slabd-plant", "--config", self.line.config], stderr=subprocess.DEVNULL)
        self.addCleanup(sender.wait)
        self.addCleanup(sender.kill)
        self.until(lambda: self.inbox() == self.line.rows())
        self.line.slabctl("db", "restore", backup, "--reason", "disk", "--operator", "anna")
        self.assertEqual(len(self.line.sql("SELECT uuid FROM epoch")), 2)
        self.until(lambda: self.inbox() == self.line.rows(), 60)

    def test_what_the_server_lost_is_sent_again(self):
        self.run_plant("--once")
        newest, = self.line.sql("SELECT max(seq) FROM outbox")[0]
        self.line.sql("UPDATE line SET sent_seq = ?", newest)  # as slabd has noted
        self.server.run("DELETE FROM plant.inbox WHERE seq % 7 = 3; DELETE FROM plant.item; DELETE FROM plant.slab")
        self.run_plant("--once")
        self.assertNotEqual(self.inbox(), self.line.rows(), "these rows were noted as sent")
        checked = json.loads(self.line.plant("--check", "--json").stdout)
        self.assertGreater(checked["epochs"][0]["sent_again"], 0)
        self.assertGreater(checked["missing_slabs"], 0)
        self.server.one("SELECT plant.unfold_all()")
        self.assert_complete()

    def test_a_bad_network_delays_and_loses_nothing(self):
        chance = random.Random(11)

        def treat(total):
            return chance.choices(("pass", "stall", "cut", "half"), (60, 4, 3, 3))[0] if total > 2000 else "pass"

        proxy = Proxy(self.server.port, treat)
        self.addCleanup(proxy.close)
        self.line.configure(self.server.dsn(port=proxy.port), "hall-1", "batch = 5")
        for _ in range(200):
            if self.line.plant("--once").returncode == OK:
                break
        self.line.configure(self.server.dsn(), "hall-1")
        self.run_plant("--once")
        self.assertGreater(proxy.connections, 2)
        self.assert_complete()

    def test_kill_9_of_sender_and_server_at_any_moment(self):
        chance = random.Random(12)
        self.line.configure(self.server.dsn(), "hall-1", "batch = 3")
        for turn in range(14):
            sender = subprocess.Popen([BUILD / "plant/slabd-plant", "--config", self.line.config],
                                      stderr=subprocess.DEVNULL)
            time.sleep(chance.uniform(0.05, 0.6))
            if turn % 3 == 2:
                self.server.kill()
                time.sleep(chance.uniform(0.0, 0.3))
                self.server.start()
                time.sleep(chance.uniform(0.0, 1.5))
            sender.kill()
            sender.wait()
        self.run_plant("--once")
        self.assert_complete()

    def test_a_sender_finds_its_server_again_by_itself(self):
        sender = subprocess.Popen([BUILD / "plant/slabd-plant", "--config", self.line.config], stderr=subprocess.PIPE,
                                  text=True)
        self.addCleanup(sender.kill)
        self.until(lambda: self.inbox() == self.line.rows())
        self.server.kill()
        key, = self.line.sql("SELECT min(slab_key) FROM slab_result WHERE verdict <> 'pass'")[0]
        self.line.slabctl("disposition", f"key:{key}", "--decision", "hold", "--reason", "look", "--authority", "Li Wei",
                          "--operator", "anna")
        time.sleep(3)
        self.server.start()
        self.until(lambda: self.inbox() == self.line.rows())
        sender.terminate()
        said = sender.communicate()[1]
        self.assertEqual(sender.returncode, OK, said)
        self.assertEqual(said.count("sends to"), 2, said)

    def until(self, condition, limit_s=300):
        begun = time.monotonic()
        while time.monotonic() - begun < limit_s:
            if condition():
                return
            time.sleep(0.2)
        self.fail(f"not within {limit_s} s")

    def test_a_full_disk_of_the_server_is_named_and_passes(self):
        try:
            small = Server(size_mb=110)
        except subprocess.CalledProcessError:
            self.skipTest("a small disk cannot be mounted without the rights of root")
        self.addCleanup(small.close)
        line = Line(small, "hall-1")
        self.addCleanup(line.close)
        self.assertEqual(line.plant("--init").returncode, OK)
        filler = small.disk / "filler"
        free = shutil.disk_usage(small.disk).free
        with open(filler, "wb") as out:
            out.write(b"x" * max(free - 300_000, 0))
        said = line.plant("--once")
        self.assertEqual(said.returncode, UNREACHABLE, said.stderr)
        filler.unlink()
        small.wait()
        self.assertEqual(line.plant("--once").returncode, OK)
        checked = json.loads(line.plant("--check", "--json").stdout)
        self.assertTrue(checked["complete"], checked)

    def test_a_server_far_away_must_prove_its_name(self):
        self.line.configure("host=192.0.2.1 dbname=plant connect_timeout=1 hostaddr=127.0.0.2 port=" +
                            str(self.server.port), "hall-1")
        self.assertEqual(self.line.plant("--once").returncode, UNREACHABLE)
        # A name that is not this computer's, but leads here: without a certificate nothing is sent.
        self.line.configure(f"host=plant.example hostaddr=127.0.0.1 port={self.server.port} user=admin dbname=plant "
                            "sslmode=verify-full", "hall-1")
        self.assertIn("SSL", self.run_plant("--once", status=UNREACHABLE))
        self.assertEqual(self.inbox(), set())


if __name__ == "__main__":
    unittest.main(verbosity=2)
