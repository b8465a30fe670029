"""Nodes: where they stand, what they are called, and which of them are shown."""

from __future__ import annotations

import numpy as np
import pytest
from scene.gltf.documents import Document, boxes, read, square

from legoworld.errors import NonFiniteGeometryError
from legoworld.scene.gltf.verdicts import UnreadableGltfError

HALF = float(np.sqrt(0.5))


def test_world_axes_are_blenders():
    made = Document()
    made.node(name="Quad", mesh=made.mesh(*square(0, 0, 4)), translation=[1, 2, 3])
    placed = read(made.glb()).world_from_mesh[0]
    # (x, y, z) of glTF is (x, -z, y) of Blender.
    assert placed.tolist() == [[1, 0, 0, 1], [0, 0, -1, -3], [0, 1, 0, 2]]


def test_translation_rotation_and_scale_through_the_hierarchy():
    made = Document()
    leaf = made.quad("Leaf", 0, 0, 4, root=False, translation=[4, 0, 0])
    middle = made.node(root=False, name="Middle", rotation=[0, 0, HALF, HALF], children=[leaf])
    made.node(name="Top", scale=[2, 2, 2], translation=[0, -20, 0], children=[middle])
    # Leaf: x 4..8, y 0..4; turned by 90 degrees: x -4..0, y 4..8; doubled and moved.
    assert boxes(made.glb()) == [("Leaf", 64, (24, 36, 32, 44))]


def test_matrices_are_column_by_column():
    made = Document()
    matrix = [0, 2, 0, 0, -2, 0, 0, 0, 0, 0, 2, 0, 10, 4, 0, 1]
    made.quad("Quad", 0, 0, 4, matrix=matrix)
    assert boxes(made.glb()) == [("Quad", 64, (34, 20, 42, 28))]
    made.json["nodes"][1]["matrix"][3] = 0.5
    with pytest.raises(UnreadableGltfError, match=r"nodes\[1\].matrix"):
        read(made.glb())


@pytest.mark.parametrize("scale", [[-1, 1, 1], [1, -1, 1], [-1, -1, -1], [-2, 3, 0.5]])
def test_negative_and_uneven_scales(scale):
    made = Document()
    made.quad("Quad", 0, 0, 4, scale=scale)
    x = sorted((32, 32 + 4 * scale[0]))
    y = sorted((32, 32 - 4 * scale[1]))
    area = (x[1] - x[0]) * (y[1] - y[0])
    assert boxes(made.glb()) == [("Quad", area, (x[0], y[0], x[1], y[1]))]


def test_rotations_are_normalised_and_a_rotation_of_length_zero_is_a_verdict():
    made = Document()
    made.quad("Quad", 4, 4, 8, rotation=[0, 0, 0, 5])
    assert boxes(made.glb()) == [("Quad", 64, (36, 20, 44, 28))]
    made.json["nodes"][1]["rotation"] = [0, 0, 0, 0]
    with pytest.raises(NonFiniteGeometryError, match="'Quad' stands nowhere"):
        read(made.glb())


def test_matrices_that_grow_beyond_numbers_are_a_verdict():
    made = Document()
    node = made.quad("Quad", 4, 4, root=False)
    for _ in range(40):
        node = made.node(root=False, scale=[1e15, 1e15, 1e15], children=[node])
    made.json["scenes"][0]["nodes"].append(node)
    with pytest.raises(NonFiniteGeometryError, match="stands nowhere"):
        read(made.glb())


def test_a_chain_of_many_nodes_is_no_recursion():
    made = Document()
    node = made.quad("Quad", 4, 4, root=False)
    for _ in range(5000):
        node = made.node(root=False, children=[node])
    made.json["scenes"][0]["nodes"].append(node)
    assert boxes(made.glb()) == [("Quad", 64, (36, 20, 44, 28))]


@pytest.mark.parametrize(
    ("children", "found"),
    [
        ({1: [2], 2: [1]}, "2 nodes are their own ancestors"),
        ({1: [1]}, "1 nodes are their own ancestors"),
        ({1: [3], 2: [3]}, "nodes[3] has two parents: 1 and 2"),
        ({1: [2]}, "lists nodes[2], which has a parent"),
        ({1: [9]}, "nodes[1].children is [9]"),
        ({1: [3, 3]}, "nodes[1].children is [3, 3]"),
    ],
)
def test_nodes_that_are_no_trees(children, found):
    made = Document()
    made.quad("A", 4, 4)
    made.quad("B", 4, 4)
    made.quad("C", 4, 4, root=False)
    for node, below in children.items():
        made.json["nodes"][node]["children"] = below
    with pytest.raises(UnreadableGltfError) as verdict:
        read(made.glb())
    assert found in str(verdict.value)


