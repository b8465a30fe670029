"""The same scene has the same content hash, whenever and in whatever order it was built."""

from __future__ import annotations

from pathlib import Path

import pytest
from scene.snapshots import build, snapshot_of

from legoworld.scene.blender_process import BlenderProcess, Limits

pytestmark = [pytest.mark.blender, pytest.mark.own_blender]

NAMES = ("saved_once", "saved_later", "built_in_another_order")


@pytest.fixture(scope="module")
def scenes(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return build(tmp_path_factory.mktemp("stable") / "scenes", "scene.stable_scenes")


def test_the_content_hash_depends_on_the_content_only(scenes):
    with BlenderProcess(Limits(time_s=600)) as blender:
        found = {name: snapshot_of(scenes / name, blender) for name in NAMES}
    with BlenderProcess(Limits(time_s=600)) as blender:
        again = {name: snapshot_of(scenes / name, blender) for name in reversed(NAMES)}
    files = {(scenes / name / "scene.blend").read_bytes() for name in NAMES}
    assert len(files) > 1, "the files themselves differ"
    hashes = {name: scene.snapshot_sha256 for name, scene in found.items()}
    assert len(set(hashes.values())) == 1, hashes
    assert {name: scene.snapshot_sha256 for name, scene in again.items()} == hashes
    snapshot = found["saved_once"].snapshot
    assert [c.name for c in snapshot.cutouts] == ["alpha 0", "alpha 1", "alpha 2"]
    assert len(snapshot.surface_mesh) == 6 + 8 + 3 + 2
