"""Evidence from what people bring, and what is refused."""

from __future__ import annotations

import io
import json
import struct
import zipfile
import zlib

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays
from pycocotools import mask as rle

from legoworld.cli import run
from legoworld.evaluation.detection.inputs.masks import measure_masks
from legoworld.plugin.evidence import EvidenceInvalidError, read_evidence
from legoworld.plugin.evidence_runs import depth_file
from legoworld.plugin.make_evidence import UserEvidence, make_evidence
from legoworld.readouts.family import protocol
from legoworld.readouts.masks import covered_px

W, H = 64, 48
SQUARE = [[10, 10], [30, 10], [30, 26], [10, 26]]


@pytest.fixture
def photo(tmp_path):
    path = tmp_path / "photo.png"
    cv2.imwrite(str(path), np.random.default_rng(0).integers(0, 255, (H, W, 3), np.uint8))
    return path


def make(tmp_path, photo, regions=None, **options):
    paths = []
    if regions is not None:
        (tmp_path / "regions.json").write_text(json.dumps(regions))
        paths = [tmp_path / "regions.json"]
    values = {
        "photo": photo, "regions": paths, "image_id": None, "vocabulary": None, "depth": None,
        "depth_space": "depth", "hfov_deg": None, **options,
    }  # fmt: skip
    make_evidence(UserEvidence(**values), tmp_path / "evidence")
    return read_evidence(tmp_path / "evidence")


def test_an_outline_is_its_polygon(tmp_path, photo):
    evidence = make(tmp_path, photo, {"regions": [{"name": "sofa", "polygons": [SQUARE]}]})
    region = evidence.region("sofa")
    assert region.bbox_xywh_px == (10, 10, 20, 16)
    assert evidence.mask(region).sum() == region.area_px == 320


def test_results_are_named_by_category_best_first(tmp_path, photo):
    mask = np.zeros((H, W), np.uint8, order="F")
    mask[5:15, 5:25] = 1
    encoded = rle.encode(mask)
    shape = {"size": [H, W], "counts": encoded["counts"].decode()}
    results = [
        {"image_id": 7, "category_id": 62, "score": 0.5, "bbox": [1, 2, 10, 20]},
        {"image_id": 7, "category_id": 62, "score": 0.9, "segmentation": shape},
        {"image_id": 7, "category_id": 1, "score": 0.1, "bbox": [1, 2, 10, 20]},
        {"image_id": 8, "category_id": 1, "score": 0.9, "bbox": [1, 2, 10, 20]},
    ]
    vocabulary = protocol("coco", None).vocabulary
    evidence = make(tmp_path, photo, results, image_id=7, vocabulary=vocabulary)
    assert [r.name for r in evidence.file.regions] == ["chair 1", "chair 2"]
    assert (evidence.mask(evidence.region("chair 1")) == mask).all()
    assert evidence.region("chair 2").area_px == 200


def test_of_an_amodal_result_the_visible_part_is_taken_and_a_hidden_one_left_out(tmp_path, photo):
    whole, seen = np.zeros((2, H, W), np.uint8)
    whole[5:15, 5:25] = seen[5:15, 5:9] = 1
    shapes = [
        {"size": [H, W], "counts": rle.encode(np.asfortranarray(m))["counts"].decode()}
        for m in (whole, seen, whole * 0)
    ]
    results = [
        {"image_id": 7, "category_id": 62, "score": 1.0, "segmentation": shapes[0],
         "visible_mask": shapes[n]}
        for n in (2, 1)
    ]  # fmt: skip
    vocabulary = protocol("amodal", None).vocabulary
    evidence = make(tmp_path, photo, results, vocabulary=vocabulary)
    (region,) = evidence.file.regions
    assert region.name == "chair 1"
    assert (evidence.mask(region) == seen).all()


