"""Row 32: scene.blend and the scene.glb exported of it show the same masks."""

from __future__ import annotations

import pytest

from legoworld import open_scene
from legoworld.running.source_comparison import SourceComparison

pytestmark = pytest.mark.blender

SCENE = """
made = camera() if fresh() else None
made.location, made.rotation_euler = (2, -9, 5), (1.05, 0.1, 0.2)
quad("Floor", z=-1, half=2.2)
for i in range(3):
    bpy.ops.mesh.primitive_uv_sphere_add(radius=0.7, location=(1.6 * i - 1.6, 0.4 * i, 0))
    ball = bpy.context.object
    ball.name, ball["category"] = f"Ball {i}", "sports ball"
    ball.scale = (1, 0.5 + 0.4 * i, 1.3)
hair = bpy.data.hair_curves.new("Hair")
hair.add_curves([3])
hair.position_data.foreach_set("vector", [0, 0, 0, 0, 0.2, 1, 0, 0, 2])
made = bpy.data.objects.new("Hair", hair)
hair.attributes.new("radius", "FLOAT", "POINT").data.foreach_set("value", [0.1, 0.1, 0.1])
made.location = (-3.2, 2, 0)
bpy.context.scene.collection.objects.link(made)
save("both")
bpy.ops.export_scene.gltf(
    filepath=str(OUT / "both" / "scene.glb"), export_format="GLB", export_extras=True,
    export_cameras=True, export_apply=True, use_renderable=True,
)
"""


@pytest.fixture(scope="module")
def compared(build_scenes, tmp_path_factory: pytest.TempPathFactory) -> SourceComparison:
    folder = tmp_path_factory.mktemp("both")
    build_scenes(SCENE, folder)
    views = [open_scene(folder / "both", source=file, cache=False) for file in ("blend", "glb")]
    blend, glb = (scene.view(size_wh=(320, 240)) for scene in views)
    return blend.compared_with(glb)


def test_row_32_blend_and_glb_show_the_same_masks(compared: SourceComparison):
    seen = {pair.name: pair for pair in compared.pairs}
    assert set(seen) == {"Ball 0", "Ball 1", "Ball 2", "Floor"}
    for pair in seen.values():
        assert pair.iou >= 0.999, pair
        assert pair.blend_category == pair.glb_category
    assert min(pair.blend_area_px for pair in seen.values()) > 300


def test_row_32_what_gltf_loses_is_listed(compared: SourceComparison):
    (lost,) = compared.lost
    assert lost.name == "Hair"
    assert lost.area_px > 100
    assert compared.gained == ()
    assert not compared.faithful
