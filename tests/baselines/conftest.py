"""Six photos, their track and a file of weights for the fake baselines."""

from __future__ import annotations

from pathlib import Path

import pytest
from baselines.tracks import make_photos, make_track

NAMES = [f"{n:03}.jpg" for n in range(1, 7)]


@pytest.fixture(scope="session")
def photos(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return make_photos(tmp_path_factory.mktemp("photos"), NAMES)


@pytest.fixture
def track(tmp_path: Path) -> Path:
    return make_track(tmp_path / "track.json", NAMES)


@pytest.fixture
def weights(tmp_path: Path) -> Path:
    path = tmp_path / "weights.bin"
    path.write_bytes(b"weights")
    return path
