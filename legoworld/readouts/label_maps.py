"""Label maps: each pixel of a view is part of one segment, or has one category; their pictures.

Pictures have a hue for each category, things of one category in several shades.
"""

from __future__ import annotations

import colorsys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from legoworld.files import atomic_path, sha256_of_file
from legoworld.readouts.family import answer_file
from legoworld.readouts.pictures import Rgb, png_bytes
from legoworld.records.run_rows import Segment
from legoworld.records.submission import WrittenFile

if TYPE_CHECKING:
    from legoworld.scene.instances import Instance
    from legoworld.tracks.vocabulary import Category, Vocabulary
    from legoworld.visibility.view import View

#: The id of a pixel without a segment, and the category of one without a class.
VOID: Final = 0
NO_CLASS: Final = 255
#: The category, where a vocabulary has it, of all that shows nothing of another one.
BACKGROUND: Final = "background"
_STUFF: Final = -1
#: The golden ratio, and the two of the plane (Roberts, 2018).
_STEPS: Final = (0.618034, 0.569840, 0.754878)
_SHADES: Final = (1.0, 0.72, 0.86, 0.58)
_VOID_RGB: Final = (0, 0, 0)
_EDGE_RGB: Final = (255, 255, 255)
_RIGHT_RGB: Final = (70, 130, 180)
_WRONG_RGB: Final = (200, 60, 40)


@dataclass(frozen=True, kw_only=True)
class SegmentMap:
    """ids: (H, W) int32, `VOID` or a segment's id. members: instance ids of each segment.

    A segment of pixels without a hit has the number of instances among its members.
    """

    ids: NDArray[np.int32]
    segments: tuple[Segment, ...]
    members: tuple[tuple[int, ...], ...]


def segment_map(view: View, instances: Sequence[Instance], sky: Category | None) -> SegmentMap:
    """Each visible thing as a segment, and each stuff category as one.

    Ids count from 1 by category id, then by the first pixel in row order. sky: the category of
    pixels without a hit; None leaves them VOID, as unlabelled surfaces are.
    """
    shown, none = view.buffers.instance, len(instances)
    first = np.full(none + 1, shown.size, np.int64)
    first[shown.ravel()[::-1]] = np.arange(shown.size)[::-1]  # -1 is the last place
    areas, boxes = view.area_px.tolist(), view.bbox_xyxy_px.tolist()
    groups: dict[tuple[int, int], list[int]] = {}
    for one in instances:
        if one.category is not None and areas[one.id]:
            own = one.id if one.category.isthing else _STUFF
            groups.setdefault((one.category.id, own), []).append(one.id)
    rows, cols = np.nonzero(shown < 0)
    if sky is not None and len(rows):
        groups.setdefault((sky.id, _STUFF), []).append(none)
        areas.append(len(rows))
        boxes.append([cols.min(), rows.min(), cols.max() + 1, rows.max() + 1])
    ordered = sorted(groups, key=lambda key: (key[0], min(first[i] for i in groups[key])))
    number = np.full(none + 1, VOID, np.int32)
    segments = []
    for at, key in enumerate(ordered, start=1):
        members = groups[key]
        number[members] = at
        x0, y0 = (min(int(boxes[i][k]) for i in members) for k in (0, 1))
        x1, y1 = (max(int(boxes[i][k]) for i in members) for k in (2, 3))
        segments.append(
            Segment(
                id=at,
                category_id=key[0],
                area=sum(areas[i] for i in members),
                bbox=(x0, y0, x1 - x0, y1 - y0),
            )
        )
    return SegmentMap(
        ids=number[shown],
        segments=tuple(segments),
        members=tuple(tuple(groups[key]) for key in ordered),
    )


def category_map(
    view: View, instances: Sequence[Instance], vocabulary: Vocabulary, sky: Category | None
) -> NDArray[np.uint8]:
    """(H, W) uint8: the category id of what each pixel shows.

    Elsewhere the id of `background` where the vocabulary has it, `NO_CLASS` otherwise. sky: the
    category of pixels without a hit, None for none.
    """
    rest = vocabulary.match(BACKGROUND)
    ids = np.full(len(instances) + 1, NO_CLASS if rest is None else rest.id, np.uint8)
    for one in instances:
        if one.category is not None:
            ids[one.id] = one.category.id
    if sky is not None:
        ids[-1] = sky.id
    shown: NDArray[np.uint8] = ids[view.buffers.instance]
    return shown


