"""Two evaluations of counts."""

import numpy as np

from legoworld.comparison.family import ComparisonFamily
from legoworld.comparison.measures import HEADLINE, Measure, Metric, shared_draws
from legoworld.evaluation.bootstrap import resampled_means


def _measurer(_scene, images, kept, settings):
    draws = shared_draws(int(kept.sum()), settings.draws, settings.seed)

    def measure(side):
        errors = [row.error for row, keep in zip(side.rows, kept, strict=True) if keep]
        if None in errors:
            return {"mae": Measure(value=np.nan, samples=None, over={"images": 0}, extra={})}
        numbers = np.array(errors)
        samples = resampled_means(numbers, np.arange(len(numbers)), draws.counts)
        over = {"images": len(numbers)}
        return {"mae": Measure(value=float(numbers.mean()), samples=samples, over=over, extra={})}

    return measure


COMPARISON = ComparisonFamily(
    metrics=lambda _task: [Metric(id="mae", policy="-", better="lower", level=HEADLINE)],
    unit=lambda _side: "image",
    measurer=_measurer,
)
