"""What a file's arrays may take in memory: each is counted, by its size, before it is made."""

from __future__ import annotations

import numpy as np
import pytest
from scene.gltf.documents import Document, png_of_alpha, read, square

from legoworld.scene.gltf import snapshot as snapshot_module
from legoworld.scene.gltf import verdicts
from legoworld.scene.gltf.verdicts import Budget, UnreadableGltfError

CORNERS, TRIANGLES = square(4, 4, 8)
WHOLE = [(0, 1), (1, 1), (1, 0), (0, 0)]
#: Of a mesh of four vertices and two triangles.
QUAD = (12 * (4 + 2), "the geometry")


@pytest.fixture
def taken(monkeypatch):
    """What was counted, in order, of the files that are read."""
    counted: list[tuple[int, str]] = []

    class Recording(Budget):
        def take(self, n_bytes, what):
            counted.append((int(n_bytes), what))
            super().take(n_bytes, what)

    monkeypatch.setattr(snapshot_module, "Budget", Recording)
    return counted


def read_quad(made, primitive, **node):
    made.node(name="Quad", mesh=made.add("meshes", primitives=[primitive]), **node)
    return read(made.glb())


def test_floats_with_indices_are_views_of_the_file(taken):
    made = Document()
    read_quad(made, made.primitive(CORNERS, TRIANGLES))
    assert taken == [QUAD]


def test_indices_that_are_not_stored_and_strips(taken):
    made = Document()
    read_quad(made, made.primitive([CORNERS[i] for i in TRIANGLES]))
    assert taken == [(4 * 6, "meshes[0].primitives[0]"), (12 * (6 + 2), "the geometry")]
    taken.clear()
    made = Document()
    read_quad(made, made.primitive(CORNERS, [0, 1, 3, 2], mode=5))  # of uint16
    assert taken == [(2 * 3 * 2, "meshes[0].primitives[0]"), QUAD]
    taken.clear()
    made = Document()
    read_quad(made, made.primitive([CORNERS[i] for i in (0, 1, 3, 2)], mode=5))  # in 32 bits
    place = "meshes[0].primitives[0]"
    assert taken == [(4 * 4, place), (2 * 3 * 4, place), QUAD]


def test_quantized_and_sparse_positions(taken):
    made = Document()
    made.json["extensionsUsed"] = ["KHR_mesh_quantization"]
    primitive = made.primitive(CORNERS, TRIANGLES)
    primitive["attributes"]["POSITION"] = made.accessor(CORNERS, "u1")
    read_quad(made, primitive)
    assert taken == [(12 * 4, "meshes[0].primitives[0]"), QUAD]
    for based in (False, True):
        taken.clear()
        made = Document()
        primitive = made.primitive(CORNERS, TRIANGLES)
        accessor = made.json["accessors"][0]
        if not based:
            del accessor["bufferView"]
        accessor["sparse"] = {
            "count": 4,
            "indices": {"bufferView": made.view(bytes(range(4))), "componentType": 5121},
            "values": {"bufferView": made.view(np.float32(CORNERS).tobytes())},
        }
        read_quad(made, primitive)
        assert taken == [(4 * 12, "accessors[0]"), QUAD]


def test_skins(taken):
    made = Document()
    primitive = made.primitive(CORNERS, TRIANGLES)
    primitive["attributes"] |= {
        "JOINTS_0": made.accessor([[0, 0, 0, 0]] * 4, "u1"),
        "WEIGHTS_0": made.accessor([[1, 0, 0, 0]] * 4),
    }
    made.add("skins", joints=[made.node(name="Root")])
    read_quad(made, primitive, skin=0)
    assert taken == [(4 * 4 * 24, "joints and weights"), (4 * 12, "skinned positions"), QUAD]


def test_instances(taken):
    made = Document()
    places = {"TRANSLATION": made.accessor([[0, 0, 0], [9, 0, 0], [18, 0, 0]])}
    instancing = {"EXT_mesh_gpu_instancing": {"attributes": places}}
    read_quad(made, made.primitive(CORNERS, TRIANGLES), extensions=instancing)
    place = "nodes[1].extensions.EXT_mesh_gpu_instancing.attributes"
    assert taken == [(256 * 3, place), QUAD]


def textured_document(alpha, uv=WHOLE, **sampler):
    made = Document()
    color = {"baseColorTexture": {"index": made.texture(alpha, **sampler)}}
    made.textured_quad({"alphaMode": "BLEND", "pbrMetallicRoughness": color}, uv)
    return made


def test_textures_and_their_tiles(taken):
    alpha = np.zeros((2, 5), np.uint8)
    alpha[0] = 255
    read(textured_document(alpha).glb())
    assert taken == [
        (2 * 48 * 2, "TEXCOORD_0"), (10, "alpha textures"), (2 * 10, "alpha textures"), QUAD,
    ]  # fmt: skip
    taken.clear()
    uv = [(0.25, 1), (2.5, 1), (2.5, 0), (0.25, 0)]
    read(textured_document(alpha, uv, wrapS=10497, wrapT=33071).glb())
    # Tiles -1 to 3 across: those that are reached, and one further on either side.
    assert taken[2] == (2 * 10 * 5, "alpha textures")
    taken.clear()
    upright = [(v, u) for u, v in uv]
    read(textured_document(alpha, upright, wrapS=33071, wrapT=10497).glb())
    assert taken[2][1] == "alpha textures"
    assert taken[2][0] > 2 * 10 * 2  # as many tiles upwards, not fewer


def test_vertex_colours(taken):
    made = textured_document(np.full((1, 1), 255))
    attributes = made.json["meshes"][0]["primitives"][0]["attributes"]
    attributes["COLOR_0"] = made.accessor([(1, 1, 1, a) for a in (0.1, 0.9, 0.9, 0.1)])
    read(made.glb())
    assert taken == [
        (4 * 4, "COLOR_0"), (3 * 24 * 2, "COLOR_0"), (2 * 48 * 2, "TEXCOORD_0"),
        (1, "alpha textures"), QUAD,
    ]  # fmt: skip


def test_files_beside_it(taken, tmp_path):
    made = Document()
    primitive = made.primitive(CORNERS, TRIANGLES)
    made.node(name="Quad", mesh=made.add("meshes", primitives=[primitive]))
    inside = bytes(made.binary)
    made.binary.clear()
    (tmp_path / "a.bin").write_bytes(inside)
    made.json["buffers"] = [{"byteLength": len(inside), "uri": "a.bin"}]
    read(made.glb(), tmp_path)
    assert taken == [(len(inside), "buffers[0]"), QUAD]
    taken.clear()
    made = textured_document(np.zeros((1, 1)))
    made.json["images"] = [{"uri": "a.png"}]
    (tmp_path / "a.png").write_bytes(png_of_alpha([[0]]))
    made.quad("Other", 0, 0)
    read(made.glb(), tmp_path)
    assert ((tmp_path / "a.png").stat().st_size, "images[0]") in taken


def test_a_budget_is_a_floor_and_a_growth_and_what_is_left_of_them(monkeypatch):
    monkeypatch.setattr(verdicts, "_FLOOR_BYTES", 1000)
    monkeypatch.setattr(verdicts, "_GROWTH", 3)
    budget = Budget(200)
    budget.take(900, "a")
    budget.take(700, "b")  # the very last byte
    assert (budget.limit, budget.bytes_left) == (1600, 0)
    budget.take(0, "c")
    with pytest.raises(UnreadableGltfError, match="d: 1 bytes when decoded; expected: at most 1,6"):
        budget.take(1, "d")
