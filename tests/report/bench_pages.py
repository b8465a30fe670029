"""Bench evaluations for pages: planes and balls, submissions with every kind of trouble."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from evaluation.reconstruction.datasets import (
    NOTHING,
    VALID,
    Dataset,
    Submission,
    evaluate_bench,
    write_dataset,
    write_run,
)
from msgspec.structs import replace
from report.pages import HOSTILE

from legoworld.records.submission import Check

EMPTY = Check(ok=False, found=f"empty {HOSTILE}", expected="a mesh", next_step="export it again")


def bench_dataset(folder: Path) -> Dataset:
    """Two families of two tiers and two views: eight cases."""
    return write_dataset(folder / "bench", views=2)


def bench_evaluation(
    folder: Path,
    dataset: Dataset,
    name: str,
    submissions: dict[int, Submission],
    agent: str = "",
) -> Path:
    """folder/name: an evaluation of a run whose other cases are the reference itself."""
    made_by = {"agent": agent or name}
    run = write_run(folder / f"run-{name}", dataset, submissions, agent=made_by)
    evaluate_bench(run, dataset.private, folder / name, draws=50)
    return folder / name


def troubled_submissions(dataset: Dataset) -> dict[int, Submission]:
    """A failure, one that is not valid, a shifted half, another picture, and drivers."""
    half = dataset.cases[4].depth_z_m.copy()
    half[:, : half.shape[1] // 2] *= 1.3
    half[:3] = np.inf
    noisy = dataset.cases[5].render.copy()
    noisy[:6] = 255 - noisy[:6]
    return {
        1: Submission(status="failed"),
        2: Submission(validity=replace(VALID, scene_glb=EMPTY)),
        4: Submission(depth_z_m=half, hfov_deg=55.0),
        5: Submission(render=noisy),
        6: Submission(integrity=replace(NOTHING, drivers=2)),
    }
