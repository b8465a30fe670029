"""Single words and lines of commands that other tests pass by."""

from __future__ import annotations

import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import click
import numpy as np
import pytest

from legoworld import cli
from legoworld.commands import baseline_output, demo_command, run_text, truths
from legoworld.errors import InstallationError
from legoworld.records.formats import FORMATS
from legoworld.records.run_rows import RunRow


def said(capsys: Any, *words: str) -> Any:
    assert cli.run([*words, "--json"]) in (0, 1)
    return json.loads(capsys.readouterr().out)


@pytest.mark.parametrize("kind", ["tasks", "datasets", "baselines"])
def test_lists_are_cards_by_name(kind, capsys):
    cards = said(capsys, "list", kind)[kind]
    assert {frozenset(card) for card in cards} == {
        frozenset(("name", "version", "title", "licence"))
    }
    assert {"tasks": "coco", "datasets": "coco", "baselines": "hf-depth"}[kind] in {
        card["name"] for card in cards
    }
    assert cli.run(["list", kind]) == 0
    header = capsys.readouterr().out.splitlines()[0]
    assert header.split() == ["name", "version", "what", "licence"]


def test_formats_are_listed_with_their_files(capsys):
    formats = said(capsys, "list", "formats")["formats"]
    assert formats == [{"name": n, "file": FORMATS[n].file} for n in sorted(FORMATS)]
    assert cli.run(["list", "formats"]) == 0
    assert capsys.readouterr().out.splitlines()[0].split() == ["name", "file"]


def test_a_task_that_is_broken_is_said_beside_the_others(capsys, monkeypatch):
    broken = InstallationError("task x cannot be loaded", found="no module y")
    monkeypatch.setattr("legoworld.commands.list_command.broken_tasks", lambda: [broken])
    assert cli.run(["list", "tasks"]) == 1
    assert capsys.readouterr().err == f"legoworld: {broken}\n"
    assert cli.run(["list", "datasets"]) == 0
    assert capsys.readouterr().err == ""


def test_a_truth_for_each_task_and_one_for_all(tmp_path):
    for name in ("a.json", "b=c.json"):
        (tmp_path / name).write_text("{}")
    one, other = tmp_path / "a.json", tmp_path / "b=c.json"
    parse = truths.parse_truths
    assert parse(tmp_path, [f"coco={one}", f"lvis={other}"]) == {"coco": one, "lvis": other}
    assert parse(tmp_path, [str(other)]) == other
    for texts in ([f"coco={one}", str(other)], [str(one), str(other)]):
        with pytest.raises(click.UsageError, match="TASK=PATH once for each task"):
            parse(tmp_path, texts)
    with pytest.raises(click.BadParameter, match="does not exist"):
        parse(tmp_path, [f"coco={one}x"])


def result(name: str, **lines: Any) -> Any:
    return SimpleNamespace(summary=name, folder=Path(name), rows=(), strangers=(), **lines)


@pytest.mark.parametrize("several", [False, True])
def test_a_run_is_named_by_its_task_where_there_are_several(several, capsys, monkeypatch):
    monkeypatch.setattr(run_text, "_lines", lambda one, **_: ["both", f"of {one.summary}"])
    monkeypatch.setattr(run_text, "warning_lines", lambda *_, **__: ["odd"])
    monkeypatch.setattr(run_text, "_counts", lambda summary: f"all of {summary}")
    runs = {"coco": result("a"), "lvis": result("b")} if several else {"coco": result("a")}
    run_text.show_runs(runs, quiet=False, verbose=False)
    out, err = (text.splitlines() for text in capsys.readouterr())
    assert err == ["odd"]
    if several:
        assert out == ["both", "coco: of a", "lvis: of b", "coco: all of a -> a",
                       "lvis: all of b -> b"]  # fmt: skip
    else:
        assert out == ["both", "of a", "all of a -> a"]
    run_text.show_runs(runs, quiet=True, verbose=False)
    assert capsys.readouterr().err == ""


@pytest.mark.parametrize(
    ("row", "cell"),
    [
        ({"depth": SimpleNamespace(finite_px=3, space="depth"), "rendered_wh": (4, 3)},
         "25.0% depth"),
        ({"depth": SimpleNamespace(finite_px=3, space="depth"), "rendered_wh": None}, 0),
        ({"depth": None, "rendered_wh": (4, 3), "n_predictions": 7}, 7),
        ({"status": "failed", "n_predictions": 7}, "-"),
    ],
)  # fmt: skip
def test_what_was_predicted_of_an_image(row, cell):
    known = {"status": "ok", "depth": None, "rendered_wh": None, "n_predictions": None}
    made: Any = SimpleNamespace(**known | row)
    assert baseline_output._result_cell(made) == cell


