"""Classes of pixels of others: a folder of PNGs, or masks of a process."""

from __future__ import annotations

from pathlib import Path
from typing import Final

import numpy as np

from legoworld.baselines.baseline_import import ImportRequest, import_images
from legoworld.baselines.family import BaselineFamily, ImportListener, ImportOptions
from legoworld.baselines.label_maps import answered_masks, map_record
from legoworld.baselines.records import AnswerRules, ResultMissingError
from legoworld.evaluation.label_maps.family import MapInvalidError
from legoworld.evaluation.label_maps.png import check_size, read_values
from legoworld.evaluation.semantic.truth import find_png
from legoworld.files import sha256_of_file
from legoworld.readouts.family import answer_file
from legoworld.readouts.label_maps import NO_CLASS
from legoworld.records.baseline_messages import Message
from legoworld.records.run_file import ImageRecord, ImageSource, ImportedFrom
from legoworld.running.image_record import initial_row
from legoworld.running.readout_run import RunResult
from legoworld.tracks.track import TrackImage


def _import(
    request: ImportRequest, source: Path, _options: ImportOptions, telling: ImportListener
) -> RunResult:
    vocabulary = request.protocol.vocabulary
    assert vocabulary is not None
    known = {category.id for category in vocabulary.categories}
    ignored = {*request.protocol.card.value("truth.ignore")}

    def answer(image: TrackImage) -> ImageRecord:
        path = find_png(source, initial_row(image))
        if path is None:
            raise ResultMissingError(
                "there is no PNG of the photo", found="nothing", expected=f"{image.scene}.png"
            )
        values = read_values(path, MapInvalidError)
        assert image.size_wh is not None
        check_size(path, values, image.size_wh[::-1], MapInvalidError)
        strange = {*np.unique(values).tolist()} - known - ignored
        if strange:
            raise MapInvalidError(
                f"{path.name} has values that are no category",
                found=str(min(strange)),
                expected=f"ids of the vocabulary, or {NO_CLASS} for none",
            )
        kept = np.where(np.isin(values, [*known]), values, NO_CLASS).astype(np.uint8)
        name, digest = path.relative_to(source).as_posix(), sha256_of_file(path)
        origin = ImageSource(source=ImportedFrom(file=name, sha256=digest))
        return map_record(image, request.run, kept, origin)

    return import_images(request, source, answer, telling)


def _record_answer(
    image: TrackImage, answer: Message, rules: AnswerRules, source: ImageSource
) -> ImageRecord:
    """Masks of one photo as classes; a later mask lies on top, pixels of none have no class."""
    assert image.size_wh is not None
    values = np.full(image.size_wh[::-1], NO_CLASS, np.uint8)
    for category_id, mask in answered_masks(image, answer, rules):
        values[mask] = category_id
    return map_record(image, rules.run, values, source)


BASELINE: Final = BaselineFamily(
    of_folder=True,
    what="a folder of PNGs of category ids, named like the photos",
    options=frozenset(),
    import_answers=_import,
    own_file=lambda row: answer_file(row.scene, ".png"),
    answered=_record_answer,
)
