"""Counts of others: one JSON file, {file name: {category id: count}}."""

import json
from collections import Counter

from msgspec.structs import replace

from legoworld.baselines.baseline_import import import_images
from legoworld.baselines.family import BaselineFamily
from legoworld.errors import CatalogError, SceneMissingError
from legoworld.files import sha256_of_file
from legoworld.records.run_file import ImageRecord, ImageSource, ImportedFrom
from legoworld.running.image_record import initial_row
from legoworld_counts.readout import write_counts


def _import(request, source, _options, telling):
    try:
        answers = json.loads(source.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise CatalogError(f"{source.name} cannot be read", found=str(error)) from error
    sha256 = sha256_of_file(source)

    def answer(image):
        if image.file_name not in answers:
            raise SceneMissingError("the file says nothing of the photo", found=image.file_name)
        counts = Counter({int(k): n for k, n in answers[image.file_name].items()})
        file = write_counts(request.run, image.scene, counts)
        origin = ImageSource(source=ImportedFrom(file=source.name, sha256=sha256))
        return ImageRecord(row=replace(initial_row(image), answer=file), scene=origin)

    return import_images(request, source, answer, telling)


BASELINE = BaselineFamily(
    of_folder=False,
    what="one JSON file of counts",
    options=frozenset(),
    import_answers=_import,
    sum_up=lambda summary, _ok: summary,
)