def id_colors(ids: NDArray[Any]) -> NDArray[np.uint8]:
    """(H, W, 3) uint8 RGB of segment ids: id = R + 256 G + 65536 B."""
    colors: NDArray[np.uint8] = np.stack(
        [ids >> shift & 0xFF for shift in (0, 8, 16)], axis=-1
    ).astype(np.uint8)
    return colors


def write_map(run: Path, name: str, pixels: NDArray[np.uint8]) -> WrittenFile:
    """Write an image's PNG, (H, W, 3) or (H, W), below a run; what its row says of it."""
    file = answer_file(name, ".png")
    (run / file).parent.mkdir(parents=True, exist_ok=True)
    with atomic_path(run / file) as temporary:
        temporary.write_bytes(png_bytes(pixels))
    return WrittenFile(
        file=file, sha256=sha256_of_file(run / file), bytes=(run / file).stat().st_size
    )


def most_bytes(size_wh: tuple[int, int]) -> int:
    """Upper bound of the size of an image's PNG."""
    return 4 * size_wh[0] * size_wh[1] + 4096


def segment_picture(place: NDArray[Any], category_ids: Sequence[int]) -> Rgb:
    """Segments in their categories' hues, with white lines between them; VOID is black.

    place: (H, W), 0 for VOID, or 1 + the place of a segment's category in `category_ids`.
    """
    nth: dict[int, int] = {}
    colors: list[tuple[int, int, int]] = [_VOID_RGB]
    for number in category_ids:
        turn = nth[number] = nth.get(number, -1) + 1
        colors.append(category_color(number, _SHADES[turn % len(_SHADES)]))
    picture: Rgb = np.array(colors, np.uint8)[place]
    picture[_between(place)] = _EDGE_RGB
    return picture


def category_picture(categories: NDArray[Any]) -> Rgb:
    """(H, W, 3) of (H, W) categories: each in its hue; black where there is none."""
    colors = [category_color(number) for number in range(256)]
    colors[NO_CLASS] = _VOID_RGB
    picture: Rgb = np.array(colors, np.uint8)[categories]
    return picture


def picture_categories(picture: Rgb, category_ids: Sequence[int]) -> NDArray[np.int64]:
    """(H, W) categories of a (H, W, 3) picture of either kind: -1 where black, -2 on a line."""
    packed = picture.astype(np.int64) @ [1 << 16, 1 << 8, 1]
    known = {0: -1}
    for number in category_ids:
        for r, g, b in (category_color(number, shade) for shade in _SHADES):
            known[r << 16 | g << 8 | b] = number
    colors, numbers = (np.array(of, np.int64) for of in zip(*sorted(known.items()), strict=True))
    place = np.minimum(np.searchsorted(colors, packed), len(colors) - 1)
    return np.where(colors[place] == packed, numbers[place], -2)


def agreement_picture(truth: NDArray[Any], answer: NDArray[Any], counted: NDArray[np.bool_]) -> Rgb:
    """Blue where two (H, W) maps of categories agree, red where not, black where not counted."""
    colors = np.array([_VOID_RGB, _WRONG_RGB, _RIGHT_RGB], np.uint8)
    picture: Rgb = colors[np.where(counted, np.where(truth == answer, 2, 1), 0)]
    return picture


def category_color(number: int, shade: float = 1.0) -> tuple[int, int, int]:
    """A category's colour: neighbouring ids, and ids of one hue, differ in the other two parts."""
    hue, saturation, value = (number * step % 1.0 for step in _STEPS)
    r, g, b = colorsys.hsv_to_rgb(hue, 0.45 + 0.45 * saturation, (0.6 + 0.4 * value) * shade)
    return round(r * 255), round(g * 255), round(b * 255)


def _between(numbers: NDArray[Any]) -> NDArray[np.bool_]:
    """Pixels whose right or lower neighbour is of another segment."""
    edges = np.zeros(numbers.shape, bool)
    edges[:, :-1] |= numbers[:, 1:] != numbers[:, :-1]
    edges[:-1] |= numbers[1:] != numbers[:-1]
    return edges
