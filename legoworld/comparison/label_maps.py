"""Label maps: the metrics of one side over some of its images, from its rows' integers."""

from __future__ import annotations

from functools import partial
from typing import Final, cast

import numpy as np
from numpy.typing import NDArray

from legoworld.comparison.family import ComparisonFamily, SideFacts, measure_over_images
from legoworld.comparison.measures import HEADLINE, TABLE, Draws, Measure, Measures, Metric
from legoworld.evaluation.label_maps.family import (
    MapFamily,
    present_categories,
    resample_values,
    total_sums,
)
from legoworld.evaluation.panoptic.family import MAPS as SEGMENTS
from legoworld.evaluation.semantic.family import MAPS as CLASSES
from legoworld.evaluation.stored import StoredEvaluation
from legoworld.records.label_maps import LabelMapRow, LabelMapSummary


def _comparison(family: MapFamily) -> ComparisonFamily:
    return ComparisonFamily(
        metrics=lambda _task: [
            Metric(
                id=name,
                policy="-",
                better="higher",
                level=HEADLINE if name in family.headline else TABLE,
            )
            for name in family.metrics
        ],
        unit=lambda _side: "image",
        measurer=measure_over_images(partial(_measures, family)),
        centred=True,
        facts=lambda side: SideFacts(dataset_version=_summary(side).dataset_version),
    )


def _measures(
    family: MapFamily, side: StoredEvaluation, is_paired: NDArray[np.bool_], draws: Draws
) -> Measures:
    rows: list[LabelMapRow] = side.kept_rows(is_paired)
    ids = present_categories(rows)
    known = {category.id: category.isthing for category in _summary(side).categories}
    things = np.array([known[number] for number in ids], bool)
    values = family.values(total_sums(rows, ids), things)
    samples = resample_values(family, rows, ids, things, draws.counts)
    over = {"images": len(rows), "categories": len(ids)}
    return {
        name: Measure(
            value=float(value),
            samples=samples[name] if len(rows) > 1 and np.isfinite(value) else None,
            over=over,
        )
        for name, value in values.items()
    }


def _summary(side: StoredEvaluation) -> LabelMapSummary:
    return cast("LabelMapSummary", side.summary)


PANOPTIC: Final = _comparison(SEGMENTS)
SEMANTIC: Final = _comparison(CLASSES)
