"""Depth: means of one side over its scored, its attempted, and the paired images."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from legoworld.comparison.family import ComparisonFamily, Measurer, SideFacts
from legoworld.comparison.measures import (
    EVERYTHING,
    HEADLINE,
    TABLE,
    Measure,
    Measures,
    Metric,
)
from legoworld.evaluation.bootstrap import resample_counts, resampled_means
from legoworld.evaluation.depth.eth3d import scene_of
from legoworld.evaluation.depth.protocol import PRIMARY_POLICY, HolePolicy
from legoworld.evaluation.depth.summary import metric_policies
from legoworld.evaluation.stored import Evaluated
from legoworld.pluralize import counted
from legoworld.records.base import as_json, to_record
from legoworld.records.comparison import Better, Images, Level
from legoworld.records.evaluation_rows import DepthRow, ScoredDepthRow
from legoworld.records.evaluation_summary import DepthRules
from legoworld.records.evidence import ComparisonSettings

#: The only metric with a value for missing images.
_WITH_MISSING: Final = "abs_rel"
_DETAILS: Final = ("delta2", "delta3")


@dataclass(frozen=True, kw_only=True)
class GroupDraws:
    """The bootstrap over groups (ETH3D scenes), shared by both sides.

    counts: (draws, groups), None where there are fewer than two groups; column: of each group.
    """

    counts: NDArray[np.int32] | None
    column: dict[str, int]


def depth_metrics() -> list[Metric]:
    """Every metric and hole policy, in display order."""
    metrics = []
    for name, policy in metric_policies():
        level: Level = EVERYTHING if name in _DETAILS else TABLE
        if name == _WITH_MISSING or (name, policy) == ("delta1", PRIMARY_POLICY):
            level = HEADLINE
        better: Better = "higher" if name.startswith("delta") else "lower"
        metrics.append(Metric(id=f"{name}.{policy}", policy=policy, better=better, level=level))
    return metrics


def group_unit(rows: Sequence[DepthRow]) -> str:
    """The resampling unit: scenes if every photo is named after one, otherwise images."""
    named = bool(rows) and all(scene_of(row.file_name) for row in rows)
    return "scene" if named else "image"


def shared_group_draws(rows: Sequence[DepthRow], draws: int, seed: int) -> GroupDraws:
    """The draws over the groups of these rows; both sides' rows have the same groups."""
    names = sorted({row.group for row in rows})
    counts = resample_counts(len(names), draws, seed) if len(names) > 1 else None
    return GroupDraws(counts=counts, column={name: k for k, name in enumerate(names)})


def measure_depth(
    side: Evaluated, images: Images, kept: NDArray[np.bool_], shared: GroupDraws
) -> Measures:
    """Means of one side over the kept images, (images,) bool.

    images "scored": the kept images that this side has scores for; "paired": all kept images are
    scored; "attempted": AbsRel only, a kept image without a score gets the declared error.
    """
    rows = [row for row, keep in zip(side.depth_rows, kept, strict=True) if keep]
    measures: Measures = {}
    if images == "attempted":
        given = side.depth.all_attempted.missing_abs_rel
        for name, policy in metric_policies():
            if name == _WITH_MISSING:
                values = [
                    row.metrics[name][policy] if isinstance(row, ScoredDepthRow) else given
                    for row in rows
                ]
                over = {"images": len(rows), "missing": sum(not r.has_score for r in rows)}
                measures[f"{name}.{policy}"] = _mean(values, rows, shared, over, {})
        return measures
    scored = [row for row in rows if isinstance(row, ScoredDepthRow)]
    for name, policy in metric_policies():
        values = [row.metrics[name][policy] for row in scored]
        extra = {"constant": _constant(scored, name, policy)}
        measures[f"{name}.{policy}"] = _mean(values, scored, shared, {"images": len(scored)}, extra)
    return measures


def with_truth(side: Evaluated) -> NDArray[np.bool_]:
    """(images,) bool: images with enough ground truth to be scored."""
    return np.array([row.has_truth for row in side.rows], bool)


def _constant(rows: Sequence[ScoredDepthRow], name: str, policy: HolePolicy) -> float:
    """The mean of the zero-information constant, on the same pixels."""
    values = [row.constant[name][policy] for row in rows]
    return float(np.mean(np.array(values, np.float64))) if values else float("nan")


