"""Semantic maps: a grey PNG of category ids for each photo."""

from __future__ import annotations

from typing import Final

import numpy as np
from msgspec.structs import replace
from numpy.typing import NDArray

from legoworld.readouts.family import AnsweredImage, ReadoutFamily
from legoworld.readouts.label_maps import category_map, category_picture, most_bytes, write_map
from legoworld.records.run_rows import RunRow


def _map(image: AnsweredImage) -> NDArray[np.uint8]:
    assert image.vocabulary is not None
    return category_map(image.view, image.instances, image.vocabulary, image.sky)


def _write(row: RunRow, image: AnsweredImage) -> RunRow:
    return replace(row, answer=write_map(image.run, image.name, _map(image)))


READOUT: Final = ReadoutFamily(
    write=_write,
    file_bytes=most_bytes,
    picture=lambda image: category_picture(_map(image)),
)
