"""All planted faults."""

from __future__ import annotations

from report.planted.answers import PLANTS as ANSWERS
from report.planted.arrays import PLANTS as ARRAYS
from report.planted.detections import PLANTS as DETECTIONS

PLANTS = (*DETECTIONS, *ARRAYS, *ANSWERS)
