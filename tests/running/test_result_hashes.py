"""A finished run's files are on record in run.json: a byte that is still valid JSON is seen."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from running.run_folders import results

from legoworld import cli
from legoworld.files import sha256_of_file

pytestmark = pytest.mark.blender
TRUTH = Path(__file__).parents[2] / "datasets" / "skimage_examples" / "truth_coco.json"


@pytest.fixture(params=[(), ("--images-per-file", "2")], ids=["one file", "divided"])
def made(request, tmp_path):
    """A run of the shipped examples."""
    assert readout(tmp_path / "run", *request.param) == 0
    return tmp_path / "run"


def readout(run: Path, *options: str) -> int:
    return cli.run(["readout", "--task", "coco", "-o", str(run), "-q", *options])


def evaluate(run: Path, output: Path) -> int:
    return cli.run(["evaluate", str(run), "--truth", str(TRUTH), "-o", str(output), "--draws", "2"])


def flip(path: Path, before: str, after: str) -> None:
    """Another digit: the file stays valid JSON of the same length."""
    text = path.read_text()
    assert before in text
    assert len(before) == len(after)
    path.write_text(text.replace(before, after, 1))


def predictions_file(run: Path) -> Path:
    whole = run / "predictions.json"
    return whole if whole.is_file() else run / "predictions" / "00000.jsonl"


def test_run_json_has_every_result_file(made):
    document = json.loads((made / "run.json").read_text())
    assert document["schema_version"] == 2
    names = {p.relative_to(made).as_posix() for p in made.rglob("*") if p.is_file()}
    assert set(document["results_sha256"]) == names - {"run.json", ".lock"}
    for name, sha256 in document["results_sha256"].items():
        assert sha256_of_file(made / name) == sha256


@pytest.mark.parametrize("name", ["predictions", "per_image.jsonl"])
def test_evaluate_and_export_refuse_a_flipped_byte(made, tmp_path, capsys, name):
    path = predictions_file(made) if name == "predictions" else made / name
    before = path.read_bytes()
    flip(path, '"image_id":1', '"image_id":2') if name == "predictions" else flip(
        path, '"warnings":[]', '"warningz":[]'
    )
    for command in (
        ["evaluate", str(made), "--truth", str(TRUTH), "-o", str(tmp_path / "eval")],
        ["export", str(made), "-o", str(tmp_path / "coco.json")],
    ):
        assert cli.run(command) == 2
        said = capsys.readouterr().err
        assert said.count("\n") == 1
        assert f"{path.name} is not the one that the run wrote" in said
    path.write_bytes(before)
    assert evaluate(made, tmp_path / "eval") == 0


def test_a_run_of_before_is_evaluated_as_it_is(made, tmp_path):
    document = json.loads((made / "run.json").read_text())
    del document["results_sha256"]
    (made / "run.json").write_text(json.dumps({**document, "schema_version": 1}))
    assert evaluate(made, tmp_path / "eval") == 0


def test_flipped_predictions_are_read_again(made, request):
    before = results(made)
    flip(predictions_file(made), '"score":1.0', '"score":1.1')
    options = request.node.callspec.params["made"]
    assert readout(made, *options) == 0
    assert results(made) == before


def test_flipped_rows_are_refused_until_overwritten(made, request, capsys):
    before = results(made)
    flip(made / "per_image.jsonl", '"n_predictions":', '"n_predictionz":')
    options = request.node.callspec.params["made"]
    assert readout(made, *options) == 2
    assert "run/per_image.jsonl is not the one that the run wrote" in capsys.readouterr().err
    assert readout(made, *options, "--overwrite") == 0
    assert results(made) == before


@pytest.mark.parametrize("name", ["predictions", "per_image.jsonl", "summary.json"])
def test_merge_refuses_a_flipped_byte(made, tmp_path, capsys, name):
    path = predictions_file(made) if name == "predictions" else made / name
    flip(path, *{
        "predictions": ('"score":1.0', '"score":1.1'),
        "per_image.jsonl": ('"status":"ok"', '"status":"OK"'),
        "summary.json": ('"task": "coco"', '"task": "cocx"'),
    }[name])  # fmt: skip
    assert cli.run(["merge", str(made), "-o", str(tmp_path / "merged")]) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert path.name in said or "lacks some of its predictions" in said