def test_of_fifty_failures_the_first_are_named(capsys):
    rows = [RunRow(image_id=k, file_name=f"{k}.jpg", status="failed", reason="no")
            for k in range(51)]  # fmt: skip
    run: Any = SimpleNamespace(rows=rows, folder=Path("out"), summary=None)
    lines = baseline_output._lines(run, rows, verbose=False)
    shown = [next(lines) for _ in range(51)]
    assert shown[49:] == [
        "failed: 49.jpg (image 49): no", "... and 1 more, in out/per_image.jsonl",
    ]  # fmt: skip


@pytest.mark.parametrize("given", [None, "there"])
@pytest.mark.parametrize("tasks", [["coco"], ["coco", "lvis"]])
def test_where_the_examples_are_read_to(given, tasks, tmp_path, monkeypatch, capsys):
    asked = []

    def readout(scenes: Any, output: Any, **how: Any) -> Any:
        asked.append((output, how["task"], sorted(how["track"])))
        return {}

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("legoworld.api.readout.readout", readout)
    monkeypatch.setattr("legoworld.commands.readout_command.show_runs", lambda *_, **__: None)
    words = ["readout", *(word for task in tasks for word in ("--task", task))]
    assert cli.run([*words, *(["-o", given] if given else [])]) == 0
    alone = len(tasks) == 1
    folder = Path("legoworld-runs") / ("examples-coco" if alone else "examples")
    assert asked == [(Path(given) if given else folder, "coco" if alone else tasks, tasks)]
    named = "the coco examples" if alone else "the examples"
    assert f"no SCENES given: reading {named} that ship with legoworld" in capsys.readouterr().err


def test_the_photos_of_the_demo_are_written_in_red_green_and_blue(tmp_path, monkeypatch):
    data = pytest.importorskip("skimage.data")
    import cv2

    for name in ("astronaut", "chelsea", "coffee", "stereo_motorcycle"):
        picture = np.full((2, 3, 3), (10, 20, 30 + len(name)), np.uint8)
        both = (picture, None, None) if name == "stereo_motorcycle" else picture
        monkeypatch.setattr(data, name, lambda both=both: both)
    assert demo_command._write_files(tmp_path) is True
    photos = sorted((tmp_path / "photos").iterdir())
    assert [path.name for path in photos] == [
        "astronaut.png", "chelsea.png", "coffee.png", "motorcycle.png",
    ]  # fmt: skip
    assert cv2.imread(str(photos[3]))[0, 0].tolist() == [47, 20, 10]  # OpenCV has blue first


def test_what_is_undone_is_said(tmp_path, capsys):
    words = ["plugin", "install", "--for", "claude", "--project", str(tmp_path)]
    (tmp_path / ".mcp.json").write_text('{"mcpServers": {}}')
    assert cli.run([*words, "--ledger", str(tmp_path / "case"), "--write"]) == 0
    wrote = capsys.readouterr().out.splitlines()
    assert {line.split()[0] for line in wrote} == {"wrote"}
    assert cli.run([*words, "--ledger", str(tmp_path / "case"), "--write"]) == 0
    assert {line.split()[0] for line in capsys.readouterr().out.splitlines()} == {"unchanged"}
    assert cli.run([*words, "--undo"]) == 0
    undone = capsys.readouterr().out.splitlines()
    assert {line.split()[0] for line in undone} == {"removed", "restored"}
    assert {line.split(" ", 1)[1] for line in undone} == {line.split(" ", 1)[1] for line in wrote}
    assert cli.run([*words, "--undo"]) == 0
    assert capsys.readouterr().out == "nothing is installed here\n"


def test_scores_over_the_images_that_all_agents_have(tmp_path, monkeypatch, capsys):
    document: Any = SimpleNamespace(agents=["own"], common=["shared"], common_images=[1, 2])
    monkeypatch.setattr("legoworld.trajectories.api.trajectory_score", lambda *_, **__: document)
    monkeypatch.setattr("legoworld.trajectories.page.agents_table", lambda rows: rows)
    monkeypatch.setattr("legoworld.tables.terminal.terminal", lambda rows: f"table of {rows[0]}")
    words = ["trajectory", "score", str(tmp_path), "--truth", str(tmp_path), "-o", "scores"]
    assert cli.run(words) == 0
    assert capsys.readouterr().out.splitlines() == [
        "table of own", "", "Over 2 images that all agents have:", "table of shared",
    ]  # fmt: skip
    document.common = None
    assert cli.run(words) == 0
    assert capsys.readouterr().out == "table of own\n"
