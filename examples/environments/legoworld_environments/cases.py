"""The public half of a dataset: its cases, and what an agent is told of one."""

from __future__ import annotations

import json
import os
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

#: Names the dataset where no argument does.
DATASET = "LEGOWORLD_DATASET"

PROMPT = """Rebuild the scene of this picture in Blender.

Write one Python program for Blender's API (bpy). It starts in Blender's start-up scene, which it
has to clear. It builds real geometry in metres, with materials and lights, and leaves one active
camera at the place the picture was taken from. The picture has {width} x {height} pixels, a
horizontal field of view of {hfov_deg:.6f} degrees, square pixels, and its principal point in the
middle. Do not render and do not save: both are done for you. Do not show the picture itself.

The scene is compared with the one behind the picture: its visible surface point by point, in the
camera's frame and in metres, and a render of it pixel by pixel. Nothing is aligned before.

Things that may be in the picture: {categories}.

Answer with the program in one block of ```python."""

_BLOCK = re.compile(r"```(?:python|py)?[ \t]*\n(.*?)```", re.DOTALL)


@dataclass(frozen=True)
class Case:
    """A picture to rebuild. picture: its path; prompt: what an agent is told."""

    image_id: int
    name: str
    picture: Path
    prompt: str
    about: dict[str, Any]


def dataset_folder(given: str | Path | None) -> Path:
    """The dataset that is named, by LEGOWORLD_DATASET without an argument."""
    named = given or os.environ.get(DATASET)
    if not named:
        raise ValueError(f"no dataset: name the output of `legoworld bench make`, or set {DATASET}")
    return Path(named)


def read_cases(dataset: Path) -> list[Case]:
    """All cases of a dataset, by image id."""
    track = json.loads((dataset / "public" / "track.json").read_text("utf-8"))
    categories = ", ".join(one["name"] for one in track["categories"])
    return [
        Case(
            image_id=image["id"],
            name=image["file_name"].removesuffix(".png"),
            picture=dataset / "public" / "images" / image["file_name"],
            prompt=PROMPT.format(categories=categories, **image),
            about={key: image[key] for key in ("family", "tier", "environment", "theme", "split")},
        )
        for image in sorted(track["images"], key=lambda one: one["id"])
    ]


def program_of(answer: str) -> str:
    """The last block of code in a model's answer; the whole answer where it has none."""
    blocks = _BLOCK.findall(answer)
    return blocks[-1] if blocks else answer
