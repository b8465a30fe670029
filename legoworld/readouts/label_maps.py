"""Label maps: each pixel of a view is part of one segment, or has one category."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from legoworld.files import atomic_path, sha256_of_file
from legoworld.readouts.family import answer_file
from legoworld.readouts.pictures import png_bytes
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
