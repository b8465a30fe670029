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
from legoworld.commands import (
    baseline_command,
    demo_command,
    evaluate_command,
    options,
    param_types,
    progress,
    run_text,
    score_command,
)
from legoworld.commands.output import Output
from legoworld.errors import InstallationError
from legoworld.evaluation.normals.arrays import SIGNS
from legoworld.records.formats import FORMATS
from legoworld.records.run_rows import RunRow


def run_json(capsys: Any, *words: str) -> Any:
    assert cli.run([*words, "--json"]) in (0, 1)
    return json.loads(capsys.readouterr().out)


@pytest.mark.parametrize("kind", ["tasks", "datasets", "baselines"])
def test_lists_are_cards_by_name(kind, capsys):
    cards = run_json(capsys, "list", kind)[kind]
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
    formats = run_json(capsys, "list", "formats")["formats"]
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
    parse = evaluate_command.parse_truths
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
    assert baseline_command._result_cell(made) == cell


def test_of_fifty_failures_the_first_are_named(capsys):
    rows = [RunRow(image_id=k, file_name=f"{k}.jpg", status="failed", reason="no")
            for k in range(51)]  # fmt: skip
    run: Any = SimpleNamespace(rows=rows, folder=Path("out"), summary=None)
    lines = baseline_command._lines(run, rows, verbose=False)
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
    assert cli.run([*words, "--json"]) == 0
    printed = json.loads(capsys.readouterr().out)
    assert printed == {"agents": ["own"], "common": ["shared"], "schema_version": 1}
    document.common = None
    assert cli.run(words) == 0
    assert capsys.readouterr().out == "table of own\n"


def convert(kind: Any, text: Any) -> Any:
    try:
        return kind.convert(text, None, None)
    except click.BadParameter as error:
        return str(error)


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("640x480", (640, 480)), ("640X480", (640, 480)), ((3, 4), (3, 4)), ("1x8192", (1, 8192)),
        ("8192x1", (8192, 1)), ("0x5", None), ("8193x1", None), ("5", None), ("1x2x3", None),
        ("-1x5", None), ("ax5", None), ("", None),
    ],
)  # fmt: skip
def test_a_size(text, value):
    expected = value or f"{text!r} is not a size such as 640x480"
    assert convert(param_types.SizeType(), text) == expected


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("1/1", (1, 1)), ("3/3", (3, 3)), ((2, 5), (2, 5)),
        ("0/3", "'0/3': shards are counted from 1/3 to 3/3"),
        ("4/3", "'4/3': shards are counted from 1/3 to 3/3"),
        ("0/0", "'0/0': shards are counted from 1/1 to 1/1"),
        ("1", "'1' is not a shard such as 1/16"), ("1/2/3", "'1/2/3' is not a shard such as 1/16"),
        ("a/2", "'a/2' is not a shard such as 1/16"),
    ],
)  # fmt: skip
def test_a_shard(text, value):
    assert convert(param_types.ShardType(), text) == value


def test_a_place_is_a_folder_or_a_url(tmp_path):
    (tmp_path / "a b").mkdir()
    (tmp_path / "x.blend").touch()
    for kind, file in ((param_types.PLACE, False), (param_types.EXISTING_PLACE, False),
                       (param_types.EXISTING_SCENES, True)):  # fmt: skip
        assert convert(kind, "s3://bucket/a%20b") == "s3://bucket/a%20b"
        assert convert(kind, f"file://{tmp_path}/a%20b") == tmp_path / "a b"
        assert convert(kind, str(tmp_path / "a b")) == tmp_path / "a b"
        found = convert(kind, str(tmp_path / "x.blend"))
        assert (found == tmp_path / "x.blend") is file, found
    assert convert(param_types.PLACE, str(tmp_path / "new")) == tmp_path / "new"
    for kind in (param_types.EXISTING_PLACE, param_types.EXISTING_SCENES):
        assert "does not exist" in convert(kind, str(tmp_path / "new"))


@pytest.mark.parametrize(
    ("kind", "least"), [(param_types.COUNT, 1), (param_types.FROM_ZERO, 0),
                        (param_types.AMOUNT, 0.1)],
)  # fmt: skip
def test_the_least_of_a_number(kind, least):
    assert convert(kind, str(least)) == least
    assert "is not in the range" in convert(kind, str(least - 0.01 if least == 0.1 else least - 1))


