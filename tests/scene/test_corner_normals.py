"""Corner normals of snapshots: as Cycles shades, and only where they are asked for."""

from __future__ import annotations

import numpy as np
import pytest
from scene.gltf.documents import Document, square

from legoworld.scene.blender_process import BlenderProcess, Limits
from legoworld.scene.cache import SnapshotCache
from legoworld.scene.folder import SceneFolder
from legoworld.scene.freeze import checked_artefacts
from legoworld.scene.gltf.container import parse_glb
from legoworld.scene.gltf.snapshot import read_glb_snapshot
from legoworld.scene.gltf.verdicts import UnreadableGltfError
from legoworld.scene.read_scene import read_scene

SCENE = """
fresh()
camera().location = (0, 0, 9)

def ball(name, x, smooth):
    bpy.ops.mesh.primitive_uv_sphere_add(segments=12, ring_count=6, radius=0.8, location=(x, 0, 0))
    made = bpy.context.object
    made.name = made.data.name = name
    for face in made.data.polygons:
        face.use_smooth = smooth(face.index)
    return made

ball("1 smooth", -3, lambda _: True)
ball("2 flat", -1, lambda _: False)
ball("3 mixed", 1, lambda i: i % 2 == 0)
custom = ball("4 custom", 3, lambda _: True)
custom.data.normals_split_custom_set([(0.6, 0.0, 0.8)] * len(custom.data.loops))
cut = ball("5 cut", 5, lambda _: True)
hole = bpy.data.materials.new("hole")
shader = next(n for n in hole.node_tree.nodes if n.type == "BSDF_PRINCIPLED")
shader.inputs["Alpha"].default_value = 0
cut.data.materials.append(None)
cut.data.materials.append(hole)
for face in cut.data.polygons:
    face.material_index = int(face.index < 12)
save("scene")
bpy.data.objects.remove(cut)
bpy.ops.export_scene.gltf(
    filepath=str(OUT / "scene" / "scene.glb"), export_format="GLB", export_cameras=True
)
"""
NAMES = ("1 smooth", "2 flat", "3 mixed", "4 custom", "5 cut")


@pytest.fixture(scope="module")
def read(build_scenes, tmp_path_factory):
    """The scene by its source, and by whether corner normals are asked for, through one cache."""
    folder = tmp_path_factory.mktemp("corners")
    build_scenes(SCENE, folder)
    scene, cache = SceneFolder(path=folder / "scene", name="scene"), SnapshotCache(folder / "cache")
    found = {}
    with BlenderProcess(Limits(time_s=600)) as blender:
        for source in ("blend", "glb"):
            for wanted in (False, True, False, True):
                found.setdefault((source, wanted), []).append(
                    read_scene(
                        scene,
                        source=source,
                        blender=blender,
                        cache=cache,
                        files=checked_artefacts(scene, require_frozen=False),
                        corner_normals=wanted,
                    )
                )
    return found


def of_objects(snapshot):
    """By object: its triangles' face normals, corner normals and corner positions."""
    found = {}
    for surface, mesh in enumerate(snapshot.surface_mesh.tolist()):
        part = slice(*snapshot.triangle_start[mesh : mesh + 2])
        own = snapshot.vertices[snapshot.vertex_start[mesh] :]
        corners = own[snapshot.triangles[part]].astype(float)
        face = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        face /= np.linalg.norm(face, axis=1, keepdims=True)
        owner = snapshot.occurrence_object[snapshot.surface_occurrence[surface]]
        name = snapshot.objects[owner].name
        found[name] = face, snapshot.corner_normal[part], corners
    return found


@pytest.mark.blender
def test_they_are_there_where_they_are_asked_for_and_change_no_hash(read):
    for source in ("blend", "glb"):
        made = [*read[source, False], *read[source, True]]
        assert len({scene.snapshot_sha256 for scene in made}) == 1
        assert all(scene.snapshot.corner_normal is None for scene in read[source, False])
        first, again = (scene.snapshot.corner_normal for scene in read[source, True])
        assert first.tobytes() == again.tobytes()
        assert first.shape == (len(made[0].snapshot.triangles), 3, 3)


