#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""slabctl export model and recipe from-cad, as processes. Usage: cad_test.py BUILD_FOLDER

The environment's CAD_BLOCKS and CAD_SLABS are the numbers of random recipes: 200 and 200 take half an hour."""

import json
import math
import os
import pathlib
import stat
import sys
import tomllib
import unittest

import part21
import places
import random_recipe

PROGRAMS = None
BLOCKS = int(os.environ.get("CAD_BLOCKS", "25"))
SLABS = int(os.environ.get("CAD_SLABS", "5"))


def dot(a, b):
    return sum(x * y for x, y in zip(a, b))


def minus(a, b):
    return [x - y for x, y in zip(a, b)]


def draft_of(*arguments, cad=None):
    ended = PROGRAMS.run("recipe", "from-cad", *arguments, "--out", PROGRAMS.path("draft.toml"), "--json", cad=cad)
    return ended, json.loads(ended.stdout) if ended.returncode == 0 else None


class Export(unittest.TestCase):
    def block(self, name="block.step", *more):
        return part21.Model(pathlib.Path(PROGRAMS.export(name, "--block", *more)).read_text())

    def test_the_seat_is_inclined_by_1_to_40_and_the_casings_are_on_it(self):
        faces = self.block().faces()
        kind, point, normal, _ = faces["seat"][0]
        self.assertEqual(kind, "PLANE")
        self.assertAlmostEqual(abs(normal[1] / normal[2]), 1.0 / 40.0, delta=1e-12)
        self.assertAlmostEqual(dot(normal, point), 0.0, delta=1e-9)
        cant = math.atan(1.0 / 40.0)
        for name, sign in (("casing_inner", -1.0), ("casing_outer", 1.0)):
            kind, axis_point, axis, radius = faces[name][0]
            self.assertEqual(kind, "CYLINDRICAL_SURFACE")
            self.assertAlmostEqual(radius, 15.0, delta=1e-12)
            self.assertAlmostEqual(abs(dot(axis, normal)), 1.0, delta=1e-12)
            off = minus(axis_point, [0.0, sign * 116.5 * math.cos(cant), sign * 116.5 * math.sin(cant)])
            along = dot(off, normal)
            self.assertLess(math.sqrt(max(dot(off, off) - along * along, 0.0)), 1e-9)

    def test_the_jaws_are_380_mm_apart_10_mm_above_the_seat(self):
        faces = self.block().faces()
        cant = math.atan(1.0 / 40.0)
        along, up = [0.0, math.cos(cant), math.sin(cant)], [0.0, -math.sin(cant), math.cos(cant)]
        at = {}
        for name in ("jaw_inner", "jaw_outer"):
            _, point, normal, _ = faces[name][0]
            at[name] = dot(normal, minus(point, [10.0 * x for x in up])) / dot(normal, along)
            self.assertAlmostEqual(math.degrees(math.acos(-abs(dot(normal, up)))), 110.0, delta=1e-9)
        self.assertAlmostEqual(at["jaw_outer"] - at["jaw_inner"], 380.0, delta=1e-9)

    def test_a_slab_names_the_faces_of_18_blocks(self):
        model = part21.Model(pathlib.Path(PROGRAMS.export("slab.step")).read_text())
        faces = model.faces()
        expected = {f"{name}_{k}" for k in range(1, 19)
                    for name in ("seat", "jaw_inner", "jaw_outer", "casing_inner", "casing_outer")} | {"slab_top"}
        self.assertEqual(set(faces) - {""}, expected)
        self.assertTrue(all(len(faces[name]) == 1 for name in expected))
        for station, x, y in ((1, -2520.0, 758.0), (9, 2520.0, 758.0), (10, 2520.0, -758.0), (18, -2520.0, -758.0)):
            _, point, axis, _ = faces[f"casing_outer_{station}"][0]
            outward = math.copysign(116.5 * math.cos(math.atan(1 / 40)), y)
            height = 30.0 + 116.5 * math.sin(math.atan(1 / 40))
            t = (height - point[2]) / axis[2]
            self.assertAlmostEqual(point[0] + t * axis[0], x, delta=1e-9)
            self.assertAlmostEqual(point[1] + t * axis[1], y + outward, delta=1e-9)

    def test_pmi_has_the_tolerances_of_the_recipe(self):
        path = PROGRAMS.export("pmi.step", "--block", "--pmi")
        model = part21.Model(pathlib.Path(path).read_text())
        self.assertIn("AP242", model.schema)
        text = pathlib.Path(path).read_text()
        self.assertEqual(len(list(model.all("FLATNESS_TOLERANCE"))), 1)
        self.assertEqual(len(list(model.all("DIMENSIONAL_LOCATION"))), 2)  # jaws, casings
        self.assertEqual(len(list(model.all("ANGULAR_LOCATION"))), 3)  # slope, two jaws
        measured = sorted(m for number in model.entities for m in model.measures(number))
        for expected in (1.0, 380.0, 233.0, 0.5):
            self.assertTrue(any(abs(m - expected) < 1e-9 for m in measured), (expected, measured))
        self.assertIn("PLUS_MINUS_TOLERANCE", text)

    def test_ap214_is_written_without_tolerances(self):
        model = self.block("old.step", "--ap214")
        self.assertIn("AUTOMOTIVE_DESIGN", model.schema)
        ended = PROGRAMS.run("export", "model", places.RECIPE, "--ap214", "--pmi", "--out", PROGRAMS.path("x.step"))
        self.assertEqual(ended.returncode, 2)
        ended = PROGRAMS.run("export", "model", places.RECIPE, "--pmi", "--out", PROGRAMS.path("x.igs"))
        self.assertEqual(ended.returncode, 2)

    def test_iges_has_the_names_of_the_faces(self):
        text = pathlib.Path(PROGRAMS.export("block.igs", "--block")).read_text()
        for name in ("seat", "jaw_inner", "jaw_outer", "casing_inner", "casing_outer"):
            self.assertIn(f"{len(name)}H{name}", text)

    def test_a_design_sheet_moves_and_turns_its_blocks(self):
        sheet = PROGRAMS.path("sheet.csv")
        rows = "".join(f"C-1,5600,{k},{1.0 if k == 2 else 0.0},0,{5.0 if k == 2 else 0.0},{0.5 if k == 2 else 0.0}\n"
                       for k in range(1, 19))
        pathlib.Path(sheet).write_text("slab_id,slab_type,station,dx_mm,dy_mm,dz_mm,dslope_deg\n" + rows)
        path = PROGRAMS.export("curve.step", "--slab", "C-1", "--sheet", sheet)
        faces = part21.Model(pathlib.Path(path).read_text()).faces()
        normal = faces["seat_2"][0][2]
        self.assertAlmostEqual(math.degrees(math.atan(abs(normal[1] / normal[2]))),
                               math.degrees(math.atan(1 / 40)) + 0.5, delta=1e-9)
        normal = faces["seat_3"][0][2]
        self.assertAlmostEqual(abs(normal[1] / normal[2]), 1 / 40, delta=1e-12)


