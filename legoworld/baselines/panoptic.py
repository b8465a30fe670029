"""Panoptic segments of others: panopticapi's JSON and PNGs, or masks of a process."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from legoworld.baselines.baseline_import import ImportRequest, import_images
from legoworld.baselines.family import BaselineFamily, ImportListener, ImportOptions
from legoworld.baselines.label_maps import answered_masks, map_record
from legoworld.baselines.records import AnswerInvalidError, AnswerRules, ResultMissingError
from legoworld.errors import CatalogError, UsageError, cause
from legoworld.evaluation.label_maps.family import MapInvalidError
from legoworld.evaluation.label_maps.png import check_size, read_ids
from legoworld.evaluation.panoptic.family import check_answer
from legoworld.evaluation.panoptic.truth import check_listed
from legoworld.files import names_a_file, sha256_of_file
from legoworld.readouts.family import answer_file
from legoworld.readouts.label_maps import id_colors
from legoworld.records.base import RecordError, decode, find_repeated
from legoworld.records.baseline_messages import Message
from legoworld.records.coco_file import PanopticAnnotation, PanopticAnswers
from legoworld.records.run_file import ImageRecord, ImageSource, ImportedFrom
from legoworld.records.run_rows import Segment
from legoworld.running.readout_run import RunResult
from legoworld.tracks.track import TrackImage
from legoworld.visibility.runs import instance_extents


def _import(
    request: ImportRequest, source: Path, _options: ImportOptions, telling: ImportListener
) -> RunResult:
    by_image, folder = _answers(request, source), source.with_suffix("")
    vocabulary = request.protocol.vocabulary
    assert vocabulary is not None
    known = tuple(category.id for category in vocabulary.categories)

    def answer(image: TrackImage) -> ImageRecord:
        entry = by_image.get(image.id)
        path = folder / (entry.file_name if entry else "")
        if entry is None or not names_a_file(path):
            found = f"no {folder.name}/{entry.file_name}" if entry else "no annotation"
            raise ResultMissingError("no segments for this photo", found=found)
        assert image.size_wh is not None
        check_listed(entry, {*known}, MapInvalidError)
        ids = read_ids(path, MapInvalidError)
        check_size(path, ids, image.size_wh[::-1], MapInvalidError)
        place = check_answer(ids, entry.segments_info, known, entry.file_name)
        listed = sorted(entry.segments_info, key=lambda segment: segment.id)
        segments = segments_at(place, [(s.id, s.category_id) for s in listed])
        digest = sha256_of_file(path)
        origin = ImageSource(source=ImportedFrom(file=entry.file_name, sha256=digest))
        return map_record(image, request.run, id_colors(ids), origin, segments)

    return import_images(request, source, answer, telling)


def _answers(request: ImportRequest, source: Path) -> dict[int, PanopticAnnotation]:
    """The annotations by image id. CatalogError for another file, UsageError for other images."""
    try:
        entries = decode(PanopticAnswers, source.read_bytes()).annotations
        if twice := find_repeated([entry.image_id for entry in entries]):
            raise RecordError(f"image {twice[0]} twice")
    except (OSError, RecordError) as error:
        raise CatalogError(
            f"{source.name} cannot be imported",
            found=cause(error),
            expected="JSON with annotations of image_id, file_name and segments_info",
        ) from error
    strangers = {entry.image_id for entry in entries} - {i.id for i in request.track.images}
    if strangers and not request.subset:
        raise UsageError(
            "the results cover images that the track does not have",
            found=f"image {min(strangers)}",
            expected="images of the track",
            next_step="pass --subset to leave them out",
        )
    return {entry.image_id: entry for entry in entries}


def segments_at(place: NDArray[Any], listed: list[tuple[int, int]]) -> tuple[Segment, ...]:
    """Segments with areas and boxes. place: 0, or 1 + a position in `listed` of (id, category)."""
    areas, boxes = instance_extents((place - 1).astype(np.int32), len(listed))
    return tuple(
        Segment(id=number, category_id=category_id, area=area, bbox=(x0, y0, x1 - x0, y1 - y0))
        for (number, category_id), area, (x0, y0, x1, y1) in zip(
            listed, areas.tolist(), boxes.tolist(), strict=True
        )
    )


def _record_answer(
    image: TrackImage, answer: Message, rules: AnswerRules, source: ImageSource
) -> ImageRecord:
    """Masks of one photo as segments, which must not overlap; masks of one stuff category are one.

    Ids count from 1 in their order.
    """
    assert image.size_wh is not None
    assert rules.vocabulary is not None
    ids = np.zeros(image.size_wh[::-1], np.int64)
    listed: list[tuple[int, int]] = []
    stuff = {category.id: 0 for category in rules.vocabulary.categories if not category.isthing}
    for category_id, mask in answered_masks(image, answer, rules):
        number = stuff.get(category_id) or len(listed) + 1
        if ids[mask].any():
            raise AnswerInvalidError("two segments overlap", found=f"segment {number}")
        ids[mask] = number
        if number > len(listed):
            listed.append((number, category_id))
        if category_id in stuff:
            stuff[category_id] = number
    return map_record(image, rules.run, id_colors(ids), source, segments_at(ids, listed))


BASELINE: Final = BaselineFamily(
    of_folder=False,
    what="panopticapi's JSON, with the folder of its name beside it",
    options=frozenset({"subset"}),
    import_answers=_import,
    own_file=lambda row: answer_file(row.scene, ".png"),
    answered=_record_answer,
)
