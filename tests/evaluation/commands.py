"""`legoworld evaluate` on small runs of each task, its work cut into small pieces."""

from __future__ import annotations

import os
import time
from pathlib import Path

import pytest
from evaluation.depth.folders import plane, write_eth3d
from evaluation.depth.folders import write_run as write_depth_run
from evaluation.detection_runs import random_predictions, random_truth, write_run, write_truth

from legoworld import cli

CHUNK = "legoworld.evaluation.detection.matching.matches._CHUNK_DETECTIONS"
FEW = "legoworld.evaluation.detection.matching.matches._FEW"


def made(folder: Path, task: str) -> tuple[Path, Path]:
    """A run and its truth."""
    if task == "eth3d":
        names = [f"{s}/images/dslr_images/{i}.JPG" for s in ("pipes", "office") for i in range(3)]
        z = {name: plane((60, 40), seed) for seed, name in enumerate(names)}
        run = write_depth_run(folder / "run", {**z, names[1]: "missing"}, size_wh=(60, 40))
        return run, write_eth3d(folder / "truth", z)
    truth = random_truth(task, seed=8, images=20)
    predictions = random_predictions(task, truth, seed=8, levels=4)
    run = write_run(folder / "run", task, truth, predictions)
    return run, write_truth(folder / "truth.json", truth)


def evaluate(run: Path, truth: Path, output: Path, *more: object) -> int:
    arguments = ["evaluate", "-q", run, "--truth", truth, "-o", output, "--draws", 20, *more]
    return cli.run([str(a) for a in arguments])


def files(folder: Path) -> dict[str, bytes]:
    return {str(p.relative_to(folder)): p.read_bytes() for p in folder.rglob("*") if p.is_file()}


def small_pieces(monkeypatch: pytest.MonkeyPatch, size: int) -> None:
    """Work for many, where there is little."""
    monkeypatch.setattr(CHUNK, size)
    monkeypatch.setattr(FEW, 1)
    monkeypatch.setattr("legoworld.evaluation.pixels.evaluate._FEW_BYTES", 0)


def slow_chunk(_chunk: object) -> None:
    """Says which process it is in, and never ends."""
    Path(os.environ["MARKS"], str(os.getpid())).touch()
    time.sleep(600)
