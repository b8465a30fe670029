"""What commands print of a result: every number in its sentence, the same result as JSON."""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from unittest.mock import MagicMock

import pytest

from legoworld import cli
from legoworld.api import baselines
from legoworld.api.listener import Listener
from legoworld.api.readout import Run
from legoworld.cards import load_card
from legoworld.commands import (
    baseline_command,
    evaluate_command,
    inspect_command,
    run_text,
)
from legoworld.commands.output import Output
from legoworld.errors import LegoWorldError
from legoworld.exports.formats import ExportResult
from legoworld.records.agents import TrialRow, Usage
from legoworld.records.report_page import Advice
from legoworld.records.run_file import RunCoverage, RunSummary, ValidityCounts
from legoworld.records.run_rows import RunRow
from legoworld.records.scene_folder import FrozenRow, InstanceRow, Verdict
from legoworld.running.source_comparison import Pair
from legoworld.tables.table import Column, Table, table


def entry(number: int, area_px: int = 0, **said: Any) -> InstanceRow:
    known = {
        "name": f"thing {number}", "objects": ("a", "b"), "category": None, "category_id": None,
        "labelled": False,
        "bbox_xywh_px": (1, 2, 3, 4), "nested_in": None, "reason": "hidden",
    }  # fmt: skip
    return InstanceRow(id=number, area_px=area_px, **{**known, **said})


def pair(number: int, iou: float = 1.0, **said: Any) -> Pair:
    known = {"blend_category": "cup", "glb_category": "cup", "blend_area_px": 30, "glb_area_px": 31}
    return Pair(name=f"p{number}", iou=iou, **{**known, **said})


def make_comparison(**said: Any) -> Any:
    side = SimpleNamespace(
        view=SimpleNamespace(size_wh=(64, 48)),
        scene=SimpleNamespace(snapshot_sha256="ab"),
        warnings=("odd",),
    )
    known = {
        "blend": side, "glb": side, "pairs": (), "unseen": 1, "lost": (), "gained": (),
        "differences": (), "n_disagreeing": 0, "differing_px": 5, "faithful": True,
    }  # fmt: skip
    return SimpleNamespace(**{**known, **said})


def shown(found: Any, capsys: Any, **how: bool) -> tuple[int, str, str]:
    code = inspect_command._show_comparison(found, Output(**how))
    said = capsys.readouterr()
    return code, said.out, said.err


@pytest.mark.parametrize(
    ("pairs", "disagreeing", "listed"), [(40, 0, 40), (41, 0, 40), (45, 43, 43)]
)
def test_pairs_that_disagree_are_all_listed_and_forty_at_least(
    pairs: int, disagreeing: int, listed: int, capsys: Any
) -> None:
    found = make_comparison(pairs=tuple(map(pair, range(pairs))), n_disagreeing=disagreeing)
    _, said, _ = shown(found, capsys)
    assert said.count("1.00000") == listed
    more = f"... and {pairs - listed} more that agree (-v lists them)\n"
    assert (more in said) == (pairs > listed)
    assert "more that agree" in said or pairs == listed
    _, said, _ = shown(found, capsys, verbose=True)
    assert said.count("1.00000") == pairs
    assert "more that agree" not in said