def test_a_misspelt_word_is_answered_by_its_nearest():
    said = convert(param_types.Choice(["alpha", "beta"]), "alpah")
    assert said == "'alpah' is not one of 'alpha', 'beta'. Did you mean 'alpha'?"
    assert convert(param_types.Choice(["alpha"]), "alpha") == "alpha"
    with_track = param_types.TaskChoice(param_types.has_track).choices
    assert {"coco", "eth3d"} <= {*with_track} < {*param_types.TaskChoice().choices}
    assert "bench" not in with_track


@pytest.mark.parametrize(
    ("n", "verbose", "shown"),
    [(4, False, ["0", "1", "2", "3"]), (5, True, ["0", "1", "2", "3", "4"]),
     (5, False, ["0", "1", "2", "... and 2 more words (-v lists them)"])],
)  # fmt: skip
def test_lines_of_one_kind_are_three_and_their_number(n, verbose, shown):
    assert run_text._print_limited([str(k) for k in range(n)], "words", verbose=verbose) == shown


def make_score(**changes: Any) -> Any:
    row = SimpleNamespace(status="ok", file_name="a.jpg", reason="it broke", unmatched=())
    advice = [SimpleNamespace(level="bad", what=f"finding {k}", do="mend" * (k == 0))
              for k in range(7)]  # fmt: skip
    summary = SimpleNamespace(task="coco")
    return SimpleNamespace(**{"row": row, "summary": summary, "advice": advice, "execution": None,
                              "overlay": Path("o.png")} | changes)  # fmt: skip


def lines(found: Any, output: Path | None = None, *, verbose: bool = False) -> list[str]:
    out = Output(verbose=verbose)
    return list(score_command._lines(found, found.overlay, output, out))


def test_a_score_in_words(monkeypatch, capsys):
    family = SimpleNamespace(short=lambda summary: f"numbers of {summary.task}")
    monkeypatch.setattr("legoworld.evaluation.family.load_evaluation_family", lambda _: family)
    monkeypatch.setattr("legoworld.commands.output.on_terminal", lambda: True)
    first = ["numbers of coco", "bad: finding 0; do: mend",
             *(f"bad: finding {k}" for k in range(1, 5))]  # fmt: skip
    found = make_score()
    rest = "... and 2 findings more (-v lists them)"
    assert lines(found) == [*first, rest, "overlay -> o.png"]
    assert "-o FOLDER keeps the scene, the run" in capsys.readouterr().err
    assert lines(found, Path("out"), verbose=True) == [
        *first, "bad: finding 5", "bad: finding 6", "overlay -> o.png", "report -> out/report.html",
    ]  # fmt: skip
    assert capsys.readouterr().err == ""
    found.advice[6].what = "the label 'cpu' is none"
    found.row.unmatched = [SimpleNamespace(label="cpu")]
    found.overlay = None
    assert lines(found) == [*first, "bad: the label 'cpu' is none",
                            "... and 1 finding more (-v lists them)"]  # fmt: skip
    error = SimpleNamespace(line=3, type="ValueError", message="no")
    stopped = make_score(execution=SimpleNamespace(status="error", error=error), summary=None)
    assert lines(stopped) == [
        "the program stopped at line 3: ValueError: no; the partial scene is scored",
        "ok: a.jpg: it broke",
    ]
    document = score_command._document(stopped, Path("kept.png"))
    assert document == {
        "row": stopped.row, "summary": None, "advice": stopped.advice,
        "execution": {"status": "error", "error": error}, "overlay": "kept.png",
    }  # fmt: skip
    assert score_command._document(found, None)["overlay"] is None


def test_the_overlay_is_kept_where_nothing_else_is(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "o.png").write_bytes(b"picture")
    for _ in range(2):
        kept = score_command._kept_overlay(tmp_path / "o.png", Path("a/139.jpg"), "lvis")
        assert kept == Path("legoworld-runs/139-lvis-overlay.png")
        assert kept.read_bytes() == b"picture"