class Import(unittest.TestCase):
    def test_a_slab_gives_its_recipe_back(self):
        with open(places.RECIPE, "rb") as file:
            recipe = tomllib.load(file)
        for name in ("slab.step", "slab.igs"):
            ended, draft = draft_of(PROGRAMS.export(name))
            self.assertEqual(ended.returncode, 0, ended.stderr)
            self.assertEqual(draft["blocks"], 18)
            self.assertEqual(draft["not_found"], [])
            self.assertEqual(draft["remarks"], [])
            found = {value["key"]: value["value"] for value in draft["found"]}
            for table, keys in (("slab", random_recipe.SLAB), ("block", random_recipe.BLOCK)):
                for key in keys:
                    self.assertAlmostEqual(found[f"{table}.{key}"] / recipe[table][key]["value"], 1.0, delta=1e-9,
                                           msg=f"{name} {table}.{key}")
            self.assertEqual(found["slab.pairs"], 9)

    def test_a_draft_is_unconfirmed_names_its_sources_and_does_not_check(self):
        ended, draft = draft_of(PROGRAMS.export("slab.step"))
        with open(PROGRAMS.path("draft.toml"), "rb") as file:
            toml = tomllib.load(file)
        numbers = [v for table in ("slab", "block") for v in toml[table].values() if isinstance(v, dict)]
        self.assertGreater(len(numbers), 19)
        for number in numbers:
            self.assertIs(number["confirmed"], False)
        sources = [n["source"] for n in numbers if not n["source"].startswith("chosen")]
        self.assertTrue(all("slab.step" in s and draft["sha256"] in s and "face" in s for s in sources), sources)
        self.assertEqual(PROGRAMS.run("recipe", "check", PROGRAMS.path("draft.toml")).returncode, 3)
        picture = pathlib.Path(PROGRAMS.path("draft.png")).read_bytes()
        self.assertEqual(picture[:8], b"\x89PNG\r\n\x1a\n")
        self.assertGreater(len(picture), 20_000)
        folder = pathlib.Path(PROGRAMS.path("draft.png")).parent
        listed = json.loads(PROGRAMS.run("recipe", "drafts", "--dir", folder, "--json").stdout)["drafts"]
        self.assertEqual([(one["name"], one["found"], one["not_found"]) for one in listed if one["name"] == "draft"],
                         [("draft", len(draft["found"]), len(draft["not_found"]))])
        again = PROGRAMS.run("recipe", "drafts", "draft", "--dir", folder, "--json")
        self.assertEqual(json.loads(again.stdout), draft)
        copied = PROGRAMS.path("copy.png")
        self.assertEqual(PROGRAMS.run("recipe", "drafts", "draft", "--dir", folder, "--picture", copied).returncode, 0)
        self.assertEqual(pathlib.Path(copied).read_bytes(), picture)

    def test_no_file_of_a_person_is_overwritten(self):
        model = PROGRAMS.export("mine.step", "--block")
        before = pathlib.Path(model).read_bytes()
        for out in (model, PROGRAMS.path("d.json")):
            self.assertEqual(PROGRAMS.run("recipe", "from-cad", model, "--out", out).returncode, 2, out)
        self.assertEqual(pathlib.Path(model).read_bytes(), before)
        confirmed = pathlib.Path(PROGRAMS.path("confirmed.toml"))
        self.assertEqual(PROGRAMS.run("recipe", "from-cad", model, "--out", confirmed).returncode, 0)
        text = confirmed.read_text().replace("confirmed = false, source", "confirmed = true, source", 1)
        confirmed.write_text(text)
        ended = PROGRAMS.run("recipe", "from-cad", model, "--out", confirmed)
        self.assertEqual(ended.returncode, 3, ended.stderr)
        self.assertIn("confirmed", ended.stderr)
        self.assertEqual(confirmed.read_text(), text)

    def test_a_chinese_name_gives_a_draft_that_can_be_read(self):
        name = "承轨台模型第三版修改后的最终文件"
        model = pathlib.Path(PROGRAMS.path(f"{name}.step"))
        model.write_bytes(pathlib.Path(PROGRAMS.export("plain.step", "--block")).read_bytes())
        self.assertEqual(PROGRAMS.run("recipe", "from-cad", model, "--out", PROGRAMS.path("zh.toml")).returncode, 0)
        with open(PROGRAMS.path("zh.toml"), "rb") as file:
            self.assertTrue(name.startswith(tomllib.load(file)["name"]))

    def test_a_completed_draft_checks(self):
        draft_of(PROGRAMS.export("slab.step"))
        text = pathlib.Path(PROGRAMS.path("draft.toml")).read_text()
        recipe = places.RECIPE.read_text()
        evaluation = recipe[recipe.index("[evaluation]") : recipe.index("# Assumed properties")]
        text = text.replace("# slab_type = ?", "slab_type = 77").replace("[evaluation]\n", evaluation)
        done = pathlib.Path(PROGRAMS.path("done.toml"))
        done.write_text(text)
        ended = PROGRAMS.run("recipe", "check", done)
        self.assertEqual(ended.returncode, 0, ended.stderr)

    def test_random_blocks_come_back(self):
        template = places.RECIPE.read_text()
        worst = 0.0
        for seed in range(BLOCKS):
            n = random_recipe.numbers(seed)
            recipe = PROGRAMS.path(f"r{seed}.toml")
            random_recipe.write(template, recipe, n)
            path = PROGRAMS.export(f"r{seed}.{'igs' if seed % 5 == 4 else 'step'}", "--block", recipe=recipe)
            ended, draft = draft_of(path, "--reference-height", repr(n["jaw_reference_height_mm"]))
            self.assertEqual(ended.returncode, 0, ended.stderr)
            off = random_recipe.differences(draft["found"], n, random_recipe.BLOCK)
            worst = max(worst, *off.values())
            self.assertLess(max(off.values()), 1e-9, f"seed {seed}: {off}")
        print(f"{BLOCKS} random blocks: worst relative difference {worst:.2e}")

    def test_random_slabs_come_back(self):
        template = places.RECIPE.read_text()
        worst = 0.0
        for seed in range(SLABS):
            n = random_recipe.numbers(1000 + seed)
            recipe = PROGRAMS.path(f"s{seed}.toml")
            random_recipe.write(template, recipe, n)
            path = PROGRAMS.export(f"s{seed}.step", recipe=recipe)
            ended, draft = draft_of(path, "--reference-height", repr(n["jaw_reference_height_mm"]))
            self.assertEqual(ended.returncode, 0, ended.stderr)
            off = random_recipe.differences(draft["found"], n, random_recipe.BLOCK + random_recipe.SLAB + ["pairs"])
            worst = max(worst, *off.values())
            self.assertLess(max(off.values()), 1e-9, f"seed {seed}: {off}")
        print(f"{SLABS} random slabs: worst relative difference {worst:.2e}")