def test_only_the_default_scene_is_read():
    made = Document()
    made.quad("Shown", 4, 4)
    hidden = made.quad("Other", 20, 4, root=False)
    made.add("scenes", name="Second", nodes=[hidden])
    snapshot = read(made.glb())
    assert [o.name for o in snapshot.objects] == ["Camera", "Shown"]
    assert snapshot.render.scene_name == "Scene"
    assert any("holds 2 scenes; read: 'Scene'" in w for w in snapshot.warnings)
    made.json["scene"] = 1
    made.json["scenes"][1]["nodes"].append(0)
    made.json["scenes"][0]["nodes"].remove(0)
    assert [n for n, *_ in boxes(made.glb())] == ["Other"]


def test_names_and_labels_come_from_nodes_and_their_extras():
    made = Document()
    extras = {"category": "chair", "lvis_category": "armchair", "height": 3, "note": "x"}
    made.quad("Seat", 4, 4, extras=extras)
    mesh = made.mesh(*square(20, 4, 4))
    made.json["meshes"][mesh] |= {"name": "Board", "extras": {"category": "not this"}}
    made.node(mesh=mesh, extras={"category": 3})
    made.node(mesh=made.mesh(*square(20, 20, 4)))
    snapshot = read(made.glb())
    named = {o.name: o.properties for o in snapshot.objects}
    assert named == {
        "Camera": {},
        "Seat": {"category": "chair", "lvis_category": "armchair"},
        "Board": {"category": "3"},
        "node 3": {},
    }
    assert [o.type for o in snapshot.objects] == ["MESH", "CAMERA", "MESH", "MESH"]


def test_a_labelled_parent_owns_its_parts():
    made = Document()
    parts = [made.quad(f"Part{i}", 8 * i, 0, 4, root=False) for i in range(3)]
    made.node(name="Chair", children=parts, extras={"category": "chair"})
    assert boxes(made.glb()) == [("Chair", 48, (32, 28, 52, 32))]


def test_instances_of_one_node_are_instances():
    made = Document()
    mesh = made.mesh(*square(0, 0, 4))
    attributes = {
        "TRANSLATION": made.accessor([(0, 0, 0), (8, 0, 0), (16, 0, 0)]),
        "ROTATION": made.accessor([(0, 0, 0, 127), (0, 0, 127, 0), (0, 0, 0, 127)], "i1",
                                  normalized=True),
        "SCALE": made.accessor([(1, 1, 1), (1, 1, 1), (-1, 2, 1)]),
    }  # fmt: skip
    made.node(
        name="Tree", mesh=mesh, translation=[0, 8, 0], extras={"category": "tree"},
        extensions={"EXT_mesh_gpu_instancing": {"attributes": attributes}},
    )  # fmt: skip
    snapshot = read(made.glb())
    assert len(snapshot.vertices) == 4
    assert boxes(snapshot) == [
        ("Tree", 16, (32, 20, 36, 24)),
        ("Tree", 16, (36, 24, 40, 28)),
        ("Tree", 32, (44, 16, 48, 24)),
    ]
    instancing = made.json["nodes"][1]["extensions"]["EXT_mesh_gpu_instancing"]["attributes"]
    instancing["SCALE"] = made.accessor([(1, 1, 1)])
    with pytest.raises(UnreadableGltfError, match=r"has \[1, 3\] instances"):
        read(made.glb())
    instancing["SCALE"] = made.accessor([(1, 1, 1), (np.nan, 1, 1), (1, 1, 1)])
    with pytest.raises(NonFiniteGeometryError, match="an instance of node 'Tree'"):
        read(made.glb())


def test_hidden_nodes_hide_what_is_below_them():
    made = Document()
    below = made.quad("Below", 4, 4, root=False)
    hidden = {"KHR_node_visibility": {"visible": False}}
    made.node(name="Hidden", children=[below], extensions=hidden)
    made.quad("Shown", 20, 4)
    assert [n for n, *_ in boxes(made.glb())] == ["Shown"]


def test_the_order_of_nodes_does_not_change_the_picture():
    def snapshot(order):
        made = Document()
        for name in order:
            made.quad(name, {"A": 0, "B": 4, "C": 8}[name], 0)
        return boxes(made.glb())

    assert snapshot("ABC") == snapshot("CAB") == snapshot("BCA")
