"""The images of a depth section: every side's row, small aligned arrays, and what to do."""

from __future__ import annotations

import base64
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from msgspec.structs import replace
from numpy.typing import NDArray

from legoworld.evaluation.pixels.view import decoded
from legoworld.evaluation.stored import Evaluated
from legoworld.records.depth import DepthRow, ScoredDepthRow
from legoworld.records.evaluation_view import DepthView
from legoworld.records.report_page import Advice, DepthDrawing
from legoworld.records.run_file import ImageSource
from legoworld.records.run_rows import RunRow
from legoworld.report.advice import failure_advice, sorted_advice

#: The code of a pixel without depth.
NO_DEPTH: Final = 65535
#: Shares of pixels left out at both ends of the colour scale.
_LIMITS_PERCENT: Final = (2, 98)
_MANY_HOLES: Final = 0.02
_MUCH_CLAMPED: Final = 0.02

F32 = NDArray[np.float32]


@dataclass(frozen=True, kw_only=True)
class DepthImage:
    """One photo. rows: each side's row; view: what the page draws, None where no side scored.

    truth_z_m, aligned_z_m: the drawn arrays, None where there is none.
    """

    rows: tuple[DepthRow, ...]
    run_rows: tuple[RunRow, ...]
    scenes: tuple[ImageSource | None, ...]
    view: DepthDrawing | None
    truth_z_m: F32 | None
    aligned_z_m: tuple[F32 | None, ...]


def depth_images(sides: Sequence[Evaluated]) -> Iterator[DepthImage]:
    """The photos of a section's track, ascending id, one at a time."""
    for rows in zip(*(side.depth_rows for side in sides), strict=True):
        image_id = rows[0].image_id
        views = [side.depth_view(image_id) for side in sides]
        known = next((v for v in views if v is not None), None)
        yield DepthImage(
            rows=rows,
            run_rows=tuple(side.run_rows[image_id] for side in sides),
            scenes=tuple(side.source(image_id) for side in sides),
            view=depth_view(views),
            truth_z_m=decoded(known.truth_z_m, known.size_wh) if known else None,
            aligned_z_m=tuple(
                None if v is None else decoded(v.aligned_z_m, v.size_wh) for v in views
            ),
        )


def depth_view(views: Sequence[DepthView | None]) -> DepthDrawing | None:
    """The drawn arrays of one photo on one scale.

    The colour scale goes from the 2nd to the 98th percentile of inverse depth over the truth and
    every side, the error scale to the 98th of |aligned - truth|.
    """
    known = [v for v in views if v is not None]
    if not known:
        return None
    truth = decoded(known[0].truth_z_m, known[0].size_wh)
    aligned = [None if v is None else decoded(v.aligned_z_m, v.size_wh) for v in views]
    every = [truth, *(a for a in aligned if a is not None)]
    values = np.concatenate([a[np.isfinite(a) & (a > 0)] for a in every]).astype(np.float64)
    low, high = np.percentile(1.0 / values, _LIMITS_PERCENT)
    errors = np.concatenate([_errors(a, truth) for a in aligned if a is not None])
    z0_m, step = float(values.min()), float(np.log(values.max() / values.min()) / (NO_DEPTH - 1))
    return DepthDrawing(
        size_wh=known[0].size_wh,
        image_wh=known[0].image_wh,
        near_far_z_m=(float(1.0 / high), float(1.0 / low)),
        error_m=float(np.percentile(errors, _LIMITS_PERCENT[1])) if len(errors) else 0.0,
        z0_m=z0_m,
        step=step,
        truth=encoded(truth, z0_m, step),
        aligned=tuple(None if a is None else encoded(a, z0_m, step) for a in aligned),
    )


def encoded(z_m: F32, z0_m: float, step: float) -> str:
    """Depths as uint16 codes, equal ratios apart; within half a step of the logarithm."""
    codes = np.full(z_m.shape, NO_DEPTH, "<u2")
    known = np.isfinite(z_m) & (z_m > 0)
    if step > 0:
        codes[known] = np.rint(np.log(z_m[known].astype(np.float64) / z0_m) / step)
    else:
        codes[known] = 0
    return base64.b64encode(codes.tobytes()).decode("ascii")


def _errors(aligned: F32, truth: F32) -> NDArray[np.float64]:
    both = np.isfinite(aligned) & np.isfinite(truth)
    errors_m: NDArray[np.float64] = np.abs(aligned[both].astype(np.float64) - truth[both])
    return errors_m


def depth_advice(row: DepthRow, run_row: RunRow, *, scene: bool) -> tuple[Advice, ...]:
    """Everything to say of one side's depth of a photo; what to do only where it is a scene."""
    advice = failure_advice(run_row)
    if not advice and isinstance(row, ScoredDepthRow):
        advice += _scored(row)
    elif not advice:
        advice.append(Advice(level="bad", what=f"not scored ({row.status}): {row.reason}"))
    if not scene:
        advice = [replace(a, do="") for a in advice]
    warnings = {*row.warnings, *run_row.warnings}
    advice += [Advice(level="warn", what=str(w)) for w in sorted(warnings)]
    return sorted_advice(advice)


def _scored(row: ScoredDepthRow) -> list[Advice]:
    advice = []
    if row.worse_than_constant:
        advice.append(
            Advice(
                level="bad",
                what="a constant depth would score better",
                do="check the camera first, then which surfaces are near and which far",
            )
        )
    if row.status == "inverted":
        what = "near and far are exchanged: the aligned scale is negative"
        advice.append(Advice(level="bad", what=what, do="check the order of things along the view"))
    if row.hole_share > _MANY_HOLES:
        advice.append(
            Advice(
                level="bad",
                what=f"{row.hole_share:.1%} of the measured pixels have no geometry",
                do="close floor, walls and background: under error_1 a hole is an error of 100 %",
            )
        )
    if row.outside_view_share > _MANY_HOLES:
        what = f"{row.outside_view_share:.1%} of the measured pixels are outside the view"
        advice.append(Advice(level="warn", what=what, do="widen the camera's field of view"))
    if row.clamped_share > _MUCH_CLAMPED:
        what = f"{row.clamped_share:.1%} of the pixels were held at the deepest truth"
        advice.append(Advice(level="warn", what=what, do="the far end of the scene is too far"))
    return advice
