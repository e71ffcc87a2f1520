# SPDX-License-Identifier: Apache-2.0
"""Recipes with random geometry, and the comparison of a draft with its recipe."""

import random
import re

BLOCK = """cant_ratio jaw_half_distance_mm jaw_angle_deg shoulder_outer_z_mm shoulder_inner_z_mm end_half_length_mm
side_half_width_mm draft_deg slab_top_z_mm casing_half_spacing_mm casing_bore_diameter_mm casing_rim_diameter_mm
casing_rim_height_mm""".split()
SLAB = """length_mm width_mm thickness_mm pitch_mm first_pair_from_end_mm seat_centre_distance_mm block_origin_z_mm""".split()


def numbers(seed):
    """Numbers of [slab] and [block] for this seed, in the ranges in which a block can be drawn."""
    r = random.Random(seed)
    top = -r.uniform(25.0, 60.0)
    n = {
        "cant_ratio": r.uniform(15.0, 400.0),
        "jaw_half_distance_mm": r.uniform(170.0, 200.0),
        "jaw_reference_height_mm": r.uniform(2.0, 12.0),
        "jaw_angle_deg": r.uniform(95.0, 125.0),
        "shoulder_outer_z_mm": r.uniform(26.0, 34.0),
        "shoulder_inner_z_mm": r.uniform(16.0, 24.0),
        "end_half_length_mm": r.uniform(80.0, 107.0),
        "side_half_width_mm": r.uniform(235.0, 244.0),
        "draft_deg": r.uniform(0.5, 14.0),
        "slab_top_z_mm": top,
        "block_origin_z_mm": -top,
        "casing_half_spacing_mm": r.uniform(90.0, 125.0),
        "casing_bore_diameter_mm": r.uniform(20.0, 34.0),
        "casing_rim_diameter_mm": r.uniform(36.0, 50.0),
        "casing_rim_height_mm": r.choice([-1.0, 1.0]) * r.uniform(0.05, 2.0),
        "pairs": r.randint(6, 9),
        "pitch_mm": r.uniform(560.0, 680.0),
        "first_pair_from_end_mm": r.uniform(250.0, 320.0),
        "seat_centre_distance_mm": r.uniform(1450.0, 1550.0),
        "width_mm": r.uniform(2300.0, 2600.0),
        "thickness_mm": r.uniform(150.0, 260.0),
    }
    n["length_mm"] = 2.0 * n["first_pair_from_end_mm"] + (n["pairs"] - 1) * n["pitch_mm"]
    return n


def write(template, path, n):
    """A recipe with these numbers; items lose their nominals and limits, which would have to follow."""
    head, items = template.split("[items.seat_slope]")
    for key, value in n.items():
        if key == "pairs":
            head = re.sub(r"(?m)^pairs = \d+", f"pairs = {value}", head)
        else:
            head, count = re.subn(rf"(?m)^{key} = {{ value = [^,]+,", f"{key} = {{ value = {value!r},", head)
            if count != 1:
                raise ValueError(key)
    items = "[items.seat_slope]" + items
    items = re.sub(r"(?m)^(nominal|lower|upper|tolerance|U|depth_max_mm|share_max) =.*\n", "", items)
    items = re.sub(r"(?m)^required = true", "required = false", items)
    with open(path, "w", encoding="utf-8") as file:
        file.write(head + items)


def differences(found, n, keys):
    """Relative differences of a slabd.cad_draft/1's values from the numbers, by key; infinite if one is missing."""
    values = {value["key"].split(".")[1]: value["value"] for value in found if not value["key"].startswith("edges")}
    return {key: abs(values[key] - n[key]) / abs(n[key]) if key in values else float("inf") for key in keys}
