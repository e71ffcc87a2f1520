# SPDX-License-Identifier: Apache-2.0
"""Reader of the text of ISO 10303-21 (STEP) files: entities, faces with their surfaces, and tolerances. It shares nothing
with OpenCASCADE, so it can contradict it."""

import re

TOKEN = re.compile(r"'(?:[^']|'')*'|#\d+|\.[A-Z_0-9]+\.|[-+]?\d+\.?\d*(?:[eE][-+]?\d+)?|[A-Z_][A-Z_0-9]*|[(),$*;=]")


def value(tokens, at):
    """The value that begins at a token, and the place behind it. Entities in parentheses are lists; a typed value is
    (name, list)."""
    token = tokens[at]
    if token == "(":
        items, at = [], at + 1
        while tokens[at] != ")":
            if tokens[at] == ",":
                at += 1
                continue
            item, at = value(tokens, at)
            items.append(item)
        return items, at + 1
    if token[0] == "'":
        return token[1:-1].replace("''", "'"), at + 1
    if token[0] == "#":
        return int(token[1:]), at + 1  # a reference
    if re.match(r"[A-Z_]", token):
        inner, behind = value(tokens, at + 1)
        return (token, inner), behind
    if token[0] in ".$*":
        return token, at + 1
    return float(token), at + 1


class Model:
    def __init__(self, text):
        data = text[text.index("DATA;") + 5 : text.rindex("ENDSEC;")]
        self.schema = re.search(r"FILE_SCHEMA\s*\(\s*\(\s*'([^']*)'", text).group(1)
        tokens = TOKEN.findall(re.sub(r"/\*.*?\*/", "", data, flags=re.S))
        self.entities = {}
        at = 0
        while at < len(tokens):
            number = int(tokens[at][1:])
            if tokens[at + 1] != "=":
                raise ValueError(f"#{number} has no =")
            content, at = value(tokens, at + 2)
            self.entities[number] = content if isinstance(content, list) else [content]
            if tokens[at] != ";":
                raise ValueError(f"#{number} does not end")
            at += 1

    def all(self, name):
        """(number, arguments) of all entities of this type; of complex ones those of the part."""
        for number, parts in self.entities.items():
            for part in parts:
                if part[0] == name:
                    yield number, part[1]

    def part(self, number, name):
        for part in self.entities[number]:
            if part[0] == name:
                return part[1]
        return None

    def vector(self, number):
        return self.entities[number][0][1][1]

    def placement(self, number):
        """Point, axis and reference direction of an AXIS2_PLACEMENT_3D."""
        arguments = self.part(number, "AXIS2_PLACEMENT_3D")
        return tuple(self.vector(reference) for reference in arguments[1:4])

    def faces(self):
        """name -> (type of the surface, point, axis, radius, sense) of all ADVANCED_FACEs with a name."""
        found = {}
        for _, (name, _, surface, sense) in self.all("ADVANCED_FACE"):
            kind, arguments = self.entities[surface][0]
            point, axis, _ = self.placement(arguments[1])
            radius = arguments[2] if kind == "CYLINDRICAL_SURFACE" else None
            normal = axis if sense == ".T." else [-x for x in axis]
            found.setdefault(name, []).append((kind, point, normal, radius))
        return found

    def measures(self, number):
        """All numbers with units that an entity refers to, directly or through others of the same measure."""
        found = []
        for part in self.entities[number]:
            for argument in part[1]:
                if isinstance(argument, tuple) and "MEASURE" in argument[0]:
                    found.append(argument[1][0])
        return found