def test_two_sources_in_words(capsys: Any) -> None:
    found = make_comparison(
        pairs=(
            pair(1, 0.5, glb_category="mug"),
            pair(2, blend_category=None, glb_category=None),
            pair(3, glb_category=None),
        ),
        n_disagreeing=1,
        lost=(entry(1, 7), entry(2, 9, category="cup"), entry(3)),
        gained=tuple(entry(k, k) for k in range(1, 23)),
        differences=("the camera",),
        faithful=False,
    )
    code, said, warned = shown(found, capsys)
    lines = said.splitlines()
    assert code == 1
    assert lines[0].split("  ")[0] == "instance"
    assert lines[2].split() == ["p1", "cup", "|", "mug", "30", "31", "0.50000"]
    assert lines[3].split() == ["p2", "-", "30", "31", "1.00000"]
    assert lines[4].split() == ["p3", "cup", "|", "-", "30", "31", "1.00000"]
    assert lines[6:11] == [
        "3 instances in both sources at 64x48: 1 disagrees; 1 more is not seen in either; "
        "5 pixels differ",
        "only in scene.blend: 'thing 2', cup, 9 px",
        "only in scene.blend: 'thing 1', 7 px",
        "only in scene.blend: 1 more, 1 of them not seen",
        "only in scene.glb: 'thing 22', 22 px",
    ]
    assert lines[-2:] == ["only in scene.glb: 2 more, 0 of them not seen", "differs: the camera"]
    assert warned == "warning: scene.blend: odd\nwarning: scene.glb: odd\n"
    assert shown(found, capsys, quiet=True) == (1, said, "")
    assert shown(make_comparison(), capsys)[0] == 0
    code, said, _ = shown(found, capsys, as_json=True)
    document = json.loads(said)
    assert code == 1
    assert document["instances"][0] == {
        "name": "p1", "blend_category": "cup", "glb_category": "mug", "blend_area_px": 30,
        "glb_area_px": 31, "iou": 0.5,
    }  # fmt: skip
    assert [len(document[name]) for name in ("lost", "gained")] == [3, 22]
    assert document["size_wh"] == [64, 48]
    assert (document["disagreeing"], document["differing_px"], document["unseen"]) == (1, 5, 1)
    assert document["differences"] == ["the camera"]
    assert document["warnings"] == {"blend": ["odd"], "glb": ["odd"]}
    assert document["snapshot_sha256"] == {"blend": "ab", "glb": "ab"}


def test_the_instances_of_a_scene_in_words(tmp_path: Path, capsys: Any) -> None:
    entries = [entry(k, 50 - k) for k in range(40)]
    entries += [entry(40, labelled=True, category="cup"), entry(41, 9, labelled=True)]
    view = SimpleNamespace(
        instances=entries, size_wh=(64, 48), n_triangles=12, outside_vocabulary={"mugg": 2},
        nearest={"mugg": ("mug",)}, not_rendered=(("Empty", "cup"),), warnings=("odd",),
        camera=SimpleNamespace(name="Camera", type="PERSP", lens_mm=35.0),
        render=SimpleNamespace(unit_scale=0.01, frame=7), task_table=None,
    )  # fmt: skip
    Output(quiet=False, verbose=False).show(
        {}, inspect_command._lines(view, tmp_path, Output(quiet=False, verbose=False))
    )  # type: ignore[arg-type]
    said = capsys.readouterr()
    lines = said.out.splitlines()
    assert lines[2].split() == ["41", "thing", "41", "2", "-", "9", "1", "2", "3", "4"]
    assert lines[3].split() == ["40", "thing", "40", "2", "cup", "0", "(hidden)"]
    assert lines[4].split()[0] == "0", "the largest of those without a label"
    assert lines[42] == "... and 2 more (-v lists them)"
    assert lines[44] == (
        "42 instances (2 labelled), 12 triangles; camera 'Camera' PERSP 35 mm; 64x48; "
        "1 unit = 0.01 m; frame 7"
    )
    assert "mugg" in lines[45]
    assert "mug" in lines[45].split("mugg", 1)[1]
    assert lines[46:] == [
        "'Empty', labelled 'cup', has no surface that renders",
        f"-> {tmp_path}",
    ]
    assert said.err == "warning: odd\n"
    Output(quiet=True, verbose=True).show(
        {}, inspect_command._lines(view, None, Output(quiet=True, verbose=True))
    )  # type: ignore[arg-type]
    said = capsys.readouterr()
    assert said.err == ""
    assert "more (-v" not in said.out
    assert "-> " not in said.out
    rows = tuple((f"{k} cup", "left_of") for k in range(41))
    columns = (Column(name="instance"), Column(name="relation"))
    view.task_table = Table(title="Relations", columns=columns, rows=rows)
    shown = "\n".join(inspect_command._lines(view, None, Output()))  # type: ignore[arg-type]
    assert "\nRelations\ninstance  relation\n" in shown
    assert "39 cup    left_of\n... and 1 more (-v lists them)\n" in shown


