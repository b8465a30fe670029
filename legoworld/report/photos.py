"""The photos behind the drawings: looked up by name, made small, written as WebP."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Final

import cv2
import numpy as np

from legoworld.errors import LegoWorldError, cause
from legoworld.files import names_a_file
from legoworld.readouts.pictures import read_photo
from legoworld.scene.pictures import MOST_PHOTO_PX

LONGEST_SIDE: Final = 800
#: 29 kB a COCO photo: 500 of them are 19 MB of a page.
_QUALITY: Final = 50
#: COCO's and LVIS's folders, below the one that is named.
_FOLDERS: Final = ("", "train2017", "val2017")


@dataclass(frozen=True, kw_only=True)
class Photo:
    """A photo for the page. webp: None where there is none; note: shown instead of it."""

    webp: bytes | None
    note: str


def find_photo(photos: Path, file_name: str) -> Path | None:
    """PHOTOS/file_name, or that below its train2017/ or val2017/; None where there is no such file.

    A name that leads out of the folder is not followed.
    """
    name = PurePosixPath(file_name)
    if name.is_absolute() or ".." in name.parts:
        return None
    for below in _FOLDERS:
        path = photos / below / name
        if names_a_file(path):
            return path
    return None


def page_photo(photos: Path | None, file_name: str, size_wh: tuple[int, int] | None) -> Photo:
    """A photo at most 800 pixels long; a note in place of one that is absent or does not decode.

    size_wh: what the annotations are drawn for. A photo of another size is not shown: the drawing
    would lie about it.
    """
    if photos is None:
        return Photo(webp=None, note="no folder of photos was given (--photos)")
    path = find_photo(photos, file_name)
    if path is None:
        return Photo(webp=None, note=f"the photo {file_name} was not found")
    return page_picture(path, f"the photo {file_name}", size_wh)


def page_picture(
    path: Path, name: str, size_wh: tuple[int, int] | None = None, *, most_px: int = MOST_PHOTO_PX
) -> Photo:
    """A picture file at most LONGEST_SIDE pixels long, as WebP. LegoWorldError where that fails."""
    try:
        picture = read_photo(path, most_px=most_px, name=path.name)
    except (LegoWorldError, OSError) as error:
        return Photo(webp=None, note=f"{name} could not be read: {cause(error)}")
    height, width = picture.shape[:2]
    if size_wh is not None and (width, height) != size_wh:
        sizes = f"{name} is {width}x{height}, its truth {size_wh[0]}x{size_wh[1]}"
        return Photo(webp=None, note=f"{sizes}: not shown")
    shrink = LONGEST_SIDE / max(width, height)
    if shrink < 1:
        small = max(1, round(width * shrink)), max(1, round(height * shrink))
        picture = cv2.resize(picture, small, interpolation=cv2.INTER_AREA).astype(np.uint8)
    done, data = cv2.imencode(
        ".webp", np.ascontiguousarray(picture[:, :, ::-1]), [cv2.IMWRITE_WEBP_QUALITY, _QUALITY]
    )
    if not done:
        raise LegoWorldError("a photo could not be encoded", found=f"shape {picture.shape}")
    return Photo(webp=data.tobytes(), note="")