@pytest.mark.blender
def test_they_are_what_blender_shades_with(read):
    found = of_objects(read["blend", True][0].snapshot)
    assert sorted(found) == [*NAMES]
    for name in ("1 smooth", "5 cut"):
        _, normals, corners = found[name]
        radial = corners / np.linalg.norm(corners, axis=-1, keepdims=True)
        assert (normals * radial).sum(axis=-1).min() > 0.99
    assert len(found["5 cut"][1]) == 100
    assert not found["2 flat"][1].any()
    flat = ~found["3 mixed"][1].any(axis=(1, 2))
    assert 0.4 < flat.mean() < 0.6
    assert np.allclose(found["4 custom"][1], [0.6, 0, 0.8], atol=2e-4)


@pytest.mark.blender
def test_a_glb_has_the_normals_that_blender_exported(read):
    """It has one for every vertex: those of flat faces are the faces' own."""
    found = of_objects(read["glb", True][0].snapshot)
    face, normals, _ = found["2 flat"]
    assert np.allclose(normals, face[:, None], atol=2e-3)
    turned = np.array([0.6, 0.8, 0.0])  # y up
    assert np.allclose(found["4 custom"][1], turned, atol=2e-3) or np.allclose(
        found["4 custom"][1], turned * [1, 1, -1], atol=2e-3
    )
    _, normals, corners = found["1 smooth"]
    radial = corners / np.linalg.norm(corners, axis=-1, keepdims=True)
    assert (normals * radial).sum(axis=-1).min() > 0.99


def glb_normals(document):
    return read_glb_snapshot(parse_glb(document.glb()), None, corner_normals=True).corner_normal


def test_primitives_without_normals_are_flat_and_targets_move_them():
    positions, indices = square(4, 4, 8)
    made = Document()
    up = made.accessor(np.tile([0.0, 0, 1], (4, 1)))
    right = made.accessor(np.tile([1.0, 0, 0], (4, 1)))
    targets = [{"POSITION": made.accessor(np.zeros((4, 3))), "NORMAL": right}]
    made.node(mesh=made.mesh(positions, indices))
    posed = made.mesh(positions, indices, attributes={"NORMAL": up}, targets=targets)
    made.node(mesh=posed, weights=[0.5])
    found = glb_normals(made)
    assert found.shape == (4, 3, 3)
    assert not found[:2].any()
    assert np.all(found[2:] == np.array([0.5, 0, 1], np.float32))


def test_a_skin_turns_normals_by_the_inverse_transpose():
    positions, indices = square(4, 4, 8)
    made = Document()
    slanted = np.tile(np.array([1.0, 0, 1]) / np.sqrt(2), (4, 1))
    attributes = {
        "NORMAL": made.accessor(slanted),
        "JOINTS_0": made.accessor(np.zeros((4, 4)), "u1"),
        "WEIGHTS_0": made.accessor(np.tile([1.0, 0, 0, 0], (4, 1))),
    }
    joint = made.node(name="Joint", scale=[4, 1, 1])
    skin = made.add("skins", joints=[joint])
    made.node(mesh=made.mesh(positions, indices, attributes=attributes), skin=skin)
    found = glb_normals(made)[0, 0]
    expected = np.array([1 / 4, 0, 1])
    assert np.allclose(found / np.linalg.norm(found), expected / np.linalg.norm(expected))


def test_normals_of_another_shape_are_a_verdict():
    positions, indices = square(4, 4, 8)
    made = Document()
    short = made.accessor(np.zeros((3, 3)))
    made.node(mesh=made.mesh(positions, indices, attributes={"NORMAL": short}))
    with pytest.raises(UnreadableGltfError, match="NORMAL"):
        glb_normals(made)
