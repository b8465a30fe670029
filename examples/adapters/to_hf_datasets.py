"""Views as a Hugging Face dataset: python to_hf_datasets.py SCENE PHOTO FOLDER."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import legoworld


def rows(views: Mapping[str, legoworld.SceneView]) -> list[dict[str, Any]]:
    """A row for each photo: its path, its size, and its labelled instances."""
    return [
        {
            "image": str(photo),
            "width": view.size_wh[0],
            "height": view.size_wh[1],
            "objects": [
                {
                    "category": instance.category,
                    "bbox_xywh_px": list(instance.bbox_xywh_px),
                    "area_px": instance.area_px,
                    "name": instance.name,
                }
                for instance in view.labelled
            ],
        }
        for photo, view in views.items()
    ]


def to_hf_datasets(views: Mapping[str, legoworld.SceneView]) -> Any:
    """A datasets.Dataset; `category` is a ClassLabel of the names that occur."""
    import datasets

    found = rows(views)
    names = sorted({str(one["category"]) for row in found for one in row["objects"]})
    features = datasets.Features(
        {
            "image": datasets.Image(),
            "width": datasets.Value("int32"),
            "height": datasets.Value("int32"),
            "objects": [
                {
                    "category": datasets.ClassLabel(names=names),
                    "bbox_xywh_px": [datasets.Value("int64")],
                    "area_px": datasets.Value("int64"),
                    "name": datasets.Value("string"),
                }
            ],
        }
    )
    return datasets.Dataset.from_list(found, features=features)


if __name__ == "__main__":
    seen = legoworld.open_scene(sys.argv[1]).view(task="coco")
    to_hf_datasets({str(Path(sys.argv[2]).resolve()): seen}).save_to_disk(sys.argv[3])