class FromScan(unittest.TestCase):
    def test_a_master_block_gives_dimensions_with_their_uncertainty(self):
        scan = PROGRAMS.path("master.ply")
        ended = PROGRAMS.run("simulate", "scan", "--points", "quarter", "--recipe", places.RECIPE, "--block", 3, "--out", scan)
        self.assertEqual(ended.returncode, 0, ended.stderr)
        with open(PROGRAMS.path("master.json"), encoding="utf-8") as file:
            truth = json.load(file)
        ended = PROGRAMS.run("recipe", "from-scan", scan, "--like", places.RECIPE, "--out", PROGRAMS.path("m.toml"), "--json")
        self.assertEqual(ended.returncode, 0, ended.stderr)
        proposed = {p["key"]: p for p in json.loads(ended.stdout)["proposed"]}
        for key, item, factor in (("block.jaw_half_distance_mm", "jaw_distance", 0.5),
                                  ("block.casing_half_spacing_mm", "casing_spacing", 0.5)):
            self.assertGreater(proposed[key]["U"], 0.0)
            self.assertLess(abs(proposed[key]["value"] - factor * truth[item]), proposed[key]["U"], key)
        with open(PROGRAMS.path("m.toml"), "rb") as file:
            toml = tomllib.load(file)
        self.assertIn("U ", toml["block"]["jaw_half_distance_mm"]["source"])
        self.assertIn("not measured", toml["block"]["draft_deg"]["source"])


