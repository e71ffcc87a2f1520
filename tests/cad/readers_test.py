#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Files of slabctl export model in gmsh and FreeCAD, and models that FreeCAD drew in slabctl recipe from-cad.
Usage: readers_test.py BUILD_FOLDER"""

import importlib.util
import json
import pathlib
import subprocess
import sys
import unittest

import places

PROGRAMS = None
FREECAD = "/usr/lib/freecad-python3/lib"

EXPECTED = {"block.cant_ratio": 40.0, "block.jaw_half_distance_mm": 190.0, "block.jaw_angle_deg": 110.0,
            "block.shoulder_outer_z_mm": 29.75, "block.shoulder_inner_z_mm": 20.25, "block.end_half_length_mm": 105.0,
            "block.side_half_width_mm": 240.0, "block.draft_deg": 10.0, "block.slab_top_z_mm": -30.0,
            "block.casing_half_spacing_mm": 116.5, "block.casing_bore_diameter_mm": 30.0,
            "block.casing_rim_diameter_mm": 44.0, "block.casing_rim_height_mm": -0.25}


def volume_of(stdout):
    return float(stdout.split(",")[1].split()[0])


class Gmsh(unittest.TestCase):
    def setUp(self):
        if importlib.util.find_spec("gmsh") is None:
            self.skipTest("python3-gmsh is not installed")

    def test_volume_and_faces_are_those_of_slabd(self):
        for name, more, faces in (("block.step", ["--block"], 18), ("block.igs", ["--block"], 18), ("slab.step", [], 18 * 17 + 6)):
            ended = PROGRAMS.run("export", "model", places.RECIPE, "--out", PROGRAMS.path(name), *more)
            self.assertEqual(ended.returncode, 0, ended.stderr)
            code = ("import gmsh, sys\ngmsh.initialize(['', '-v', '0'])\n"
                    "gmsh.model.occ.importShapes(sys.argv[1])\ngmsh.model.occ.synchronize()\n"
                    "solids = gmsh.model.getEntities(3)\n"
                    "print(len(solids), len(gmsh.model.getEntities(2)), repr(sum(gmsh.model.occ.getMass(*s) for s in solids)))\n")
            read = subprocess.run(["/usr/bin/python3", "-c", code, PROGRAMS.path(name)], capture_output=True, text=True, check=True)
            solids, count, volume = read.stdout.split()[-3:]
            self.assertEqual((int(solids), int(count)), (1, faces), name)
            own = volume_of(ended.stdout)
            self.assertLess(abs(float(volume) - own) / own, 1e-9, name)


@unittest.skipUnless(pathlib.Path(FREECAD).exists(), "freecad-python3 is not installed")
class FreeCad(unittest.TestCase):
    def test_freecad_reads_one_valid_solid_with_planes_and_cylinders(self):
        code = ("import sys\nsys.path.append('/usr/lib/freecad-python3/lib')\nimport FreeCAD, Part\n"
                "s = Part.Shape()\ns.read(sys.argv[-1])\n"
                "kinds = [type(f.Surface).__name__ for f in s.Faces]\n"
                "print('RESULT', len(s.Solids), s.isValid(), kinds.count('Plane'), kinds.count('Cylinder'), repr(s.Volume))\n")
        for name in ("block.step", "block.igs"):
            ended = PROGRAMS.run("export", "model", places.RECIPE, "--block", "--out", PROGRAMS.path(name))
            read = subprocess.run(["/usr/bin/python3", "-c", code, PROGRAMS.path(name)], capture_output=True, text=True)
            line = [line for line in read.stdout.splitlines() if line.startswith("RESULT")]
            self.assertTrue(line, read.stdout + read.stderr)
            _, solids, valid, planes, cylinders, volume = line[0].split()
            self.assertEqual((int(solids), valid, int(planes), int(cylinders)), (1, "True", 14, 4), name)
            own = volume_of(ended.stdout)
            self.assertLess(abs(float(volume) - own) / own, 1e-9, name)


@unittest.skipUnless(pathlib.Path(FREECAD).exists(), "freecad-python3 is not installed")
class Drawn(unittest.TestCase):
    """Models that slabd did not draw."""

    @classmethod
    def setUpClass(cls):
        script = pathlib.Path(__file__).with_name("draw_models.py")
        drawn = subprocess.run(["/usr/bin/python3", str(script), PROGRAMS.folder.name], capture_output=True, text=True)
        if drawn.returncode != 0:
            raise AssertionError(drawn.stdout + drawn.stderr)

    def draft(self, name):
        ended = PROGRAMS.run("recipe", "from-cad", PROGRAMS.path(name), "--out", PROGRAMS.path("draft.toml"), "--json")
        self.assertEqual(ended.returncode, 0, f"{name}: {ended.stderr}")
        draft = json.loads(ended.stdout)
        return draft, {v["key"]: v["value"] for v in draft["found"]}, {v["key"]: v["why"] for v in draft["not_found"]}

    def expect_block(self, name, but=()):
        draft, found, missing = self.draft(name)
        for key, value in EXPECTED.items():
            if key in but:
                continue
            self.assertIn(key, found, f"{name}: {missing}")
            self.assertLess(abs(found[key] - value), 1e-6 * abs(value), f"{name} {key}: {found[key]}")
        return draft, found, missing

    def test_a_plain_block_is_found(self):
        self.expect_block("plain.step")
        self.expect_block("plain.igs")

    def test_a_block_on_a_slab_is_found(self):
        self.expect_block("on_slab.step")

    def test_another_frame_does_not_matter(self):
        self.expect_block("turned.step")

    def test_a_mirrored_block_is_found(self):
        self.expect_block("mirrored.step")

    def test_inches_are_converted(self):
        draft, _, _ = self.expect_block("inches.step")
        self.assertIn("INCH", draft["unit"].upper())

    def test_fillets_are_set_aside_and_named(self):
        _, found, _ = self.expect_block("filleted.step")
        self.assertAlmostEqual(found["edges.fillet_seat_mm"], 5.0, delta=1e-6)
        self.assertAlmostEqual(found["edges.fillet_shoulder_mm"], 4.0, delta=1e-6)
        self.assertEqual(found["evaluation.edge_margin_mm"], 6.0)

    def test_chamfers_are_set_aside(self):
        self.expect_block("chamfered.step")

    def test_a_missing_casing_is_named_and_not_guessed(self):
        _, found, missing = self.expect_block("one_casing.step", but=("block.casing_half_spacing_mm",))
        self.assertNotIn("block.casing_half_spacing_mm", found)
        self.assertIn("outer casing", missing["block.casing_half_spacing_mm"])

    def test_a_right_model_leaves_nothing_to_look_at(self):
        for name in ("plain.step", "plain.igs", "turned.step", "mirrored.step", "filleted.step", "inches.step"):
            draft, _, _ = self.draft(name)
            self.assertEqual([text for text in draft["remarks"] if "block rests" not in text], [], name)
        self.assertEqual(self.draft("assembly.step")[0]["remarks"], [])

    def test_faces_that_no_number_explains_are_named(self):
        for name, words in (("small_holes.step", "hole of diameter 10.00"), ("stepped.step", "hole of diameter 20.00"),
                            ("beside.step", "3.0 mm along the rail"), ("grooved.step", "a plane of"),
                            ("lug.step", "a plane of")):
            draft, found, _ = self.draft(name)
            self.assertTrue(any("not explained" in text and words in text for text in draft["remarks"]),
                            f"{name}: {draft['remarks']}")
            if name in ("small_holes.step", "stepped.step"):
                self.assertAlmostEqual(found["block.casing_bore_diameter_mm"], 30.0, delta=1e-6)
                self.assertAlmostEqual(found["block.casing_half_spacing_mm"], 116.5, delta=1e-6)

    def test_a_slot_is_no_bore(self):
        _, found, missing = self.draft("slot.step")
        self.assertIn("inner casing", missing["block.casing_half_spacing_mm"])
        self.assertEqual(found["block.casing_bore_diameter_mm"], 30.0)

    def test_an_assembly_gives_pitch_and_pairs(self):
        draft, found, missing = self.expect_block("assembly.step")
        self.assertEqual(draft["blocks"], 12)
        for key, value in (("slab.pairs", 6), ("slab.pitch_mm", 650.0), ("slab.seat_centre_distance_mm", 1500.0),
                           ("slab.length_mm", 4000.0), ("slab.width_mm", 2500.0), ("slab.thickness_mm", 200.0),
                           ("slab.first_pair_from_end_mm", 375.0), ("slab.block_origin_z_mm", 30.0)):
            self.assertAlmostEqual(found.get(key, float("nan")), value, delta=1e-6, msg=f"{key}: {missing}")


if __name__ == "__main__":
    PROGRAMS = places.Programs(sys.argv.pop(1))
    unittest.main(verbosity=2)
