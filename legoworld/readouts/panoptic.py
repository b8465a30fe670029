"""Panoptic segments: a PNG of ids for each photo, and one JSON file of all segments."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Final

import numpy as np
from msgspec.structs import replace

from legoworld.files import Json, canonical_json, write_text
from legoworld.readouts.family import ANSWERS, AnsweredImage, ReadoutFamily
from legoworld.readouts.label_maps import (
    VOID,
    SegmentMap,
    id_colors,
    most_bytes,
    segment_map,
    segment_picture,
    write_map,
)
from legoworld.readouts.pictures import Rgb
from legoworld.records.base import as_json
from legoworld.records.run_rows import Exported, RunRow


def _map(image: AnsweredImage) -> SegmentMap:
    return segment_map(image.view, image.instances, image.sky)


def _write(row: RunRow, image: AnsweredImage) -> RunRow:
    made = _map(image)
    return replace(
        row,
        answer=write_map(image.run, image.name, id_colors(made.ids)),
        segments=made.segments,
        exported=tuple(_describe_segment(image, made, at) for at in range(len(made.segments))),
        warnings=(*row.warnings, *_notes(image)),
    )


def _describe_segment(image: AnsweredImage, made: SegmentMap, at: int) -> Exported:
    """A thing by its own name, stuff by its category's, with the objects of all its members."""
    assert image.vocabulary is not None
    category = image.vocabulary.category_name(made.segments[at].category_id)
    members = [image.instances[i] for i in made.members[at] if i < len(image.instances)]
    objects = sorted({name for one in members for name in one.objects})
    things = len(members) == 1 and members[0].category and members[0].category.isthing
    return Exported(
        name=members[0].name if things else category, category=category, objects=tuple(objects)
    )


def _notes(image: AnsweredImage) -> list[str]:
    """What is missing of a scene whose labels name things alone."""
    categories = image.vocabulary.categories if image.vocabulary else ()
    stuff = {category.id for category in categories if not category.isthing}
    seen = {i.category.id for i in image.instances if i.category and image.view.area_px[i.id]}
    if not stuff or not seen or stuff & seen or (image.sky and image.sky.id in stuff):
        return []
    return ["things only: no visible stuff has a label, so walls, floor and sky are VOID"]


def write_segments_file(run: Path, rows: Sequence[RunRow]) -> None:
    """Write the JSON that panopticapi reads; an image without a result is all VOID.

    Its folder of PNGs has the file's name, so the official script needs no option.
    """
    entries: list[Json] = []
    for row in sorted(rows, key=lambda row: row.image_id):
        file = row.answer or None
        if file is None and row.size_wh:
            width, height = row.size_wh
            file = write_map(run, row.scene, id_colors(np.full((height, width), VOID, np.int32)))
        if file is not None:
            segments: list[Json] = [as_json(segment) for segment in row.segments or ()]
            name = Path(file.file).relative_to(Path(ANSWERS).stem).as_posix()
            entries.append({"image_id": row.image_id, "file_name": name, "segments_info": segments})
    write_text(run / ANSWERS, canonical_json({"annotations": entries}) + "\n")


def _picture(image: AnsweredImage) -> Rgb:
    made = _map(image)
    return segment_picture(made.ids, [segment.category_id for segment in made.segments])


READOUT: Final = ReadoutFamily(
    write=_write,
    complete=write_segments_file,
    file_bytes=most_bytes,
    picture=_picture,
    notes=_notes,
)
