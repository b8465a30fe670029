"""Visualisations: instances drawn over the photo, and colour-coded depth."""

from __future__ import annotations

import colorsys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from legoworld.conventions import NO_INSTANCE
from legoworld.errors import LegoWorldError
from legoworld.files import atomic_path, open_regular
from legoworld.records.scene_folder import InstanceRow
from legoworld.scene.pictures import FORMATS, MOST_PHOTO_PX, decoded_picture
from legoworld.visibility.cuboids import EDGES

#: ColorBrewer's Spectral, 11 classes, near to far, as RGB.
_SPECTRAL: Final = np.array(
    [
        (158, 1, 66), (213, 62, 79), (244, 109, 67), (253, 174, 97), (254, 224, 139),
        (255, 255, 191), (230, 245, 152), (171, 221, 164), (102, 194, 165), (50, 136, 189),
        (94, 79, 162),
    ],
    np.float64,
)  # fmt: skip
_NO_DEPTH_RGB: Final = (40, 40, 40)
_FONT: Final = cv2.FONT_HERSHEY_SIMPLEX
_INK: Final = (0, 0, 0)  # on `_color`, of which all are bright

#: What a pixel shows, besides 0: nothing that is listed.
_LABELLED, _UNLABELLED = 1, 2
_BAND_ROWS: Final = 128

Rgb = NDArray[np.uint8]
Mask = NDArray[np.bool_]


def read_photo(path: Path, *, most_px: int = MOST_PHOTO_PX, name: str = "") -> Rgb:
    """(H, W, 3) uint8 RGB, stored orientation (EXIF rotation is not applied).

    LegoWorldError if it is no picture or claims more than `most_px` pixels. name: in the error, by
    default the path.
    """
    name = name or str(path)
    with open_regular(path) as stream:
        data = stream.read()
    picture = decoded_picture(data, color=True, most_px=most_px, name=name)
    if picture is None:
        raise LegoWorldError(
            f"{name} is not an image", found="a file that does not decode", expected=FORMATS
        )
    return np.ascontiguousarray(picture[:, :, ::-1], np.uint8)


def write_png(path: Path, picture: Rgb) -> None:
    """Write (H, W, 3) RGB."""
    data = png_bytes(picture)
    with atomic_path(path) as temporary:
        temporary.write_bytes(data)


def png_bytes(picture: Rgb) -> bytes:
    """A PNG of (H, W, 3) RGB, or of (H, W) grey. LegoWorldError where it cannot be made."""
    pixels = picture[:, :, ::-1] if picture.ndim == 3 else picture
    done, data = cv2.imencode(".png", np.ascontiguousarray(pixels))
    if not done:
        raise LegoWorldError("an image could not be encoded", found=f"shape {picture.shape}")
    return data.tobytes()


def depth_picture(depth_z_m: NDArray[np.float32]) -> Rgb:
    """Inverse depth between its 2nd and 98th percentile in Spectral colours, near is red.

    (H, W) to (H, W, 3). Pixels without depth are dark grey, a colour outside the map.
    """
    finite = np.isfinite(depth_z_m) & (depth_z_m > 0)
    picture: Rgb = np.full((*depth_z_m.shape, 3), _NO_DEPTH_RGB, np.uint8)
    if not finite.any():
        return picture
    inverse = 1.0 / depth_z_m[finite].astype(np.float64)
    low, high = np.percentile(inverse, (2, 98))
    share = np.clip((high - inverse) / max(high - low, 1e-12), 0, 1) * (len(_SPECTRAL) - 1)
    channels = [np.interp(share, range(len(_SPECTRAL)), _SPECTRAL[:, c]) for c in range(3)]
    picture[finite] = np.rint(np.stack(channels, 1)).astype(np.uint8)
    return picture


