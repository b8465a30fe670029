"""What single regions of an array cost: each is given its truth, and the photo is scored again."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final, Protocol, cast

import cv2
import numpy as np
from numpy.typing import NDArray

from legoworld.evaluation.stored import StoredEvaluation
from legoworld.pluralize import plural
from legoworld.records.base import UNSET
from legoworld.records.pixels import PixelRow, PixelSummary
from legoworld.report.costs import Finding, Findings, Key
from legoworld.report.scene_objects import Objects
from legoworld.report.tried import shift_words

Mask = NDArray[np.bool_]
F32 = NDArray[np.float32]
Regions = dict[Key, "Region"]
#: So many photos of the largest errors are mended; a region is at least such a share of one.
_PHOTOS: Final = 20
_REGIONS: Final = 6
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
_THIRDS: Final = (("upper left", "at the top", "upper right"),
                  ("on the left", "in the middle", "on the right"),
                  ("lower left", "at the bottom", "lower right"))  # fmt: skip


class PixelMending(Protocol):
    """The drawn pixels of a photo. errors: (H, W) of what is predicted, NaN elsewhere.

    truth, predicted: (H, W, C), NaN where there is none.
    """

    truth: NDArray[Any]
    predicted: NDArray[Any]
    errors: NDArray[np.float64]

    def score(self, predicted: NDArray[Any]) -> float:
        """The metric of this photo with other predictions, by its family's own measuring."""
        ...

    def without(self, region: Mask) -> NDArray[Any]:
        """The predictions as they are measured where a region has no say in it."""
        ...

    def errors_of(self, predicted: NDArray[Any]) -> NDArray[np.float64]:
        """(H, W) of other predictions."""
        ...

    def say(self, region: Mask) -> str:
        """How a region differs from the truth, in words."""
        ...


@dataclass(frozen=True, kw_only=True)
class Mending:
    """How a family's photos are mended.

    of: a photo's pixels, of a task's view of it; hole: the error of a pixel without a prediction;
    far: the least error of a region that is off; unit: of the numbers; least: a smaller gain is
    none.
    """

    of: Callable[[str, Any], PixelMending]
    hole: float
    far: float
    unit: str
    least: float


@dataclass(frozen=True, kw_only=True)
class Region:
    """gain: how much lower the photo's error is with a region, or its camera, mended."""

    gain: float
    text: str


def photo_mended(mending: Mending, task: str, view: Any, objects: Objects | None) -> Regions:
    """The regions of one photo by what they cost, or the photo as a whole where none explains it.

    A region is an object where they are known, else pixels that hang together and are off. Keys are
    without the photo's id.
    """
    of = mending.of(task, view)
    base = of.score(of.predicted)
    found: Regions = {}
    for name, region in _regions(of, mending.far, objects):
        gain = base - of.score(np.where(region[..., None], of.truth, of.without(region)))
        share = np.count_nonzero(region) / np.count_nonzero(np.isfinite(of.errors))
        where = name or f"the region {_where(region)}"
        found["region", name] = Region(
            gain=gain, text=f"{where}, {share:.0%} of it, is {of.say(region)}"
        )
    whole = float(np.nansum(of.errors)) / np.count_nonzero(np.isfinite(of.truth[..., 0]))
    if max((one.gain for one in found.values()), default=0.0) >= _EXPLAINS * whole:
        return found
    shifted = shift(of, mending.hole)
    if shifted is None:
        return {**found, ("photo", ""): Region(gain=whole, text="wrong as a whole")}
    x, y, before, after = shifted
    words = f"fits better {shift_words(x, y, view.image_wh[0] / view.size_wh[0])}"
    return {
        **found,
        ("camera", ""): Region(
            gain=before - after,
            text=f"{words} ({before:.3f} to {after:.3f}): turn or move the camera",
        ),
    }


