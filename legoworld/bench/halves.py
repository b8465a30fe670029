"""Where the files of a dataset's public and private halves are, and how they are written."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from numpy.typing import NDArray

from legoworld.files import atomic_path, sha256_of_file, write_npz
from legoworld.records.bench_dataset import BenchHashes
from legoworld.records.second_card import XTruth

if TYPE_CHECKING:
    from legoworld.bench.case import SeenCase

TRACK: Final = "track.json"
TRUTH: Final = "truth.json"
#: The second card's track and truth.
X: Final = "x.json"
PUBLIC: Final = "public"
PRIVATE: Final = "private"


class Halves:
    """The two folders of a dataset."""

    def __init__(self, dataset: Path) -> None:
        self.public = dataset / PUBLIC
        self.private = dataset / PRIVATE

    def image(self, file_name: str) -> Path:
        """A public picture."""
        return self.public / "images" / file_name

    def write(self, stem: str, picture: bytes, seen_case: SeenCase) -> BenchHashes:
        """Write a case's picture and its private arrays; their hashes."""
        image = self.image(f"{stem}.png")
        with atomic_path(image) as temporary:
            temporary.write_bytes(picture)
        depth, instances, raster = (
            self.private / kind / f"{stem}.npz" for kind in ("depth", "instances", "raster")
        )
        write_npz(depth, {"depth_z_m": seen_case.depth_z_m}, compressed=True)
        write_npz(instances, {"instance": seen_case.instance}, compressed=True)
        write_npz(
            raster,
            {"depth_z_m": seen_case.raster_depth_z_m, "instance": seen_case.raster_instance},
            compressed=True,
        )
        return BenchHashes(
            reference=hashlib.sha256(picture).hexdigest(),
            depth=sha256_of_file(depth),
            instances=sha256_of_file(instances),
            raster=sha256_of_file(raster),
        )

    def write_x(
        self, stem: str, arrays: Mapping[str, NDArray[Any]], picture: bytes | None
    ) -> XTruth:
        """Write what the second card's probe sees, arrays of any shape; R_empty still 0."""
        path, shown = self.private / "x" / f"{stem}.npz", self.private / "x" / f"{stem}.png"
        write_npz(path, arrays)
        if picture is not None:
            with atomic_path(shown) as temporary:
                temporary.write_bytes(picture)
        return XTruth(
            R_empty=0.0,
            arrays_sha256=sha256_of_file(path),
            picture=None if picture is None else f"{PRIVATE}/x/{stem}.png",
            picture_sha256=None if picture is None else sha256_of_file(shown),
        )
