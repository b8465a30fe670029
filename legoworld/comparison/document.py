"""comparison.json: a comparison as a pure function of the evaluation folders, with its notes."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from legoworld.comparison.family import ComparisonFamily, SideFacts, load_comparison_family
from legoworld.comparison.measures import IntervalRule, comparison_row
from legoworld.comparison.provenance import (
    provenance_by_field,
    provenance_notes,
    recorded_provenance,
)
from legoworld.errors import one_line
from legoworld.evaluation.bootstrap import LEVEL
from legoworld.evaluation.stored import StoredEvaluation
from legoworld.records.base import as_json, to_record
from legoworld.records.comparison import (
    Comparison,
    ComparisonBootstrap,
    ComparisonRow,
    ComparisonSettings,
    Dropped,
    ImageName,
    Method,
    Pair,
    PairCoverage,
    Unscored,
)
from legoworld.records.evaluation import Coverage


@dataclass(frozen=True, kw_only=True)
class Pairing:
    """is_paired: (images,) bool, in ascending id; dropped: the other images, with all reasons."""

    is_paired: NDArray[np.bool_]
    dropped: tuple[Dropped, ...]


def pair_images(scene: StoredEvaluation, baseline: StoredEvaluation) -> Pairing:
    """Images that both sides scored and that have usable ground truth.

    Usable is at least one annotation that is neither crowd nor ignored; for depth, enough valid
    truth pixels. A bench's case is scored where the submission is valid.
    """
    dropped: list[Dropped] = []
    is_paired = np.ones(len(scene.rows), bool)
    for k, rows in enumerate(zip(scene.rows, baseline.rows, strict=True)):
        reasons = [rows[0].truth_gap]
        for side, row in zip((scene, baseline), rows, strict=True):
            reasons.append(row.score_gap and f"{side.name}: {row.score_gap}")
        reasons = [reason for reason in reasons if reason]
        if reasons:
            is_paired[k] = False
            row = rows[0]
            dropped.append(
                Dropped(image_id=row.image_id, file_name=row.file_name, reasons=tuple(reasons))
            )
    return Pairing(is_paired=is_paired, dropped=tuple(dropped))


def _note_differences(sides: Sequence[StoredEvaluation], family: ComparisonFamily) -> list[str]:
    """Notes on every difference between the sides that does not make them incomparable."""
    notes = [f"Differences are {sides[0].name} minus the other method."]
    notes += [_truth_prompts(side) for side in sides if side.used_truth]
    notes += family.notes(sides)
    return [*notes, *_versions(sides)]


def _truth_prompts(side: StoredEvaluation) -> str:
    return (
        f"{side.name} was prompted with the truth of the images it is scored on: "
        f"{one_line(str(as_json(side.used_truth)), 160)}."
    )


def _versions(sides: Sequence[StoredEvaluation]) -> list[str]:
    """Different package versions: the 1e-12 agreement is checked within one version only."""
    versions = [s.evidence.versions for s in sides]
    names = sorted({name for packages in versions for name in packages})
    notes = []
    for name in names:
        of_sides = [v.get(name, "absent") for v in versions]
        if len(set(of_sides)) > 1:
            listed = ", ".join(f"{s.name} {v}" for s, v in zip(sides, of_sides, strict=True))
            notes.append(f"Evaluated with other versions of {name}: {listed}.")
    return notes


def compare(
    sides: Sequence[StoredEvaluation],
    settings: ComparisonSettings,
    notice: Callable[[str], None] = lambda _text: None,
) -> Comparison:
    """The document of a comparison of the first side with each of the others.

    sides: must pass `check_comparable`. The document depends only on the evaluations' files and the
    settings, so equal inputs give equal documents.
    """
    rows, family = sides[0].rows, load_comparison_family(sides[0].task)
    rule = IntervalRule(centred=family.centred, unit=family.unit(sides[0]))
    facts = [family.facts(side) for side in sides]
    by_field = provenance_by_field(sides)
    made = provenance_notes(by_field) if any(side.is_scene for side in sides) else []
    pairs = []
    for baseline in sides[1:]:
        notice(f"{settings.draws} bootstrap samples of {sides[0].name} and {baseline.name}")
        pairs.append(_pair(sides[0], baseline, settings, family, rule))
    return Comparison(
        task=sides[0].task,
        dataset_version=facts[0].dataset_version,
        evaluator=sides[0].summary.evaluator,
        protocol=facts[0].protocol,
        bootstrap=ComparisonBootstrap(
            draws=settings.draws, seed=settings.seed, level=LEVEL, unit=rule.unit
        ),
        images=tuple(ImageName(image_id=r.image_id, file_name=r.file_name) for r in rows),
        methods=tuple(
            _method(side, own, first=side is sides[0])
            for side, own in zip(sides, facts, strict=True)
        ),
        pairs=tuple(pairs),
        provenance=by_field,
        notes=(*_note_differences(sides, family), *made),
    )


def _method(side: StoredEvaluation, facts: SideFacts, *, first: bool) -> Method:
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
    scene: StoredEvaluation,
    baseline: StoredEvaluation,
    settings: ComparisonSettings,
    family: ComparisonFamily,
    rule: IntervalRule,
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
            paired=int(pairing.is_paired.sum()),
        ),
        paired_image_ids=tuple(i for i, keep in zip(ids, pairing.is_paired, strict=True) if keep),
        dropped=pairing.dropped,
        rows=tuple(_measure_rows(scene, baseline, pairing.is_paired, settings, family, rule)),
    )


def _measure_rows(
    scene: StoredEvaluation,
    baseline: StoredEvaluation,
    paired: NDArray[np.bool_],
    settings: ComparisonSettings,
    family: ComparisonFamily,
    rule: IntervalRule,
) -> Iterator[ComparisonRow]:
    """The rows over each selection of images; none over no image: coverage says 0 paired."""
    unpaired = family.unpaired(scene)
    for images in family.images:
        kept = paired if images == "paired" else unpaired
        if not kept.any():
            continue
        measure = family.measurer(scene, images, kept, settings)
        ours, theirs = measure(scene), measure(baseline)
        for metric in family.metrics(scene.task):
            if metric.id in ours:
                yield comparison_row(metric, images, ours[metric.id], theirs[metric.id], rule)
