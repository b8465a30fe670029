"""A view of a scene as supervision's Detections: python to_supervision.py SCENE PICTURE.png."""

from __future__ import annotations

import sys

import cv2
import numpy as np
import supervision as sv

import legoworld


def to_supervision(view: legoworld.SceneView) -> sv.Detections:
    """Boxes, masks and category names; class ids are positions in the sorted names."""
    names = sorted({str(instance.category) for instance in view.labelled})
    boxes = view.boxes_xywh_px().astype(np.float64)
    boxes[:, 2:] += boxes[:, :2]
    return sv.Detections(
        xyxy=boxes,
        mask=view.masks(),
        confidence=np.ones(len(boxes)),
        class_id=np.array([names.index(str(i.category)) for i in view.labelled], int),
        data={"class_name": np.array([str(i.category) for i in view.labelled])},
    )


if __name__ == "__main__":
    seen = legoworld.open_scene(sys.argv[1]).view(task="coco")
    picture = np.full((*seen.instance.shape, 3), 255, np.uint8)
    cv2.imwrite(sys.argv[2], sv.MaskAnnotator().annotate(picture, to_supervision(seen)))
