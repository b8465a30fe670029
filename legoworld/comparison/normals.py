"""Normals compared: means over images."""

from __future__ import annotations

from typing import Final

from legoworld.comparison.pixels import PixelComparison, pixel_comparison
from legoworld.evaluation.normals.family import PIXELS

COMPARISON: Final = pixel_comparison(PixelComparison(family=PIXELS))
