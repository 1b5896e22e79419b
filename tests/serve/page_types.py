"""Compares the types of the page's TypeScript with the OpenAPI document of the service.

    page_types.py FILE DOCUMENT

FILE is growbot-page/src/api_types.ts. Each of its interfaces has the name of a schema, and only fields of that schema.
Each list of words has all values of its enumeration.
"""

import json
import re
import sys

text, schemas = open(sys.argv[1]).read(), json.load(open(sys.argv[2]))["components"]["schemas"]
# The document describes a plan by its file format. The page's name of a command is that of a type of its own.
OF_PLAN = {"Plan", "PlanWarning"}
RENAMED = {"CommandName": "RobotCommand"}


def values(schema):
    """Returns the values of an enumeration, which a schema may refer to. None for other schemas."""
    for part in [schema, *schema.get("allOf", []), *schema.get("anyOf", [])]:
        part = schemas[part["$ref"].rsplit("/", 1)[1]] if "$ref" in part else part
        if "enum" in part:
            return set(part["enum"])
    return None


def compare(place, words, schema):
    """Compares the type of a field with its schema, if it is a list of words."""
    listed = set(re.findall(r'"([\w-]+)"', words))
    assert not listed or listed == values(schema), f"{place}: {listed}, but the document has {values(schema)}"
    return bool(listed)


interfaces = re.findall(r"export interface (\w+) \{(.*?)^\}", text, re.S | re.M)
types = re.findall(r"export type (\w+) =(.*?);", text, re.S)
lists = sum(compare(name, words, schemas[RENAMED.get(name, name)]) for name, words in types)
for name, body in interfaces:
    if name in OF_PLAN:
        continue
    for field, words in re.findall(r"^  (\w+)\??: (.*);$", body, re.M):
        assert field in schemas[name]["properties"], f"the document has no {name}.{field}"
        lists += compare(f"{name}.{field}", words, schemas[name]["properties"][field])
assert len(interfaces) > len(OF_PLAN) and lists > 3, f"{len(interfaces)} interfaces, {lists} lists: is the file read?"
print(f"{len(interfaces)} types of the page fit the OpenAPI document, {lists} of their lists are complete")
