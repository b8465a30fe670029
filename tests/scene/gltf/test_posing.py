"""Morph targets and skins in the pose the file stores."""

from __future__ import annotations

import numpy as np
import pytest
from scene.gltf.documents import Document, boxes, read, square

from legoworld.errors import NonFiniteGeometryError
from legoworld.scene.gltf.verdicts import UnreadableGltfError

CORNERS, TRIANGLES = square(4, 4, 8)
MOVE_RIGHT = np.tile([10.0, 0, 0], (4, 1))
MOVE_UP = np.tile([0, 10.0, 0], (4, 1))


def morph(mesh_weights=None, node_weights=None):
    made = Document()
    targets = [{"POSITION": made.accessor(MOVE_RIGHT)}, {"POSITION": made.accessor(MOVE_UP)}]
    mesh = made.mesh(CORNERS, TRIANGLES, targets=targets)
    if mesh_weights is not None:
        made.json["meshes"][mesh]["weights"] = mesh_weights
    fields = {} if node_weights is None else {"weights": node_weights}
    made.node(name="Quad", mesh=mesh, **fields)
    return made


@pytest.mark.parametrize(
    ("mesh_weights", "node_weights", "moved"),
    [
        (None, None, (0, 0)),
        ([0.5, 0], None, (5, 0)),
        ([0.5, 1], None, (5, 10)),
        ([0.5, 1], [0, -0.4], (0, -4)),
        (None, [1, 0], (10, 0)),
    ],
)
def test_default_weights_and_the_nodes_own(mesh_weights, node_weights, moved):
    x, y = 36 + moved[0], 20 - moved[1]
    found = boxes(morph(mesh_weights, node_weights).glb())
    assert found == [("Quad", 64, (x, y, x + 8, y + 8))]


def test_two_nodes_may_pose_one_mesh_differently():
    made = morph([0, 0])
    made.node(name="Moved", mesh=0, weights=[2, 0])
    assert boxes(made.glb()) == [
        ("Moved", 64, (56, 20, 64, 28)),
        ("Quad", 64, (36, 20, 44, 28)),
    ]


def test_targets_of_another_size_are_a_verdict():
    made = morph([1, 0])
    made.json["accessors"][0]["count"] = 3
    with pytest.raises(UnreadableGltfError, match="another shape than the positions"):
        read(made.glb())
    with pytest.raises(UnreadableGltfError, match="2 targets for 3 weights"):
        read(morph([0, 0, 1]).glb())


def test_poses_that_are_no_numbers_are_a_verdict():
    made = morph([1, 0])
    move = made.accessor([[np.nan, 0, 0], [0, 0, 0], [0, 0, 0], [0, 0, 0]])
    made.json["meshes"][0]["primitives"][0]["targets"][0]["POSITION"] = move
    with pytest.raises(NonFiniteGeometryError, match="1 of 4 vertices"):
        read(made.glb())
    with pytest.raises(NonFiniteGeometryError):
        read(morph([1e300, 0]).glb())


def skin_document(joints, weights, second=None, bind=None, **node):
    made = Document()
    attributes = {"JOINTS_0": made.accessor(joints, "u1"), "WEIGHTS_0": made.accessor(weights)}
    if second is not None:
        attributes["JOINTS_1"] = made.accessor(second[0], "u2")
        attributes["WEIGHTS_1"] = made.accessor(second[1])
    mesh = made.mesh(CORNERS, TRIANGLES, attributes=attributes)
    tip = made.node(root=False, name="Tip", translation=[0, 10, 0])
    root = made.node(name="Root", translation=[10, 0, 0], children=[tip])
    skin = {"joints": [root, tip]}
    if bind is not None:
        skin["inverseBindMatrices"] = made.accessor(bind)
    made.add("skins", **skin)
    made.node(name="Quad", mesh=mesh, skin=0, **node)
    return made


ROOT_ONLY = ([[0, 0, 0, 0]] * 4, [[1, 0, 0, 0]] * 4)
#: The lower corners follow the root at (10, 0), the upper ones the tip at (10, 10).
BOTH = (
    [[0, 0, 0, 0], [0, 0, 0, 0], [1, 0, 0, 0], [1, 0, 0, 0]],
    [[1, 0, 0, 0]] * 4,
)


