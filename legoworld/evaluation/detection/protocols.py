"""The detection protocols, one row each; numbers from their cards."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache, cached_property
from typing import Final, Literal

from legoworld.cards import Card, load_card
from legoworld.errors import UsageError
from legoworld.evaluation.detection.grid import SPACE, Grid
from legoworld.evaluation.detection.payloads.amodal import AMODAL
from legoworld.evaluation.detection.payloads.boxes import BOXES
from legoworld.evaluation.detection.payloads.boxes3d import BOXES3D
from legoworld.evaluation.detection.payloads.masks import MASKS
from legoworld.evaluation.detection.payloads.payload import IouType, Payload
from legoworld.tasks.registry import family_tasks, find_task
from legoworld.tasks.shipped import DETECTION

#: By the card's `readout.reads`.
PAYLOADS: Final[Mapping[str, Payload]] = {one.name: one for one in (BOXES, MASKS, AMODAL, BOXES3D)}


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

    payload: what overlaps are measured on. per_category_cap: detections kept per image and
    category; per_image_cap: per image over all categories, before the federated filter.
    metrics: in the official evaluator's order.
    """

    task: str
    payload: Payload
    per_category_cap: int | None
    per_image_cap: int | None
    federated: bool
    metrics: tuple[Metric, ...]

    @property
    def grid(self) -> Grid:
        """The payload's."""
        return self.payload.grid

    @property
    def iou_type(self) -> IouType:
        """As the official evaluators call it."""
        return self.payload.iou_type

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


_LVIS_METRICS: Final = (
    *_AP,
    *_areas("AP"),
    *(Metric(f"AP{f}", "AP", frequency=f) for f in "rcf"),
    Metric("AR@300", "AR"),
    *_areas("AR", "@300"),
)


_SPACE_METRICS: Final = (
    Metric("AP", "AP"),
    *(Metric(f"AP{round(100 * iou)}", "AP", iou=iou) for iou in (0.15, 0.25, 0.5)),
    *(Metric(f"AP{name[0]}", "AP", area=name) for name in SPACE.areas[1:]),
    *(Metric(f"AR{rank}", "AR", max_rank=rank) for rank in (1, 10, 100)),
    *(Metric(f"AR{name[0]}", "AR", area=name) for name in SPACE.areas[1:]),
)


@cache
def detection_protocol(task: str) -> DetectionProtocol:
    """The rules of a task of boxes or masks: LVIS's where its dataset is federated, else COCO's.

    Raises UsageError where there is no such task.
    """
    known = find_task(task)
    if known is None or known.family != DETECTION:
        raise UsageError(
            "there is no such detection task",
            found=repr(task),
            expected=" or ".join(one.name for one in family_tasks(DETECTION)),
        )
    federated = known.dataset.federated
    payload = PAYLOADS[load_card(task).reads]
    official = _SPACE_METRICS if payload.grid is SPACE else _COCO_METRICS
    return DetectionProtocol(
        task=task,
        payload=payload,
        per_category_cap=None if federated else 100,
        per_image_cap=300 if federated else None,
        federated=federated,
        metrics=_LVIS_METRICS if federated else official,
    )
