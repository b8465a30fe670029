"""Every planted fault is named on the first screen of its page, with its size, a click away."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from report.planted.arrays import PLANTS as ARRAYS
from report.planted.detections import PLANTS as DETECTIONS
from report.planted.plant import Plant, check

PLANTS = (*DETECTIONS, *ARRAYS)


@pytest.mark.parametrize("plant", PLANTS, ids=lambda p: p.id)
@pytest.mark.parametrize("seed", range(2))
def test_a_planted_fault_is_named_with_its_size(plant: Plant, seed: int, tmp_path: Path) -> None:
    number = PLANTS.index(plant)
    check(plant.make(tmp_path, np.random.default_rng((seed, number))))
