"""Normals: one uncompressed .npz per photo."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from msgspec import structs

from legoworld.files import sha256_of_file
from legoworld.readouts.family import AnsweredImage, ReadoutFamily
from legoworld.readouts.pixels import PixelFile
from legoworld.records.run_rows import NormalsFile, RunRow
from legoworld.visibility.normals import Normals

NORMALS_FILE: Final = PixelFile(
    folder="normals",
    array="normal_cam",
    labels={"sign": "towards_camera"},
    version=1,
    hole=np.nan,
    channels=3,
)


def _normals(image: AnsweredImage) -> Normals:
    return image.view.normals(image.normals or "geometric", threads=image.threads)


def _write(row: RunRow, image: AnsweredImage) -> RunRow:
    name = NORMALS_FILE.path(image.name)
    path, normals = image.run / name, _normals(image)
    NORMALS_FILE.write(path, normals.normal_cam, {"variant": np.array(normals.variant)})
    share = normals.flipped_share
    file = NormalsFile(
        file=name,
        sha256=sha256_of_file(path),
        bytes=path.stat().st_size,
        sign=NORMALS_FILE.labels["sign"],
        finite_px=int(np.isfinite(normals.normal_cam[..., 0]).sum()),
        flipped_share=None if math.isnan(share) else share,
    )
    return structs.replace(row, normals=file)


READOUT: Final = ReadoutFamily(
    write=_write,
    file_bytes=NORMALS_FILE.most_bytes,
    needs_instances=False,
    normals=True,
    array=lambda image: _normals(image).normal_cam,
)
