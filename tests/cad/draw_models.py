# SPDX-License-Identifier: Apache-2.0
"""Draws supporting blocks with FreeCAD, not with slabd: `draw_models.py FOLDER`, in a Python that has FreeCAD's modules.

The block is a box with a trapezoidal channel cut by extruded polygons; it has no part of slabd's own construction.
Variants: fillets, chamfers, inches, an assembly of placed solids, mirrored, turned and moved, one casing missing."""

import math
import sys

sys.path.append("/usr/lib/freecad-python3/lib")
sys.path.append("/usr/lib/freecad/lib")
import FreeCAD  # noqa: E402
import Part  # noqa: E402

V = FreeCAD.Vector
CANT = math.atan(1.0 / 40.0)
ALONG = V(0, math.cos(CANT), math.sin(CANT))
UP = V(0, -math.sin(CANT), math.cos(CANT))


def prism(points, half):
    """Polygon in (y, z), extruded along x to both sides."""
    wire = Part.makePolygon([V(-half, y, z) for y, z in points + points[:1]])
    return Part.Face(wire).extrude(V(2 * half, 0, 0))


def block(casings=(-1, 1), with_slab=False):
    """Jaws 380 mm apart 10 mm above the seat, 110 degrees; casings 233 mm apart; drafts of 10 degrees."""
    t = math.tan(math.radians(10.0))
    low, high = -30.0, 60.0

    def frustum():
        def ring(z):
            x, y = 105.0 - z * t, 240.0 - z * t
            return Part.makePolygon([V(-x, -y, z), V(x, -y, z), V(x, y, z), V(-x, y, z), V(-x, -y, z)])

        return Part.makeLoft([ring(low), ring(high)], True, True)

    def on_seat(s, h):
        p = ALONG * s + UP * h
        return (p.y, p.z)

    lean = math.tan(math.radians(20.0))
    foot = 190.0 - 10.0 * lean
    body = frustum()
    channel = prism([on_seat(-foot, 0), on_seat(foot, 0), on_seat(foot + 90 * lean, 90), on_seat(-foot - 90 * lean, 90)], 300)
    body = body.cut(channel)
    body = body.cut(prism([(0, 29.75), (400, 29.75), (400, 200), (0, 200)], 300))
    body = body.cut(prism([(0, 20.25), (-400, 20.25), (-400, 200), (0, 200)], 300))
    for sign in casings:
        centre = ALONG * (116.5 * sign)
        body = body.cut(Part.makeCylinder(22.0, 30.0, centre - UP * 0.25, UP))
        body = body.cut(Part.makeCylinder(15.0, 40.0, centre - UP * 20.0, UP))
    if with_slab:
        body = body.fuse(Part.makeBox(600, 900, 200, V(-300, -450, low - 200))).removeSplitter()
    return body


def edges(shape, test):
    """Edges along x for whose middle test(y, z) is true."""
    found = []
    for edge in shape.Edges:
        ends = [vertex.Point for vertex in edge.Vertexes]
        if len(ends) != 2 or (ends[1] - ends[0]).Length < 1.0 or abs((ends[1] - ends[0]).normalize().x) < 0.999:
            continue
        middle = edge.CenterOfMass
        if test(middle.y, middle.z):
            found.append(edge)
    return found