def instance_picture(instance: NDArray[np.int32]) -> Rgb:
    """(H, W) indices to (H, W, 3): a colour each on black, used when there is no photo."""
    n = int(instance.max()) + 1
    colors = np.array([_color(i) for i in range(max(n, 1))] + [(0, 0, 0)], np.uint8)
    return np.ascontiguousarray(colors[instance] // 2, np.uint8)


def overlay(ground: Rgb, instance: NDArray[np.int32], entries: Sequence[InstanceRow]) -> Rgb:
    """Outlines, boxes and names over a photo (H, W, 3) of the size of (H, W) indices.

    entries: rows of instances.json; labelled ones get a box and a name, others a thin outline.
    """
    picture = ground.copy()
    shown = [e for e in entries if e.area_px > 0]
    labelled = sorted((e for e in shown if e.category), key=lambda e: -e.area_px)
    _tint(picture, instance, shown)
    for entry in labelled:
        _draw_box(picture, entry)
    return picture


def amodal_overlay(ground: Rgb, masks: Mapping[int, tuple[Mask, Mask]]) -> Rgb:
    """Outlines of amodal masks over a photo of the same size, what is hidden of them hatched.

    masks: by instance id, amodal and visible, (H, W) each.
    """
    picture = ground.copy()
    y, x = np.indices(picture.shape[:2])
    hatching = (x + y) % 8 < 3
    for ident, (amodal, visible) in masks.items():
        picture[amodal & ~visible & hatching] = _color(ident)
        edges, _ = cv2.findContours(amodal.astype(np.uint8), cv2.RETR_LIST, cv2.CHAIN_APPROX_NONE)
        cv2.drawContours(picture, edges, -1, _color(ident), 2)
    return picture


def boxes_overlay(ground: Rgb, lines: Mapping[int, Sequence[Sequence[float]]]) -> Rgb:
    """Edges of boxes in space over an (H, W, 3) photo. lines: x, y, x, y by instance id."""
    picture = ground.copy()
    for ident, edges in lines.items():
        _draw_lines(picture, edges, _color(ident))
    return picture


def plan_picture(corners: Mapping[int, NDArray[np.float64]], side_px: int) -> Rgb:
    """Boxes from above: the camera at the middle of the lower edge, its axis upwards.

    corners: (8, 3) in the camera frame by instance id. What is behind the camera is left out.
    """
    picture = np.full((side_px, side_px, 3), 255, np.uint8)
    shown = {i: c[:, [0, 2]] for i, c in corners.items() if c[:, 2].max() > 0}
    reach = max((float(np.abs(p * [2, 1]).max()) for p in shown.values()), default=1.0)
    scale = side_px / (1.05 * max(reach, 1e-6))
    for ident, points in shown.items():
        x, y = side_px / 2 + points[:, 0] * scale, side_px - points[:, 1] * scale
        lines = [[x[a], y[a], x[b], y[b]] for a, b in EDGES]
        _draw_lines(picture, lines, _color(ident))
    cv2.circle(picture, (side_px // 2, side_px - 1), 4, (0, 0, 0), -1)
    return picture


def _draw_lines(picture: Rgb, lines: Sequence[Sequence[float]], color: tuple[int, ...]) -> None:
    """Lines that may leave the picture far away."""
    height, width = picture.shape[:2]
    for line in np.clip(np.array(lines, np.float64).reshape(-1, 4), -1e6, 1e6):
        x0, y0, x1, y1 = np.rint(line).astype(int).tolist()
        inside, start, end = cv2.clipLine((0, 0, width, height), (x0, y0), (x1, y1))
        if inside:
            cv2.line(picture, start, end, color, 2, cv2.LINE_AA)


def _tint(picture: Rgb, instance: NDArray[np.int32], shown: Sequence[InstanceRow]) -> None:
    """Colour each pixel by its instance, in place: one pass, whatever the number of instances."""
    n = max([int(instance.max()), *(e.id for e in shown)], default=-1) + 1
    kind = np.zeros(n + 1, np.uint8)  # the last one is NO_INSTANCE's
    colors = np.zeros((n + 1, 3), np.int64)
    for entry in shown:
        kind[entry.id] = _LABELLED if entry.category else _UNLABELLED
        colors[entry.id] = _color(entry.id)
    edges = _edges(instance)
    for top in range(0, len(picture), _BAND_ROWS):
        band = slice(top, top + _BAND_ROWS)
        ids, rows, edge = instance[band], picture[band], edges[band]
        kinds = kind[ids]
        faint = edge & (kinds == _UNLABELLED)
        rows[faint] = (rows[faint] // 2) + 64
        inside = kinds == _LABELLED
        rows[inside] = (rows[inside] * 0.72 + colors[ids[inside]] * 0.28).astype(np.uint8)
        outline = edge & inside
        rows[outline] = colors[ids[outline]]


def _draw_box(picture: Rgb, entry: InstanceRow) -> None:
    x, y, w, h = entry.bbox_xywh_px
    color = _color(entry.id)
    cv2.rectangle(picture, (x, y), (x + w - 1, y + h - 1), color, 1)
    text = f"{entry.id} {entry.category}"
    (width, height), base = cv2.getTextSize(text, _FONT, 0.4, 1)
    left = min(x, max(0, picture.shape[1] - width - 2))
    top = y if y + height + base < picture.shape[0] else picture.shape[0] - height - base - 2
    cv2.rectangle(picture, (left, top), (left + width + 2, top + height + base), color, -1)
    cv2.putText(picture, text, (left + 1, top + height), _FONT, 0.4, _INK, 1, cv2.LINE_AA)


def _edges(instance: NDArray[np.int32]) -> NDArray[np.bool_]:
    """Pixels with a different id to the right, left, above or below."""
    edges = np.zeros(instance.shape, bool)
    across = instance[:, 1:] != instance[:, :-1]
    down = instance[1:] != instance[:-1]
    edges[:, 1:] |= across
    edges[:, :-1] |= across
    edges[1:] |= down
    edges[:-1] |= down
    edges &= instance != NO_INSTANCE
    return edges


def _color(number: int) -> tuple[int, int, int]:
    """Distinct colours by golden-ratio steps of hue."""
    r, g, b = colorsys.hsv_to_rgb((0.08 + number * 0.618034) % 1.0, 0.75, 1.0)
    return round(r * 255), round(g * 255), round(b * 255)
