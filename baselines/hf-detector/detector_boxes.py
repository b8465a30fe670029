"""A detector's output to COCO results, through the processor that came with the model."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any


def coco_results(
    detections: Mapping[str, Any], category_of_label: Mapping[int, int], image_id: int
) -> tuple[list[dict[str, Any]], int]:
    """Results of one image, and how many detections were of a label that is no category.

    detections: "boxes" (N, 4) x0, y0, x1, y1 in the photo's pixels, "scores" (N,), "labels" (N,)
    tensors, as `post_process_object_detection` gives them. category_of_label: label index to
    category id. Boxes are not clipped to the photo.
    """
    results = []
    rows = zip(
        detections["labels"].tolist(),
        detections["scores"].tolist(),
        detections["boxes"].double().tolist(),
        strict=True,
    )
    for label, score, (x0, y0, x1, y1) in rows:
        if label in category_of_label:
            results.append(
                {
                    "image_id": image_id,
                    "category_id": category_of_label[label],
                    "bbox": [x0, y0, x1 - x0, y1 - y0],
                    "score": score,
                }
            )
    return results, len(detections["labels"]) - len(results)


def categories_of_labels(
    names: Mapping[int, str], matched: Mapping[str, int]
) -> tuple[dict[int, int], list[str]]:
    """Label index to category id, and the names that stand at more than one index.

    names: the model's label names by index; matched: category id by label name.
    """
    found = {index: matched[name] for index, name in names.items() if name in matched}
    used = [names[index] for index in found]
    return found, sorted({name for name in used if used.count(name) > 1})
