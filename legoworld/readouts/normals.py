"""Geometric normals: one uncompressed .npz per photo."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from msgspec import structs

from legoworld.files import sha256_of_file
from legoworld.readouts.family import AnsweredImage, ReadoutFamily
from legoworld.readouts.pixels import PixelFile
from legoworld.records.run_rows import NormalsFile, RunRow

NORMALS_FILE: Final = PixelFile(
    folder="normals",
    array="normal_cam",
    labels={"sign": "towards_camera", "kind": "geometric"},
    version=1,
    hole=np.nan,
    channels=3,
)


def _write(row: RunRow, image: AnsweredImage) -> RunRow:
    name = NORMALS_FILE.path(image.name)
    path, normals = image.run / name, image.view.normals(threads=image.threads)
    NORMALS_FILE.write(path, normals.normal_cam, {})
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
    sum_up=lambda summary, _rows, _ok: summary,
    file_bytes=NORMALS_FILE.most_bytes,
    needs_instances=False,
    array=lambda image: image.view.normals(threads=image.threads).normal_cam,
)