@pytest.mark.parametrize("quiet", [False, True])
def test_progress_on_a_terminal_is_a_bar(quiet, monkeypatch, capsys):
    pytest.importorskip("tqdm")
    monkeypatch.setattr(progress, "on_terminal", lambda: True)
    with progress.shown_progress("scene", quiet=quiet) as listener:
        listener.total(4)
        listener.kept(1)
        listener.notice("a notice")
        listener.warn("odd")
        listener.row(RunRow(image_id=1, file_name="", status="failed"))
        listener.row(RunRow(image_id=2, file_name="", status="ok"))
    said = capsys.readouterr().err
    if quiet:
        assert said == ""
        return
    assert "a notice" in said
    assert "warning: odd" in said
    assert "1/4" in said


def test_progress_without_a_terminal_is_lines(monkeypatch, capsys):
    monkeypatch.setattr(progress, "on_terminal", lambda: False)
    clock = iter([0.0, 2.0, 3.0, 4.0])
    monkeypatch.setattr(progress.time, "monotonic", lambda: next(clock))
    with progress.shown_progress("scene", quiet=False) as listener:
        listener.total(3)
        for k in range(3):
            listener.row(RunRow(image_id=k, file_name="", status="failed"))
        listener.warn("odd")
    assert capsys.readouterr().err.splitlines() == [
        "1 of 3 scenes, 1 failed, 2 s each", "3 of 3 scenes, 3 failed, 1.3 s each", "warning: odd",
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("words", "logged"), [(["-v"], True), ([], False), (["-q"], False), (["-v", "-q"], False)]
)
def test_what_a_baseline_logs_is_said_with_v(words, logged, tmp_path, monkeypatch):
    listeners = []
    monkeypatch.setattr(
        "legoworld.api.baselines.baseline_run",
        lambda *_, listener, **__: listeners.append(listener),
    )
    monkeypatch.setattr(baseline_command, "show", lambda *_: 0)
    for name in ("t.json", "w.pth"):
        (tmp_path / name).touch()
    run = ["baseline", "run", "dino", "--task", "coco", "--track", str(tmp_path / "t.json"),
           "--photos", str(tmp_path), "--weights", str(tmp_path / "w.pth"), "-o",
           str(tmp_path / "run")]  # fmt: skip
    assert cli.run([*run, *words]) == 0
    (listener,) = listeners
    assert (listener.log == listener.notice) is logged


@pytest.mark.parametrize(
    ("cache", "no_cache", "why", "taken"),
    [
        (None, False, "", True), (None, False, "read-only", False), (None, True, "", False),
        (Path("c"), False, "read-only", Path("c")), (Path("c"), True, "", False),
    ],
)  # fmt: skip
def test_which_cache_is_taken(cache, no_cache, why, taken, monkeypatch, capsys):
    monkeypatch.setattr("legoworld.scene.cache.default_cache_folder", lambda: Path("own"))
    monkeypatch.setattr("legoworld.scene.cache.why_unwritable", lambda _: why)
    assert options._cache(cache, no_cache) == taken
    told = bool(why) and cache is None
    said = "the snapshot cache own cannot be written (read-only): continuing without one; "
    assert capsys.readouterr().err.startswith(said) == told


def test_the_signs_of_normals_are_those_that_are_read():
    (kind,) = (how["type"] for names, _, how in options.SHARED if names == "--sign")
    assert tuple(kind.choices) == SIGNS


@pytest.mark.parametrize(
    ("changes", "bare"),
    [({}, True), ({"status": "failed"}, False), ({"instances": None}, False),
     ({"instances": SimpleNamespace(labelled=1)}, False), ({"unmatched": ["x"]}, False),
     ({"unexported": ["x"]}, False)],
)  # fmt: skip
def test_a_scene_without_any_label_is_said(changes, bare):
    row = {"status": "ok", "instances": SimpleNamespace(labelled=0), "unmatched": None,
           "unexported": None, "scene": "rooms/den"}  # fmt: skip
    run: Any = SimpleNamespace(rows=[SimpleNamespace(**row | changes)] * 2,
                               summary=SimpleNamespace(task="lvis"))  # fmt: skip
    said = (
        "2 scenes have no label, such as rooms/den: give objects the custom property "
        "`category` (`legoworld list schema --task lvis`)"
    )
    assert run_text.unlabelled_lines(run) == [said] * bare
