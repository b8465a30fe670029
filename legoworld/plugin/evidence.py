"""A folder of evidence, read: regions as masks, depth as disparity."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from legoworld.depth_files.errors import DepthFileError
from legoworld.depth_files.read_depth import read_npz_array
from legoworld.errors import LegoWorldError
from legoworld.files import sha256_of_file
from legoworld.readouts.masks import covered_px
from legoworld.readouts.pictures import read_photo
from legoworld.records.base import RecordError, decode
from legoworld.records.plugin_evidence import EvidenceFile, Region

EVIDENCE: Final = "evidence.json"
DEPTH: Final = "depth.npz"


class EvidenceInvalidError(LegoWorldError):
    """The evidence of a photo cannot be used."""

    code = "evidence_invalid"


@dataclass(frozen=True, kw_only=True)
class Evidence:
    """evidence.json and its arrays.

    disparity: (H, W) float64, larger is nearer, NaN where unknown; None where there is no depth.
    photo: (H, W, 3) uint8 RGB, None where it was not given.
    """

    file: EvidenceFile
    disparity: NDArray[np.float64] | None
    photo: NDArray[np.uint8] | None = None

    @property
    def size_wh(self) -> tuple[int, int]:
        """The photo's size in pixels."""
        return self.file.photo.width, self.file.photo.height

    def region(self, name: str) -> Region | None:
        """A region by its name; None for one the file does not have."""
        return next((r for r in self.file.regions if r.name == name), None)

    def mask(self, region: Region) -> NDArray[np.bool_]:
        """(H, W) bool: a region's pixels."""
        from pycocotools import mask as rle

        width, height = self.size_wh
        decoded = rle.decode({"size": [height, width], "counts": region.counts.encode("ascii")})
        return np.asarray(decoded, bool)


def read_evidence(folder: Path, photo: Path | None = None) -> Evidence:
    """Read what `legoworld plugin evidence` wrote. EvidenceInvalidError for anything else.

    photo: the photo itself; another one than the evidence is about is refused by its hash.
    """
    path = folder / EVIDENCE
    try:
        file = decode(EvidenceFile, path.read_bytes())
    except FileNotFoundError as error:
        raise EvidenceInvalidError(
            "the folder holds no evidence",
            found=f"no {EVIDENCE} in {folder.name}",
            expected="a folder written by `legoworld plugin evidence`",
            next_step="run `legoworld plugin evidence --photo PHOTO -o DIR`",
        ) from error
    except RecordError as error:
        raise EvidenceInvalidError(
            f"{EVIDENCE} cannot be used",
            found=str(error),
            expected="evidence of version 1",
            next_step="run `legoworld plugin evidence` again",
        ) from error
    for region in file.regions:
        check_run_lengths(
            region.name, region.counts, file.photo.width * file.photo.height, EVIDENCE
        )
    return Evidence(
        file=file,
        disparity=_disparity(folder, file),
        photo=None if photo is None else _photo(photo, file.photo.sha256),
    )


def check_run_lengths(name: str, counts: str, pixels: int, source: str) -> None:
    """EvidenceInvalidError for a mask whose run lengths are not of the photo's pixels."""
    if (covered := covered_px(counts)) != pixels:
        raise EvidenceInvalidError(
            f"the mask of region {name!r} of {source} cannot be used",
            found="no run lengths" if covered < 0 else f"run lengths of {covered:,} pixels",
            expected=f"those of the photo's {pixels:,} pixels",
            next_step="write the mask again, with pycocotools' encode say",
        )


def _photo(path: Path, sha256: str) -> NDArray[np.uint8]:
    if (digest := sha256_of_file(path)) != sha256:
        raise EvidenceInvalidError(
            "the evidence is of another photo",
            found=f"{path.name} with sha256 {digest[:12]}...",
            expected=f"sha256 {sha256[:12]}...",
            next_step="run `legoworld plugin evidence` on this photo",
        )
    return read_photo(path)


def _disparity(folder: Path, file: EvidenceFile) -> NDArray[np.float64] | None:
    if file.depth is None:
        return None
    path = folder / DEPTH
    if not path.is_file() or sha256_of_file(path) != file.depth.sha256:
        raise EvidenceInvalidError(
            f"{DEPTH} is not the one {EVIDENCE} names",
            found="no such file" if not path.is_file() else "another sha256",
            expected=file.depth.sha256,
            next_step="run `legoworld plugin evidence` again",
        )
    try:
        values = read_npz_array(path, "values", None).astype(np.float64)
    except DepthFileError as error:
        raise EvidenceInvalidError(
            f"{path} cannot be used", found=error.found, expected="an .npz with `values`"
        ) from error
    if values.shape != (file.photo.height, file.photo.width):
        raise EvidenceInvalidError(
            f"{DEPTH} has another size than the photo",
            found=f"{values.shape[1]}x{values.shape[0]}",
            expected=f"{file.photo.width}x{file.photo.height}",
        )
    return values if file.depth.space == "disparity" else inverse(values)


def inverse(depth: NDArray[np.float64]) -> NDArray[np.float64]:
    """1 / depth in its shape, NaN where depth is not positive and finite."""
    usable = np.isfinite(depth) & (depth > 0)
    return np.divide(1.0, depth, out=np.full_like(depth, np.nan), where=usable)