def shift(of: PixelMending, hole: float) -> tuple[int, int, float, float] | None:
    """The shift right and down that was tried and scores much better; scores before and after.

    Both are over the pixels that have a prediction.
    """

    def score(predicted: NDArray[Any]) -> float:
        n = np.count_nonzero(np.isfinite(of.truth[..., 0]))
        holes = n - np.count_nonzero(np.isfinite(predicted + of.truth)[..., 0])
        return (of.score(predicted) * n - hole * holes) / (n - holes) if n > holes else math.inf

    flat = _filled(of.predicted), _filled(of.truth)
    step = -(-max(flat[0].shape) // _COARSE_PX)
    thin = flat[0][::step, ::step], flat[1][::step, ::step]
    most = [n // _REACH for n in thin[0].shape]
    down, right = (step * n for n in _alike(thin, (0, 0), most))
    down, right = _alike(flat, (down, right), (step, step))
    height, width = flat[0].shape
    moved = np.full_like(of.predicted, np.nan)
    to, source = (_overlap((height, width), (sign * down, sign * right)) for sign in (1, -1))
    moved[to] = of.predicted[source]
    before, after = score(of.predicted), score(moved)
    return (right, down, before, after) if after < _LEFT * before else None


def _alike(pair: tuple[F32, F32], about: tuple[int, int], most: Sequence[int]) -> tuple[int, int]:
    """The shift of the first picture, near one, at which both vary most alike."""

    def likeness(by: tuple[int, int]) -> float:
        shape, back = pair[0].shape, (-by[0], -by[1])
        one, other = pair[0][_overlap(shape, back)], pair[1][_overlap(shape, by)]
        return (
            float(np.corrcoef(one.ravel(), other.ravel())[0, 1])
            if one.std() * other.std() > 0
            else -1.0
        )

    reach = [range(at - n, at + n + 1) for at, n in zip(about, most, strict=True)]
    shifts = [(down, right) for down in reach[0] for right in reach[1]]
    return max(shifts, key=lambda by: (likeness(by), -abs(by[0]) - abs(by[1])))


def _overlap(shape: tuple[int, ...], by: tuple[int, int]) -> tuple[slice, slice]:
    """The pixels that a picture still covers when it is shifted."""
    rows, cols = (slice(max(0, k), n + min(0, k)) for n, k in zip(shape, by, strict=True))
    return rows, cols


def _filled(values: NDArray[Any]) -> F32:
    """The channel that varies most, without holes."""
    spread = [float(np.nanstd(values[..., k])) for k in range(values.shape[-1])]
    one = values[..., int(np.argmax(spread))].astype(np.float32)
    return np.where(np.isfinite(one), one, np.float32(np.nanmedian(one)))


def _regions(of: PixelMending, far: float, objects: Objects | None) -> Iterator[tuple[str, Mask]]:
    """The regions of a photo with the most error, each with its name."""
    if objects is not None:
        yield from _largest(of.errors, *objects, most=_REGIONS)
        return
    off = list(_largest(of.errors, *_off(of.errors, far), most=1))
    if off:  # measured without it, it is found whole
        errors = of.errors_of(of.without(off[0][1]))
        yield from _largest(errors, *_off(errors, far), most=1)


def _off(errors: NDArray[np.float64], far: float) -> Objects:
    """Pixels that hang together and are far off, without names."""
    limit = max(far, _FAR * float(np.nanmedian(errors)))
    n, place = cv2.connectedComponents((np.nan_to_num(errors) > limit).astype(np.uint8))
    return ("",) * (n - 1), place.astype(np.int64) - 1


def _largest(
    errors: NDArray[np.float64], names: Sequence[str], labels: NDArray[np.int64], most: int
) -> Iterator[tuple[str, Mask]]:
    known = np.isfinite(errors) & (labels >= 0)
    pixels = np.bincount(labels[known], minlength=len(names))
    total = np.bincount(labels[known], errors[known], minlength=len(names))
    large = pixels >= _SMALLEST * errors.size
    for k in np.argsort(-np.where(large, total, 0.0), kind="stable")[:most]:
        if large[k]:
            yield names[k], known & (labels == k)


def _where(region: Mask) -> str:
    rows, cols = np.nonzero(region)
    high, wide = region.shape
    return _THIRDS[int(3 * rows.mean() / high)][int(3 * cols.mean() / wide)]


def pixel_findings(
    mending: Mending,
    metric: tuple[str, str, str],
    side: StoredEvaluation,
    regions: Mapping[int, Regions],
) -> Findings:
    """One side's holes, regions and photos. metric: the page's name, the rows' and its policy."""
    shown, name, policy = metric
    rows = cast("tuple[PixelRow, ...]", side.rows)
    summary = cast("PixelSummary", side.summary)
    scored = [row for row in rows if row.has_score]
    failed = [row.image_id for row in rows if row.has_truth and not row.has_score]
    n_truth = sum(row.has_truth for row in rows)
    found: dict[Key, Finding] = {}
    holes = {r.image_id: r.hole_share for r in scored if r.hole_share is not UNSET and r.hole_share}
    if holes:
        share = sum(holes.values()) / len(scored)
        worst = sorted(holes, key=lambda i: (-holes[i], i))
        found["holes", ""] = Finding(
            text=f"holes: {share:.1%} of the measured pixels have nothing, each an error of "
            f"{mending.hole:g}{mending.unit}",
            gain=mending.hole * share,
            images=worst,
        )
    files = {row.image_id: row.file_name for row in rows}
    for image, of_photo in regions.items():
        for (kind, about), region in of_photo.items():
            found[kind, f"{image} {about}"] = Finding(
                text=f"{files[image]}: {region.text}",
                gain=region.gain / len(scored),
                images=(image,),
            )
    attempted: Any = getattr(summary, "all_attempted", None)
    return Findings(
        label=side.name,
        metric=shown,
        over=f"the {plural(len(scored), 'image', 'images')} with a score, of {len(rows)} attempted",
        found=found,
        attempted=n_truth,
        noun="scene" if side.is_scene else "answer",
        failed=failed,
        value=getattr(attempted, name)[policy],
        answered=summary.metrics[name][policy],
        missing=f", each counted as {getattr(attempted, f'missing_{name}'):g}{mending.unit}",
        least=mending.least,
        sign=-1,
    )


def costliest(metric: tuple[str, str], sides: Sequence[StoredEvaluation]) -> set[int]:
    """The photos that are mended: of every side, those with the largest errors."""
    name, policy = metric
    chosen: set[int] = set()
    for side in sides:
        rows = [row for row in cast("tuple[PixelRow, ...]", side.rows) if row.scores]
        rows.sort(key=lambda r: (-(r.scores or {})[name][policy], r.image_id))
        chosen |= {row.image_id for row in rows[:_PHOTOS]}
    return chosen
