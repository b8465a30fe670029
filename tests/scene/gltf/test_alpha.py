"""Alpha: modes, factors, textures, samplers and texture transforms, pixel by pixel.

A card of 8 x 8 px from the middle to the upper right shows a texture of 4 x 4 or fewer texels, read
without interpolation, so that every texel is a block of pixels.
"""

from __future__ import annotations

import math
import struct
import zlib

import cv2
import numpy as np
import pytest
from scene.gltf.documents import Document, boxes, mask, png_of_alpha, read

from legoworld.errors import NoMeshError
from legoworld.scene.gltf.cutouts import read_alpha, size_wh, threshold_at_half
from legoworld.scene.gltf.fields import Fields
from legoworld.scene.gltf.materials import material_alpha, varying_alpha
from legoworld.scene.gltf.verdicts import UnreadableGltfError

#: glTF's v points down: (0, 0) is the picture's upper left corner.
WHOLE = [(0, 1), (1, 1), (1, 0), (0, 0)]
TEXELS = np.array([[255, 0, 255, 255], [0, 0, 0, 255], [255, 255, 0, 0], [0, 255, 0, 0]])


def card(alpha=TEXELS, uv=WHOLE, *, mode="BLEND", factor=None, transform=None, cutoff=None,
         sampler=None):  # fmt: skip
    made = Document()
    info = {"index": made.texture(alpha, **(sampler or {}))}
    if transform is not None:
        info["extensions"] = {"KHR_texture_transform": transform}
    color = {"baseColorTexture": info}
    if factor is not None:
        color["baseColorFactor"] = [1, 1, 1, factor]
    material = {"alphaMode": mode, "pbrMetallicRoughness": color}
    if cutoff is not None:
        material["alphaCutoff"] = cutoff
    made.textured_quad(material, uv)
    return made


def draw_card(made, size=8):
    """The card's pixels, rows from the top."""
    return mask(made.glb())[32 - size : 32, 32 : 32 + size]


