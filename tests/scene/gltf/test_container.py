"""The container and its JSON: every way to be damaged has a verdict that says what is wrong."""

from __future__ import annotations

import base64
import json
import struct
from pathlib import Path

import pytest
from scene.gltf.documents import Document, boxes, glb_of, read, square

from legoworld.errors import NoCameraError, NoMeshError, SceneInvalidError
from legoworld.scene.artefacts import check_glb
from legoworld.scene.gltf.buffers import external_files
from legoworld.scene.gltf.fields import Fields
from legoworld.scene.gltf.verdicts import UnreadableGltfError, UnsupportedGltfError

QUAD = ("Quad", 64, (36, 20, 44, 28))  # 4..12 right of the middle, 4..12 above it


def quad() -> Document:
    made = Document()
    made.quad("Quad", 4, 4)
    return made


def test_a_minimal_file_is_read_exactly():
    assert boxes(quad().glb()) == [QUAD]


@pytest.mark.parametrize(
    ("damage", "found"),
    [
        (lambda _: b"", "0 bytes"),
        (lambda d: d[:19], "19 bytes"),
        (lambda d: b"gltF" + d[4:], "begins with b'gltF'"),
        (lambda d: d[:4] + b"\1" + d[5:], "version 1"),
        (lambda d: d[:-4], "its header says"),
        (lambda d: d + b"\0", "its header says"),
        (lambda d: d[:16] + b"BIN\0" + d[20:], "first chunk is not JSON"),
        (lambda d: d[:12] + b"\xff\xff\xff\x7f" + d[16:], "cut short"),
        (lambda _: glb_of(b"{"), "does not parse"),
        (lambda _: glb_of(b"\xff\xfe{}"), "does not parse"),
        (lambda _: glb_of(b"[" * 100_000), "does not parse"),
        (lambda _: glb_of(b'{"asset": NaN}'), "NaN is not JSON"),
        (lambda _: glb_of(b"9" * 5000), "does not parse"),
        (lambda _: glb_of(b"[]"), "its JSON is a list"),
        (lambda _: glb_of(b"{}"), "asset.version is ''"),
        (lambda _: glb_of(b'{"asset": {"version": "1.0"}}'), "asset.version is '1.0'"),
        (lambda _: glb_of(b'{"asset": {"version": 2}}'), "asset.version is 2"),
    ],
)
def test_damaged_containers(damage, found):
    with pytest.raises(UnreadableGltfError, match="not a usable glTF") as verdict:
        read(damage(quad().glb()))
    assert found in str(verdict.value)


def test_other_chunks_are_skipped():
    whole = quad().glb()
    extra = struct.pack("<II", 4, 0x12345678) + b"1234"
    longer = whole[:8] + struct.pack("<I", len(whole) + len(extra)) + whole[12:] + extra
    assert boxes(longer) == [QUAD]


def test_the_binary_chunk_is_the_second_and_of_its_kind():
    whole = quad().glb()
    (length,) = struct.unpack_from("<I", whole, 12)
    at = 20 + length  # of the second chunk's header
    renamed = whole[: at + 4] + struct.pack("<I", 0x12345678) + whole[at + 8 :]
    only = struct.pack("<III", 0x46546C67, 2, at) + whole[12:at]
    for data in (renamed, only):
        with pytest.raises(UnreadableGltfError, match=r"buffers\[0\] has no bytes"):
            read(data)
    cut = whole[:8] + struct.pack("<I", at + 4) + whole[12 : at + 4]
    with pytest.raises(UnreadableGltfError, match="a chunk's header is cut short"):
        read(cut)


@pytest.mark.parametrize(
    "uri", ["data:;base64,AA A", "data:;base64,A*==", "data:,AAAA", "data:;base64"]
)
def test_data_uris_that_are_none(uri):
    made = quad()
    made.binary.clear()
    made.json["buffers"] = [{"byteLength": 1, "uri": uri}]
    with pytest.raises(UnreadableGltfError, match=r"buffers\[0\]\.uri"):
        read(made.glb())


def test_required_extensions_that_are_unknown_are_named():
    made = quad()
    made.json["extensionsRequired"] = ["KHR_materials_unlit", "ACME_voxels"]
    with pytest.raises(UnsupportedGltfError, match="ACME_voxels") as verdict:
        read(made.glb())
    assert "found: ACME_voxels;" in str(verdict.value)
    made.json["extensionsRequired"] = ["KHR_materials_unlit"]
    assert boxes(made.glb()) == [QUAD]


