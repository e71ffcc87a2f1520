#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""Reads what slabctl export wrote with readers that are independent of slabd, and prints what it found as JSON.

read_exports.py csv FILE | mesh FILE | cloud FILE
"""
import csv
import json
import sys

import numpy as np

KINDS = {"float": "<f4", "double": "<f8", "uchar": "u1", "int": "<i4", "uint": "<u4"}


def ply(path):
    """Elements by name, as the PLY description of Turk (1994) has them: binary, little-endian."""
    with open(path, "rb") as file:
        data = file.read()
    end = data.index(b"end_header\n") + len(b"end_header\n")
    lines = data[:end].decode("ascii").splitlines()
    assert lines[0] == "ply" and lines[1] == "format binary_little_endian 1.0", lines[:2]
    elements, at, out = [], end, {}
    for line in lines[2:-1]:
        words = line.split()
        if words[0] == "element":
            elements.append((words[1], int(words[2]), []))
        elif words[0] == "property":
            elements[-1][2].append(words[1:])
        else:
            assert words[0] == "comment", line
    for name, count, properties in elements:
        if properties[0][0] == "list":
            kind = np.dtype([("n", KINDS[properties[0][1]]), ("index", KINDS[properties[0][2]], 3)])
        else:
            kind = np.dtype([(p[1], KINDS[p[0]]) for p in properties])
        out[name] = np.frombuffer(data, kind, count, at)
        at += count * kind.itemsize
    assert at == len(data), f"{len(data) - at} bytes behind the last element"
    return out


def mesh(path):
    if path.endswith(".stl"):
        data = open(path, "rb").read()
        count = int.from_bytes(data[80:84], "little")
        kind = np.dtype([("n", "<f4", 3), ("p", "<f4", (3, 3)), ("attribute", "<u2")])
        assert len(data) == 84 + count * kind.itemsize and not data.startswith(b"solid")
        corners = np.frombuffer(data, kind, count, 84)["p"].astype(float)
    else:
        elements = ply(path)
        vertices = np.stack([elements["vertex"][axis] for axis in "xyz"], axis=1).astype(float)
        assert (elements["face"]["n"] == 3).all()
        corners = vertices[elements["face"]["index"]]
    # Closed: every edge is traversed once in each direction. Vertices are compared by position, because STL does not
    # share them.
    places, index = np.unique(corners.reshape(-1, 3), axis=0, return_inverse=True)
    index = index.reshape(-1, 3)
    edges = np.concatenate([index[:, [0, 1]], index[:, [1, 2]], index[:, [2, 0]]])
    forward = {}
    for a, b in edges.tolist():
        forward[(a, b)] = forward.get((a, b), 0) + 1
    open_edges = sum(count != forward.get((b, a), 0) for (a, b), count in forward.items())
    volume = float(np.einsum("ij,ij->i", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])).sum() / 6)
    return {"triangles": len(corners), "vertices": len(places), "open_edges": open_edges, "volume_mm3": volume,
            "low": corners.min((0, 1)).tolist(), "high": corners.max((0, 1)).tolist()}


def cloud(path):
    vertex = ply(path)["vertex"]
    p = np.stack([vertex[axis] for axis in "xyz"], axis=1).astype(float)
    out = {"points": len(p), "fields": list(vertex.dtype.names), "low": p.min(0).tolist(), "high": p.max(0).tolist()}
    if "deviation_mm" in vertex.dtype.names:
        d = vertex["deviation_mm"].astype(float)
        seat = d[vertex["face"] == 0]
        out["median_abs_deviation_mm"] = float(np.median(abs(d)))
        out["seat_mean_mm"], out["seat_points"] = float(seat.mean()), len(seat)
    if "station" in vertex.dtype.names:
        out["stations"] = np.unique(vertex["station"]).tolist()
    return out


def table(path):
    raw = open(path, "rb").read()
    text = raw.decode("utf-8-sig")
    assert raw.count(b"\n") == raw.count(b"\r\n"), "lines end with CR LF"
    rows = list(csv.DictReader(text.splitlines(keepends=True), strict=True))
    assert all(None not in row and None not in row.values() for row in rows), "a row of another length"
    return {"bom": raw.startswith(b"\xef\xbb\xbf"), "columns": list(rows[0]), "rows": rows}


print(json.dumps({"csv": table, "mesh": mesh, "cloud": cloud}[sys.argv[1]](sys.argv[2])))
