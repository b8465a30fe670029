"""comparison.json: a comparison as a pure function of the evaluation folders."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from legoworld.comparison import bench
from legoworld.comparison.depth import (
    depth_metrics,
    group_unit,
    measure_depth,
    shared_group_draws,
    with_truth,
)
from legoworld.comparison.detections import detection_metrics, measure_detections
from legoworld.comparison.measures import (
    IntervalRule,
    Measures,
    Metric,
    comparison_row,
    shared_draws,
)
from legoworld.comparison.notes import notes_of
from legoworld.comparison.pairing import has_truth, is_scored, pair_images
from legoworld.comparison.provenance import (
    provenance_by_field,
    provenance_notes,
    recorded_provenance,
)
from legoworld.evaluation.bootstrap import LEVEL
from legoworld.evaluation.detection.protocols import PROTOCOLS
from legoworld.evaluation.stored import Evaluated
from legoworld.records.base import as_json, to_record
from legoworld.records.comparison import (
    Comparison,
    ComparisonBootstrap,
    ComparisonRow,
    ImageName,
    Images,
    Method,
    Pair,
    PairCoverage,
    Unscored,
)
from legoworld.records.evaluation_summary import Coverage, DepthRules
from legoworld.records.evidence import ComparisonSettings

_IMAGES: Final[tuple[Images, ...]] = ("attempted", "paired")
_DEPTH_IMAGES: Final[tuple[Images, ...]] = ("scored", "attempted", "paired")


def metrics_of(task: str) -> list[Metric]:
    """Every metric of a comparison of a task, in display order."""
    if task in PROTOCOLS:
        return detection_metrics(PROTOCOLS[task])
    return bench.bench_metrics() if task == "bench" else depth_metrics()


def compare(
    sides: Sequence[Evaluated],
    settings: ComparisonSettings,
    notice: Callable[[str], None] = lambda _text: None,
) -> Comparison:
    """The document of a comparison of the first side with each of the others.

    sides: must pass `check_comparable`. The document depends only on the evaluations' files and the
    settings, so equal inputs give equal documents.
    """
    rows = sides[0].rows
    unit = _unit(sides[0])
    by_field = provenance_by_field(sides)
    made = provenance_notes(by_field) if any(side.is_scene for side in sides) else []
    pairs = []
    for baseline in sides[1:]:
        notice(f"{settings.draws} bootstrap samples of {sides[0].name} and {baseline.name}")
        pairs.append(_pair(sides[0], baseline, settings, unit))
    return Comparison(
        task=sides[0].task,
        dataset_version=sides[0].dataset_version,
        evaluator=sides[0].summary.evaluator,
        protocol=_protocol(sides[0]),
        bootstrap=ComparisonBootstrap(
            draws=settings.draws, seed=settings.seed, level=LEVEL, unit=unit
        ),
        images=tuple(ImageName(image_id=r.image_id, file_name=r.file_name) for r in rows),
        methods=tuple(_method(side, first=side is sides[0]) for side in sides),
        pairs=tuple(pairs),
        provenance=by_field,
        notes=(*notes_of(sides), *made),
    )


def _unit(side: Evaluated) -> str:
    """What the bootstrap draws."""
    if side.is_depth:
        return group_unit([row for row in side.depth_rows if has_truth(row)])
    return "image" if side.task in PROTOCOLS else bench.UNIT


def _protocol(side: Evaluated) -> DepthRules | None:
    """The declared choices of depth; each method has its own camera model."""
    if not side.is_depth:
        return None
    return to_record(DepthRules, as_json(side.depth.protocol))


def _method(side: Evaluated, *, first: bool) -> Method:
    return Method(
        name=side.name,
        role="scene" if first else "baseline",
        kind=str(side.summary.kind),
        coverage=to_record(Coverage, as_json(side.summary.coverage)),
        not_scored=tuple(
            Unscored(image_id=row.image_id, file_name=row.file_name, status=row.status)
            for row in side.rows
            if not is_scored(row)
        ),
        used_truth=side.used_truth,
        camera_model=side.camera_model,
        max_side=side.max_side,
        resampled=side.resampled,
        provenance=tuple(recorded_provenance(side)),
    )


def _pair(scene: Evaluated, baseline: Evaluated, settings: ComparisonSettings, unit: str) -> Pair:
    pairing = pair_images(scene, baseline)
    ids = [row.image_id for row in scene.rows]
    return Pair(
        scene=scene.name,
        baseline=baseline.name,
        coverage=PairCoverage(
            attempted=len(scene.rows),
            with_truth=sum(has_truth(row) for row in scene.rows),
            scene_scored=sum(is_scored(row) for row in scene.rows),
            baseline_scored=sum(is_scored(row) for row in baseline.rows),
            paired=int(pairing.kept.sum()),
        ),
        paired_image_ids=tuple(i for i, keep in zip(ids, pairing.kept, strict=True) if keep),
        dropped=pairing.dropped,
        rows=tuple(_measured(scene, baseline, pairing.kept, settings, unit)),
    )


def _measured(
    scene: Evaluated,
    baseline: Evaluated,
    paired: NDArray[np.bool_],
    settings: ComparisonSettings,
    unit: str,
) -> Iterator[ComparisonRow]:
    """The rows over each selection of images; none over no image: coverage says 0 paired."""
    rule = IntervalRule(centred=scene.task in PROTOCOLS, unit=unit)
    others = with_truth(scene) if scene.is_depth else np.ones(len(paired), bool)
    for images in _DEPTH_IMAGES if scene.is_depth else _IMAGES:
        kept = paired if images == "paired" else others
        if not kept.any():
            continue
        measure = _measure(scene, images, kept, settings)
        ours, theirs = measure(scene), measure(baseline)
        for metric in metrics_of(scene.task):
            if metric.id in ours:
                yield comparison_row(metric, images, ours[metric.id], theirs[metric.id], rule)


def _measure(
    scene: Evaluated, images: Images, kept: NDArray[np.bool_], settings: ComparisonSettings
) -> Callable[[Evaluated], Measures]:
    """What measures a side over the kept images, with draws that both sides share."""
    if scene.is_depth:
        drawn = [row for row, keep in zip(scene.depth_rows, kept, strict=True) if keep]
        groups = shared_group_draws(drawn, settings.draws, settings.seed)
        return lambda side: measure_depth(side, images, kept, groups)
    if scene.task in PROTOCOLS:
        draws = shared_draws(int(kept.sum()), settings.draws, settings.seed)
        return lambda side: measure_detections(side, PROTOCOLS[side.task], kept, draws)
    families = bench.family_draws(scene, kept, settings.draws, settings.seed)
    return lambda side: bench.measure_bench(side, images, kept, families)
