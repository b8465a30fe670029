"""docs/json.md against what the commands print."""

from __future__ import annotations

import ast
import inspect
import json
import re
import shutil
import sys
import textwrap
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import click
import cv2
import numpy as np
import pytest
from evaluation.detection_runs import random_predictions, random_truth, write_truth

from legoworld import cli
from legoworld.records.bench_results import JudgesFile
from legoworld.shipped import catalog

PAGE = Path(__file__).parents[2] / "docs" / "json.md"
SCENE = Path(__file__).parents[2] / "examples" / "coffee"
EXAMPLES_TRUTH = catalog.folder("datasets") / "skimage_examples" / "truth_coco.json"
ROWS = dict(re.findall(r"^\| `([^`]+)` \| (.*) \|$", PAGE.read_text(encoding="utf-8"), re.M))


def keys(command: str) -> set[str]:
    """The top-level keys the page gives a command."""
    return set(re.findall(r"`(\w+)`", re.sub(r"\{[^}]*\}", "", ROWS[command])))


def inner_keys(command: str, key: str) -> set[str]:
    """The keys of the entries of a list, where the page names them."""
    return set(re.findall(r"`(\w+)`", re.search(rf"`{key}`:[^;{{]*\{{(.*?)\}}", ROWS[command])[1]))


@pytest.fixture(scope="module")
def printed(tmp_path_factory: pytest.TempPathFactory) -> dict[str, dict[str, Any]]:
    """What each command of the page prints, from one small data set."""
    here = tmp_path_factory.mktemp("json")
    truth = random_truth("coco", seed=1, images=4)
    results = here / "results.json"
    results.write_text(json.dumps(random_predictions("coco", truth, seed=1)))
    annotations = write_truth(here / "truth.json", truth)
    for name in ("photos", "scenes/stranger"):
        (here / name).mkdir(parents=True)
    (here / "scenes" / "stranger" / "scene.blend").write_bytes(b"")
    cv2.imwrite(str(here / "photos" / "x.png"), np.zeros((4, 4, 3), np.uint8))
    program = here / "program.py"
    program.write_text("import bpy\nbpy.ops.mesh.primitive_cube_add()\n")
    shutil.copytree(SCENE, here / "frozen" / "coffee")
    cv2.imwrite(str(here / "photos" / "coffee.png"), np.zeros((400, 600, 3), np.uint8))
    track, run, evaluation = here / "track.json", here / "run", here / "eval"
    imported = ["--task", "coco", "--track", track]
    calls: dict[str, list[Any]] = {
        **{f"list {kind}": [] for kind in ("tasks", "datasets", "baselines", "formats", "schema")},
        "track make": ["--task", "coco", "--truth", annotations, "-o", track],
        "track check": [track, "--photos", here / "photos"],
        "inspect": [SCENE, "--source", "glb", "--size", "60x40"],
        "readout": [here / "scenes", *imported, "-o", here / "read"],
        "baseline import": [results, *imported, "-o", run],
        "merge": [run, "-o", here / "merged"],
        "evaluate": [run, "--truth", annotations, "-o", evaluation, "--draws", "5"],
        "evidence verify": [evaluation],
        "compare": [evaluation, evaluation, "-o", here / "comparison", "--draws", "5"],
        "report": [evaluation, "-o", here / "report.html"],
        "export": [run, "--track", track, "-o", here / "coco.json"],
        "execute": [program, "-o", here / "executed", "--no-picture", "--sandbox", "limits"],
        "freeze": [here / "frozen"],
        "score": [
            SCENE,
            "--photo",
            here / "photos" / "coffee.png",
            "--truth",
            EXAMPLES_TRUTH,
            "--source",
            "glb",
            "--no-cache",
            "-o",
            here / "score",
        ],
        "doctor": [],
    }
    return {name: document(name, arguments) for name, arguments in calls.items()}


def document(name: str, arguments: list[Any]) -> dict[str, Any]:
    import contextlib
    import io

    with contextlib.redirect_stdout(io.StringIO()) as shown:
        code = cli.run([*name.split(), *map(str, arguments), "--json"])
    assert code in (0, 1), name
    found: dict[str, Any] = json.loads(shown.getvalue())
    return found


#: Commands that need an agent, a network, minutes or Ctrl-C: their keys are read from their source.
NOT_CALLED = {
    "agent check", "agent install", "agent list", "baseline install", "baseline run",
    "bench judges", "bench make", "bench table", "blender finalise", "import", "reconstruct",
    "trajectory pairs", "trajectory pick", "trajectory report", "trajectory score",
    "trajectory show", "view",
}  # fmt: skip


@pytest.mark.parametrize("command", sorted(set(ROWS) - NOT_CALLED))
def test_the_page_names_every_key(command, printed):
    assert set(printed[command]) == keys(command) | {"schema_version"}
    assert printed[command]["schema_version"] == 1


def commands_with_json(group: click.Command, words: tuple[str, ...] = ()) -> Iterator[str]:
    if isinstance(group, click.Group):
        for name in group.list_commands(click.Context(group)):
            inner = group.get_command(click.Context(group), name)
            assert inner is not None
            yield from commands_with_json(inner, (*words, name))
    elif any("--json" in parameter.opts for parameter in group.params):
        yield " ".join(words)


def test_every_command_with_json_is_on_the_page():
    expected = {*commands_with_json(cli.main)} - {"list"}
    expected |= {f"list {kind}" for kind in ("tasks", "datasets", "baselines", "formats", "schema")}
    assert set(ROWS) == expected


@pytest.mark.parametrize("command", sorted(NOT_CALLED))
def test_the_page_names_the_keys_in_the_source(command):
    """The keys of the one literal document that the module of the command prints or makes."""
    found = cli.main
    for word in command.split():
        found = found.get_command(click.Context(found), word)
    module = sys.modules[found.callback.__module__]
    trees = [ast.parse(textwrap.dedent(inspect.getsource(found.callback)))]
    if command == "bench judges":
        printed = set(JudgesFile.__struct_fields__) - {"schema_version"}
    else:
        if command == "bench make":
            trees = [ast.parse(inspect.getsource(module._document))]
        elif command == "baseline run":
            from legoworld.commands import baseline_command

            trees = [ast.parse(inspect.getsource(baseline_command.show))]
        printed = {
            key.value
            for call in ast.walk(trees[0])
            if isinstance(call, ast.Return)
            or (isinstance(call, ast.Call) and ast.unparse(call.func) in ("print_json", "out.show"))
            for document in [call.args[0] if isinstance(call, ast.Call) else call.value]
            if isinstance(document, ast.Dict)
            for key in document.keys
        }
    assert printed == keys(command)


@pytest.mark.parametrize(
    ("command", "key"),
    [
        ("list tasks", "tasks"),
        ("track check", "problems"),
        ("readout", "unmatched_folders"),
        ("freeze", "scenes"),
        ("doctor", "findings"),
        ("evidence verify", "checks"),
    ],
)
def test_the_page_names_the_keys_of_entries(command, key, printed):
    assert printed[command][key], "something to look at"
    for entry in printed[command][key]:
        assert set(entry) == inner_keys(command, key)