def main(folder):
    plain = block()
    plain.exportStep(f"{folder}/plain.step")
    plain.exportIges(f"{folder}/plain.igs")
    block(with_slab=True).exportStep(f"{folder}/on_slab.step")

    turned = plain.copy()
    turned.rotate(V(0, 0, 0), V(1, 2, 3), 77.0)
    turned.translate(V(1234.5, -987.6, 555.5))
    turned.exportStep(f"{folder}/turned.step")

    plain.mirror(V(0, 0, 0), V(0, 1, 0)).exportStep(f"{folder}/mirrored.step")

    block(casings=(-1,)).exportStep(f"{folder}/one_casing.step")

    seat_edges = edges(plain, lambda y, z: 180.0 < abs(y) < 192.0 and abs(z) < 8.0)
    filleted = plain.makeFillet(5.0, seat_edges)
    shoulder_edges = edges(filleted, lambda y, z: 190.0 < abs(y) < 205.0 and z > 15.0)
    filleted.makeFillet(4.0, shoulder_edges).exportStep(f"{folder}/filleted.step")
    # Blocks that a recipe cannot say, or of which another face may be the right one.
    def holes(radius, depth, places):
        drills = [Part.makeCylinder(radius, depth + 60.0, ALONG * s + V(x, 0, 0) - UP * depth, UP) for s, x in places]
        return drills[0].fuse(drills[1:])

    plain.cut(holes(5.0, 30.0, [(-60, 0), (60, 0)])).exportStep(f"{folder}/small_holes.step")
    plain.cut(holes(10.0, 35.0, [(-116.5, 0), (116.5, 0)])).exportStep(f"{folder}/stepped.step")
    block(casings=()).cut(holes(15.0, 20.0, [(-116.5, 3), (116.5, 3)])).exportStep(f"{folder}/beside.step")
    slot = holes(15.0, 20.0, [(-116.5, -8), (-116.5, 8)]).fuse(
        prism([(0, 0), (30, 0), (30, 80), (0, 80)], 8.0).translated(V(0, -116.5 - 15, -20)))
    block(casings=(1,)).cut(slot).exportStep(f"{folder}/slot.step")
    plain.cut(Part.makeBox(60, 40, 200, V(-30, -20, -3))).exportStep(f"{folder}/grooved.step")
    plain.fuse(Part.makeBox(20, 20, 40, V(-10, -225, 0))).removeSplitter().exportStep(f"{folder}/lug.step")

    outer = edges(plain, lambda y, z: abs(y) > 230.0 and z > 15.0)
    plain.makeChamfer(6.0, outer).exportStep(f"{folder}/chamfered.step")

    # Twelve placed copies of one solid on a slab of its own: an assembly of three levels.
    import Import

    document = FreeCAD.newDocument("assembly")
    group = document.addObject("App::Part", "slab")
    body = document.addObject("Part::Feature", "body")
    body.Shape = Part.makeBox(4000, 2500, 200, V(-2000, -1250, -200))
    group.addObject(body)
    for i in range(6):
        for row in (1, -1):
            part = document.addObject("App::Part", f"block_{i}_{row}")
            solid = document.addObject("Part::Feature", f"solid_{i}_{row}")
            solid.Shape = plain
            part.addObject(solid)
            turn = FreeCAD.Rotation(V(0, 0, 1), 0 if row > 0 else 180)
            part.Placement = FreeCAD.Placement(V(-1625 + 650 * i, 750 * row, 30), turn)
            group.addObject(part)
    document.recompute()
    Import.export([group], f"{folder}/assembly.step")

    # Inches: the same file with another unit would be another size, so the solid is shrunk first.
    small = plain.copy()
    small.scale(1.0 / 25.4)
    small.exportStep(f"{folder}/shrunk.step")
    text = open(f"{folder}/shrunk.step", encoding="utf-8").read()
    number = max(int(line.split("=")[0][1:]) for line in text.splitlines() if line.startswith("#")) + 1
    import re

    metre = re.search(r"#(\d+)\s*=\s*\(\s*LENGTH_UNIT\(\)\s*NAMED_UNIT\(\*\)\s*SI_UNIT\(\.MILLI\.,\.METRE\.\)\s*\);", text)
    inch = (f"#{metre.group(1)} = ( CONVERSION_BASED_UNIT('INCH',#{number}) LENGTH_UNIT() NAMED_UNIT(#{number + 2}) );\n"
            f"#{number} = LENGTH_MEASURE_WITH_UNIT(LENGTH_MEASURE(25.4),#{number + 1});\n"
            f"#{number + 1} = ( LENGTH_UNIT() NAMED_UNIT(*) SI_UNIT(.MILLI.,.METRE.) );\n"
            f"#{number + 2} = DIMENSIONAL_EXPONENTS(1.,0.,0.,0.,0.,0.,0.);")
    open(f"{folder}/inches.step", "w", encoding="utf-8").write(text.replace(metre.group(0), inch))


main(sys.argv[-1])
