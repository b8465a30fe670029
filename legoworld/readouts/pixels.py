"""How a family keeps one array for each image: an uncompressed .npz."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from legoworld.files import write_npz

#: Overhead of one .npz in bytes: zip headers and its texts, rounded up.
_CONTAINER_BYTES: Final = 4096


@dataclass(frozen=True, kw_only=True)
class PixelFile:
    """The .npz of a family's arrays.

    folder: of the files in a run; array: the array's name; labels: texts beside it; version: of
    the file, an integer beside it; hole: what a pixel without a value has, not finite; channels:
    numbers of a pixel, 1 for arrays (height, width).
    """

    folder: str
    array: str
    labels: Mapping[str, str]
    version: int
    hole: float
    channels: int = 1

    def path(self, scene: str) -> str:
        """Path of a photo's file, relative to the run; `scene`: its path without extension."""
        return f"{self.folder}/{scene}.npz"

    def most_bytes(self, size_wh: tuple[int, int]) -> int:
        """Upper bound of the size of a photo's file."""
        return 4 * size_wh[0] * size_wh[1] * self.channels + _CONTAINER_BYTES

    def write(
        self,
        path: Path,
        values: NDArray[np.float32] | NDArray[np.float64],
        others: Mapping[str, NDArray[Any]],
    ) -> None:
        """Write an array with its labels and further arrays or labels, atomically."""
        labels = {name: np.array(text) for name, text in self.labels.items()}
        version = np.array(self.version)
        write_npz(path, {self.array: values, **labels, "format_version": version, **others})
