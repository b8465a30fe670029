"""comparison.json: a comparison as a pure function of the evaluation folders."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from legoworld.comparison.family import comparison_of_task
from legoworld.comparison.image_pairs import pair_images
from legoworld.comparison.measures import IntervalRule, Metric, comparison_row
from legoworld.comparison.notes import note_differences
from legoworld.comparison.provenance import (
    provenance_by_field,
    provenance_notes,
    recorded_provenance,
)
from legoworld.evaluation.bootstrap import LEVEL
from legoworld.evaluation.stored import StoredEvaluation
from legoworld.records.base import as_json, to_record
from legoworld.records.comparison import (
    Comparison,
    ComparisonBootstrap,
    ComparisonRow,
    ImageName,
    Method,
    Pair,
    PairCoverage,
    Unscored,
)
from legoworld.records.evaluation_summary import Coverage
from legoworld.records.evidence import ComparisonSettings


def list_metrics(task: str) -> list[Metric]:
    """Every metric of a comparison of a task, in display order."""
    return comparison_of_task(task).metrics(task)


def compare(
    sides: Sequence[StoredEvaluation],
    settings: ComparisonSettings,
    notice: Callable[[str], None] = lambda _text: None,
) -> Comparison:
    """The document of a comparison of the first side with each of the others.

    sides: must pass `check_comparable`. The document depends only on the evaluations' files and the
    settings, so equal inputs give equal documents.
    """
    rows, family = sides[0].rows, comparison_of_task(sides[0].task)
    unit, facts = family.unit(sides[0]), family.facts(sides[0])
    by_field = provenance_by_field(sides)
    made = provenance_notes(by_field) if any(side.is_scene for side in sides) else []
    pairs = []
    for baseline in sides[1:]:
        notice(f"{settings.draws} bootstrap samples of {sides[0].name} and {baseline.name}")
        pairs.append(_pair(sides[0], baseline, settings, unit))
    return Comparison(
        task=sides[0].task,
        dataset_version=facts.dataset_version,
        evaluator=sides[0].summary.evaluator,
        protocol=facts.protocol,
        bootstrap=ComparisonBootstrap(
            draws=settings.draws, seed=settings.seed, level=LEVEL, unit=unit
        ),
        images=tuple(ImageName(image_id=r.image_id, file_name=r.file_name) for r in rows),
        methods=tuple(_method(side, first=side is sides[0]) for side in sides),
        pairs=tuple(pairs),
        provenance=by_field,
        notes=(*note_differences(sides), *made),
    )


def _method(side: StoredEvaluation, *, first: bool) -> Method:
    facts = comparison_of_task(side.task).facts(side)
    return Method(
        name=side.name,
        role="scene" if first else "baseline",
        kind=str(side.summary.kind),
        coverage=to_record(Coverage, as_json(side.summary.coverage)),
        not_scored=tuple(
            Unscored(image_id=row.image_id, file_name=row.file_name, status=row.status)
            for row in side.rows
            if not row.has_score
        ),
        used_truth=side.used_truth,
        camera_model=facts.camera_model,
        max_side=facts.max_side,
        resampled=facts.resampled,
        provenance=tuple(recorded_provenance(side)),
    )


def _pair(
    scene: StoredEvaluation, baseline: StoredEvaluation, settings: ComparisonSettings, unit: str
) -> Pair:
    pairing = pair_images(scene, baseline)
    ids = [row.image_id for row in scene.rows]
    return Pair(
        scene=scene.name,
        baseline=baseline.name,
        coverage=PairCoverage(
            attempted=len(scene.rows),
            with_truth=sum(row.has_truth for row in scene.rows),
            scene_scored=sum(row.has_score for row in scene.rows),
            baseline_scored=sum(row.has_score for row in baseline.rows),
            paired=int(pairing.kept.sum()),
        ),
        paired_image_ids=tuple(i for i, keep in zip(ids, pairing.kept, strict=True) if keep),
        dropped=pairing.dropped,
        rows=tuple(_measure_rows(scene, baseline, pairing.kept, settings, unit)),
    )


def _measure_rows(
    scene: StoredEvaluation,
    baseline: StoredEvaluation,
    paired: NDArray[np.bool_],
    settings: ComparisonSettings,
    unit: str,
) -> Iterator[ComparisonRow]:
    """The rows over each selection of images; none over no image: coverage says 0 paired."""
    family = comparison_of_task(scene.task)
    rule = IntervalRule(centred=family.centred, unit=unit)
    unpaired = family.unpaired(scene)
    for images in family.images:
        kept = paired if images == "paired" else unpaired
        if not kept.any():
            continue
        measure = family.measurer(scene, images, kept, settings)
        ours, theirs = measure(scene), measure(baseline)
        for metric in list_metrics(scene.task):
            if metric.id in ours:
                yield comparison_row(metric, images, ours[metric.id], theirs[metric.id], rule)