def _mean(
    values: Sequence[float],
    rows: Sequence[DepthRow],
    shared: GroupDraws,
    over: Mapping[str, int],
    extra: Mapping[str, float],
) -> Measure:
    numbers = np.array(values, np.float64)
    value = float(np.mean(numbers)) if len(numbers) else float("nan")
    samples = None
    if shared.counts is not None and len(numbers):
        groups = np.array([shared.column[row.group] for row in rows], np.int64)
        samples = resampled_means(numbers, groups, shared.counts)
    return Measure(value=value, samples=samples, over=over, extra=extra)


def _camera_model(side: Evaluated) -> str:
    """How a scene's depth was read: none or dataset."""
    return side.depth.protocol.camera_model


def _max_side(side: Evaluated) -> int | None:
    """What a scene's depth was read out at, where that is smaller than the photos."""
    asked = side.run.configuration.max_side
    return asked if asked and side.depth.resampled else None


def _differences(first: Evaluated, other: Evaluated) -> list[str]:
    """Cameras and sizes that make depths incomparable (docs/protocols/comparison.md)."""
    differences = []
    if first.is_scene and other.is_scene and _camera_model(first) != _camera_model(other):
        differences.append(f"camera model {_camera_model(first)} and {_camera_model(other)}")
    if _camera_model(first) == _camera_model(other) == "dataset":
        ours, theirs = (_calibration(s) for s in (first, other))
        if ours != theirs:
            differences.append("calibration")
    return differences + _size_differences(first, other)


def _calibration(side: Evaluated) -> list[str]:
    return [e.sha256 for e in side.evidence.inputs if e.role == "calibration"]


def _size_differences(first: Evaluated, other: Evaluated) -> list[str]:
    """A scene read out below the photos' size cannot be compared with anything of full size."""
    if first.is_scene and other.is_scene:
        if _max_side(first) != _max_side(other):
            return [f"depth {_size(first)} and {_size(other)}"]
        return []
    for scene, baseline in ((first, other), (other, first)):
        if _max_side(scene) is None:
            continue
        full = [r for r in baseline.rows if isinstance(r, ScoredDepthRow) and not r.resampled]
        if full:
            images = counted(len(full), "image", "images")
            return [f"depth {_size(scene)} and {images} of full size"]
    return []


def _size(side: Evaluated) -> str:
    return "of full size" if _max_side(side) is None else f"resampled from {_max_side(side)} px"


def _notes(sides: Sequence[Evaluated]) -> list[str]:
    notes = ["Images scored: each method over its own, so their differences are of other images."]
    models = {s.name: _camera_model(s) for s in sides}
    if set(models.values()) != {"none"}:
        listed = ", ".join(f"{name} {model}" for name, model in models.items())
        notes.append(
            f"Camera model: {listed}. A scene's pinhole view is warped to the distorted photo that "
            "the other methods saw."
        )
    notes += [
        f"{s.name}: {s.depth.resampled} of {s.summary.coverage.scored} depth maps are "
        "smaller than the truth and were resampled to it."
        for s in sides
        if s.depth.resampled
    ]
    return notes


def _facts(side: Evaluated) -> SideFacts:
    """The declared choices of depth; each method has its own camera model."""
    return SideFacts(
        protocol=to_record(DepthRules, as_json(side.depth.protocol)),
        camera_model=_camera_model(side),
        max_side=_max_side(side),
        resampled=side.depth.resampled,
    )


def _measurer(
    scene: Evaluated, images: Images, kept: NDArray[np.bool_], settings: ComparisonSettings
) -> Measurer:
    drawn = [row for row, keep in zip(scene.depth_rows, kept, strict=True) if keep]
    groups = shared_group_draws(drawn, settings.draws, settings.seed)
    return lambda side: measure_depth(side, images, kept, groups)


COMPARISON: Final = ComparisonFamily(
    metrics=lambda _task: depth_metrics(),
    unit=lambda side: group_unit([row for row in side.depth_rows if row.has_truth]),
    measurer=_measurer,
    images=("scored", "attempted", "paired"),
    unpaired=with_truth,
    facts=_facts,
    differences=_differences,
    notes=_notes,
)
