#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""Holds JSON documents against the published schemas: validate_json.py SCHEMAS FILE...

Strictly: a key that the schema does not name is an error too, so that nothing is written that is not published. A
document that does not name its schema (a request) is given as TITLE=FILE.
"""
import json
import pathlib
import sys

import jsonschema


def strict(schema):
    """The same schema, in which an object has no keys but those it names."""
    if isinstance(schema, list):
        return [strict(part) for part in schema]
    if not isinstance(schema, dict):
        return schema
    out = {key: strict(part) for key, part in schema.items()}
    if isinstance(out.get("properties"), dict) and "additionalProperties" not in out:
        out["additionalProperties"] = False
    return out


def main():
    schemas = {}
    for path in pathlib.Path(sys.argv[1]).glob("*.json"):
        schema = json.loads(path.read_text())
        jsonschema.Draft202012Validator.check_schema(schema)
        schemas[schema["title"]] = strict(schema)
    by_id = {schema["$id"]: schema for schema in schemas.values()}
    faults = 0
    for argument in sys.argv[2:]:
        title, _, name = argument.rpartition("=")
        document = json.loads(pathlib.Path(name).read_text())
        title = title or document.get("schema")
        schema = schemas.get(title)
        if schema is None:
            print(f"{name}: no schema is published for {title}")
            faults += 1
            continue
        resolver = jsonschema.RefResolver(schema["$id"], schema, store=by_id)
        for error in jsonschema.Draft202012Validator(schema, resolver=resolver).iter_errors(document):
            print(f"{name}: {title}: {'/'.join(map(str, error.absolute_path))}: {error.message[:300]}")
            faults += 1
    print(f"{len(sys.argv) - 2} documents, {faults} faults")
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(main())