@pytest.mark.parametrize(
    "name",
    [
        "EXT_mesh_gpu_instancing", "EXT_meshopt_compression", "EXT_texture_avif",
        "EXT_texture_webp", "KHR_animation_pointer", "KHR_draco_mesh_compression",
        "KHR_lights_punctual", "KHR_materials_clearcoat", "KHR_mesh_quantization",
        "KHR_node_visibility", "KHR_texture_basisu", "KHR_texture_transform", "KHR_xmp_json_ld",
        "MSFT_texture_dds",
    ],
)  # fmt: skip
def test_an_extension_that_is_read_or_changes_no_surface_may_be_required(name):
    made = quad()
    made.json["extensionsRequired"] = [name]
    assert boxes(made.glb()) == [QUAD]
    made.json["extensionsRequired"] = [name, f"{name[:3]}_{name}"]
    with pytest.raises(UnsupportedGltfError) as verdict:
        read(made.glb())
    assert name in verdict.value.expected or name.startswith("KHR_materials_")
    assert verdict.value.expected.endswith(" or KHR_materials_*")


def test_a_file_s_own_settings_are_plain_metres_and_square_pixels():
    made = quad()
    made.json["scenes"][0]["name"] = "Attic"
    snapshot = read(made.glb())
    assert vars(snapshot.render) == {
        "resolution_x": 1080, "resolution_y": 1080, "resolution_percentage": 100,
        "pixel_aspect_x": 1.0, "pixel_aspect_y": 1.0, "use_border": False, "frame": 0,
        "subframe": 0.0, "unit_system": "METRIC", "unit_scale": 1.0, "scene_name": "Attic",
        "view_layer": "",
    }  # fmt: skip
    camera = {k: v for k, v in vars(snapshot.camera).items() if k != "world_from_camera"}
    assert camera == {
        "name": "Camera", "type": "ORTHO", "lens_mm": 36.0, "sensor_width_mm": 36.0,
        "sensor_height_mm": 36.0, "sensor_fit": "AUTO", "shift_x": 0.0, "shift_y": 0.0,
        "ortho_scale": 64.0, "clip_start": 0.1, "clip_end": 100,
    }  # fmt: skip
    (warning,) = snapshot.warnings
    assert warning.startswith("scene.glb records no picture size")
    assert snapshot.collections == ()
    assert [(o.name, o.type, o.parent, o.instance_type, o.library) for o in snapshot.objects] == [
        ("Camera", "CAMERA", -1, "NONE", None), ("Quad", "MESH", -1, "NONE", None),
    ]  # fmt: skip
    assert snapshot.occurrence_object.tolist() == [0, 1]
    assert snapshot.occurrence_instancer.tolist() == [-1, -1]
    assert snapshot.occurrence_frame.tolist() == [0, 0]
    assert snapshot.surface_occurrence.tolist() == [1]
    assert snapshot.surface_mesh.tolist() == snapshot.surface_holdout.tolist() == [0]
    matrix = [[1, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0]]
    assert snapshot.world_from_mesh.tolist() == [matrix]


def test_no_camera_and_no_mesh_have_their_own_verdicts():
    without = Document(camera=False)
    without.quad("Quad", 4, 4)
    with pytest.raises(NoCameraError):
        read(without.glb())
    with pytest.raises(NoMeshError):
        read(Document().glb())


@pytest.mark.parametrize(
    ("change", "place"),
    [
        (lambda j: j["nodes"][1].update(mesh=7), "nodes[1].mesh is 7"),
        (lambda j: j["nodes"][1].update(mesh=-1), "nodes[1].mesh is -1"),
        (lambda j: j["nodes"][1].update(mesh=True), "nodes[1].mesh is True"),
        (lambda j: j["nodes"][1].update(scale=[1, 1]), "nodes[1].scale is [1, 1]"),
        (lambda j: j["nodes"][1].update(scale=[1, 1, 10**400]), "nodes[1].scale"),
        (lambda j: j["meshes"][0].update(primitives=3), "meshes[0].primitives is 3"),
        (lambda j: j["accessors"][0].update(count=1.5), "accessors[0].count is 1.5"),
        (lambda j: j["accessors"][0].update(componentType=5124), "accessors[0].componentType"),
        (lambda j: j["accessors"][0].update(type="VEC5"), "accessors[0].type is 'VEC5'"),
        (lambda j: j["bufferViews"][0].pop("buffer"), "bufferViews[0].buffer is nothing"),
        (lambda j: j["cameras"][0]["orthographic"].update(znear="0"), "orthographic.znear is '0'"),
        (lambda j: j.update(nodes={}), "nodes is {}"),
    ],
)
def test_values_of_the_wrong_kind_are_named_by_their_place(change, place):
    made = quad()
    change(made.json)
    with pytest.raises(UnreadableGltfError) as verdict:
        read(made.glb())
    assert place in str(verdict.value)


def test_a_name_no_encoding_can_hold_is_replaced():
    made = quad()
    made.json["nodes"][1]["name"] = "Qu\ud800ad"
    snapshot = read(made.glb())
    assert snapshot.objects[1].name == "Qu?ad"
    assert len(snapshot.content_sha256()) == 64


