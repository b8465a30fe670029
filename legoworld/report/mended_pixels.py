"""What single regions of an array cost: each is given its truth, and the photo is scored again."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final, NamedTuple, Protocol, cast

import cv2
import numpy as np
from numpy.typing import NDArray

from legoworld.evaluation.stored import StoredEvaluation
from legoworld.pluralize import plural
from legoworld.records.base import UNSET
from legoworld.records.pixels import PixelRow, PixelSummary
from legoworld.report.costs import Finding, Findings, Key
from legoworld.report.tried import shift_words

Mask = NDArray[np.bool_]
F32 = NDArray[np.float32]
#: So many photos of the largest errors are mended; a region is at least such a share of one.
_PHOTOS: Final = 20
_SMALLEST: Final = 0.005
#: A region is off where its error is so many times the photo's median, and at least the family's.
_FAR: Final = 3.0
#: A region that costs less of a photo's error than this does not explain it.
_EXPLAINS: Final = 0.5
#: Shifts are looked for in so many pixels of the longer side, up to 1 / _REACH of each side.
_COARSE_PX: Final = 64
_REACH: Final = 6
#: A shift of the whole picture that leaves more of its error than this is no better camera.
_LEFT: Final = 0.7
_THIRDS: Final = ("upper left", "at the top", "upper right", "on the left", "in the middle",
                  "on the right", "lower left", "at the bottom", "lower right")  # fmt: skip


class PixelMending(Protocol):
    """The drawn pixels of a photo. truth, predicted: (H, W, C), NaN where there is none."""

    truth: NDArray[Any]
    predicted: NDArray[Any]

    def pixel_errors(self, predicted: NDArray[Any]) -> NDArray[np.float64]:
        """(H, W), NaN where there is none."""
        ...

    def score(self, predicted: NDArray[Any]) -> float:
        """The metric of this photo with other predictions, by its family's own measuring."""
        ...

    def without(self, region: Mask, /) -> NDArray[Any]:
        """The predictions as they are measured where a region has no say in it."""
        ...

    def say(self, region: Mask) -> str:
        """How a region differs from the truth, in words."""
        ...


@dataclass(frozen=True, kw_only=True)
class Mending:
    """How a family's photos are mended.

    of: the pixels of a task's view; hole: the error of one without a prediction; far: the least
    error of a region, or a photo, that is off; unit: of the numbers; least: a smaller gain is none.
    """

    of: Callable[[str, Any], PixelMending]
    hole: float
    far: float
    unit: str
    least: float


class Region(NamedTuple):
    """gain: how much lower the photo's error is with a region, or its camera, mended."""

    gain: float
    text: str


Regions = dict[Key, Region]


def photo_mended(mending: Mending, task: str, view: Any) -> Regions:
    """The worst region of one photo by what it costs, or the photo where none explains its error.

    A region is pixels that hang together and are off.
    """
    of, found = mending.of(task, view), Regions()
    errors, base = of.pixel_errors(of.predicted), of.score(of.predicted)
    if not np.isfinite(errors).any():  # what is predicted lies between the drawn pixels
        return found
    region = _worst(errors, mending.far)
    if region is not None:  # measured without it, it is found whole
        region = _worst(of.pixel_errors(of.without(region)), mending.far)
    if region is not None:
        gain = base - of.score(np.where(region[..., None], of.truth, of.without(region)))
        share = np.count_nonzero(region) / np.count_nonzero(np.isfinite(errors))
        text = f"the region {_describe_place(region)}, {share:.0%} of it, is {of.say(region)}"
        found["region", ""] = Region(gain, text)
    whole = float(np.nansum(errors)) / np.count_nonzero(np.isfinite(of.truth[..., 0]))
    most = max((one.gain for one in found.values()), default=0.0)
    if whole >= mending.far and most < _EXPLAINS * whole:
        shifted = _find_shift(of, mending.hole, view.image_wh[0] / view.size_wh[0])
        kind = "camera" if shifted else "photo"
        found[kind, ""] = shifted or Region(whole, "wrong as a whole")
    return found


