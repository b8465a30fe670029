"""Tracks of questions: of scenes whose facts are known, or of statements about photos."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

from legoworld.errors import UsageError
from legoworld.evaluation.relations.truth import read_truth
from legoworld.readouts.pictures import read_photo
from legoworld.records.base import canonical
from legoworld.records.track import ImageInfo
from legoworld.track_making.family import TrackFamily
from legoworld.tracks.track import Source


def _source(task: str, path: Path, options: Mapping[str, Any]) -> Source:
    """Photos with their questions, without answers. photos: where sizes of photos are read."""
    truth, photos = read_truth(path, task), options.get("photos")
    images, questions, without = [], [], []
    for image in sorted(truth.images.values(), key=lambda i: i.image_id):
        size = image.size_wh
        if size is None:
            if photos is None:
                raise UsageError(
                    "statements do not give the sizes of their photos",
                    found=path.name,
                    expected="--photos PHOTOS, the folder of the photos",
                )
            photo = Path(photos) / image.file_name
            if not photo.is_file():
                without.append(image.file_name)
                continue
            height, width = read_photo(photo).shape[:2]
            size = width, height
        images.append(
            ImageInfo(id=image.image_id, file_name=image.file_name, width=size[0], height=size[1])
        )
        questions += [one.question for one in image.answers]
    if not images:
        raise UsageError(
            f"no photo of {path.name} is below {Path(str(photos)).name}",
            found=f"nothing for {without[0]}" if without else "no image",
            expected="the photos that the statements name",
        )
    notice = (
        f"{len(without)} photos are not there and left out, such as {without[0]}" if without else ""
    )
    return Source(
        name=path.resolve().name,
        version="custom",
        sha256=hashlib.sha256(canonical([images, questions]).encode()).hexdigest(),
        images=tuple(images),
        questions=tuple(questions),
        notices=(notice,) if notice else (),
    )


TRACK: Final = TrackFamily(source=_source, options=frozenset({"photos"}))
