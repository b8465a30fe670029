"""Scored on a cluster of two nodes: the bytes of one machine, and its errors."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from evaluation.commands import evaluate, files, made, small_pieces

from legoworld.evaluation.pixels.evaluate import image_tasks
from legoworld.workers.tasks import WorkerPool, map_items

ray = pytest.importorskip("ray")

pytestmark = [pytest.mark.cluster, pytest.mark.filterwarnings("default")]

RAY = ("--engine", "ray", "--workers", 2)


@pytest.fixture(autouse=True)
def in_pieces(monkeypatch: pytest.MonkeyPatch) -> None:
    """Work for both nodes."""
    small_pieces(monkeypatch, 30)


def node_of(_item: int) -> str:
    node: str = ray.get_runtime_context().get_node_id()
    return node


@pytest.mark.parametrize("task", ["coco", "lvis", "eth3d"])
def test_same_bytes_as_the_local_engine_on_two_nodes(task, tmp_path: Path, two_nodes, capsys):
    run, truth = made(tmp_path, task)
    assert evaluate(run, truth, tmp_path / "local") == 0
    assert evaluate(run, truth, tmp_path / "ray", *RAY) == 0
    assert files(tmp_path / "ray") == files(tmp_path / "local")
    assert (tmp_path / "ray" / "evidence.json").is_file()


def test_both_nodes_work(two_nodes):
    assert len(set(map_items(node_of, range(8), WorkerPool(engine="ray", workers=2)))) == 2


def test_a_machine_that_does_not_see_the_depth_says_so(tmp_path, two_nodes, monkeypatch, capsys):
    """Never taken for an image without a prediction. What goes meanwhile no worker finds."""
    run, truth = made(tmp_path, "eth3d")
    hidden = sorted((run / "depth").rglob("*.npz"))[-1]

    def then_hidden(*arguments, **options):
        found = image_tasks(*arguments, **options)
        hidden.rename(hidden.with_suffix(".gone"))
        return found

    monkeypatch.setattr("legoworld.evaluation.pixels.evaluate.image_tasks", then_hidden)
    assert evaluate(run, truth, tmp_path / "eval", *RAY) == 4
    error = capsys.readouterr().err
    assert "a machine does not see the depth files of" in error
    assert "folders that all machines see under the same path" in error
    assert error.count("\n") == 1
    assert not (tmp_path / "eval" / "summary.json").exists()


def test_the_first_unusable_mask_is_named(tmp_path, two_nodes, capsys):
    run, truth = made(tmp_path, "lvis")
    entries = json.loads((run / "predictions.json").read_text())
    for place in (150, 61, 100):
        entries[place]["segmentation"]["counts"] = "11"
    (run / "predictions.json").write_text(json.dumps(entries))
    errors = []
    for more in ((), RAY):
        assert evaluate(run, truth, tmp_path / "eval", *more) == 2
        errors.append(capsys.readouterr().err)
    assert errors[0] == errors[1]
    assert f"image {entries[61]['image_id']}," in errors[0]