def test_data_uris_and_files_in_the_folder_are_read(tmp_path):
    made = quad()
    inside = bytes(made.binary)
    made.binary.clear()
    data = base64.b64encode(inside).decode()
    uri = f"data:application/octet-stream;base64,{data}"
    made.json["buffers"] = [{"byteLength": len(inside), "uri": uri}]
    assert boxes(made.glb()) == [QUAD]
    (tmp_path / "sub").mkdir()
    (tmp_path / "sub" / "a b.bin").write_bytes(inside)
    made.json["buffers"][0]["uri"] = "sub/a%20b.bin"
    assert boxes(read(made.glb(), tmp_path)) == [QUAD]
    (tmp_path / "sub" / "a b.bin").unlink()
    with pytest.raises(UnreadableGltfError, match=r"buffers\[0\] has no bytes"):
        read(made.glb(), tmp_path)


@pytest.mark.parametrize(
    "uri",
    ["../out.bin", "/etc/passwd", "file:///etc/passwd", "http://example.org/a.bin", "link.bin",
     "a/../../out.bin", "%2e%2e/out.bin", "./a:b.bin", "a\\b.bin", "a.bin?b", "a.bin#b",
     "C:\\out.bin", "..\\out.bin", "//host/share", "", "a\0b", "%ff.bin"],
)  # fmt: skip
def test_uris_that_lead_out_of_the_folder_are_refused(uri, tmp_path):
    folder = tmp_path / "scene"
    folder.mkdir()
    (tmp_path / "out.bin").write_bytes(bytes(1000))
    (folder / "link.bin").symlink_to(tmp_path / "out.bin")
    made = quad()
    made.binary.clear()
    made.json["buffers"] = [{"byteLength": 100, "uri": uri}]
    with pytest.raises(SceneInvalidError, match=r"outside its folder.*next: export a self-contain"):
        read(made.glb(), folder)
    (folder / "scene.glb").write_bytes(made.glb())
    with pytest.raises(SceneInvalidError, match="outside its folder"):
        check_glb(folder / "scene.glb")


def test_files_that_a_document_names():
    owners = {
        "buffers": [{"byteLength": 1, "uri": "b.bin"}, {"uri": "data:;base64,AA=="}, {}],
        "images": [{"uri": "sub/a%20b.png"}, {"uri": "b.bin"}, {"bufferView": 0}],
    }
    assert external_files(Fields(owners), Path("folder")) == ["b.bin", "sub/a b.png"]
    assert external_files(Fields({}), Path("folder")) == []
    with pytest.raises(SceneInvalidError, match=r"found: x{200};"):
        external_files(Fields({"images": [{"uri": "x" * 200 + "?y"}]}), Path("folder"))


def test_check_glb_reads_ranges_without_decoding(tmp_path):
    path = tmp_path / "scene.glb"
    path.write_bytes(quad().glb())
    check_glb(path)
    without_camera = Document(camera=False)
    without_camera.quad("Quad", 4, 4)
    path.write_bytes(without_camera.glb())
    check_glb(path)
    broken = quad()
    broken.json["accessors"][1]["count"] = 7
    path.write_bytes(broken.glb())
    with pytest.raises(UnreadableGltfError, match=r"accessors\[1\] needs 14 bytes"):
        check_glb(path)
    path.write_bytes(Document().glb())
    with pytest.raises(UnreadableGltfError, match="no mesh with positions"):
        check_glb(path)


def test_a_file_cannot_claim_more_memory_than_its_size_allows():
    made = Document()
    positions, indices = square(4, 4, 8)
    mesh = made.mesh(positions, indices)
    made.json["accessors"][0] = {"componentType": 5126, "count": 2**40, "type": "VEC3"}
    made.node(name="Quad", mesh=mesh)
    with pytest.raises(UnreadableGltfError, match="when decoded"):
        read(made.glb())


def test_many_primitives_of_one_big_accessor_stay_within_the_budget():
    made = Document()
    made.view(bytes(1 << 20))
    made.add("accessors", bufferView=0, componentType=5121, count=1 << 20, type="SCALAR")
    made.json["extensionsUsed"] = ["KHR_mesh_quantization"]
    made.add("accessors", bufferView=0, componentType=5121, count=1 << 18, type="VEC3")
    primitive = {"attributes": {"POSITION": 1}, "indices": 0, "mode": 5}
    made.node(mesh=made.add("meshes", primitives=[primitive] * 10_000))
    with pytest.raises(UnreadableGltfError, match="at most"):
        read(made.glb())


def test_the_document_of_a_glb_may_hold_any_json_where_it_is_not_read():
    made = quad()
    made.json["extras"] = {"deep": json.loads("[" * 500 + "]" * 500)}
    made.json["nodes"][1]["extras"] = ["not", "an", "object"]
    assert boxes(made.glb()) == [QUAD]
