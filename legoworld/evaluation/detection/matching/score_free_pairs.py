"""Matched IoU, free of scores: one-to-one pairs that maximise total overlap (Kuhn, Hungarian).

docs/protocols/coco.md and lvis.md define the numbers.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from legoworld.evaluation.detection.problem import Bools, Floats, Ints

#: A pair at least this good is a true positive of precision and recall.
HIT: Final = 0.5


@dataclass(frozen=True, kw_only=True)
class Pairs:
    """Pairs of a run, or of some of its images, and what they are counted against.

    detection, truth: (P,) positions in its columns; iou: (P,), all above 0; counted: (D,)
    detections that are answered for: paired at HIT or better, or not forgiven by the official
    rules (in a crowd, on an ignored instance, category unverified or not exhaustively annotated).
    """

    detection: Ints
    truth: Ints
    iou: Floats
    counted: Bools
