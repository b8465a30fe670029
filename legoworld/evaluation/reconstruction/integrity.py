"""What a person should look at: a picture where geometry was asked for. No score changes."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from legoworld.evaluation.reconstruction.appearance import Picture, resize_picture
from legoworld.evaluation.reconstruction.points import Flags
from legoworld.records.reconstruction import Flag, FlagKind
from legoworld.records.submission import ImageTexture, Integrity

#: One of these is enough for a flag.
_ANY: Final = 1
_FLAT: Final = 1e-9


@dataclass(frozen=True, kw_only=True)
class FlagThresholds:
    """From which measurement on something is flagged, as the card's [integrity] declares.

    picture_correlation: of an image in the scene with the reference; plane_hits_share: of A's hits
    on planes turned to the camera; high_a with R below low_r: a picture without its geometry;
    view_drop: how far A may fall from a family's first view to another one.
    """

    picture_correlation: float
    plane_hits_share: float
    high_a: float
    low_r: float
    view_drop: float


def scene_flags(
    facts: Integrity,
    thumbnails: NDArray[np.uint8],
    reference: Picture | None,
    thresholds: FlagThresholds,
) -> list[Flag]:
    """Flags of what the opened scene holds. thumbnails: (N, h, w, 3), reference: (H, W, 3)."""
    flags: list[Flag] = []
    if len(thumbnails) and reference is not None:
        small = resize_picture(reference, (thumbnails.shape[2], thumbnails.shape[1]))
        for image in facts.images:
            if image.thumbnail is None or image.thumbnail >= len(thumbnails):
                continue
            measured = correlation(thumbnails[image.thumbnail], small)
            if measured >= thresholds.picture_correlation:
                flags.append(_picture_flag(image, measured, thresholds))
    if facts.compositor_nodes:
        nodes = ", ".join(facts.compositor_nodes[:5])
        flags.append(make_flag("compositor_nodes", nodes, len(facts.compositor_nodes), _ANY))
    if facts.texts:
        names = ", ".join(text.name for text in facts.texts[:5])
        flags.append(make_flag("text_blocks", names, len(facts.texts), _ANY))
    if facts.drivers:
        flags.append(make_flag("drivers", "drivers in the scene", facts.drivers, _ANY))
    return flags


def correlation(a: Picture, b: Picture) -> float:
    """Pearson's r of two pictures of one size over pixels and channels, mirrored or not.

    Both (H, W, 3). A mirrored picture on a wall is as much a picture: the largest over both
    directions. 0 where one of them is flat.
    """
    y = b.astype(np.float64).ravel()
    y -= y.mean()
    found = 0.0
    for picture in (a, a[:, ::-1], a[::-1], a[::-1, ::-1]):
        x = picture.astype(np.float64).ravel()
        x -= x.mean()
        scale = float(np.sqrt(np.dot(x, x) * np.dot(y, y)))
        if scale > _FLAT:
            found = max(found, float(np.dot(x, y)) / scale)
    return found


def scale_flags(
    facts: Integrity,
    thumbnails: NDArray[np.uint8],
    reference: Picture,
    scales: Sequence[tuple[tuple[int, int], float]],
) -> Iterator[Flag]:
    """Images that are the reference or its negative, in whatever detail: |r| at several sizes.

    thumbnails: (N, h, w, 3), reference: (H, W, 3).
    """
    for image in facts.images:
        if image.thumbnail is None or image.thumbnail >= len(thumbnails):
            continue
        shown, most = thumbnails[image.thumbnail], (0.0, 0.0, "")
        for size_wh, threshold in scales:
            small = resize_picture(reference, size_wh)
            measured = _either_sign(resize_picture(shown, size_wh), small)
            if measured >= threshold:
                most = max(most, (measured, threshold, "{}x{}".format(*size_wh)))
        if most[1]:
            used = ", ".join(image.users) or "nothing"
            what = f"{image.name}, used by {used}, at {most[2]}"
            yield make_flag("picture_like_reference", what, most[0], most[1])


def _either_sign(a: Picture, b: Picture) -> float:
    return max(correlation(a, b), correlation(np.invert(a), b))


def plane_flags(
    facts: Integrity, plane: NDArray[Any], hits: Flags, thresholds: FlagThresholds
) -> Iterator[Flag]:
    """plane: (H, W) index of the camera-facing plane a pixel of A shows, -1; hits: A's."""
    total = int(np.count_nonzero(hits))
    shown = plane[hits]
    counts = np.bincount(shown[shown >= 0], minlength=len(facts.planes))
    if not total or not counts.any():
        return
    share = float(counts.sum()) / total
    if share >= thresholds.plane_hits_share:
        most = int(np.argmax(counts))
        name = facts.planes[most].object if most < len(facts.planes) else "a plane"
        yield make_flag("camera_facing_planes", f"{name} first of {np.count_nonzero(counts)}",
                    share, thresholds.plane_hits_share)  # fmt: skip


def score_flags(r: float, a: float, thresholds: FlagThresholds) -> Iterator[Flag]:
    """A picture that agrees over geometry that does not."""
    if a >= thresholds.high_a and r < thresholds.low_r:
        yield make_flag("appearance_without_geometry", f"R {r:.3f}", a, thresholds.high_a)


def view_drop(first_a: float, other_a: float, thresholds: FlagThresholds) -> Flag | None:
    """A of another view of one family and tier against the first one's."""
    drop = first_a - other_a
    if drop < thresholds.view_drop:
        return None
    return make_flag("view_drop", f"A {first_a:.3f} in the first view", drop, thresholds.view_drop)


def _picture_flag(image: ImageTexture, measured: float, thresholds: FlagThresholds) -> Flag:
    kind: FlagKind = "picture_in_world" if "world" in image.users else "picture_in_scene"
    what = f"{image.name}, used by {', '.join(image.users) or 'nothing'}"
    return make_flag(kind, what, measured, thresholds.picture_correlation)


def make_flag(kind: FlagKind, what: str, measured: float, threshold: float) -> Flag:
    """A flag with its measurement."""
    return Flag(
        kind=kind,
        what=what,
        measured=float(measured),
        threshold=float(threshold),
    )
