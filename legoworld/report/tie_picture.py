"""AP over the orders that equal confidence leaves open, as the coordinates of a small drawing."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from legoworld.evaluation.detection.matching.outcomes import EQUAL, OWN, table_from
from legoworld.evaluation.detection.ranking.ties import order_aps
from legoworld.evaluation.stored import StoredEvaluation
from legoworld.pluralize import share
from legoworld.records.detection import Ties, TieSpread
from legoworld.records.report_tables import TieBar, TieDrawing, TiePicture

WIDTH: Final = 640
HEIGHT: Final = 150
_LEFT: Final = 30
_TOP: Final = 34
_BASE: Final = 104
_BINS: Final = 40
#: Bounds nearer than this are one number on the page.
_NO_WIDTH: Final = 5e-5


def tie_pictures(side: StoredEvaluation) -> list[TiePicture]:
    """The picture under the predictions' own scores, and under equal ones where those differ."""
    summary = side.detection
    equal = summary.equal_confidence
    own = "every prediction with the same confidence" if equal.already_equal else "own scores"
    pictures = [_picture(side, OWN, own, summary.metrics["AP"], summary.ties)]
    if not equal.already_equal:
        ap, ties = equal.metrics["AP"], equal.ties
        pictures.append(_picture(side, EQUAL, "equal confidence", ap, ties))
    return pictures


def _picture(
    side: StoredEvaluation, policy: str, title: str, ap: float | None, ties: Ties
) -> TiePicture:
    drawing, known = None, ties.spread
    if ap is not None and known is not None and known.best - known.worst >= _NO_WIDTH:
        aps = order_aps(table_from(side.matches, policy), draws=ties.draws, seed=ties.seed)
        drawing = _draw_ties(aps, ap, known)
    return TiePicture(title=f"{side.name}: {title}", ap=ap, ties=ties, drawing=drawing)


def _draw_ties(aps: NDArray[np.float64], ap: float, known: TieSpread) -> TieDrawing:
    low, high = min(known.worst, ap), max(known.best, ap)

    def x(value: float) -> float:
        return round(float(_LEFT + (value - low) / (high - low) * (WIDTH - 2 * _LEFT)), 2)

    return TieDrawing(
        bars=tuple(_bars(aps, low, high)),
        x={
            "worst": x(known.worst),
            "best": x(known.best),
            "expected": x(known.expected),
            "ap": x(ap),
        },
        spread=(
            x(max(low, known.expected - known.sd)),
            x(min(high, known.expected + known.sd)),
        ),
        width=WIDTH,
        height=HEIGHT,
        base=_BASE,
        top=_TOP,
    )


def _bars(aps: NDArray[np.float64], low: float, high: float) -> list[TieBar]:
    """Bars that are not empty: x, y, w, h in the drawing, and what they count."""
    counts, edges = np.histogram(np.clip(aps, low, high), bins=_BINS, range=(low, high))
    width = (WIDTH - 2 * _LEFT) / _BINS
    tallest = counts.max()
    bars = []
    for i in np.flatnonzero(counts).tolist():
        height = round(float(counts[i] / tallest * (_BASE - _TOP)), 2)
        bars.append(
            TieBar(
                x=round(_LEFT + i * width + 0.5, 2),
                y=_BASE - height,
                w=round(width - 1, 2),
                h=height,
                text=f"{share(int(counts[i]), len(aps), 'order', 'orders')}: {edges[i]:.4f} to "
                f"{edges[i + 1]:.4f}",
            )
        )
    return bars