@pytest.mark.parametrize(
    ("regions", "why"),
    [
        ({"regions": [{"name": "a", "polygons": [[[1, 1], [2, 2]]]}]}, "no outline"),
        ({"regions": [{"name": "a", "polygons": [[[99, 99], [120, 99], [120, 120]]]}]}, "outside"),
        ({"regions": [{"name": "a", "polygons": [SQUARE]}] * 2}, "one name"),
        ({"areas": []}, "regions"),
        ([{"image_id": 1, "category_id": 1, "score": 1.0}], "without a shape"),
        ([{"image_id": 1, "category_id": 1, "score": 1.0,
           "segmentation": {"size": [9, 9], "counts": "o2"}}], "another photo"),
        *(([{"image_id": 1, "category_id": 1, "score": 1.0,
             "segmentation": {"size": [H, W], "counts": counts}}], why)
          for counts, why in (("o2", "run lengths of 95 pixels"), ("", "no run lengths"),
                              ("o2\u00e9", "no run lengths"), ("o", "no run lengths"),
                              ("oooooooo2", "no run lengths"))),
        ([{"image_id": 1, "category_id": 1, "score": 1.0, "bbox": [0, 0, 1e300, 9]}], "too far"),
        ({"regions": [{"name": "a", "polygons": [[[1, 1], [4e8, 1], [2, 9]]]}]}, "too far"),
    ],
)  # fmt: skip
def test_regions_that_cannot_be_used_are_refused(tmp_path, photo, regions, why):
    with pytest.raises(EvidenceInvalidError, match=why):
        make(tmp_path, photo, regions)


def test_a_mask_of_another_size_in_evidence_itself_is_refused(tmp_path, photo):
    make(tmp_path, photo, {"regions": [{"name": "sofa", "polygons": [SQUARE]}]})
    path = tmp_path / "evidence" / "evidence.json"
    document = json.loads(path.read_text())
    document["regions"][0]["counts"] = "o2"
    path.write_text(json.dumps(document))
    with pytest.raises(EvidenceInvalidError, match=r"'sofa' of evidence\.json cannot be"):
        read_evidence(tmp_path / "evidence")


@given(pixels=arrays.arrays(np.uint8, (13, 17), elements=st.integers(0, 1)))
def test_run_lengths_are_counted_as_pycocotools_writes_them(pixels):
    text = rle.encode(np.asfortranarray(pixels))["counts"].decode()
    assert covered_px(text) == pixels.size
    assert covered_px(text) == measure_masks([text])[0][0]
    assert covered_px(text[:-1]) == measure_masks([text[:-1]])[0][0]


def test_results_of_other_images_are_refused(tmp_path, photo):
    entry = {"category_id": 1, "score": 1.0, "bbox": [1, 1, 9, 9]}
    results = [{**entry, "image_id": i} for i in (1, 2)]
    with pytest.raises(EvidenceInvalidError, match="other images"):
        make(tmp_path, photo, results)


@pytest.mark.parametrize("space", ["depth", "disparity"])
def test_depth_of_either_space_is_disparity_when_it_is_read(tmp_path, photo, space):
    values = np.full((H, W), 4.0, np.float32)
    values[0, 0] = np.inf
    np.save(tmp_path / "d.npy", values)
    evidence = make(tmp_path, photo, depth=tmp_path / "d.npy", depth_space=space)
    assert evidence.disparity[5, 5] == (4.0 if space == "disparity" else 0.25)


