"""Boxes and masks: all official and score-free numbers of one side over some of its images.

`restrict_table`: as if only those had been evaluated.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from legoworld.comparison.family import ComparisonFamily, SideFacts, measure_over_images
from legoworld.comparison.measures import (
    EVERYTHING,
    HEADLINE,
    TABLE,
    Draws,
    Measure,
    Measures,
    Metric,
)
from legoworld.evaluation.detection.amodal_sums import AMODAL_METRICS, amodal_metrics, amodal_values
from legoworld.evaluation.detection.grid import Grid
from legoworld.evaluation.detection.matching import outcomes
from legoworld.evaluation.detection.matching.matched_metrics import MatchedCounts, matched_metrics
from legoworld.evaluation.detection.matching.outcomes import MatchTable
from legoworld.evaluation.detection.payloads.amodal import AMODAL
from legoworld.evaluation.detection.problem import Floats
from legoworld.evaluation.detection.protocols import DetectionProtocol, detection_protocol
from legoworld.evaluation.detection.protocols import Metric as OfficialMetric
from legoworld.evaluation.detection.ranking.accumulation import accumulate, metric_value
from legoworld.evaluation.detection.ranking.resampling import (
    resampled_metrics,
    single_image_metrics,
)
from legoworld.evaluation.detection.ranking.ties import tie_orders
from legoworld.evaluation.stored import StoredEvaluation
from legoworld.records.comparison import Better, Level


def restrict_table(table: MatchTable, is_paired: NDArray[np.bool_]) -> MatchTable:
    """The match table of the paired images.

    is_paired: (images,). Ranks, caps and LVIS's verified categories are per image, so nothing is
    matched again: the official evaluator gives the same on these images (checked by a test).
    """
    position = np.cumsum(is_paired) - 1
    rows, cells = is_paired[table.image], is_paired[table.truth_image]
    return replace(
        table,
        image_ids=table.image_ids[is_paired],
        image=position[table.image[rows]],
        category=table.category[rows],
        score=table.score[rows],
        rank=table.rank[rows],
        entry=table.entry[rows],
        state=np.ascontiguousarray(table.state[:, :, rows]),
        truth_image=position[table.truth_image[cells]],
        truth_category=table.truth_category[cells],
        n_truths=np.ascontiguousarray(table.n_truths[:, cells]),
    )


def restrict_counts(counts: MatchedCounts, is_paired: NDArray[np.bool_]) -> MatchedCounts:
    """The score-free sums of the kept images, (images,) bool."""
    position = np.cumsum(is_paired) - 1
    cells = is_paired[counts.cell_image]
    return MatchedCounts(
        per_image=counts.per_image[is_paired],
        cell_image=position[counts.cell_image[cells]],
        cell_category=counts.cell_category[cells],
        cell_n_gt=counts.cell_n_gt[cells],
        cell_iou_sum=counts.cell_iou_sum[cells],
    )


EQUAL: Final = "equal_confidence."
TIES: Final = "tie_orders.AP"
_KINDS: Final = ("class_aware", "class_agnostic")
_HEADLINE: Final = ("AP", "AP25", "AP50", "AP75")
#: COCO's recalls at fewer than 100 detections are in the rows, but not in every table.
_SMALL_CAPS: Final = ("AR1", "AR10")
_SCORE_FREE: Final = (
    "miou_gt_micro", "miou_gt_macro", "miou_matched", "precision_50", "recall_50", "f1_50",
    "sq", "rq", "pq", "label_accuracy",
)  # fmt: skip
_SCORE_FREE_TABLE: Final = ("miou_gt_micro", "miou_matched", "f1_50")


def detection_metrics(task: str) -> list[Metric]:
    """Every metric of a comparison of boxes or masks, in display order."""
    protocol, metrics = detection_protocol(task), []
    for prefix, policy in (("", "own_scores"), (EQUAL, "equal_confidence")):
        for official in protocol.metrics:
            level: Level = HEADLINE if official.name in _HEADLINE else TABLE
            if official.name in _SMALL_CAPS or (prefix and official.name != "AP"):
                level = EVERYTHING
            metrics.append(
                Metric(id=prefix + official.name, policy=policy, better="higher", level=level)
            )
    metrics.append(Metric(id=TIES, policy="tie_orders", better="higher", level=TABLE))
    for kind in _KINDS:
        for name in _SCORE_FREE:
            if (kind, name) != ("class_aware", "label_accuracy"):  # right by construction
                shown = kind == "class_aware" and name in _SCORE_FREE_TABLE
                level = TABLE if shown else EVERYTHING
                metrics.append(
                    Metric(id=f"{kind}.{name}", policy="score_free", better="higher", level=level)
                )
    if protocol.payload is AMODAL:
        for name in AMODAL_METRICS:
            better: Better = "lower" if name.endswith("_error") else "higher"
            metrics.append(
                Metric(id=f"amodal.{name}", policy="score_free", better=better, level=TABLE)
            )
    return metrics


def side_frequencies(side: StoredEvaluation, category_ids: NDArray[np.int64]) -> NDArray[np.str_]:
    """(K,) LVIS's frequency letters; empty for categories without annotations and predictions."""
    letters = {row.category_id: row.frequency or "" for row in side.categories}
    return np.array([letters.get(int(i), "") for i in category_ids])


