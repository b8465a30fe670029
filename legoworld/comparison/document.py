"""comparison.json: evaluations beside each other, as a pure function of their folders."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from legoworld.comparison.depth import (
    depth_metrics,
    group_unit,
    measure_depth,
    shared_group_draws,
    with_truth,
)
from legoworld.comparison.detections import detection_metrics, measure_detections, shared_draws
from legoworld.comparison.measures import (
    Images,
    IntervalRule,
    Measures,
    Metric,
    comparison_row,
)
from legoworld.comparison.notes import notes_of
from legoworld.comparison.pairing import has_truth, is_scored, pair_images
from legoworld.comparison.provenance import provenance_by_field, recorded_provenance
from legoworld.conventions import SCHEMA_VERSION
from legoworld.evaluation.bootstrap import LEVEL
from legoworld.evaluation.folder import Row
from legoworld.evaluation.protocols import PROTOCOLS
from legoworld.evaluation.stored import Evaluated
from legoworld.records.base import as_json

KIND: Final = "comparison"
_DEPTH_IMAGES: Final[tuple[Images, ...]] = ("scored", "attempted", "paired")


@dataclass(frozen=True, kw_only=True)
class Settings:
    """What a command line may set."""

    draws: int
    seed: int
    allow_truth_prompts: bool


def compare(
    sides: Sequence[Evaluated],
    settings: Settings,
    notice: Callable[[str], None] = lambda _text: None,
) -> dict[str, Any]:
    """The document of a comparison of the first side with each of the others.

    sides: as `check_comparable` lets them pass. Nothing but the evaluations' own files and the
    settings enters, so equal inputs give equal documents.
    """
    rows = sides[0].rows
    unit = "image"
    if sides[0].task not in PROTOCOLS:
        unit = group_unit([row for row in sides[0].depth_rows if has_truth(row)])
    by_field = provenance_by_field(sides)
    pairs = []
    for baseline in sides[1:]:
        notice(f"{settings.draws} bootstrap samples of {sides[0].name} and {baseline.name}")
        pairs.append(_pair(sides[0], baseline, settings, unit))
    return {
        "schema_version": SCHEMA_VERSION,
        "kind": KIND,
        "task": sides[0].task,
        "dataset_version": sides[0].dataset_version,
        "evaluator": as_json(sides[0].summary.evaluator),
        "protocol": _protocol(sides[0]),
        "bootstrap": {
            "draws": settings.draws,
            "seed": settings.seed,
            "level": LEVEL,
            "unit": unit,
        },
        "images": [{"image_id": r.image_id, "file_name": r.file_name} for r in rows],
        "methods": [_method(side, first=side is sides[0]) for side in sides],
        "pairs": pairs,
        "provenance": by_field,
        "notes": notes_of(sides, by_field),
    }


def _protocol(side: Evaluated) -> dict[str, Any] | None:
    """Depth's declared choices; the camera model is each method's own."""
    if side.task in PROTOCOLS:
        return None
    return {k: v for k, v in as_json(side.depth.protocol).items() if k != "camera_model"}


def _method(side: Evaluated, *, first: bool) -> Row:
    coverage = side.summary.coverage
    return {
        "name": side.name,
        "role": "scene" if first else "baseline",
        "kind": str(side.summary.kind),
        "coverage": {
            k: getattr(coverage, k) for k in ("attempted", "scored", "with_truth", "by_status")
        },
        "not_scored": [
            {k: getattr(row, k) for k in ("image_id", "file_name", "status")}
            for row in side.rows
            if not is_scored(row)
        ],
        "used_truth": side.used_truth,
        "camera_model": side.camera_model,
        "max_side": side.max_side,
        "resampled": side.resampled,
        "provenance": recorded_provenance(side),
    }


def _pair(scene: Evaluated, baseline: Evaluated, settings: Settings, unit: str) -> dict[str, Any]:
    pairing = pair_images(scene, baseline)
    ids = [row.image_id for row in scene.rows]
    measured = _measured_detections if scene.task in PROTOCOLS else _measured_depth
    return {
        "scene": scene.name,
        "baseline": baseline.name,
        "coverage": {
            "attempted": len(scene.rows),
            "with_truth": sum(has_truth(row) for row in scene.rows),
            "scene_scored": sum(is_scored(row) for row in scene.rows),
            "baseline_scored": sum(is_scored(row) for row in baseline.rows),
            "paired": int(pairing.kept.sum()),
        },
        "paired_image_ids": [i for i, keep in zip(ids, pairing.kept, strict=True) if keep],
        "dropped": list(pairing.dropped),
        "rows": measured(scene, baseline, pairing.kept, settings, unit),
    }


def _measured_detections(
    scene: Evaluated,
    baseline: Evaluated,
    paired: NDArray[np.bool_],
    settings: Settings,
    unit: str,
) -> list[Row]:
    protocol = PROTOCOLS[scene.task]
    rule = IntervalRule(centred=True, unit=unit)
    rows: list[Row] = []
    selections: tuple[tuple[Images, NDArray[np.bool_]], ...]
    selections = (("attempted", np.ones(len(paired), bool)), ("paired", paired))
    for images, kept in selections:
        if not kept.any():
            continue  # no image, no number: coverage says 0 paired
        shared = shared_draws(int(kept.sum()), settings.draws, settings.seed)
        ours, theirs = (measure_detections(s, protocol, kept, shared) for s in (scene, baseline))
        rows += _rows(detection_metrics(protocol), images, ours, theirs, rule)
    return rows


def _measured_depth(
    scene: Evaluated,
    baseline: Evaluated,
    paired: NDArray[np.bool_],
    settings: Settings,
    unit: str,
) -> list[Row]:
    rule = IntervalRule(centred=False, unit=unit)
    rows: list[Row] = []
    for images in _DEPTH_IMAGES:
        kept = paired if images == "paired" else with_truth(scene)
        if not kept.any():
            continue
        drawn = [row for row, keep in zip(scene.depth_rows, kept, strict=True) if keep]
        shared = shared_group_draws(drawn, settings.draws, settings.seed)
        ours, theirs = (measure_depth(s, images, kept, shared) for s in (scene, baseline))
        rows += _rows(depth_metrics(), images, ours, theirs, rule)
    return rows


def _rows(
    metrics: Sequence[Metric], images: Images, ours: Measures, theirs: Measures, rule: IntervalRule
) -> list[Row]:
    return [
        comparison_row(m, images, ours[m.id], theirs[m.id], rule) for m in metrics if m.id in ours
    ]
