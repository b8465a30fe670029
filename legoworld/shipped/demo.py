"""The files of `legoworld demo`: example scenes, their photos, tracks and ground truth."""

from __future__ import annotations

import importlib.util
import shutil
from pathlib import Path
from typing import Final

from legoworld.shipped import catalog

TASKS: Final = ("coco", "lvis")
_SCENES: Final = ("astronaut", "chelsea", "coffee", "motorcycle")


def write_example_files(folder: Path) -> bool:
    """Write scenes/, tracks/, truth/ and photos/; whether the photos are there.

    The photos are scikit-image's and part of no legoworld.
    """
    data = catalog.folder("datasets") / "skimage_examples"
    for name in _SCENES:
        target = folder / "scenes" / name
        shutil.copytree(catalog.folder("examples") / name, target, dirs_exist_ok=True)
    for kind, place in (("track", "tracks"), ("truth", "truth")):
        (folder / place).mkdir(parents=True, exist_ok=True)
        for task in TASKS:
            shutil.copyfile(data / f"{kind}_{task}.json", folder / place / f"{task}.json")
    if importlib.util.find_spec("skimage") is None:
        return False
    import cv2
    import skimage.data

    (folder / "photos").mkdir(exist_ok=True)
    for name in _SCENES:
        rgb = skimage.data.stereo_motorcycle()[0] if name == "motorcycle" else None
        rgb = getattr(skimage.data, name)() if rgb is None else rgb
        cv2.imwrite(str(folder / "photos" / f"{name}.png"), rgb[:, :, ::-1])
    return True
