"""Depth on a page: the arrays of a photo on one scale, its facts, and what to do about it."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from legoworld.cards import load_card
from legoworld.evaluation.depth.arrays import DepthArray
from legoworld.evaluation.depth.protocol import depth_protocol
from legoworld.evaluation.depth.scoring import ImageScore, aligned_z, score_image, valid_truth
from legoworld.evaluation.pixels.resampling import decode_array, sampler
from legoworld.records.depth import DepthView, ScoredDepthRow
from legoworld.records.report_page import Advice, DepthDrawing
from legoworld.records.report_tables import Plots
from legoworld.report.mended_pixels import Mending
from legoworld.report.plots import DepthPixels

#: The code of a pixel without depth.
NO_DEPTH: Final = 65535
#: Shares of pixels left out at both ends of the colour scale.
_LIMITS_PERCENT: Final = (2, 98)
_MANY_HOLES: Final = 0.02
_MUCH_CLAMPED: Final = 0.02

F32 = NDArray[np.float32]


def depth_view(views: Sequence[DepthView | None]) -> DepthDrawing | None:
    """The drawn arrays of one photo on one scale.

    The colour scale goes from the 2nd to the 98th percentile of inverse depth over the truth and
    every side, the error scale to the 98th of |aligned - truth|.
    """
    known = [v for v in views if v is not None]
    if not known:
        return None
    truth = decode_array(known[0].truth_z_m, known[0].size_wh)
    aligned = [None if v is None else decode_array(v.aligned_z_m, v.size_wh) for v in views]
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
        truth=encode_depth(truth, z0_m, step),
        aligned=tuple(None if a is None else encode_depth(a, z0_m, step) for a in aligned),
    )


def encode_depth(z_m: F32, z0_m: float, step: float) -> str:
    """(H, W) depths as uint16 codes, equal ratios apart; to half a step of the logarithm."""
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


def depth_facts(row: ScoredDepthRow) -> list[tuple[str, str]]:
    """How the depth was aligned, and what it lacks."""
    return [
        ("fit", f"1/z = {row.s:.6g} x + {row.t:.6g}, x in {row.space}"),
        ("holes", f"{row.hole_share:.2%} of the valid ground truth"),
    ]


def depth_constant(row: ScoredDepthRow) -> float:
    """AbsRel of the constant that knows nothing of the picture."""
    return row.constant["abs_rel"]["error_1"]


class MendedDepth:
    """The drawn pixels of a photo, (H, W, 1) metres, aligned and scored again by depth's rules."""

    def __init__(self, task: str, view: DepthView) -> None:
        self._size_wh, self._protocol = view.size_wh, depth_protocol(load_card(task))
        truth, aligned = (
            decode_array(text, view.size_wh).astype(np.float64)
            for text in (view.truth_z_m, view.aligned_z_m)
        )
        known = valid_truth(truth)
        self.truth = np.where(known, truth, np.nan)[..., None]
        self.predicted = np.where(known & np.isfinite(aligned), aligned, np.nan)[..., None]

    def score(self, predicted: NDArray[Any]) -> float:
        """AbsRel under error_1."""
        found = self._score_depth(predicted)
        return found.metrics["abs_rel"]["error_1"] if found.metrics else 1.0

    def _score_depth(self, predicted: NDArray[Any]) -> ImageScore:
        array = DepthArray(values=predicted[..., 0], space="depth", unit="m", intrinsics_px=None)
        sample = sampler(array, self._size_wh)
        return score_image(self.truth[..., 0], sample, self._protocol)

    def without(self, region: NDArray[np.bool_]) -> NDArray[np.float64]:
        """Aligned by the fit of the other pixels."""
        found = self._score_depth(np.where(region[..., None], np.nan, self.predicted))
        if found.fit is None:
            return self.predicted
        return aligned_z(1 / self.predicted, found.fit, 1 / found.deepest_z_m)[0]

    def pixel_errors(self, predicted: NDArray[Any]) -> NDArray[np.float64]:
        """Relative."""
        errors: NDArray[np.float64] = (np.abs(predicted - self.truth) / self.truth)[..., 0]
        return errors

    def say(self, region: NDArray[np.bool_]) -> str:
        """How far it is off at the median."""
        off_m = float(np.nanmedian((self.predicted - self.truth)[..., 0][region]))
        return f"{abs(off_m):.2g} m too {'far' if off_m > 0 else 'near'}"


MENDING: Final = Mending(of=MendedDepth, hole=1.0, far=0.1, unit="", least=0.0005)


class DepthPlots:
    """The error by true depth of every side."""

    def __init__(self, n_sides: int) -> None:
        self._pixels = [DepthPixels() for _ in range(n_sides)]

    def add(self, views: Sequence[DepthView | None]) -> None:
        """One photo."""
        for mine, view in zip(self._pixels, views, strict=True):
            if view is not None:
                mine.add(
                    decode_array(view.truth_z_m, view.size_wh),
                    decode_array(view.aligned_z_m, view.size_wh),
                )

    def plots(self, names: Sequence[str]) -> Plots:
        """Of the sides that have a pixel."""
        plots = (p.plot(name) for p, name in zip(self._pixels, names, strict=True))
        return Plots(depth_error=tuple(plot for plot in plots if plot))


def depth_advice(row: ScoredDepthRow) -> list[Advice]:
    """What lowers a photo's score, and what to do about it."""
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
