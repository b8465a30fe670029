"""Boxes and masks on a page: the main metrics, and the section with its photos."""

from __future__ import annotations

from typing import Final

from legoworld.report.detection_section import detection_section
from legoworld.report.family import PageFamily

PAGE: Final = PageFamily(
    forest={
        "AP": "AP",
        "AP25": "AP25",
        "AP50": "AP50",
        "AP75": "AP75",
        "APs": "AP small",
        "APm": "AP medium",
        "APl": "AP large",
        "APn": "AP near",
        "equal_confidence.AP": "AP, equal confidence",
        "amodal.invisible_iou": "IoU of the invisible part",
        "amodal.order_f1": "order of layers, F1",
        "class_aware.miou_gt_micro": "mean IoU per object",
        "class_aware.recall_50": "recall at IoU 0.5",
        "class_aware.precision_50": "precision at IoU 0.5",
    },
    fill=detection_section,
)
