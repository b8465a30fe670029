"""What training takes of one view: boxes, category ids and masks in one value, row by row."""

from __future__ import annotations

from typing import Any, Literal, TypedDict, cast

import numpy as np
from numpy.typing import NDArray

from legoworld.errors import UsageError
from legoworld.records.scene_folder import InstanceRow

Arrays = Literal["numpy", "torch"]


class TorchvisionTarget(TypedDict):
    """The target of torchvision's detectors; arrays, or tensors of the same dtypes.

    boxes: (N, 4) float32, x0, y0, x1, y1 at pixel edges; labels: (N,) int64, the dataset's category
    ids, of which torchvision takes 0 for the background; masks: (N, H, W) uint8; area: (N,)
    float32, pixels; iscrowd: (N,) int64, zeros.
    """

    boxes: Any
    labels: Any
    masks: Any
    image_id: int
    area: Any
    iscrowd: Any


class HfAnnotation(TypedDict):
    """One annotation. bbox: x, y, width, height."""

    id: int
    image_id: int
    category_id: int
    bbox: list[float]
    area: float
    iscrowd: int


class HfTarget(TypedDict):
    """What the image processors of transformers' detectors take as `annotations`."""

    image_id: int
    annotations: list[HfAnnotation]


def torchvision_target(
    rows: tuple[InstanceRow, ...],
    category_ids: NDArray[np.int64],
    masks: NDArray[np.bool_],
    image_id: int,
    arrays: Arrays,
) -> TorchvisionTarget:
    """The target of one image; (n,) ids, (n, H, W) masks. UsageError for tensors without torch."""
    xywh = np.array([row.bbox_xywh_px for row in rows], np.float32).reshape(-1, 4)
    of_numpy = {
        "boxes": np.concatenate([xywh[:, :2], xywh[:, :2] + xywh[:, 2:]], axis=1),
        "labels": category_ids,
        "masks": masks.view(np.uint8),
        "area": np.array([row.area_px for row in rows], np.float32),
        "iscrowd": np.zeros(len(rows), np.int64),
    }
    made: dict[str, Any] = {**of_numpy}
    if arrays == "torch":
        try:
            import torch  # pyright: ignore[reportMissingImports]
        except ImportError as error:
            raise UsageError(
                "tensors need PyTorch", found=str(error), next_step='install it, or arrays="numpy"'
            ) from error
        made = {name: torch.from_numpy(array) for name, array in of_numpy.items()}
    return cast("TorchvisionTarget", {"image_id": image_id, **made})


def hf_target(
    rows: tuple[InstanceRow, ...], category_ids: NDArray[np.int64], image_id: int
) -> HfTarget:
    """The target of one image; ids are those of the instances. category_ids: (n,)."""
    return HfTarget(
        image_id=image_id,
        annotations=[
            HfAnnotation(
                id=row.id,
                image_id=image_id,
                category_id=category_id,
                bbox=[float(x) for x in row.bbox_xywh_px],
                area=float(row.area_px),
                iscrowd=0,
            )
            for row, category_id in zip(rows, category_ids.tolist(), strict=True)
        ],
    )
