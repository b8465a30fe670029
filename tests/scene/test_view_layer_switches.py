"""What a view layer's own switches leave out of a render, and what is read of it all the same."""

from __future__ import annotations

import numpy as np
import pytest
from scene.snapshots import read_alone

from legoworld.scene.snapshot import Snapshot

pytestmark = pytest.mark.blender

SCENES = """
for name, solid, strand in (("both", True, True), ("no surfaces", False, True),
                            ("no hair", True, False)):
    fresh(); camera(); quad("Wall")
    hair = bpy.data.hair_curves.new("Hair")
    hair.add_curves([2])
    hair.position_data.foreach_set("vector", [0, 0, 1, 0, 2, 1])
    bpy.context.scene.collection.objects.link(bpy.data.objects.new("Hair", hair))
    layer = bpy.context.view_layer
    layer.use_solid, layer.use_strand = solid, strand
    save(name)
"""


@pytest.fixture(scope="module")
def snapshots(build_scenes, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Snapshot]:
    folder = tmp_path_factory.mktemp("layers")
    build_scenes(SCENES, folder)
    return {place.name: read_alone(place).snapshot for place in sorted(folder.iterdir())}


def objects_with_surfaces(snapshot: Snapshot) -> set[str]:
    shown = np.unique(snapshot.occurrence_object[snapshot.surface_occurrence])
    return {snapshot.objects[i].name for i in shown.tolist()}


def test_a_layer_without_surfaces_is_read_with_them_and_says_so(snapshots):
    assert objects_with_surfaces(snapshots["no surfaces"]) == {"Hair", "Wall"}
    (warning,) = snapshots["no surfaces"].warnings
    assert warning == "view layer 'ViewLayer' renders no surfaces: read with them"


def test_a_layer_without_hair_shows_none(snapshots):
    assert objects_with_surfaces(snapshots["both"]) == {"Hair", "Wall"}
    assert objects_with_surfaces(snapshots["no hair"]) == {"Wall"}
    assert snapshots["both"].warnings == snapshots["no hair"].warnings == ()