def test_joints_move_vertices_and_the_nodes_own_place_does_not_count():
    moved = [("Quad", 64, (46, 20, 54, 28))]
    assert boxes(skin_document(*ROOT_ONLY).glb()) == moved
    assert (
        boxes(skin_document(*ROOT_ONLY, translation=[-30, -30, 0], scale=[9, 9, 9]).glb()) == moved
    )


def test_each_vertex_follows_its_joints():
    assert boxes(skin_document(*BOTH).glb()) == [("Quad", 144, (46, 10, 54, 28))]
    half = ([[0, 1, 0, 0]] * 4, [[0.5, 0.5, 0, 0]] * 4)
    assert boxes(skin_document(*half).glb()) == [("Quad", 64, (46, 15, 54, 23))]
    # Weights that do not sum to 1 count by their shares; further influences count too.
    rounded = ([[0, 0, 0, 0]] * 4, [[0.25, 0, 0, 0]] * 4)
    more = ([[1, 0, 0, 0]] * 4, [[0.25, 0, 0, 0]] * 4)
    made = skin_document(*rounded, second=more)
    assert boxes(made.glb()) == [("Quad", 64, (46, 15, 54, 23))]
    # Sets are numbered from 0 without a gap: what is beyond one does not count.
    attributes = made.json["meshes"][0]["primitives"][0]["attributes"]
    for name in ("JOINTS", "WEIGHTS"):
        attributes[f"{name}_2"] = attributes.pop(f"{name}_1")
    assert boxes(made.glb()) == [("Quad", 64, (46, 20, 54, 28))]


def test_a_vertex_without_weights_follows_the_first_joint():
    joints = [[1, 1, 1, 1], [1, 1, 1, 1], [1, 0, 0, 0], [1, 0, 0, 0]]
    weights = [[0, 0, 0, 0], [0, 0, 0, 0], [1, 0, 0, 0], [1, 0, 0, 0]]
    assert boxes(skin_document(joints, weights).glb()) == boxes(skin_document(*BOTH).glb())


def test_inverse_bind_matrices_undo_the_rest_pose():
    undo = np.tile(np.eye(4), (2, 1, 1))
    undo[0, :3, 3] = (-10, 0, 0)
    undo[1, :3, 3] = (-10, -10, 0)
    columns = undo.transpose(0, 2, 1).reshape(2, 16)
    assert boxes(skin_document(*BOTH, bind=columns).glb()) == [("Quad", 64, (36, 20, 44, 28))]


def test_more_matrices_than_joints_are_left_and_fewer_are_a_verdict():
    columns = np.tile(np.eye(4), (3, 1, 1)).reshape(3, 16)
    assert boxes(skin_document(*BOTH, bind=columns).glb()) == boxes(skin_document(*BOTH).glb())
    with pytest.raises(UnreadableGltfError, match="1 matrices for 2 joints"):
        read(skin_document(*BOTH, bind=columns[:1]).glb())


@pytest.mark.parametrize(
    ("change", "found"),
    [
        (lambda m: m.json["skins"][0].update(joints=[1]), "follows joint 1 of 1"),
        (lambda m: m.json["skins"][0].update(joints=[1, 99]), "joints is [1, 99]"),
        (lambda m: m.json["skins"][0].update(inverseBindMatrices=0), "not MAT4"),
        (
            lambda m: m.json["meshes"][0]["primitives"][0]["attributes"].pop("JOINTS_0"),
            "JOINTS_0 is nothing",
        ),
        (
            lambda m: m.json["meshes"][0]["primitives"][0]["attributes"].pop("WEIGHTS_0"),
            "WEIGHTS_0 is nothing",
        ),
        (
            lambda m: m.json["meshes"][0]["primitives"][0]["attributes"].update(JOINTS_0=3),
            "not VEC4 a vertex",
        ),
    ],
)
def test_broken_skins_are_verdicts(change, found):
    made = skin_document(*BOTH)
    change(made)
    with pytest.raises(UnreadableGltfError) as verdict:
        read(made.glb())
    assert found in str(verdict.value)


def test_animations_are_not_played_and_said():
    made = morph()
    made.json["animations"] = [{"channels": [], "samplers": []}]
    assert any("holds animations" in w for w in read(made.glb()).warnings)