class Process(unittest.TestCase):
    """A reader that crashes, hangs or grows is one sentence and status 3."""

    def fake(self, name, text):
        path = pathlib.Path(PROGRAMS.path(name))
        path.write_text("#!/usr/bin/python3\n" + text)
        path.chmod(path.stat().st_mode | stat.S_IXUSR)
        return path

    def refused(self, cad, words):
        ended, _ = draft_of(PROGRAMS.export("block.step", "--block"), cad=cad)
        self.assertEqual(ended.returncode, 3, ended.stderr)
        self.assertEqual(ended.stderr.count("\n"), 1, ended.stderr)
        self.assertIn(words, ended.stderr)

    def test_a_crash_is_one_sentence(self):
        self.refused(self.fake("crash", "import os\nos.kill(os.getpid(), 11)\n"), "crashed slabd-cad (signal 11)")

    def test_a_loop_ends_at_its_limit(self):
        self.refused(self.fake("loop", "while True: pass\n"), "at its limit of 30 s")

    def test_memory_ends_at_its_limit(self):
        self.refused(self.fake("bomb", "x = []\nwhile True: x.append(bytearray(10_000_000))\n"), "block.step: ")

    def test_a_long_output_ends_at_its_limit(self):
        self.refused(self.fake("long", "import os\nwhile True: os.write(1, bytes(1_000_000))\n"), "block.step: ")

    def test_an_answer_that_is_none_is_refused(self):
        for text in ("{}", "[1, 2", "{\\\"schema\\\": \\\"slabd.cad_findings/1\\\", \\\"unit\\\": 3}"):
            self.refused(self.fake("odd", f"print(\"{text}\")\n"), "cannot read")

    def test_a_missing_program_names_its_package(self):
        ended, _ = draft_of(PROGRAMS.export("block.step", "--block"), cad="/nonexistent/slabd-cad")
        self.assertEqual(ended.returncode, 4)
        self.assertIn("apt install slabd-cad", ended.stderr)

    def test_a_file_of_another_kind_is_refused(self):
        for name, text in (("a.step", "hello\n"), ("b.igs", ""), ("c.stp", "ISO-10303-21;\nHEADER;\nENDSEC;\n")):
            path = pathlib.Path(PROGRAMS.path(name))
            path.write_text(text)
            ended, _ = draft_of(path)
            self.assertEqual(ended.returncode, 3, ended.stderr)
            self.assertEqual(ended.stderr.count("\n"), 1)



if __name__ == "__main__":
    PROGRAMS = places.Programs(sys.argv.pop(1))
    unittest.main(verbosity=2)
