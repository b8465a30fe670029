"""Every planted fault is named on the first screen of its page, with its size, a click away."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from report.planted.plant import Plant, check
from report.planted.table import PLANTS

#: No seed that anything was developed with; `python -m report.planted` draws others.
SEED = 20261126


@pytest.mark.parametrize("plant", PLANTS, ids=lambda p: p.id)
def test_a_planted_fault_is_named_with_its_size(plant: Plant, tmp_path: Path) -> None:
    check(plant.make(tmp_path, np.random.default_rng((SEED, PLANTS.index(plant)))))