def blocks(texels, size=8):
    texels = np.asarray(texels) > 0
    return np.kron(texels, np.ones((size // texels.shape[0], size // texels.shape[1]))) > 0


def test_a_texture_cuts_texel_by_texel_the_right_way_up():
    assert (draw_card(card()) == blocks(TEXELS)).all()


@pytest.mark.parametrize("factor", [0.0, 0.5])
def test_a_mask_that_is_cut_off_at_nothing_shows_everything(factor):
    assert draw_card(card(mode="MASK", cutoff=0.0, factor=factor)).all()


def test_opaque_ignores_every_alpha():
    assert draw_card(card(mode="OPAQUE", factor=0.0)).all()
    assert read(card(mode="OPAQUE").glb()).cutouts == ()


@pytest.mark.parametrize(
    ("factor", "there"), [(0.0, False), (0.49, False), (0.5, True), (0.51, True), (1.0, True)]
)
def test_constant_alpha_of_blend(factor, there):
    made = Document()
    number = made.add(
        "materials", alphaMode="BLEND", pbrMetallicRoughness={"baseColorFactor": [1, 1, 1, factor]}
    )
    made.quad("Card", 0, 0)
    made.json["meshes"][0]["primitives"][0]["material"] = number
    if there:
        assert draw_card(made).all()
    else:
        with pytest.raises(NoMeshError):
            read(made.glb())


@pytest.mark.parametrize(
    ("mode", "factor", "cutoff", "least"),
    [
        ("BLEND", None, None, 128),  # 127.5 of 255
        ("BLEND", 0.75, None, 170),  # 0.75 * 170 / 255 = 0.5
        ("MASK", None, None, 128),
        ("MASK", None, 0.3, 77),  # 76.5
        ("MASK", None, 0.8, 204),  # exactly 204
        ("MASK", 0.5, 0.3, 153),  # exactly 153
        ("MASK", None, 0.0, 0),
        ("MASK", None, 1.0, 255),
        ("MASK", None, 0.999, 255),
    ],
)
def test_thresholds_are_exact_to_the_texel(mode, factor, cutoff, least):
    ramp = np.arange(256).reshape(16, 16)
    made = card(ramp, mode=mode, factor=factor, cutoff=cutoff)
    made.json["meshes"][0]["primitives"][0]["attributes"]["POSITION"] = made.accessor(
        [(0, 0, 0), (16, 0, 0), (16, 16, 0), (0, 16, 0)]
    )
    assert (draw_card(made, 16) == (ramp >= least)).all()


def test_blend_has_a_threshold_of_its_own_whatever_the_cutoff():
    ramp = np.arange(256).reshape(16, 16)
    made = card(ramp, mode="BLEND", cutoff=0.9)
    made.json["meshes"][0]["primitives"][0]["attributes"]["POSITION"] = made.accessor(
        [(0, 0, 0), (16, 0, 0), (16, 16, 0), (0, 16, 0)]
    )
    assert (draw_card(made, 16) == (ramp >= 128)).all()


def test_a_cutoff_no_alpha_reaches_removes_the_surface():
    for made in (card(mode="MASK", cutoff=1.5), card(factor=0.4)):
        with pytest.raises(NoMeshError):
            read(made.glb())


def test_interpolated_alpha_meets_any_cutoff_where_it_should():
    # 0 | 255 side by side, linear: alpha passes c at u = 0.25 + c / 2, whatever the cutoff.
    for cutoff in (0.1, 0.25, 0.5, 0.75, 0.9):
        moved = threshold_at_half(np.array([[0, 255]], np.uint8), cutoff).astype(float)
        crossing = (127.5 - moved[0, 0]) / (moved[0, 1] - moved[0, 0])
        assert crossing == pytest.approx(cutoff, abs=1 / 128)


def test_interpolation_follows_the_sampler():
    made = card([[0, 255]], sampler={"magFilter": 9729, "wrapS": 33071, "wrapT": 33071})
    assert (draw_card(made) == (np.arange(8) >= 4)).all()
    made = card([[0, 0, 255, 255]], sampler={"magFilter": 9729})
    # Repeating: halfway between the last texel and the first one again alpha is 0.5.
    assert (draw_card(made) == [0, 0, 0, 0, 1, 1, 1, 1]).all()
    assert read(made.glb()).cutouts[0].interpolation == "linear"
    assert read(card().glb()).cutouts[0].interpolation == "closest"


@pytest.mark.parametrize(
    ("wrap", "row"),
    [(10497, "01010101"), (33071, "00011111"), (33648, "10011001")],
)
def test_wrap_modes(wrap, row):
    uv = [(-1, 1), (3, 1), (3, 0), (-1, 0)]  # texels -2 .. 5 of two
    made = card([[0, 255]], uv, sampler={"wrapS": wrap, "wrapT": wrap})
    assert "".join("01"[int(x)] for x in draw_card(made)[0]) == row


@pytest.mark.parametrize("wrap_s", [10497, 33071, 33648])
@pytest.mark.parametrize("wrap_t", [10497, 33071, 33648])
def test_wrap_modes_that_differ_by_direction(wrap_s, wrap_t):
    rng = np.random.default_rng(7)
    texels = rng.integers(0, 2, (2, 2)) * 255
    texels[0, 0], texels[1, 1] = 255, 0
    uv = [(-1.5, 2.5), (2.5, 2.5), (2.5, -1.5), (-1.5, -1.5)]
    made = card(texels, uv, sampler={"wrapS": wrap_s, "wrapT": wrap_t})
    at = np.floor((-1.5 + (np.arange(8) + 0.5) / 2) * 2).astype(int)  # texel of each pixel

    def wrapped(index, wrap):
        if wrap == 10497:
            return index % 2
        if wrap == 33071:
            return np.clip(index, 0, 1)
        return np.where(index % 4 < 2, index % 4, 3 - index % 4)

    expected = texels[np.ix_(wrapped(at, wrap_t), wrapped(at, wrap_s))] > 0
    assert (draw_card(made) == expected).all()


def test_wraps_too_long_to_tile_are_warned_of():
    uv = [(0, 1), (9e3, 1), (9e3, 0), (0, 0)]
    snapshot = read(card(TEXELS, uv, sampler={"wrapS": 10497, "wrapT": 33071}).glb())
    assert any("wraps differently" in w for w in snapshot.warnings)
    (cutout,), (alpha,) = snapshot.cutouts, snapshot.cutout_alphas
    assert (cutout.wrap, alpha.tolist()) == ("repeat", TEXELS.tolist())
    corners = {(0.0, 0.0), (9e3, 0.0), (9e3, 1.0), (0.0, 1.0)}
    assert {tuple(corner) for corner in snapshot.corner_uv.reshape(-1, 2).tolist()} == corners


@pytest.mark.parametrize(
    ("transform", "expected"),
    [
        ({"offset": [0.25, 0]}, np.roll(TEXELS, -1, axis=1)),
        ({"offset": [0, 0.25]}, np.roll(TEXELS, -1, axis=0)),
        ({"scale": [0.5, 0.5]}, np.kron(TEXELS[:2, :2], np.ones((2, 2)))),
        # The texture coordinates turn counter-clockwise as one looks, the picture clockwise:
        # about the upper left corner, and repeating brings it back into view.
        ({"rotation": math.pi / 2}, np.rot90(TEXELS, -1)),
        ({"rotation": math.pi / 2, "scale": [0.5, 1], "offset": [0.5, 0]}, None),
    ],
)
def test_texture_transforms(transform, expected):
    if expected is None:
        # u' = 0.5 + v, v' = -0.5 u: of pixel (row, column) at u, v = (c + 0.5) / 8, (r + 0.5) / 8.
        at = (np.arange(8) + 0.5) / 8
        column = np.floor((0.5 + at) % 1 * 4).astype(int)
        row = np.floor((-0.5 * at) % 1 * 4).astype(int)
        expected = TEXELS[row[None, :], column[:, None]]
        assert (draw_card(card(transform=transform)) == (expected > 0)).all()
        return
    assert (draw_card(card(transform=transform)) == blocks(expected)).all()


def test_the_texture_coordinate_set_is_the_textures_and_the_transforms_wins():
    made = card(uv=[(0.1, 0.1)] * 4)
    attributes = made.json["meshes"][0]["primitives"][0]["attributes"]
    attributes["TEXCOORD_1"] = made.accessor(WHOLE)
    info = made.json["materials"][0]["pbrMetallicRoughness"]["baseColorTexture"]
    assert draw_card(made).all()  # all of it is the upper left texel
    info["texCoord"] = 1
    assert (draw_card(made) == blocks(TEXELS)).all()
    info["extensions"] = {"KHR_texture_transform": {"texCoord": 0}}
    assert draw_card(made).all()
    info["texCoord"] = 5
    info["extensions"] = {}
    snapshot = read(made.glb())
    said = "a mesh has no TEXCOORD_5; its surface is taken as opaque"
    assert f"material 'material 0': {said}" in snapshot.warnings
    made.json["materials"][0]["name"] = "Leaf"
    assert f"material 'Leaf': {said}" in read(made.glb()).warnings
    assert draw_card(made).all()


def test_quantized_texture_coordinates():
    made = card()
    attributes = made.json["meshes"][0]["primitives"][0]["attributes"]
    attributes["TEXCOORD_0"] = made.accessor(np.array(WHOLE) * 65535, "u2", normalized=True)
    assert (draw_card(made) == blocks(TEXELS)).all()


def test_vertex_colours():
    def colored(alphas):
        made = card(np.full((1, 1), 255), factor=0.8)
        attributes = made.json["meshes"][0]["primitives"][0]["attributes"]
        attributes["COLOR_0"] = made.accessor([(1, 1, 1, a) for a in alphas])
        return made

    assert draw_card(colored([0.7] * 4)).all()
    with pytest.raises(NoMeshError):
        read(colored([0.6] * 4).glb())  # 0.48


#: Of the card's corners: at its left edge 0.1, at its right edge 0.9; 0.5 is passed in the middle.
LEFT_TO_RIGHT = [0.1, 0.9, 0.9, 0.1]


def paint_alpha(alphas, dtype="f4", texels=None, **kwargs):
    made = card(np.full((1, 1), 255) if texels is None else texels, **kwargs)
    attributes = made.json["meshes"][0]["primitives"][0]["attributes"]
    colors = np.array([(1, 1, 1, a) for a in alphas])
    if dtype == "f4":
        attributes["COLOR_0"] = made.accessor(colors)
    else:
        top = np.iinfo(dtype).max
        attributes["COLOR_0"] = made.accessor(np.rint(colors * top), dtype, normalized=True)
    return made


@pytest.mark.parametrize("dtype", ["f4", "u1", "u2"])
def test_alpha_that_varies_by_vertex_cuts_where_it_is_interpolated(dtype):
    made = paint_alpha(LEFT_TO_RIGHT, dtype)
    assert (draw_card(made) == (np.arange(8) >= 4)).all()
    assert read(made.glb()).warnings == read(card().glb()).warnings


@pytest.mark.parametrize(
    ("mode", "cutoff", "factor", "columns"),
    [
        ("OPAQUE", None, 0.1, 8),
        ("MASK", 0.3, None, 6),  # 0.1 + 0.8 u >= 0.3 from u = 0.25 on
        ("MASK", 0.0, 0.1, 8),
        ("BLEND", None, 0.8, 3),  # 0.1 + 0.8 u >= 0.625 from u = 0.656 on
        ("BLEND", None, 0.5, 0),
        ("BLEND", None, 0.0, 0),
    ],
)
def test_vertex_alpha_under_every_mode_and_factor(mode, cutoff, factor, columns):
    made = paint_alpha(LEFT_TO_RIGHT, mode=mode, cutoff=cutoff, factor=factor)
    if not columns:
        with pytest.raises(NoMeshError):
            read(made.glb())
        return
    assert (draw_card(made) == (np.arange(8) >= 8 - columns)).all()


def test_vertex_alpha_times_a_texture():
    texels = [[255, 255, 255, 255], [255, 255, 200, 200], [0, 0, 0, 255], [180, 180, 180, 180]]
    made = paint_alpha(LEFT_TO_RIGHT, texels=texels)
    alpha = np.kron(np.array(texels) / 255, np.ones((2, 2))) * (
        0.1 + 0.8 * (np.arange(8) + 0.5) / 8
    )
    assert (draw_card(made) == (alpha >= 0.5)).all()


@pytest.mark.parametrize("dtype", ["f4", "u1"])
def test_one_alpha_at_all_vertices_is_stored_as_a_factor(dtype):
    same = read(paint_alpha([0.8] * 4, dtype, TEXELS).glb())
    factor = read(card(TEXELS, factor=0.8).glb())
    assert same.corner_alpha.tolist() == factor.corner_alpha.tolist()
    assert same.triangle_cutout.tolist() == factor.triangle_cutout.tolist()
    varying = read(paint_alpha([0.8, 0.8, 0.8, 0.7], dtype, TEXELS).glb())
    assert len(varying.corner_alpha) > len(factor.corner_alpha)


def test_triangles_whose_corners_are_all_above_or_below_need_no_cut_out():
    snapshot = read(paint_alpha([0.6, 0.7, 0.8, 0.9]).glb())
    assert snapshot.cutouts == ()
    snapshot = read(paint_alpha([0.1, 0.2, 0.3, 0.9]).glb())
    assert len(snapshot.triangles) == 1
    assert len(snapshot.corner_alpha) == 1


def test_a_triangle_that_is_whole_beside_one_that_is_cut():
    made = paint_alpha([0.9, 0.9, 0.9, 0.1])  # (0, 1, 2) and (0, 2, 3)
    snapshot = read(made.glb())
    assert snapshot.triangle_cutout.tolist() == [-1, 0]
    assert snapshot.corner_alpha[1].tolist() == pytest.approx([0.9, 0.9, 0.1])
    cut = draw_card(made)
    assert cut[np.arange(8)[:, None] + np.arange(8)[None, :] > 7].all()  # below the diagonal
    assert not cut[0, 0]
    assert not cut.all()


def test_vertex_colours_that_are_no_colours_are_refused():
    made = paint_alpha([0.1, float("nan"), 1, 1])
    with pytest.raises(UnreadableGltfError, match="COLOR_0"):
        read(made.glb())
    made = card(np.full((1, 1), 255))
    attributes = made.json["meshes"][0]["primitives"][0]["attributes"]
    attributes["COLOR_0"] = made.accessor([(1, 1, 1, 0.2), (1, 1, 1, 1.0)])
    with pytest.raises(UnreadableGltfError, match="COLOR_0"):
        read(made.glb())


@pytest.mark.parametrize(("mode", "cutoff"), [("OPAQUE", None), ("MASK", 0.0), (None, None)])
def test_what_shows_everything_has_no_threshold(mode, cutoff):
    values = {"alphaMode": mode, "alphaCutoff": cutoff,
              "pbrMetallicRoughness": {"baseColorFactor": [1, 1, 1, 0.0]}}  # fmt: skip
    material = Fields({k: v for k, v in values.items() if v is not None}, "materials[0]")
    assert material_alpha(Fields({}), material, 0.05) == "opaque"
    assert varying_alpha(Fields({}), material) == "opaque"


def test_specular_glossiness_materials():
    made = card()
    texture = made.json["materials"][0].pop("pbrMetallicRoughness")["baseColorTexture"]
    glossy = {"diffuseFactor": [1, 1, 1, 1], "diffuseTexture": texture}
    made.json["materials"][0]["extensions"] = {"KHR_materials_pbrSpecularGlossiness": glossy}
    assert (draw_card(made) == blocks(TEXELS)).all()
    glossy["diffuseFactor"] = [1, 1, 1, 0.4]
    with pytest.raises(NoMeshError):
        read(made.glb())


@pytest.mark.parametrize("kind", ["jpeg", "rgb", "gray", "opaque"])
def test_pictures_without_alpha_cut_nothing(kind):
    picture = np.full((4, 4, 3), 90, np.uint8)
    data = cv2.imencode(".jpg" if kind == "jpeg" else ".png",
                        picture[..., 0] if kind == "gray" else picture)[1].tobytes()  # fmt: skip
    if kind == "opaque":
        data = png_of_alpha(np.full((4, 4), 255))
    made = card()
    made.json["images"][0]["bufferView"] = made.view(data)
    snapshot = read(made.glb())
    assert snapshot.cutouts == ()
    assert not any("alpha texture" in w for w in snapshot.warnings)
    assert draw_card(made).all()


@pytest.mark.parametrize("kind", [".png", ".webp"])
def test_deep_png_and_webp(kind):
    alpha = np.array([[0, 255], [200, 40]], np.uint8)
    picture = np.full((2, 2, 4), 100, np.uint16 if kind == ".png" else np.uint8)
    picture[..., 3] = alpha.astype(picture.dtype) * (257 if kind == ".png" else 1)
    options = [] if kind == ".png" else [cv2.IMWRITE_WEBP_QUALITY, 101]
    data = cv2.imencode(kind, picture, options)[1].tobytes()
    found, why = read_alpha(data)
    assert why == ""
    assert found.tolist() == alpha.tolist()


def test_deep_alpha_is_rounded_to_eight_bits():
    alpha = np.array([[0, 128, 129, 300, 385, 386, 65406, 65407, 65535]], np.uint16)
    picture = np.full((1, 9, 4), 100, np.uint16)
    picture[..., 3] = alpha
    found, _ = read_alpha(cv2.imencode(".png", picture)[1].tobytes())
    assert found.tolist() == [[0, 0, 1, 1, 1, 2, 254, 255, 255]]


@pytest.mark.parametrize(
    ("header", "expected"),
    [
        (b"VP8X" + bytes(8) + b"\x03\x00\x00" + b"\x01\x01\x00", (4, 258)),
        (b"VP8L" + bytes(5) + (0x3FFE | 9 << 14).to_bytes(4, "little") + bytes(6), (16383, 10)),
        (b"VP8L" + bytes(5) + (15 | 9 << 14 | 1 << 28).to_bytes(4, "little") + bytes(6), (16, 10)),
        (b"VP8L" + bytes(4) + b"\xff" + (5 | 9 << 14).to_bytes(4, "little") + b"\xff" * 6, (6, 10)),
        (b"VP8 " + bytes(10) + (0x4000 | 12).to_bytes(2, "little") + b"\x07\xc0", (12, 7)),
        (b"ALPH" + bytes(14), (0, 0)),
    ],
)
def test_the_size_of_a_webp_by_its_first_chunk(header, expected):
    data = b"RIFF\0\0\0\0WEBP" + header
    assert len(data) >= 30
    assert size_wh(data) == expected
    assert size_wh(data[:29]) == (0, 0)


@pytest.mark.parametrize(
    ("size", "sound"),
    [((1, 1), True), ((0, 5), False), ((5, 0), False), ((8192, 8192), True), ((8192, 8193), False),
     ((16384, 1), True), ((16385, 1), False), ((1, 16385), False)],
)  # fmt: skip
def test_the_largest_picture_that_is_decoded(size, sound):
    data = b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR" + struct.pack(">II", *size) + bytes(9)
    assert size_wh(data) == (size if sound else (0, 0))
    assert size_wh(data[:32]) == (0, 0)


@pytest.mark.parametrize(
    ("data", "why"),
    [
        (b"", "is neither PNG"),
        (b"\xabKTX 20\xbb\r\n\x1a\n" + bytes(100), "is neither PNG"),
        (png_of_alpha(TEXELS)[:40], "does not decode"),
        (png_of_alpha(TEXELS)[:16] + b"\0\1\0\0\0\1\0\0" + bytes(20), "is neither PNG"),
        (b"RIFF\0\0\0\0WEBPVP8X" + bytes(20), "does not decode"),
        (png_of_alpha(TEXELS).replace(b"IDAT", b"IDAt"), "does not decode"),
        # A chunk that claims 2 GB: the decoder would make room for it.
        (png_of_alpha(TEXELS)[:33] + b"\x7f\xff\xff\xf0IDAT" + bytes(50), "does not decode"),
    ],
)
def test_pictures_that_do_not_decode_are_opaque_with_a_warning(data, why):
    made = card()
    made.json["images"][0]["bufferView"] = made.view(data)
    made.json["materials"][0]["name"] = "Leaf"
    assert any(w.startswith(f"material 'Leaf': its alpha texture {why}")
               for w in read(made.glb()).warnings)  # fmt: skip
    assert draw_card(made).all()


def test_missing_picture_files_are_opaque_with_a_warning(tmp_path):
    made = card()
    made.json["images"][0] = {"uri": "leaf.png"}
    assert any("is missing" in w for w in read(made.glb(), tmp_path).warnings)
    (tmp_path / "leaf.png").write_bytes(png_of_alpha(TEXELS))
    assert boxes(read(made.glb(), tmp_path))[0][1] == int(blocks(TEXELS).sum())


def test_broken_texture_coordinates_and_modes_are_verdicts():
    with pytest.raises(UnreadableGltfError, match="TEXCOORD_0 holds NaN"):
        read(card(uv=[(np.nan, 0), (1, 1), (1, 0), (0, 0)]).glb())
    with pytest.raises(UnreadableGltfError, match="TEXCOORD_0 is not VEC2 a vertex"):
        read(card(uv=[(0, 1, 0), (1, 1, 0), (1, 0, 0), (0, 0, 0)]).glb())
    with pytest.raises(UnreadableGltfError, match="alphaMode is 'GLASS'"):
        read(card(mode="GLASS").glb())
    with pytest.raises(UnreadableGltfError, match="wrapS is 5"):
        read(card(sampler={"wrapS": 5}).glb())


def test_cut_outs_of_several_meshes_keep_their_own():
    made = card()
    number = made.add(
        "materials", alphaMode="BLEND",
        pbrMetallicRoughness={"baseColorTexture": {"index": made.texture([[0, 255]])}},
    )  # fmt: skip
    made.quad("Solid", -8, 0)
    card_two = made.textured_quad({"alphaMode": "OPAQUE"}, WHOLE, x=8, name="Two")
    mesh = made.json["nodes"][card_two]["mesh"]
    made.json["meshes"][mesh]["primitives"][0]["material"] = number
    found = {name: area for name, area, _ in boxes(made.glb())}
    assert found == {"Card": int(blocks(TEXELS).sum()), "Solid": 64, "Two": 32}


def test_palettes_with_transparency_and_other_chunks():
    def chunk(kind, data):
        sum_of = zlib.crc32(kind + data)
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", sum_of)

    header = struct.pack(">IIBBBBB", 2, 2, 8, 3, 0, 0, 0)  # 2 x 2, palette
    data = b"".join([
        b"\x89PNG\r\n\x1a\n", chunk(b"IHDR", header), chunk(b"tEXt", b"a\0b"),
        chunk(b"PLTE", bytes(9)), chunk(b"tRNS", bytes([0, 90])),
        chunk(b"IDAT", zlib.compress(bytes([0, 0, 1, 0, 2, 1]))), chunk(b"IEND", b""),
    ])  # fmt: skip
    found, why = read_alpha(data)
    assert why == ""
    assert found.tolist() == [[0, 90], [255, 90]]