def score(status: str = "ok", advice: int = 0, **said: Any) -> Any:
    row = RunRow(image_id=1, file_name="a.png", status=status, reason="no scene")
    found = tuple(Advice(level="bad", what=f"w{k}", do="d" * (k % 2)) for k in range(advice))
    known = {"row": row, "summary": SimpleNamespace(task="coco"), "advice": found,
             "execution": None, "overlay": None}  # fmt: skip
    return SimpleNamespace(**{**known, **said})


@pytest.fixture
def scored(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Any) -> Any:
    """The command's code, output and errors, where scoring gives a result."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "scene").mkdir()
    for name in ("a.png", "t.json"):
        (tmp_path / name).touch()
    family = MagicMock()
    family.return_value.short.return_value = "AP 0.5"
    monkeypatch.setattr("legoworld.evaluation.family.load_evaluation_family", family)

    def go(found: Any, *words: str) -> tuple[int, str, str]:
        monkeypatch.setattr("legoworld.api.one_photo.score_photo", lambda *_: found)
        arguments = ["score", "scene", "--photo", "a.png", "--truth", "t.json", "--no-cache"]
        code = cli.run([*arguments, *words])
        said = capsys.readouterr()
        return code, said.out, said.err

    return go


def test_a_score_in_words(scored: Any, tmp_path: Path) -> None:
    keep = "-o FOLDER keeps the scene, the run, the evaluation and a report\n"
    code, said, err = scored(score(advice=6))
    assert code == 0
    assert said.splitlines() == [
        "AP 0.5", "bad: w0", "bad: w1; do: d", "bad: w2", "bad: w3; do: d", "bad: w4",
        "... and 1 finding more (-v lists them)",
    ]  # fmt: skip
    assert err == keep
    code, said, err = scored(score(advice=6), "-v", "-q")
    assert said.splitlines()[-1] == "bad: w5; do: d"
    assert err == ""
    assert "more (-v" not in scored(score(advice=5))[1]
    assert scored(score(), "-o", "out")[1:] == ("AP 0.5\nreport -> out/report.html\n", "")
    code, said, _ = scored(score("missing", summary=None))
    assert (code, said) == (1, "missing: a.png: no scene\n")


def test_an_overlay_is_kept_where_no_folder_was_asked_for(scored: Any, tmp_path: Path) -> None:
    (tmp_path / "overlay.png").write_bytes(b"picture")
    found = score(overlay=tmp_path / "overlay.png")
    kept = Path("legoworld-runs") / "a-coco-overlay.png"
    assert f"overlay -> {kept}\n" in scored(found)[1]
    assert kept.read_bytes() == b"picture"
    kept.unlink()
    assert f"overlay -> {tmp_path / 'overlay.png'}\n" in scored(found, "-o", "out")[1]
    assert not kept.exists()


def test_a_program_that_stopped_is_said_and_is_in_the_json(scored: Any) -> None:
    error = {"line": 7, "type": "NameError", "message": "x"}
    found = score(execution=SimpleNamespace(status="partial", error=SimpleNamespace(**error)))
    assert scored(found)[1].startswith(
        "the program stopped at line 7: NameError: x; the partial scene is scored\nAP 0.5\n"
    )
    found = score(summary=None, advice=1, execution=SimpleNamespace(status="done", error=None))
    code, said, _ = scored(found, "--json")
    assert code == 0
    document = json.loads(said)
    assert document["row"]["status"] == "ok"
    assert document["execution"] == {"status": "done", "error": None}
    assert document["advice"][0]["what"] == "w0"
    assert (document["summary"], document["overlay"]) == (None, None)
    assert json.loads(scored(score(summary=None), "--json")[1])["execution"] is None


def test_what_was_exported_in_words(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Any
) -> None:
    failed: dict[str, LegoWorldError] = {}
    made = ExportResult(images=2, annotations=1, losses=("its tilt",), failed=failed)
    monkeypatch.setattr("legoworld.api.exporting.export", lambda *_, **__: made)
    output = tmp_path / "o.json"
    assert cli.run(["export", str(tmp_path), "-o", str(output)]) == 0
    said = capsys.readouterr()
    assert said.out == f"1 annotation of 2 images -> {output}\n"
    assert said.err == "coco does not hold: its tilt\n"
    failed["cup"] = LegoWorldError("no camera")
    assert cli.run(["export", str(tmp_path), "-o", str(output)]) == 1
    assert capsys.readouterr().err.endswith("cup: no camera\n")
    failed.clear()
    assert cli.run(["export", str(tmp_path), "-o", str(output), "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert document | {
        "format": "coco",
        "output": str(output),
        "images": 2,
        "annotations": 1,
        "not_held": ["its tilt"],
        "failed": [],
    } == (document)


def trial(number: int, status: str = "ok", **said: Any) -> TrialRow:
    known = {"reason": "too late", "seconds": 12.4, "checkpoints": 3}
    return TrialRow(image_id=number, scene=f"s{number}", run=1, status=status, **known | said)


def test_trials_as_they_end_and_as_json(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Any
) -> None:
    usage = Usage(completion_tokens=1500, cost_usd=0.25)
    rows = [trial(1), trial(2, "failed", usage=usage), trial(3, kept=True, usage=usage)]
    held = SimpleNamespace(does_not_hold=("the network",))
    plan = SimpleNamespace(
        agent_held=held, blender_held=SimpleNamespace(does_not_hold=("files", "processes")),
        card=SimpleNamespace(name="codex"),
        work=SimpleNamespace(track=SimpleNamespace(images=[1, 2, 3])),
    )  # fmt: skip
    monkeypatch.setattr("legoworld.agents.campaign.plan_run", lambda *_, **__: plan)
    given = []

    def make(_plan: Any, _output: Any, *, listener: Any, **words: Any) -> list[TrialRow]:
        given.append(words["images"])
        listener.total(len(rows))
        for row in rows:
            listener.trial(row)
        return rows

    monkeypatch.setattr("legoworld.agents.campaign.make_trials", make)
    (tmp_path / "t.json").touch()
    words = ["reconstruct", str(tmp_path / "t.json"), "--photos", str(tmp_path),
             "--agent", "codex", "-o", str(tmp_path / "out")]  # fmt: skip
    assert cli.run([*words, "--limit", "2"]) == 1
    said = capsys.readouterr()
    assert given == [[1, 2]]
    assert said.out == f"2 of 3 trials left a scene -> {tmp_path / 'out'}\n"
    assert said.err.splitlines() == [
        "not kept from codex: the network",
        "not kept from Blender: files, processes",
        "1/3 s1 (12 s, 3 checkpoints)",
        "2/3 s2 (12 s, 3 checkpoints, 1,500 output tokens in all, $0.25): failed: too late",
        "3/3 s3 (kept, 3 checkpoints, 3,000 output tokens in all, $0.50)",
    ]
    del rows[1]
    assert cli.run([*words, "--json", "-q"]) == 0
    said = capsys.readouterr()
    assert said.err == ""
    assert [t["scene"] for t in json.loads(said.out)["trials"]] == ["s1", "s3"]


def test_the_calls_of_a_trial_and_its_score(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Any
) -> None:
    rows = [[1, "0.5", "execute", "ok", "c1", "0.2500", "hello"]]
    finalisation = SimpleNamespace(source="none")
    about = SimpleNamespace(
        agent="codex", status="ok", ended="itself", agent_seconds=61.5, finalisation=finalisation
    )
    trial = SimpleNamespace(about=about, calls=["a call"])
    scores: list[Any] = [None]
    place = "legoworld.trajectories"
    monkeypatch.setattr(f"{place}.api.read_trial", lambda _: trial)
    head = ["call", "s", "command", "status", "checkpoint", "Q", "said"]
    monkeypatch.setattr(f"{place}.page.calls_table", lambda *_: table(head, rows))
    monkeypatch.setattr(f"{place}.api.find_score", lambda *_: scores[0])
    monkeypatch.setattr(f"{place}.api.read_scores", lambda _: None)
    words = ["trajectory", "show", str(tmp_path)]
    assert cli.run(words) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].split() == head
    assert lines[2].split() == ["1", "0.5", "execute", "ok", "c1", "0.2500", "hello"]
    assert lines[3:] == ["codex: ok, ended by itself after 62 s; nothing was submitted"]
    scores[0] = SimpleNamespace(final_q=0.5, regret=0.125)
    finalisation.source = "last"
    assert cli.run(words) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[3].endswith("; submitted: its last scene")
    assert lines[4:] == ["final Q 0.5000, regret 0.1250"]


def test_the_calls_of_a_ledger(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Any
) -> None:
    known = {"tool": "diff", "transaction": None, "error": None, "phase": "open",
             "scene_signature": None}  # fmt: skip
    changes: list[dict[str, Any]] = [
        {},
        {"transaction": "t1", "scene_signature": "0123456789abcdef"},
        {"error": "no"},
    ]
    entries = [SimpleNamespace(**{"seq": k, **known, **c}) for k, c in enumerate(changes, start=1)]
    monkeypatch.setattr("legoworld.plugin.ledger.plugin_replay", lambda _: entries)
    assert cli.run(["plugin", "replay", str(tmp_path)]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].split() == ["seq", "tool", "transaction", "then", "scene"]
    assert [line.split() for line in lines[2:5]] == [
        ["1", "diff", "open"],
        ["2", "diff", "t1", "open", "0123456789ab"],
        ["3", "diff", "failed"],
    ]
    assert lines[5] == "3 entries, the chain is whole"


def frozen_row(name: str, status: str = "ok", **said: Any) -> FrozenRow:
    checks = {
        "scene.blend": Verdict(status=status, code="", reason="broken" if status != "ok" else None)
    }
    return FrozenRow(scene=name, status=status, checks=checks, **{"warnings": []} | said)


def test_what_was_frozen_in_words(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Any
) -> None:
    rows = [
        frozen_row("a", warnings=["odd"]), frozen_row("b", "invalid"), frozen_row("c"),
        frozen_row("d", "failed"),
    ]  # fmt: skip
    told: list[Any] = []

    def freeze(*_: Any, total: Any, row: Any, **__: Any) -> list[FrozenRow]:
        total(len(rows))
        for one in rows:
            row(one)
        return rows

    @contextmanager
    def shown(unit: str, *, quiet: bool) -> Iterator[Listener]:
        told.append((unit, quiet))
        yield Listener(total=told.append, row=lambda r: told.append((r.file_name, r.status)))

    monkeypatch.setattr("legoworld.commands.freeze_command.shown_progress", shown)
    monkeypatch.setattr("legoworld.api.scene_folders.freeze_scenes", freeze)

    def said(*words: str) -> tuple[int, list[str]]:
        code = cli.run(["freeze", str(tmp_path), "--no-cache", *words])
        return code, capsys.readouterr().out.splitlines()

    bad = ["invalid: b/scene.blend: broken", "failed: d/scene.blend: broken"]
    end = "2 of 4 scenes frozen, 2 scenes fail a check"
    assert said() == (1, ["warning: a: odd", *bad, end])
    scenes = [("a", "ok"), ("b", "invalid"), ("c", "ok"), ("d", "failed")]
    assert told == [("scene", False), 4, *scenes]
    assert said("-q") == (1, [*bad, end])
    assert said("-v") == (1, ["warning: a: odd", "ok: a", bad[0], "ok: c", bad[1], end])
    assert said("-v", "-q") == (1, [*bad, end])
    code, lines = said("--json")
    assert code == 1
    assert [s["scene"] for s in json.loads("".join(lines))["scenes"]] == list("abcd")
    del rows[1::2]
    assert said("-q") == (0, ["2 of 2 scenes frozen, all checks passed"])


def make_predictions(n_bad: int, task: str = "coco", **said: Any) -> Any:
    rows = [RunRow(image_id=k, file_name=f"{k}.jpg", status="failed", reason="no")
            for k in range(1, n_bad + 1)]  # fmt: skip
    rows.append(RunRow(image_id=99, file_name="ok.jpg", status="ok", **said.pop("row", {})))
    coverage = RunCoverage(attempted=n_bad + 1, ok=1, by_status={}, **said.pop("coverage", {}))
    summary = RunSummary(
        schema_version=1, task=task, coverage=coverage, warnings=0, **{"partial": False} | said
    )
    return Run(folder=Path("out"), rows=tuple(rows), summary=summary, strangers=())


@pytest.mark.parametrize(
    ("found", "line", "made"),
    [
        (make_predictions(1), "1 of 2 images predicted", "0"),
        (
            make_predictions(1, predictions=1, coverage={"ok_empty": 0}, row={"n_predictions": 1}),
            "1 of 2 images predicted (0 without any), 1 box", "1",
        ),
        (
            make_predictions(0, task="lvis", predictions=2, coverage={"ok_empty": 1}, partial=True),
            "1 of 1 image predicted (1 without any), 2 masks, partial run", "0",
        ),
    ],
)  # fmt: skip
def test_what_a_baseline_made_in_words(found: Run, line: str, made: str, capsys: Any) -> None:
    code = baseline_command.show(found, Output(as_json=False, verbose=True))
    lines = capsys.readouterr().out.splitlines()
    assert code == (len(found.rows) > 1)
    assert lines[0].split() == ["image", "photo", "status", "predicted"]
    assert lines[1 + len(found.rows)].split() == ["99", "ok.jpg", "ok", made]
    assert lines[2 + len(found.rows)] == ""
    assert lines[3 + len(found.rows) :] == [
        *(f"failed: {k}.jpg (image {k}): no" for k in range(1, len(found.rows))),
        f"{line} -> out",
    ]
    baseline_command.show(found, Output(as_json=True, verbose=True))
    document = json.loads(capsys.readouterr().out)
    assert document["run"] == "out"
    assert len(document["rows"]) == len(found.rows)


@pytest.mark.parametrize(("n_bad", "more"), [(50, []), (51, ["... and 1 more, in "])])
def test_fifty_failures_are_listed(n_bad: int, more: list[str], capsys: Any) -> None:
    baseline_command.show(make_predictions(n_bad), Output(as_json=False, verbose=False))
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) == 50 + len(more) + 1
    assert lines[50:-1] == [f"{text}out/per_image.jsonl" for text in more]


@pytest.mark.parametrize("verbose", [False, True])
@pytest.mark.parametrize("quiet", [False, True])
@pytest.mark.parametrize("terminal", [False, True])
def test_evaluate_speaks_on_a_terminal_or_with_v_and_warns_always_but_with_q(
    verbose: bool, quiet: bool, terminal: bool, monkeypatch: pytest.MonkeyPatch, capsys: Any
) -> None:
    for module in ("output", "evaluate_command"):
        monkeypatch.setattr(f"legoworld.commands.{module}.on_terminal", lambda: terminal)
    with evaluate_command._open_listener(Output(quiet=quiet, verbose=verbose)) as listener:
        listener.notice("a notice")
        listener.warn("a warning")
    said = capsys.readouterr().err.splitlines()
    notices = ["a notice"] if not quiet and (verbose or terminal) else []
    assert said == [*notices, *(["a warning"] if not quiet else [])]


@pytest.mark.parametrize(
    ("task", "said", "counts"),
    [
        ("coco", {"predictions": 1, "partial": True}, ", 1 box, partial run"),
        ("coco", {}, ", 0 boxes"),
        (
            "lvis",
            {"predictions": 1, "coverage": {"ok_empty": 2}},
            " (2 without any export), 1 mask",
        ),
        ("coco-masks", {"predictions": 5, "warnings": 1}, ", 5 masks, 1 warning"),
        ("eth3d", {"warnings": 3}, ", 3 warnings"),
        ("bench", {"validity": ValidityCounts(valid=4, failed={})}, ", 4 valid"),
    ],
)
def test_the_last_line_of_a_readout(
    task: str, said: dict[str, Any], counts: str, tmp_path: Path, capsys: Any
) -> None:
    known = {"partial": False, "warnings": 0} | said
    coverage = RunCoverage(attempted=9, ok=8, by_status={}, **known.pop("coverage", {}))
    summary = RunSummary(schema_version=1, task=task, coverage=coverage, **known)
    assert run_text._counts(summary) == f"8 of 9 images read{counts}"


def test_photos_that_do_not_match_a_track(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Any
) -> None:
    images = [SimpleNamespace(id=k, file_name=f"{k}.jpg") for k in range(52)]
    problems = [SimpleNamespace(image=i, status="missing", found="nothing") for i in images[:51]]
    for module in ("legoworld.tracks.track", "legoworld.api.tracks"):
        loaded = SimpleNamespace(images=images)
        monkeypatch.setattr(f"{module}.load_track", lambda _, loaded=loaded: loaded)
    monkeypatch.setattr("legoworld.api.tracks.check_photos", lambda *_: problems)
    (tmp_path / "t.json").touch()
    words = ["track", "check", str(tmp_path / "t.json"), "--photos", str(tmp_path)]
    assert cli.run(words) == 1
    lines = capsys.readouterr().out.splitlines()
    assert lines[0] == "missing: 0.jpg (image 0): nothing"
    assert lines[49:] == [
        "missing: 49.jpg (image 49): nothing",
        "... and 1 more (--json lists them)",
        "1 of 52 photos matches the track",
    ]
    assert cli.run([*words, "--json"]) == 1
    document = json.loads(capsys.readouterr().out)
    assert document["images"] == 52
    assert document["problems"][50] == {
        "image_id": 50, "file_name": "50.jpg", "status": "missing", "found": "nothing",
    }  # fmt: skip
    del problems[50:]
    assert cli.run(words) == 1
    assert "more (--json" not in capsys.readouterr().out
    del problems[:]
    assert cli.run(words) == 0
    assert capsys.readouterr().out == "52 of 52 photos match the track\n"


def test_the_page_of_trials_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Any
) -> None:
    given: list[Any] = []
    trial = SimpleNamespace(about=SimpleNamespace(file_name="a.jpg"))
    (tmp_path / "a.jpg").touch()
    monkeypatch.setattr("legoworld.trajectories.api.recorded_trials", lambda _: [trial])
    monkeypatch.setattr(
        "legoworld.trajectories.api.write_page",
        lambda *words, **how: given.append((words, how)),
    )
    page = tmp_path / "page.html"
    words = ["trajectory", "report", str(tmp_path), "--photos", str(tmp_path), "-o", str(page)]
    assert cli.run(words) == 0
    assert capsys.readouterr().out == f"1 trial -> {page}\n"
    assert given == [(([trial], page), {"photos": tmp_path, "scores": None, "report": ""})]
    assert cli.run([*words, "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert (document["page"], document["trials"]) == (str(page), 1)


@pytest.mark.parametrize(
    ("task", "words", "refused"),
    [
        ("coco", "--space depth", "--space"),
        ("coco", "--suffix _depth", "--suffix"),
        ("coco-masks", "--box-format xyxy", "--box-format"),
        ("eth3d", "--category-ids dataset", "--category-ids"),
        ("eth3d", "--space disparity --unit m", "--unit is for depth"),
    ],
)
def test_an_import_s_option_for_another_task_is_refused(
    task: str,
    words: str,
    refused: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: Any,
) -> None:
    about = SimpleNamespace(card=load_card(task))
    monkeypatch.setattr(baselines, "_track_and_protocol", lambda *_: (None, about))
    (tmp_path / "t.json").touch()
    arguments = ["baseline", "import", str(tmp_path), "--task", task, "--track",
                 str(tmp_path / "t.json"), "-o", str(tmp_path / "run"), *words.split()]  # fmt: skip
    assert cli.run(arguments) == 2
    said = capsys.readouterr().err
    assert refused in said
    assert "is not for --task" in said or "scale and shift" in said


def test_a_run_is_evaluated_and_not_imported(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Any
) -> None:
    about = SimpleNamespace(card=load_card("coco"))
    monkeypatch.setattr(baselines, "_track_and_protocol", lambda *_: (None, about))
    for name in ("t.json", "run.json"):
        (tmp_path / name).touch()
    words = ["baseline", "import", str(tmp_path), "--task", "coco", "--track",
             str(tmp_path / "t.json"), "-o", str(tmp_path / "out")]  # fmt: skip
    assert cli.run(words) == 2
    said = " ".join(capsys.readouterr().err.split())
    assert f"but {tmp_path.name} is a folder: it is already a run, evaluate it directly" in said


@pytest.mark.parametrize("lacking", [[], ["torch is not installed"]])
def test_what_became_of_an_installation(
    lacking: list[str], monkeypatch: pytest.MonkeyPatch, capsys: Any
) -> None:
    python = Path("there/bin/python")
    monkeypatch.setattr("legoworld.baselines.environments.install", lambda *_, **__: python)
    monkeypatch.setattr("legoworld.baselines.environments.problems", lambda *_: lacking)
    assert cli.run(["baseline", "install", "dino"]) == len(lacking)
    ready = "is not ready" if lacking else "is ready"
    assert capsys.readouterr().out.splitlines() == [*lacking, f"dino {ready} -> {python}"]
    assert cli.run(["baseline", "install", "dino", "--json"]) == len(lacking)
    document = json.loads(capsys.readouterr().out)
    assert (document["baseline"], document["python"]) == ("dino", str(python))
    assert document["lacking"] == lacking


def test_an_inspection_as_json(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Any
) -> None:
    view = SimpleNamespace(
        to_dict=lambda: {"instances": [7]}, save=lambda *words: saved.append(words)
    )
    saved: list[Any] = []
    sizes: list[Any] = []
    opened = SimpleNamespace(view_by=lambda _reading, size: sizes.append(size) or view)
    monkeypatch.setattr("legoworld.api.scenes.open_scene", lambda *_, **__: opened)
    (tmp_path / "scene.blend").touch()
    words = ["inspect", str(tmp_path), "--no-cache", "--json", "--size", "30x20"]
    assert cli.run([*words, "-o", str(tmp_path / "out")]) == 0
    assert json.loads(capsys.readouterr().out)["instances"] == [7]
    assert sizes == [(30, 20)]
    assert saved == [(tmp_path / "out", None)]


@pytest.mark.parametrize(
    "words", ["--unit mm", "--space depth", "--scenes a", "--dataset mine", "--photos ."]
)
def test_a_track_s_option_for_another_task_is_refused(
    words: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Any
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "t.json").touch()
    arguments = ["track", "make", "--task", "coco", "--truth", "t.json", "-o", "out.json"]
    assert cli.run([*arguments, *words.split()]) == 2
    assert words.split()[0] in capsys.readouterr().err
    assert not (tmp_path / "out.json").exists()
