"""Photos as every baseline sees them: stored orientation, RGB, and of the size the track says."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image


class PhotoError(Exception):
    """A photo is absent, does not decode, or has another size than the track says."""


def read_photo(path: str | Path, width: int, height: int) -> NDArray[np.uint8]:
    """(height, width, 3) uint8 RGB of a photo in its stored orientation.

    EXIF orientation is NOT applied: annotations and measured depth belong to the stored pixels.
    Grey, palette and CMYK pictures are converted. PhotoError when the photo cannot be used.
    """
    path = Path(path)
    try:
        with Image.open(path) as picture:
            found: Any = picture.size
            if found != (width, height):
                raise PhotoError(
                    f"{path.name} is {found[0]}x{found[1]}, the track says {width}x{height}"
                )
            return np.asarray(picture.convert("RGB"), np.uint8).copy()
    except (OSError, SyntaxError, ValueError) as error:
        raise PhotoError(f"{path.name} cannot be read: {error}") from error
