"""The JSON Schemas of the file formats: true of the files that ship, and not changed unnoticed."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import jsonschema
import pytest

from legoworld import cli
from legoworld.records.formats import FORMATS, schema_text

ROOT = Path(__file__).parents[2]


def schema(name: str) -> dict[str, object]:
    return json.loads(schema_text(name))


def test_no_format_has_changed_unnoticed():
    check = [sys.executable, str(ROOT / "docs" / "formats_page.py"), "--check"]
    assert subprocess.run(check, check=False).returncode == 0, (
        "a record type or docs/formats.md changed: run `make docs`, look at the digests that "
        "`git diff docs/formats.md` shows, and tell in CHANGELOG.md of a key that was renamed, "
        "removed or became required"
    )


def test_a_digest_is_of_the_format_and_not_of_its_words():
    sys.path.insert(0, str(ROOT / "docs"))
    try:
        from formats_page import digest
    finally:
        sys.path.pop(0)
    said = {"properties": {"description": {"type": "string"}}, "description": "One."}
    reworded, without = {**said, "description": "Two."}, {**said, "properties": {}}
    digests = [digest(json.dumps(one)) for one in (said, reworded, without)]
    assert digests[0] == digests[1] != digests[2]


@pytest.mark.parametrize("name", sorted(FORMATS))
def test_each_is_a_schema(name):
    jsonschema.Draft202012Validator.check_schema(schema(name))


def test_the_command_prints_it_and_lists_its_name(capsys):
    assert cli.run(["list", "formats"]) == 0
    assert "TRACK.json" in capsys.readouterr().out
    assert cli.run(["list", "schema", "--format", "track"]) == 0
    assert capsys.readouterr().out == schema_text("track")
    for mixed in (["tasks", "--format", "track"], ["schema", "--format", "track", "--task", "coco"],
                  ["formats", "--task", "coco"], ["schema", "--format", "trak"]):  # fmt: skip
        assert cli.run(["list", *mixed]) == 2


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