def measure_detections(
    side: StoredEvaluation, is_paired: NDArray[np.bool_], shared: Draws
) -> Measures:
    """Every metric of `detection_metrics` over kept (images,) bool, from the recorded matches."""
    protocol, arrays = detection_protocol(side.task), side.matches
    frequencies = side_frequencies(side, arrays["category_ids"])
    measures: Measures = {}
    table = restrict_table(outcomes.table_from(arrays, outcomes.OWN), is_paired)
    own = equal = _official(table, protocol, frequencies, shared)
    if _ranks(side):
        table = restrict_table(outcomes.table_from(arrays, outcomes.EQUAL), is_paired)
        equal = _official(table, protocol, frequencies, shared)
    measures |= own | {EQUAL + name: measure for name, measure in equal.items()}
    measures[TIES] = _ties(table, shared, equal["AP"].over)
    images_with_truth = len(np.unique(table.truth_image))
    for kind, aware in zip(_KINDS, (True, False), strict=True):
        counts = restrict_counts(outcomes.counts_from(arrays, class_aware=aware), is_paired)
        for name, measure in _score_free(counts, shared, spread=images_with_truth > 1).items():
            measures[f"{kind}.{name}"] = measure
    return measures | _amodal(side, is_paired, shared)


def _amodal(side: StoredEvaluation, is_paired: NDArray[np.bool_], shared: Draws) -> Measures:
    """Of amodal masks: what AP hides, from the rows; undefined without visible masks."""
    if not side.detection.amodal:
        return {}
    sums = [row.amodal for row in side.kept_rows(is_paired)]
    known = [one for one in sums if one]
    samples = amodal_metrics(known, shared.counts) if known else {}
    point = amodal_values(known) if known else {}
    return {
        f"amodal.{name}": Measure(
            value=np.nan if point.get(name) is None else float(point[name] or 0),
            samples=samples.get(name),
            over={"images": len(sums)},
        )
        for name in AMODAL_METRICS
    }


def _ranks(side: StoredEvaluation) -> bool:
    """Whether the predictions' own scores rank them."""
    return not side.detection.equal_confidence.already_equal


def _official(
    table: MatchTable, protocol: DetectionProtocol, frequencies: NDArray[np.str_], shared: Draws
) -> Measures:
    """The evaluator's numbers and their bootstrap samples."""
    curves = accumulate(table, protocol)
    samples = resampled_metrics(table, protocol, shared.counts, frequencies)
    lone = single_image_metrics(table, protocol, frequencies)
    measures = {}
    for metric in protocol.metrics:
        value = metric_value(metric, curves, frequencies)
        defined = value != -1 and metric.name not in lone
        measures[metric.name] = Measure(
            value=np.nan if value == -1 else value,
            samples=samples[metric.name] if defined else None,
            over=_count_denominators(table, metric, frequencies, protocol.grid),
        )
    return measures


def _count_denominators(
    table: MatchTable, metric: OfficialMetric, frequencies: NDArray[np.str_], grid: Grid
) -> dict[str, int]:
    counted = table.truths_per_category[grid.areas.index(metric.area)]
    if metric.frequency is not None:
        counted = np.where(frequencies == metric.frequency, counted, 0)
    return {
        "images": len(table.image_ids),
        "categories": int((counted > 0).sum()),
        "truths": int(counted.sum()),
    }


def _ties(table: MatchTable, shared: Draws, over: Mapping[str, int]) -> Measure:
    """Expected AP over random orders of equally confident predictions."""
    spread = tie_orders(table, draws=shared.draws, seed=shared.seed).spread
    expected, *others = spread or (np.nan,) * 4
    extra: dict[str, float] = dict(zip(("sd", "worst", "best"), others, strict=True))
    return Measure(value=expected, samples=None, over=over, extra=extra)


def _score_free(counts: MatchedCounts, shared: Draws, *, spread: bool) -> Measures:
    samples = matched_metrics(counts, shared.counts)
    point: dict[str, Floats] = matched_metrics(
        counts, np.ones((1, len(counts.per_image)), np.int32)
    )
    over = {
        "images": len(counts.per_image),
        "truths": int(point["n_gt"][0]),
        "predictions": int(point["n_dt"][0]),
    }
    more = {
        "miou_gt_macro": {"categories": len(np.unique(counts.cell_category))},
        "miou_matched": {"pairs": int(point["n_matched"][0])},
        "label_accuracy": {"pairs": int(point["n_hits_50"][0])},
    }
    measures = {}
    for name in _SCORE_FREE:
        value = float(point[name][0])
        measures[name] = Measure(
            value=value,
            samples=samples[name] if spread and np.isfinite(value) else None,
            over={**over, **more.get(name, {})},
        )
    return measures


def _notes(sides: Sequence[StoredEvaluation]) -> list[str]:
    """Which sides rank their predictions."""
    ranked = [s.name for s in sides if _ranks(s)]
    unranked = [s.name for s in sides if not _ranks(s)]
    if not ranked or not unranked:
        return []
    return [
        f"Official metrics: {', '.join(ranked)} ranked by own scores, {', '.join(unranked)} "
        "equally confident in everything and ordered canonically. Those of equal_confidence and "
        "tie_orders: no method ranks."
    ]


COMPARISON: Final = ComparisonFamily(
    metrics=detection_metrics,
    unit=lambda _side: "image",
    measurer=measure_over_images(measure_detections),
    centred=True,
    facts=lambda side: SideFacts(dataset_version=side.detection.dataset_version),
    notes=_notes,
)
