"""A baseline of whole batches; the image in a folder called bad fails alone."""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import Any

from legoworld_baseline import serve


def load(request: dict[str, Any]) -> tuple[dict[str, Any], dict[str, Any]]:
    return request, {"model": "fake_batched"}


def predict_batch(
    request: dict[str, Any], images: Sequence[dict[str, Any]]
) -> list[dict[str, Any]]:
    time.sleep(request["options"]["sleep_s"])
    together = sum(2 ** image["image_id"] for image in images)
    return [
        {"failed": "a bad one"}
        if image["file_name"].startswith("bad/")
        else {
            "predictions": [
                {
                    "image_id": image["image_id"],
                    "category_id": request["categories"][0]["id"],
                    "bbox": [1, 2, 3, 4],
                    "score": together / 2**20,
                }
            ]
        }
        for image in images
    ]


if __name__ == "__main__":
    serve(load, predict_batch=predict_batch)
