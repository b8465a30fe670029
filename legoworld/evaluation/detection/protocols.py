"""The detection protocols, one row each; numbers from their cards."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray

from legoworld.cards import Card, load_card
from legoworld.errors import UsageError

IouType = Literal["bbox", "segm"]

#: COCO's and LVIS's area ranges in px^2, both ends included: all, small, medium, large.
AREA_NAMES: Final = ("all", "small", "medium", "large")
AREA_RANGES: Final = ((0.0, 1e10), (0.0, 1024.0), (1024.0, 9216.0), (9216.0, 1e10))

#: Both evaluators build their grids this way; 0.05 steps by arange differ in the last bit.
IOU_THRESHOLDS: Final[NDArray[np.float64]] = np.linspace(0.5, 0.95, 10, endpoint=True)
RECALL_THRESHOLDS: Final[NDArray[np.float64]] = np.linspace(0.0, 1.0, 101, endpoint=True)


@dataclass(frozen=True)
class Metric:
    """One official number: an average of precision or recall. max_rank: COCO's maxDets of AR."""

    name: str
    kind: Literal["AP", "AR"]
    iou: float | None = None
    area: str = "all"
    frequency: str | None = None
    max_rank: int | None = None


@dataclass(frozen=True, kw_only=True)
class DetectionProtocol:
    """A task's rules of scoring.

    iou_type: what overlaps are measured on. per_category_cap: detections kept per image and
    category; per_image_cap: per image over all categories, before the federated filter.
    metrics: in the official evaluator's order.
    """

    task: str
    iou_type: IouType
    per_category_cap: int | None
    per_image_cap: int | None
    federated: bool
    metrics: tuple[Metric, ...]

    @cached_property
    def card(self) -> Card:
        """The readout card, checked against what this module computes."""
        card = load_card(self.task)
        card.hold_to(
            {
                "scoring.metrics": [m.name for m in self.metrics],
                "scoring.max_detections": self.per_category_cap or self.per_image_cap,
                "scoring.protocol": self.iou_type,
                "scoring.images": "track",
                "scoring.failed_image": "no_detections",
                "scoring.bootstrap_unit": "image",
            }
        )
        return card


def _areas(kind: Literal["AP", "AR"], suffix: str = "") -> tuple[Metric, ...]:
    return tuple(
        Metric(f"{kind}{name[0]}{suffix}", kind, area=name) for name in ("small", "medium", "large")
    )


_AP: Final = (Metric("AP", "AP"), Metric("AP50", "AP", iou=0.5), Metric("AP75", "AP", iou=0.75))

_COCO_METRICS: Final = (
    *_AP,
    *_areas("AP"),
    Metric("AR1", "AR", max_rank=1),
    Metric("AR10", "AR", max_rank=10),
    Metric("AR100", "AR", max_rank=100),
    *_areas("AR"),
)


def _coco(task: str, iou_type: IouType) -> DetectionProtocol:
    return DetectionProtocol(
        task=task,
        iou_type=iou_type,
        per_category_cap=100,
        per_image_cap=None,
        federated=False,
        metrics=_COCO_METRICS,
    )


PROTOCOLS: Final = {
    p.task: p
    for p in (
        _coco("coco", "bbox"),
        _coco("coco-masks", "segm"),
        DetectionProtocol(
            task="lvis",
            iou_type="segm",
            per_category_cap=None,
            per_image_cap=300,
            federated=True,
            metrics=(
                *_AP,
                *_areas("AP"),
                *(Metric(f"AP{f}", "AP", frequency=f) for f in "rcf"),
                Metric("AR@300", "AR"),
                *_areas("AR", "@300"),
            ),
        ),
    )
}


def detection_protocol(task: str) -> DetectionProtocol:
    """The rules of a detection task."""
    if task not in PROTOCOLS:
        raise UsageError(
            "there is no such detection task", found=repr(task), expected=" or ".join(PROTOCOLS)
        )
    return PROTOCOLS[task]
