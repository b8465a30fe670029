"""Runs and evaluations at URLs: the numbers of folders of this machine."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from evaluation.commands import evaluate, files, made

from legoworld import cli
from legoworld import remote as places

fsspec = pytest.importorskip("fsspec")

BUCKET = "memory://bucket"


@pytest.fixture(autouse=True)
def empty() -> None:
    fsspec.filesystem("memory").rm("/", recursive=True)


def at_url(run: Path) -> str:
    places.publish_folder(run, f"{BUCKET}/run", last="run.json")
    return f"{BUCKET}/run"


def fetched(url: str, into: Path) -> dict[str, bytes]:
    places.fetch_folder(url, into)
    return files(into)


def without_places(found: dict[str, bytes]) -> dict[str, bytes]:
    """The files of an evaluation, evidence.json without where its inputs were."""
    evidence = json.loads(found["evidence.json"])
    for entry in evidence["inputs"]:
        del entry["path"]
    return {**found, "evidence.json": json.dumps(evidence).encode()}


@pytest.mark.parametrize("task", ["coco", "lvis", "eth3d"])
def test_same_bytes_from_and_to_a_url(task, tmp_path, capsys):
    run, truth = made(tmp_path, task)
    assert evaluate(run, truth, tmp_path / "local") == 0
    assert evaluate(at_url(run), truth, f"{BUCKET}/eval") == 0
    assert f"-> {BUCKET}/eval" in capsys.readouterr().out
    found = fetched(f"{BUCKET}/eval", tmp_path / "fetched")
    assert without_places(found) == without_places(files(tmp_path / "local"))


def test_inputs_are_named_by_where_they_really_are(tmp_path):
    run, truth = made(tmp_path, "coco")
    for output in (f"{BUCKET}/eval", tmp_path / "eval"):
        assert evaluate(at_url(run), truth, output) == 0
    recorded = {}
    for name, folder in (("url", tmp_path / "fetched"), ("here", tmp_path / "eval")):
        places.fetch_folder(f"{BUCKET}/eval", tmp_path / "fetched")
        inputs = json.loads((folder / "evidence.json").read_text())["inputs"]
        recorded[name] = {entry["role"]: entry["path"] for entry in inputs}
    assert recorded["url"]["predictions"] == f"{BUCKET}/run/predictions.json"
    assert recorded["url"]["truth"] == truth.resolve().as_posix()
    assert recorded["here"]["predictions"] == f"{BUCKET}/run/predictions.json"
    assert recorded["here"]["truth"] == "../truth.json"
    for folder in (tmp_path / "fetched", tmp_path / "eval"):
        assert cli.run(["evidence", "verify", str(folder), "--root", str(tmp_path)]) == 0


def test_a_password_in_a_url_is_not_written_down(tmp_path):
    from legoworld.evaluation.family import EvaluationRequest, Origins, prepare_inputs
    from legoworld.evaluation.run import read_run
    from legoworld.records.detection import DetectionConfiguration

    run = read_run(made(tmp_path, "coco")[0])
    request = EvaluationRequest(
        run=run, truth=tmp_path, output=tmp_path / "eval", draws=1,
        origins=Origins(run_url="ftp://me:secret@host/run/"),
    )  # fmt: skip
    (recorded,) = prepare_inputs(
        request,
        [("run", run.folder / "run.json")],
        DetectionConfiguration(
            task="coco", evaluator="official", draws=1, seed=0, card_sha256="0" * 64
        ),
    )
    assert recorded.recorded == "ftp://host/run/run.json"


def test_what_is_at_the_url_stays_when_scoring_fails(tmp_path, capsys):
    run, truth = made(tmp_path, "coco")
    assert evaluate(run, truth, f"{BUCKET}/eval") == 0
    before = fetched(f"{BUCKET}/eval", tmp_path / "before")
    assert evaluate(run, truth, f"{BUCKET}/eval", "--draws", 30) == 2
    assert "holds another evaluation" in capsys.readouterr().err
    (run / "predictions.json").write_text("[1]")
    assert evaluate(run, truth, f"{BUCKET}/eval", "--overwrite") == 2
    assert fetched(f"{BUCKET}/eval", tmp_path / "after") == before
    (run / "predictions.json").write_text("[]")
    assert evaluate(run, truth, f"{BUCKET}/eval", "--overwrite") == 0
    now = fetched(f"{BUCKET}/eval", tmp_path / "now")
    assert json.loads(now["summary.json"])["metrics"]["AP"] == 0


def test_a_folder_of_something_else_at_the_url_is_not_touched(tmp_path, capsys):
    run, truth = made(tmp_path, "coco")
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "notes.txt").write_text("mine")
    places.publish_folder(tmp_path / "mine", f"{BUCKET}/eval", last="")
    assert evaluate(run, truth, f"{BUCKET}/eval", "--overwrite") == 2
    assert "notes.txt" in capsys.readouterr().err
    assert fetched(f"{BUCKET}/eval", tmp_path / "now") == {"notes.txt": b"mine"}


def test_nothing_at_the_url_of_the_run_is_said(tmp_path, capsys):
    _, truth = made(tmp_path, "coco")
    assert evaluate(f"{BUCKET}/nowhere", truth, tmp_path / "eval") == 2
    assert "memory://bucket/nowhere is empty or does not exist" in capsys.readouterr().err


def test_an_evaluation_is_whole_or_not_there_while_it_is_replaced(tmp_path, monkeypatch):
    run, truth = made(tmp_path, "coco")
    assert evaluate(run, truth, f"{BUCKET}/eval") == 0
    system = fsspec.filesystem("memory")
    put, seen = type(system).put_file, []

    def watched(self, source, target, **named):
        seen.append((target.rpartition("/")[2], system.exists("/bucket/eval/evidence.json")))
        put(self, source, target, **named)

    monkeypatch.setattr(type(system), "put_file", watched)
    assert cli.run(["evaluate", str(run), "--truth", str(truth), "-o", f"{BUCKET}/eval",
                    "--draws", "7", "--overwrite", "-q"]) == 0  # fmt: skip
    assert seen[-1][0] == "evidence.json"
    assert not any(whole for _, whole in seen)
