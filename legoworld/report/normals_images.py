"""Normals on a page: the arrays of a photo, its facts, and what to do about it."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from legoworld.evaluation.normals.arrays import TOWARDS, NormalsArray, valid_normals
from legoworld.evaluation.normals.protocol import HOLE_DEG, angular_errors
from legoworld.evaluation.pixels.resampling import decode_array, sampler
from legoworld.records.normals import NormalsView, ScoredNormalsRow
from legoworld.records.report_page import Advice, NormalsDrawing
from legoworld.report.mended_pixels import Mending

#: The code of a pixel without an error.
NO_ERROR: Final = 65535
_PER_DEGREE: Final = 100
#: The error scale ends where 2 percent of the errors lie beyond it.
_LIMIT_PERCENT: Final = 98
_MANY_HOLES: Final = 0.02
_CHANNELS: Final = 3

F32 = NDArray[np.float32]


def normals_drawing(views: Sequence[NormalsView | None]) -> NormalsDrawing | None:
    """The drawn arrays of one photo, and their errors on one scale."""
    known = [view for view in views if view is not None]
    if not known:
        return None
    truth = decode_array(known[0].truth, known[0].size_wh, _CHANNELS)
    predicted = [
        None if v is None else decode_array(v.predicted, v.size_wh, _CHANNELS) for v in views
    ]
    errors = [None if one is None else _errors_deg(one, truth) for one in predicted]
    every = np.concatenate([e[np.isfinite(e)] for e in errors if e is not None])
    return NormalsDrawing(
        size_wh=known[0].size_wh,
        image_wh=known[0].image_wh,
        error_deg=float(np.percentile(every, _LIMIT_PERCENT)) if len(every) else 0.0,
        truth=encode_vectors(truth),
        predicted=tuple(None if one is None else encode_vectors(one) for one in predicted),
        errors=tuple(None if one is None else _encode_errors(one) for one in errors),
    )


def encode_vectors(vectors: F32) -> str:
    """(H, W, 3) unit vectors as signed bytes, within half of 1 / 127; 0, 0, 0 for none."""
    return _text(np.nan_to_num(np.rint(vectors * 127.0)).astype(np.int8))


def _encode_errors(errors_deg: NDArray[np.float64]) -> str:
    known = np.isfinite(errors_deg)
    return _text(np.where(known, np.rint(errors_deg * _PER_DEGREE), NO_ERROR).astype("<u2"))


def _text(codes: NDArray[Any]) -> str:
    return base64.b64encode(codes.tobytes()).decode("ascii")


def _errors_deg(predicted: F32, truth: F32) -> NDArray[np.float64]:
    cosines = (predicted.astype(np.float64) * truth).sum(axis=-1)
    errors: NDArray[np.float64] = np.degrees(np.arccos(np.clip(cosines, -1.0, 1.0)))
    return errors


class MendedNormals:
    """The drawn pixels of a photo, (H, W, 3), measured again by the normals' own rules."""

    def __init__(self, _task: str, view: NormalsView) -> None:
        self._size_wh = view.size_wh
        self.truth = decode_array(view.truth, view.size_wh, _CHANNELS)
        known = valid_normals(self.truth)
        self.truth = np.where(known[..., None], self.truth, np.nan)
        predicted = decode_array(view.predicted, view.size_wh, _CHANNELS)
        self.predicted = np.where(known[..., None], predicted, np.nan)
        self._n = int(known.sum())

    def score(self, predicted: NDArray[Any]) -> float:
        """The mean error under error_90."""
        sample = sampler(NormalsArray(values=predicted, sign=TOWARDS), self._size_wh)
        errors = angular_errors(self.truth, sample, self._n)
        return float(errors.sum() + HOLE_DEG * (self._n - len(errors))) / self._n

    def without(self, _region: NDArray[np.bool_]) -> NDArray[np.float64]:
        """The same: each pixel is measured alone."""
        return self.predicted

    def pixel_errors(self, predicted: NDArray[Any]) -> NDArray[np.float64]:
        """In degrees."""
        return _errors_deg(predicted, self.truth)

    def say(self, region: NDArray[np.bool_]) -> str:
        """How far it is off at the median."""
        return f"{np.nanmedian(self.pixel_errors(self.predicted)[region]):.0f} degrees off"


MENDING: Final = Mending(of=MendedNormals, hole=HOLE_DEG, far=10.0, unit=" degrees", least=0.05)


def normals_facts(row: ScoredNormalsRow) -> list[tuple[str, str]]:
    """What is known of a prediction besides its metrics."""
    return [("holes", f"{row.hole_share:.2%} of the valid ground truth")]


def normals_advice(row: ScoredNormalsRow) -> list[Advice]:
    """What lowers a photo's score, and what to do about it."""
    if row.hole_share <= _MANY_HOLES:
        return []
    return [
        Advice(
            level="bad",
            what=f"{row.hole_share:.1%} of the measured pixels have no normal",
            do="close floor, walls and background: under error_90 a hole is an error of 90 degrees",
        )
    ]
