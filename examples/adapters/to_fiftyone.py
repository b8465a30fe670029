"""A view of a scene as a FiftyOne sample: python to_fiftyone.py SCENE PHOTO opens the app."""

from __future__ import annotations

import sys
from pathlib import Path

import fiftyone as fo

import legoworld


def to_fiftyone(view: legoworld.SceneView, photo: Path) -> fo.Sample:
    """The photo with `scene`: a detection for each labelled instance, its mask cut to its box."""
    width, height = view.size_wh
    detections = []
    for instance, mask in zip(view.labelled, view.masks(), strict=True):
        x, y, w, h = instance.bbox_xywh_px
        detections.append(
            fo.Detection(
                label=instance.category,
                bounding_box=[x / width, y / height, w / width, h / height],
                mask=mask[y : y + h, x : x + w],
                confidence=1.0,
            )
        )
    sample = fo.Sample(filepath=str(photo.resolve()))
    sample["scene"] = fo.Detections(detections=detections)
    return sample


if __name__ == "__main__":
    seen = legoworld.open_scene(sys.argv[1]).view(task="coco")
    dataset = fo.Dataset()
    dataset.add_sample(to_fiftyone(seen, Path(sys.argv[2])))
    fo.launch_app(dataset).wait()