def test_half_size_depth_is_taken_and_another_shape_refused(tmp_path, photo):
    np.save(tmp_path / "half.npy", np.ones((H // 2, W // 2)))
    assert make(tmp_path, photo, depth=tmp_path / "half.npy").disparity.shape == (H, W)
    np.save(tmp_path / "wide.npy", np.ones((H, H)))
    with pytest.raises(EvidenceInvalidError, match="another photo"):
        make(tmp_path, photo, depth=tmp_path / "wide.npy")


def test_a_broken_array_is_refused_in_one_line(tmp_path, photo):
    np.savez(tmp_path / "d.npz", values=np.ones((H, W)))
    whole = (tmp_path / "d.npz").read_bytes()
    for cut in (len(whole) // 2, 8, 0):
        (tmp_path / "d.npz").write_bytes(whole[:cut])
        with pytest.raises(EvidenceInvalidError, match="cannot be read as depth"):
            make(tmp_path, photo, depth=tmp_path / "d.npz")
        with pytest.raises(EvidenceInvalidError, match="cannot be read as depth"):
            depth_file(tmp_path, "d.jpg")


@pytest.mark.parametrize("name", ["d.npy", "d.npz", "d.png"])
def test_an_array_that_claims_more_than_is_decoded_is_refused(tmp_path, photo, name):
    path = tmp_path / name
    if name == "d.png":
        head = struct.pack(">IIBBBBB", 100_000, 100_000, 16, 0, 0, 0, 0)
        chunks = [(b"IHDR", head), (b"IDAT", zlib.compress(b"")), (b"IEND", b"")]
        path.write_bytes(b"\x89PNG\r\n\x1a\n" + b"".join(
            struct.pack(">I", len(d)) + k + d + struct.pack(">I", zlib.crc32(k + d))
            for k, d in chunks
        ))  # fmt: skip
    else:
        header = {"descr": "<f8", "fortran_order": False, "shape": (100_000, 100_000)}
        npy = io.BytesIO()
        np.lib.format.write_array_header_1_0(npy, header)
        path.write_bytes(npy.getvalue())
        if name == "d.npz":
            with zipfile.ZipFile(path, "w") as archive:
                archive.writestr("values.npy", npy.getvalue())
    with pytest.raises(EvidenceInvalidError, match=r"cannot be read as depth; found: .*100000"):
        make(tmp_path, photo, depth=path)


def test_numbers_beyond_float32_are_no_depth_and_complex_ones_refused(tmp_path, photo):
    values = np.full((H, W), 2.0)
    values[0, 0] = 1e300
    np.save(tmp_path / "d.npy", values)
    disparity = make(tmp_path, photo, depth=tmp_path / "d.npy").disparity
    assert np.isnan(disparity[0, 0])
    assert disparity[5, 5] == 0.5
    np.save(tmp_path / "d.npy", values.astype(complex))
    with pytest.raises(EvidenceInvalidError, match="an array of complex128"):
        make(tmp_path, photo, depth=tmp_path / "d.npy")


def test_depth_that_was_replaced_is_refused(tmp_path, photo):
    np.save(tmp_path / "d.npy", np.ones((H, W)))
    make(tmp_path, photo, depth=tmp_path / "d.npy")
    (tmp_path / "evidence" / "depth.npz").write_bytes(b"")
    with pytest.raises(EvidenceInvalidError, match="another sha256"):
        read_evidence(tmp_path / "evidence")


def test_the_camera_of_noise_is_unknown_and_the_command_says_so(tmp_path, photo, capsys):
    words = ["plugin", "evidence", "--photo", str(photo), "--fov", "60"]
    assert run([*words, "-o", str(tmp_path / "evidence")]) == 0
    assert "camera   unknown" in capsys.readouterr().out
    assert read_evidence(tmp_path / "evidence").file.camera.world_from_cam_rotation is None


@pytest.mark.parametrize("space", ["depth", "disparity", None])
def test_the_space_of_an_array_is_what_its_file_says(tmp_path, space):
    said = {} if space is None else {"space": np.array(space)}
    np.savez(tmp_path / "d.npz", values=np.ones((2, 2)), **said)
    assert depth_file(tmp_path, "d.jpg") == (tmp_path / "d.npz", space or "depth")
    assert depth_file(tmp_path, "other.jpg") is None
    np.savez(tmp_path / "d.npz", values=np.ones((2, 2)), space=np.array("ray_distance"))
    with pytest.raises(EvidenceInvalidError, match="not depth along the camera's axis"):
        depth_file(tmp_path, "d.jpg")