def _find_shift(of: PixelMending, hole: float, scale: float) -> Region | None:
    """The shift of the whole picture that was tried and scores much better, where there is one.

    Scores are over the pixels that have a prediction. scale: photo's pixels of a drawn one.
    """

    def score(predicted: NDArray[Any]) -> float:
        n = np.count_nonzero(np.isfinite(of.truth[..., 0]))
        holes = n - np.count_nonzero(np.isfinite(predicted + of.truth)[..., 0])
        return (of.score(predicted) * n - hole * holes) / (n - holes) if n > holes else math.inf

    flat = _fill_holes(of.predicted), _fill_holes(of.truth)
    step = -(-max(flat[0].shape) // _COARSE_PX)
    thin = flat[0][::step, ::step], flat[1][::step, ::step]
    near = _alike(thin, (0, 0), [n // _REACH for n in thin[0].shape])
    down, right = _alike(flat, (step * near[0], step * near[1]), (step, step))
    moved = np.full_like(of.predicted, np.nan)
    to, source = (_overlap(flat[0].shape, (k * down, k * right)) for k in (1, -1))
    moved[to] = of.predicted[source]
    before, after = score(of.predicted), score(moved)
    if after >= _LEFT * before:
        return None
    words = f"fits better {shift_words(right, down, scale)} ({before:.3f} to {after:.3f})"
    return Region(before - after, f"{words}: turn or move the camera")


def _alike(pair: tuple[F32, F32], about: tuple[int, int], most: Sequence[int]) -> tuple[int, int]:
    """The shift of the first picture, near one, at which both vary most alike."""

    def likeness(by: tuple[int, int]) -> float:
        shape, back = pair[0].shape, (-by[0], -by[1])
        one, other = pair[0][_overlap(shape, back)], pair[1][_overlap(shape, by)]
        varied = one.std() * other.std() > 0
        return float(np.corrcoef(one.ravel(), other.ravel())[0, 1]) if varied else -1.0

    reach = [range(at - n, at + n + 1) for at, n in zip(about, most, strict=True)]
    shifts = [(down, right) for down in reach[0] for right in reach[1]]
    return max(shifts, key=lambda by: (likeness(by), -abs(by[0]) - abs(by[1])))


def _overlap(shape: tuple[int, ...], by: tuple[int, int]) -> tuple[slice, slice]:
    """The pixels that a picture still covers when it is shifted."""
    rows, cols = (slice(max(0, k), n + min(0, k)) for n, k in zip(shape, by, strict=True))
    return rows, cols


def _fill_holes(values: NDArray[Any]) -> F32:
    """The channel that varies most, without holes."""
    spread = [float(np.nanstd(values[..., k])) for k in range(values.shape[-1])]
    one = values[..., int(np.argmax(spread))].astype(np.float32)
    return np.where(np.isfinite(one), one, np.float32(np.nanmedian(one)))


def _worst(errors: NDArray[np.float64], far: float) -> Mask | None:
    """Of the pixels that are far off, those that hang together with the largest errors."""
    limit = max(far, _FAR * float(np.nanmedian(errors)))
    _, place = cv2.connectedComponents((np.nan_to_num(errors) > limit).astype(np.uint8))
    pixels = np.bincount(place.ravel())
    total = np.bincount(place.ravel(), np.nan_to_num(errors).ravel())
    total[(pixels < _SMALLEST * errors.size) | (np.arange(len(total)) == 0)] = 0.0
    worst: Mask = place == int(total.argmax())
    return worst if total.any() else None


def _describe_place(region: Mask) -> str:
    rows, cols = np.nonzero(region)
    place = 3 * int(3 * rows.mean() / region.shape[0]) + int(3 * cols.mean() / region.shape[1])
    return _THIRDS[place]


def pixel_findings(
    mending: Mending,
    metric: tuple[str, str, str],
    side: StoredEvaluation,
    regions: Mapping[int, Regions],
) -> Findings:
    """One side's holes, regions and photos. metric: the page's name, the rows' and its policy."""
    shown, name, policy = metric
    rows, summary = cast("tuple[PixelRow, ...]", side.rows), cast("PixelSummary", side.summary)
    scored = [row for row in rows if row.has_score]
    found: dict[Key, Finding] = {}
    holes = {r.image_id: r.hole_share for r in scored if r.hole_share is not UNSET and r.hole_share}
    if holes:
        share = sum(holes.values()) / len(scored)
        found["holes", ""] = Finding(
            text=f"holes: {share:.1%} of the measured pixels have nothing, each an error of "
            f"{mending.hole:g}{mending.unit}",
            gain=mending.hole * share,
            images=sorted(holes, key=lambda i: (-holes[i], i)),
        )
    files = {row.image_id: row.file_name for row in rows}
    for image, of_photo in regions.items():
        for (kind, about), (gain, text) in of_photo.items():
            found[kind, f"{image} {about}"] = Finding(
                text=f"{files[image]}: {text}", gain=gain / len(scored), images=(image,)
            )
    attempted = cast("Any", summary).all_attempted
    return Findings(
        side=side,
        metric=shown,
        over=f"the {plural(len(scored), 'image', 'images')} with a score, of {len(rows)} attempted",
        by_error=found,
        n_failed=sum(row.has_truth and not row.has_score for row in rows),
        n_attempted=sum(row.has_truth for row in rows),
        value=getattr(attempted, name)[policy],
        value_answered=summary.metrics[name][policy],
        missing=f", each counted as {getattr(attempted, f'missing_{name}'):g}{mending.unit}",
        least=mending.least,
        sign=-1,
    )


def costliest(metric: tuple[str, str], sides: Sequence[StoredEvaluation]) -> set[int]:
    """The photos that are mended: of every side, those with the largest errors."""
    name, policy = metric
    chosen: set[int] = set()
    for side in sides:
        rows = ((r.scores, r.image_id) for r in cast("tuple[PixelRow, ...]", side.rows))
        found = sorted((-scores[name][policy], image) for scores, image in rows if scores)
        chosen |= {image for _, image in found[:_PHOTOS]}
    return chosen
