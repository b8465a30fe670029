"""docs/schemas: made from the types, and true of the files that ship."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import jsonschema
import pytest

ROOT = Path(__file__).parents[2]
SCHEMAS = ROOT / "docs" / "schemas"


def schema(name: str) -> dict[str, object]:
    return json.loads((SCHEMAS / f"{name}.schema.json").read_text(encoding="utf-8"))


def test_the_schemas_are_current():
    check = [sys.executable, str(ROOT / "docs" / "schema_files.py"), "--check"]
    assert subprocess.run(check, check=False).returncode == 0, "run `python docs/schema_files.py`"


@pytest.mark.parametrize("path", sorted(SCHEMAS.glob("*.json")), ids=lambda p: p.name)
def test_each_is_a_schema(path):
    jsonschema.Draft202012Validator.check_schema(json.loads(path.read_text(encoding="utf-8")))


@pytest.mark.parametrize(
    ("name", "pattern"),
    [("track", "datasets/*/track*.json"), ("labels", "examples/*/labels.json"),
     ("frozen", "examples/*/frozen.json")],
)  # fmt: skip
def test_what_ships_is_valid(name, pattern):
    validator = jsonschema.Draft202012Validator(schema(name))
    paths = sorted(ROOT.glob(pattern))
    for path in paths:
        validator.validate(json.loads(path.read_text(encoding="utf-8")))
    assert paths or name == "labels"


@pytest.mark.parametrize(
    ("name", "document"),
    [("track", {"images": []}), ("track", {"images": [{"id": -1, "width": 1, "height": 1}]}),
     ("labels", {"version": 2, "labels": []}), ("frozen", {"files": {}})],
)  # fmt: skip
def test_what_the_types_refuse_the_schemas_refuse(name, document):
    with pytest.raises(jsonschema.ValidationError):
        jsonschema.validate(document, schema(name))
