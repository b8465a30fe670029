"""A case's pictures of R and A, and its points thinned for the page; colours the blind can tell."""

from __future__ import annotations

import base64
import math
from collections.abc import Mapping, Sequence
from typing import Any, Final

import cv2
import numpy as np
from numpy.typing import NDArray
from pycocotools import mask as _mask

from legoworld.errors import LegoWorldError
from legoworld.evaluation.reconstruction.dataset import BenchCase
from legoworld.evaluation.reconstruction.points import Raster
from legoworld.evaluation.reconstruction.reference import Reference
from legoworld.records.report_page import BenchObject, BenchPoints, BenchRaster
from legoworld.records.report_tables import Outcome
from legoworld.report.depth_images import NO_DEPTH, encode_depth
from legoworld.report.reconstruction_case import Codes, SeenSurface

#: Okabe and Ito's palette, by the places that report/reconstruction_case.py counts.
OUTCOMES: Final = (
    Outcome(name="nothing", text="no surface", colour="#000000"),
    Outcome(name="hit", text="hit: within the tolerance", colour="#0072b2"),
    Outcome(name="missed", text="missed: reference without submission", colour="#f0e442"),
    Outcome(name="extra", text="extra: submission without reference", colour="#d55e00"),
    Outcome(name="both", text="missed and extra: the surface stands elsewhere", colour="#cc79a7"),
    Outcome(name="outside", text="outside all scored masks: not in R", colour="#999999"),
)
#: How much of the photo below each of them is covered, of 255.
_OPACITY: Final = (0, 120, 225, 225, 225, 70)
#: Upper ends of the steps above A's tolerance, dark to light.
_STEPS: Final = (60, 120, 255)
_STEP_COLOURS: Final = ("#8c3a9c", "#e5604d", "#fde08a")
_WITHIN: Final = "#1d2733"
#: More points of one surface than this are thinned.
MOST_POINTS: Final = 26_000
_LOSSLESS: Final = 101


def error_steps(delta: int) -> tuple[Outcome, ...]:
    """The colours of A's picture: within delta, and by how much above it."""
    found = [Outcome(name="within", text=f"0 to {delta}: counts for A", colour=_WITHIN)]
    low = delta + 1
    for high, colour in zip(_STEPS, _STEP_COLOURS, strict=True):
        if high >= low:
            found.append(Outcome(name=f"to {high}", text=f"{low} to {high}", colour=colour))
            low = high + 1
    return tuple(found)


def hit_picture(surface: SeenSurface) -> bytes:
    """The outcome of every raster pixel, as WebP to lay over the reference."""
    return _encode_palette(surface.together, [o.colour for o in OUTCOMES], _OPACITY)


def error_picture(largest: Codes, delta: int) -> bytes:
    """A's (H, W) pixels by their largest channel difference, as WebP."""
    steps = error_steps(delta)
    ends = [delta, *(high for high in _STEPS if high > delta)]
    return _encode_palette(
        np.searchsorted(ends, largest).astype(np.uint8),
        [step.colour for step in steps],
        [255] * len(steps),
    )


def _encode_palette(codes: Codes, colours: Sequence[str], opacity: Sequence[int]) -> bytes:
    """Lossless WebP of a small palette."""
    palette = np.array(
        [[*bytes.fromhex(c[1:])[::-1], a] for c, a in zip(colours, opacity, strict=True)], np.uint8
    )
    done, data = cv2.imencode(".webp", palette[codes], [cv2.IMWRITE_WEBP_QUALITY, _LOSSLESS])
    if not done:
        raise LegoWorldError("a picture could not be encoded", found=f"shape {codes.shape}")
    return data.tobytes()


def drawn_objects(
    reference: Reference, case: BenchCase, ids: Mapping[str, int]
) -> list[BenchObject]:
    """The scored objects' masks. ids: of their categories."""
    found = []
    for k, scored in enumerate(case.truth.scored):
        mask = np.asfortranarray(reference.label == k, np.uint8)
        encoded_mask: Any = _mask.encode(mask)
        found.append(
            BenchObject(
                n=scored.name,
                c=ids[scored.category],
                box=tuple(int(v) for v in _mask.toBbox(encoded_mask)),
                rle=encoded_mask["counts"].decode("ascii"),
            )
        )
    return found


def drawn_points(
    reference: Reference, sides: Sequence[SeenSurface | None]
) -> tuple[BenchRaster, list[BenchPoints | None]]:
    """Points of the reference and of every side: each step-th pixel, from the first step's middle.

    The step is the smallest that leaves at most MOST_POINTS pixels.
    """
    raster = reference.raster
    step = max(1, math.ceil(math.sqrt(raster.width * raster.height / MOST_POINTS)))
    keep = np.s_[step // 2 :: step, step // 2 :: step]
    arrays = [reference.depth_z_m, *(s.depth_z_m for s in sides if s is not None)]
    thin = [np.ascontiguousarray(a[keep]) for a in arrays]
    known = np.concatenate([a[np.isfinite(a) & (a > 0)] for a in thin]).astype(np.float64)
    z0_m = float(known.min()) if len(known) else 1.0
    depth_step = float(np.log(known.max() / z0_m) / (NO_DEPTH - 1)) if len(known) else 0.0
    codes = iter(encode_depth(a, z0_m, depth_step) for a in thin)
    height, width = thin[0].shape
    grid = BenchRaster(
        size_wh=(width, height),
        step=step,
        n_raster=raster.width * raster.height,
        **_thin_intrinsics(raster, step),
        z0_m=z0_m,
        depth_step=depth_step,
        reference=next(codes),
    )
    return grid, [
        None
        if side is None
        else BenchPoints(
            submitted=next(codes),
            reference_outcome=_base64(side.reference_outcome[keep]),
            submitted_outcome=_base64(side.submitted_outcome[keep]),
        )
        for side in sides
    ]


def _thin_intrinsics(raster: Raster, step: int) -> dict[str, float]:
    """Intrinsics of the thinned grid: the same rays through the pixels that are kept."""
    offset = step // 2
    return {
        "fx": raster.fx / step,
        "fy": raster.fy / step,
        "cx": (raster.cx - offset - 0.5) / step + 0.5,
        "cy": (raster.cy - offset - 0.5) / step + 0.5,
    }


def _base64(codes: NDArray[np.uint8]) -> str:
    return base64.b64encode(np.ascontiguousarray(codes).tobytes()).decode("ascii")
