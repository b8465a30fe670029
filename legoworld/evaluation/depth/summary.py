"""The summary of a depth evaluation: means over images, intervals over scenes, denominators."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from legoworld.conventions import SCHEMA_VERSION
from legoworld.evaluation.bootstrap import LEVEL, interval, resample_counts, resampled_means
from legoworld.evaluation.depth.eth3d import scene_of, training_images
from legoworld.evaluation.depth.protocol import (
    EXCLUDE_METRICS,
    HOLE_METRICS,
    HOLE_POLICIES,
    DepthProtocol,
    HolePolicy,
)
from legoworld.evaluation.depth.rows import SCORED
from legoworld.evaluation.folder import Row


@dataclass(frozen=True, kw_only=True)
class Settings:
    """What a command line may set."""

    camera_model: str
    draws: int
    seed: int


def summarise(
    rows: Sequence[Row],
    *,
    kind: str,
    partial: bool,
    protocol: DepthProtocol,
    settings: Settings,
) -> dict[str, Any]:
    """summary.json. rows: of every attempted image, ascending id."""
    scored = [row for row in rows if row["status"] in SCORED]
    with_truth = [row for row in rows if row["status"] != "no_gt"]
    groups, intervals = _intervals(with_truth, scored, settings)
    return {
        "schema_version": SCHEMA_VERSION,
        "task": "eth3d",
        "kind": kind,
        "partial": partial,
        "evaluator": {"name": protocol.evaluator, "version": protocol.evaluator_version},
        "protocol": {**protocol.declared(), "camera_model": settings.camera_model},
        "coverage": {
            "attempted": len(rows),
            "scored": len(scored),
            "with_truth": len(with_truth),
            "by_status": dict(sorted(Counter(row["status"] for row in rows).items())),
            **_part_of_eth3d(rows),
        },
        "metrics": _means(scored, "metrics"),
        "constant": _means(scored, "constant"),
        "all_attempted": _all_attempted(with_truth, protocol),
        "intervals": intervals,
        "bootstrap": {"draws": settings.draws, "seed": settings.seed, **groups},
        "mean_hole_share": _mean([row["hole_share"] for row in scored]),
        "mean_outside_view_share": _mean([row["outside_view_share"] for row in scored]),
        "mean_clamped_share": _mean([row["clamped_share"] for row in scored]),
        "resampled": sum(row["resampled"] for row in scored),
        "worse_than_constant": sum(bool(row["worse_than_constant"]) for row in scored),
        "not_scored": [
            {key: row[key] for key in ("image_id", "file_name", "status", "reason")}
            for row in rows
            if row["status"] not in SCORED
        ],
        "warnings": sum(len(row["warnings"]) for row in rows),
    }


def metric_policies() -> list[tuple[str, HolePolicy]]:
    """Every (metric, hole policy) that exists, in the order they are shown."""
    pairs: list[tuple[str, HolePolicy]]
    pairs = [(metric, policy) for metric in HOLE_METRICS for policy in HOLE_POLICIES]
    return pairs + [(metric, "exclude") for metric in EXCLUDE_METRICS]


def _part_of_eth3d(rows: Sequence[Row]) -> dict[str, Any]:
    """How much of ETH3D's training set the images are; nothing where one is of another dataset."""
    names = {row["file_name"] for row in rows}
    whole = {image.file_name for image in training_images()}
    if not names or not names <= whole:
        return {}
    scenes, of = ({scene_of(name) for name in some} for some in (names, whole))
    return {
        "eth3d": {
            "images": len(names),
            "of_images": len(whole),
            "scenes": len(scenes),
            "of_scenes": len(of),
        }
    }


def _means(scored: Sequence[Row], which: str) -> dict[str, dict[str, float | None]]:
    """Unweighted means of per-image values; None when nothing was scored."""
    means: dict[str, dict[str, float | None]] = {}
    for metric, policy in metric_policies():
        values = [row[which][metric][policy] for row in scored]
        means.setdefault(metric, {})[policy] = _mean(values)
    return means


def _all_attempted(with_truth: Sequence[Row], protocol: DepthProtocol) -> dict[str, Any]:
    """AbsRel over every image with truth; one without a score counts as a whole error."""
    given = protocol.failed_image_abs_rel
    by_policy = {
        policy: _mean(
            [
                row["metrics"]["abs_rel"][policy] if row["status"] in SCORED else given
                for row in with_truth
            ]
        )
        for policy in HOLE_POLICIES
    }
    missing = sum(row["status"] not in SCORED for row in with_truth)
    return {
        "abs_rel": by_policy,
        "images": len(with_truth),
        "missing": missing,
        "missing_abs_rel": given,
    }


def _intervals(
    with_truth: Sequence[Row], scored: Sequence[Row], settings: Settings
) -> tuple[dict[str, Any], dict[str, dict[str, Any]]]:
    """Bootstrap intervals of the means, over the groups of every image with truth.

    The groups do not depend on what was scored, so two runs over one track share their draws. One
    group alone says nothing of its spread: its intervals are None.
    """
    by_scene = bool(with_truth) and all(scene_of(row["file_name"]) for row in with_truth)
    unit = "scene" if by_scene else "image"
    names = sorted({row["group"] for row in with_truth})
    groups = {"unit": unit, "groups": len(names), "level": LEVEL}
    if len(names) < 2 or not scored:
        nothing = np.full(settings.draws, np.nan)
        empty: dict[str, dict[str, Any]] = {}
        for metric, policy in metric_policies():
            empty.setdefault(metric, {})[policy] = interval(nothing, unit=unit)
        return groups, empty
    counts = resample_counts(len(names), settings.draws, settings.seed)
    column = {name: i for i, name in enumerate(names)}
    group_of_row = np.array([column[row["group"]] for row in scored], np.int64)
    intervals: dict[str, dict[str, Any]] = {}
    for metric, policy in metric_policies():
        values = np.array([row["metrics"][metric][policy] for row in scored], np.float64)
        samples = resampled_means(values, group_of_row, counts)
        intervals.setdefault(metric, {})[policy] = interval(samples, unit=unit)
    return groups, intervals


def _mean(values: Sequence[float]) -> float | None:
    return float(np.mean(np.array(values, np.float64))) if values else None
