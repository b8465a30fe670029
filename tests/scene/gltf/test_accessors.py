"""Accessors and primitives, each feature against a picture whose pixels are known."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scene.gltf.documents import Document, boxes, read, square

from legoworld.errors import NoMeshError, NonFiniteGeometryError
from legoworld.scene.gltf.accessors import Accessors
from legoworld.scene.gltf.buffers import Buffers
from legoworld.scene.gltf.container import parse_glb
from legoworld.scene.gltf.verdicts import Budget, UnreadableGltfError

QUAD = [("Quad", 64, (36, 20, 44, 28))]
CORNERS, TRIANGLES = square(4, 4, 8)


def read_accessor(primitive, made, **document):
    made.json |= document
    made.node(name="Quad", mesh=made.add("meshes", primitives=[primitive]))
    return boxes(made.glb())


@pytest.mark.parametrize("dtype", ["u1", "u2", "u4"])
def test_index_widths(dtype):
    made = Document()
    primitive = made.primitive(CORNERS)
    primitive["indices"] = made.accessor(TRIANGLES, dtype)
    assert read_accessor(primitive, made) == QUAD


def test_without_indices():
    made = Document()
    assert read_accessor(made.primitive([CORNERS[i] for i in TRIANGLES]), made) == QUAD


@pytest.mark.parametrize(
    ("mode", "indices"), [(4, TRIANGLES), (5, [0, 1, 3, 2]), (6, [0, 1, 2, 3])]
)
def test_triangles_strips_and_fans(mode, indices):
    made = Document()
    assert read_accessor(made.primitive(CORNERS, indices, mode=mode), made) == QUAD
    made = Document()
    unindexed = made.primitive([CORNERS[i] for i in indices], mode=mode)
    assert read_accessor(unindexed, made) == QUAD


def test_a_strip_of_many_triangles():
    made = Document()
    points = [(x, 4 * (x % 2), 0) for x in range(9)]  # a ribbon of height 4: 7 triangles, area 14
    snapshot_doc = made.primitive(points, mode=5)
    made.node(name="Ribbon", mesh=made.add("meshes", primitives=[snapshot_doc]))
    snapshot = read(made.glb())
    corners = snapshot.vertices[snapshot.triangles].astype(float)
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert np.linalg.norm(normals, axis=1).tolist() == [8.0] * 7  # twice an area of 4 each


@pytest.mark.parametrize("mode", [0, 1, 2, 3])
def test_points_and_lines_are_no_surface_and_named(mode):
    made = Document()
    made.node(name="Dots", mesh=made.mesh(CORNERS, TRIANGLES, mode=mode))
    with pytest.raises(NoMeshError):
        read(made.glb())
    made.quad("Quad", 4, 4)
    assert boxes(made.glb()) == QUAD
    kind = "points" if mode == 0 else "lines"
    assert any(f"{kind} are not read" in w for w in read(made.glb()).warnings)


def test_an_incomplete_last_triangle_is_left_out_with_a_warning():
    made = Document()
    primitive = made.primitive(CORNERS, [*TRIANGLES, 1, 2])
    assert read_accessor(primitive, made) == QUAD
    assert any("incomplete last triangle" in w for w in read(made.glb()).warnings)


def test_interleaved_vertices():
    made = Document()
    rows = np.zeros(4, [("position", "<f4", 3), ("normal", "<f4", 3), ("uv", "<f4", 2)])
    rows["position"], rows["normal"], rows["uv"] = CORNERS, 1e9, -1e9
    view = made.view(b"head" + rows.tobytes(), byteStride=32)
    made.add("accessors", bufferView=view, byteOffset=4, componentType=5126, count=4, type="VEC3")
    primitive = {"attributes": {"POSITION": 0}, "indices": made.accessor(TRIANGLES, "u1")}
    assert read_accessor(primitive, made) == QUAD


@pytest.mark.parametrize(
    ("dtype", "normalized", "unit"),
    [("i1", False, 1), ("u2", False, 1), ("i2", True, 32767), ("u1", True, 255), ("i1", True, 127)],
)
def test_quantized_positions(dtype, normalized, unit):
    # Stored as 0..8 or as shares of the largest value; the node's scale makes 8 of either.
    stored = np.array(CORNERS) - (4, 4, 0)
    stored = stored if not normalized else stored / 8 * unit
    made = Document()
    position = made.accessor(stored, dtype, normalized=normalized)
    primitive = {"attributes": {"POSITION": position}, "indices": made.accessor(TRIANGLES, "u1")}
    scale = [8, 8, 1] if normalized else [1, 1, 1]
    made.node(
        name="Quad", mesh=made.add("meshes", primitives=[primitive]), translation=[4, 4, 0],
        scale=scale,
    )  # fmt: skip
    with pytest.raises(UnreadableGltfError, match="VEC3 of float"):
        read(made.glb())
    made.json["extensionsUsed"] = ["KHR_mesh_quantization"]
    assert boxes(made.glb()) == QUAD


def test_the_most_negative_integer_is_minus_one():
    made = Document()
    stored = [(-128, -127, 0), (127, -127, 0), (127, 127, 0)]
    primitive = {"attributes": {"POSITION": made.accessor(stored, "i1", normalized=True)}}
    made.json["extensionsUsed"] = ["KHR_mesh_quantization"]
    made.node(mesh=made.add("meshes", primitives=[primitive]))
    assert read(made.glb()).vertices[:, :2].tolist() == [[-1, -1], [1, -1], [1, 1]]


def sparse(made, count, places, values, dtype="u2", **base):
    return made.add(
        "accessors",
        componentType=5126,
        count=count,
        type="VEC3",
        sparse={
            "count": len(places),
            "indices": {
                "bufferView": made.view(np.array(places).astype("<" + dtype).tobytes()),
                "componentType": {"u1": 5121, "u2": 5123, "u4": 5125}[dtype],
            },
            "values": {"bufferView": made.view(np.array(values, "<f4").tobytes())},
        },
        **base,
    )


@pytest.mark.parametrize("dtype", ["u1", "u2", "u4"])
def test_sparse_values_over_a_base_and_over_zeros(dtype):
    made = Document()
    wrong = np.array(CORNERS, "<f4")
    wrong[2] = (99, 99, 99)
    position = sparse(made, 4, [2], [CORNERS[2]], dtype, bufferView=made.view(wrong.tobytes()))
    primitive = {"attributes": {"POSITION": position}, "indices": made.accessor(TRIANGLES, "u1")}
    assert read_accessor(primitive, made) == QUAD
    made = Document()
    position = sparse(made, 4, [1, 2, 3], [(8, 0, 0), (8, 8, 0), (0, 8, 0)], dtype)
    primitive = {"attributes": {"POSITION": position}, "indices": made.accessor(TRIANGLES, "u1")}
    made.node(name="Quad", mesh=made.add("meshes", primitives=[primitive]), translation=[4, 4, 0])
    assert boxes(made.glb()) == QUAD


@pytest.mark.parametrize("offset", [0, 4])
def test_parts_of_no_element_are_nothing(offset):
    """No triangle of a second primitive, and no change of the first, whatever their view holds."""
    made = Document()
    position = sparse(made, 4, [], [], bufferView=made.view(np.array(CORNERS, "<f4").tobytes()))
    accessor = made.json["accessors"][position]
    for part in ("indices", "values"):
        accessor["sparse"][part] |= {"bufferView": made.view(b"1234"), "byteOffset": offset}
    primitive = {"attributes": {"POSITION": position}, "indices": made.accessor(TRIANGLES, "u1")}
    none = made.accessor(np.zeros(0), "u2")
    made.json["accessors"][none]["bufferView"] = made.view(b"12")
    other = {"attributes": {"POSITION": made.accessor([(9, 9, 0)] * 3)}, "indices": none}
    made.node(name="Quad", mesh=made.add("meshes", primitives=[primitive, other]))
    assert boxes(made.glb()) == QUAD


#: Bytes of an element: matrices of small integers begin each column at a multiple of 4 bytes.
ELEMENTS = {
    "SCALAR": (1, 2, 4), "VEC2": (2, 4, 8), "VEC3": (3, 6, 12), "VEC4": (4, 8, 16),
    "MAT2": (8, 8, 16), "MAT3": (12, 24, 36), "MAT4": (16, 32, 64),
}  # fmt: skip


@pytest.mark.parametrize("kind", ELEMENTS)
@pytest.mark.parametrize(("component", "size"), [(5120, 0), (5123, 1), (5126, 2), (5125, 2)])
def test_an_accessor_of_any_type_is_as_long_as_its_elements(kind, component, size):
    made = Document()
    n_bytes = 3 * ELEMENTS[kind][size]
    made.view(bytes(n_bytes))
    made.add("accessors", bufferView=0, componentType=component, count=3, type=kind)
    glb = parse_glb(made.glb())
    budget = Budget(0)
    accessors = Accessors(glb.document, Buffers(glb, Path(), budget), budget)
    accessors.check(0)
    made.json["bufferViews"][0]["byteLength"] = n_bytes - 1
    glb = parse_glb(made.glb())
    accessors = Accessors(glb.document, Buffers(glb, Path(), budget), budget)
    with pytest.raises(
        UnreadableGltfError, match=f"needs {n_bytes} bytes of a view of {n_bytes - 1}"
    ):
        accessors.check(0)


def test_a_matrix_of_small_integers_is_not_read():
    made = Document()
    made.view(bytes(100))
    made.add("accessors", bufferView=0, componentType=5121, count=3, type="MAT3")
    glb = parse_glb(made.glb())
    budget = Budget(0)
    accessors = Accessors(glb.document, Buffers(glb, Path(), budget), budget)
    with pytest.raises(UnreadableGltfError, match="is a matrix of small integers"):
        accessors.read(0)


def test_sparse_parts_out_of_range():
    for places, what in (([4], "changes element 4 of 4"), ([0, 1, 2, 3, 3], "at most 4")):
        made = Document()
        position = sparse(made, 4, places, [(0, 0, 0)] * len(places))
        made.node(mesh=made.add("meshes", primitives=[{"attributes": {"POSITION": position}}]))
        with pytest.raises(UnreadableGltfError, match=what):
            read(made.glb())


@pytest.mark.parametrize("part", ["indices", "values"])
def test_a_sparse_part_names_its_view(part):
    """The last view of the file would do otherwise: it is as long as needed."""
    made = Document()
    position = sparse(made, 4, [1], [(0, 0, 0)])
    del made.json["accessors"][position]["sparse"][part]["bufferView"]
    made.node(mesh=made.add("meshes", primitives=[{"attributes": {"POSITION": position}}]))
    made.view(bytes(1000))
    with pytest.raises(UnreadableGltfError, match=f"sparse.{part}"):
        read(made.glb())


@pytest.mark.parametrize(
    ("change", "found"),
    [
        (lambda j: j["accessors"][0].update(count=5), r"accessors\[0\] needs 60 bytes"),
        (lambda j: j["accessors"][0].update(byteOffset=4), r"accessors\[0\] needs 52 bytes"),
        (lambda j: j["accessors"][0].update(count=2**52), "needs"),
        (lambda j: j["bufferViews"][0].update(byteLength=2**40), r"bufferViews\[0\] ends at"),
        (lambda j: j["bufferViews"][0].update(byteStride=4), "byteStride 4 is less"),
        (lambda j: j["bufferViews"][0].update(byteStride=3), "byteStride is 3"),
        (lambda j: j["accessors"][1].update(componentType=5122), "unsigned integers"),
        (lambda j: j["accessors"][0].update(type="VEC2"), "VEC3 of float"),
        (lambda j: j["meshes"][0]["primitives"][0].update(mode=7), "mode is 7"),
        (lambda j: j["meshes"][0]["primitives"][0].update(indices=9), "indices is 9"),
    ],
)
def test_ranges_are_checked_before_anything_is_made(change, found):
    made = Document()
    made.quad("Quad", 4, 4)
    made.json["buffers"] = [{"byteLength": len(made.binary)}]
    change(made.json)
    with pytest.raises(UnreadableGltfError, match=found):
        read(made.glb())


def test_a_buffer_longer_than_its_chunk():
    made = Document()
    made.quad("Quad", 4, 4)
    made.json["buffers"] = [{"byteLength": 1000}]
    with pytest.raises(UnreadableGltfError, match="should have 1000 bytes"):
        read(made.glb())


def test_an_index_beyond_the_vertices():
    made = Document()
    made.node(mesh=made.mesh(CORNERS, [0, 1, 4]))
    with pytest.raises(UnreadableGltfError, match="uses vertex 4 of 4"):
        read(made.glb())


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_broken_vertices_are_named(bad):
    made = Document()
    positions = np.array(CORNERS)
    positions = positions.astype(float)
    positions[1, 2] = bad
    made.add("meshes", name="Broken", primitives=[made.primitive(positions, TRIANGLES)])
    made.node(mesh=0)
    with pytest.raises(NonFiniteGeometryError, match=r"'Broken'.*1 of 4 vertices"):
        read(made.glb())


def test_huge_finite_vertices_are_not_broken():
    made = Document()
    made.quad("Quad", 4, 4)
    made.node(name="Far", mesh=made.mesh([(3e38, 3e38, 0), (3e38, 3e38, 1), (3e38, 3e38, 2)]))
    assert boxes(made.glb()) == QUAD


def test_primitives_of_a_mesh_are_one_instance_and_share_vertices():
    made = Document()
    first = made.primitive(CORNERS, [0, 1, 2])
    second = first | {"indices": made.accessor([0, 2, 3], "u2")}
    other = made.primitive(*square(20, 4, 8))
    made.node(name="Quad", mesh=made.add("meshes", primitives=[first, second, other]))
    snapshot = read(made.glb())
    assert len(snapshot.vertices) == 8
    assert boxes(snapshot) == [("Quad", 128, (36, 20, 60, 28))]


def test_meshes_are_stored_once_however_often_they_are_shown():
    made = Document()
    mesh = made.mesh(*square(0, 0, 4))
    for i in range(5):
        made.node(name=f"Q{i}", mesh=mesh, translation=[8 * i - 20, 0, 0])
    snapshot = read(made.glb())
    assert len(snapshot.vertices) == 4
    assert [(n, a) for n, a, _ in boxes(snapshot)] == [(f"Q{i}", 16) for i in range(5)]
