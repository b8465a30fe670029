"""Truth on disk: ETH3D's two trees and its calibration, mirrored arrays, and what is refused."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest
from evaluation.depth.folders import plane, write_arrays, write_eth3d

from legoworld.depth_files.errors import DepthFileError
from legoworld.evaluation.depth.arrays import DepthTruthError, read_declaration
from legoworld.evaluation.depth.eth3d import (
    find_calibration,
    parse_scene_name,
    photo_camera,
    scenes_below,
)
from legoworld.evaluation.depth.truth import find_truth, load_truth
from legoworld.evaluation.run import RunImage
from legoworld.tracks.colmap import read_calibration

NAME = "courtyard/images/dslr_images/DSC_0286.JPG"
OTHER = "office/images/dslr_images/DSC_0219.JPG"


def photo(name: str = NAME, size_wh: tuple[int, int] | None = (32, 20)) -> RunImage:
    return RunImage(image_id=1, file_name=name, size_wh=size_wh, status="ok")


def lidar(seed: int = 0) -> np.ndarray:
    """A wall of which nine pixels in ten have no laser point."""
    z = plane((32, 20), seed).astype(np.float32)
    z[np.random.default_rng(seed).random(z.shape) < 0.9] = np.inf
    return z


@pytest.mark.parametrize("tree", ["eth3d", "marigold"])
def test_both_trees(tmp_path: Path, tree: str) -> None:
    truths = {NAME: lidar(0), OTHER: lidar(1)}
    write_eth3d(tmp_path, truths, tree=tree)
    files = find_truth(tmp_path, [photo(NAME), photo(OTHER)])
    for file, z in zip(files, truths.values(), strict=True):
        truth = load_truth(file)
        assert (file.kind, file.size_from, truth.size_wh) == ("eth3d_raw", "cameras.txt", (32, 20))
        assert np.array_equal(truth.values, z)
        assert tuple(truth.counts.values()) == (int(np.isinf(z).sum()), 0, 0)
        assert file.camera is not None
        assert file.camera.model == "THIN_PRISM_FISHEYE"


@pytest.mark.parametrize(
    "place", ["courtyard", "rgb/courtyard", "depth/courtyard_dslr_depth/courtyard"]
)
def test_the_calibration_is_found_in_either_tree(tmp_path: Path, place: str) -> None:
    write_eth3d(tmp_path / "made", {NAME: lidar()})
    made = tmp_path / "made/courtyard/dslr_calibration_jpg"
    folder = tmp_path / "truth" / place
    folder.mkdir(parents=True)
    assert find_calibration(tmp_path / "truth", "courtyard") is None
    made.rename(folder / "dslr_calibration_jpg")
    assert find_calibration(tmp_path / "truth", "courtyard") == folder / "dslr_calibration_jpg"
    assert find_calibration(tmp_path / "truth", "other") is None
    assert scenes_below(tmp_path / "truth") == ["courtyard"]


def test_invalid_values_are_counted(tmp_path: Path) -> None:
    z = lidar()
    z.flat[:5] = [np.nan, np.nan, 0.0, -1.0, -np.inf]
    n_inf = int((z == np.inf).sum())
    truth = load_truth(find_truth(write_eth3d(tmp_path, {NAME: z}), [photo()])[0])
    assert tuple(truth.counts.values()) == (n_inf, 2, 3)


def test_without_calibration_the_track_s_size_is_held_to_the_bytes(tmp_path: Path) -> None:
    write_eth3d(tmp_path, {NAME: lidar()})
    shutil.rmtree(tmp_path / "courtyard/dslr_calibration_jpg")
    file = find_truth(tmp_path, [photo()])[0]
    assert (file.size_from, file.camera, file.size_wh) == ("track", None, (32, 20))
    with pytest.raises(DepthFileError, match=r"2560 bytes.*2688 bytes"):
        find_truth(tmp_path, [photo(size_wh=(32, 21))])
    with pytest.raises(DepthTruthError, match=r"size of courtyard/DSC_0286\.JPG is not known"):
        find_truth(tmp_path, [photo(size_wh=None)])


def test_a_track_of_another_size_names_both(tmp_path: Path) -> None:
    write_eth3d(tmp_path, {NAME: lidar()})
    with pytest.raises(DepthTruthError, match=r"20x32 in the run.*32x20 in cameras\.txt"):
        find_truth(tmp_path, [photo(size_wh=(20, 32))])


def test_the_photo_in_the_depth_s_place(tmp_path: Path) -> None:
    write_eth3d(tmp_path, {NAME: lidar()})
    path = tmp_path / "courtyard/ground_truth_depth/dslr_images/DSC_0286.JPG"
    path.write_bytes(b"\xff\xd8\xff" + path.read_bytes()[3:])
    with pytest.raises(DepthFileError, match="is the photo, not the depth"):
        find_truth(tmp_path, [photo()])


def test_gaps_in_the_truth_end_it_before_anything_is_scored(tmp_path: Path) -> None:
    write_eth3d(tmp_path, {NAME: lidar()})
    with pytest.raises(DepthTruthError, match=r"lacks the depth of 1 of 2 images.*DSC_0219"):
        find_truth(tmp_path, [photo(), photo(OTHER)])


def test_arrays_named_like_the_photos(tmp_path: Path) -> None:
    z = plane((8, 6))
    write_arrays(tmp_path, {"a/b.png": z, "c.jpg": z * 2})
    files = find_truth(tmp_path, [photo("a/b.png", None), photo("c.jpg", None)])
    assert [np.array_equal(load_truth(f).values, e) for f, e in zip(files, (z, z * 2), strict=True)]
    np.save(tmp_path / "c.npy", z)
    with pytest.raises(DepthTruthError, match="more than one ground-truth file"):
        find_truth(tmp_path, [photo("c.jpg", None)])


def test_declared_arrays(tmp_path: Path) -> None:
    z = plane((8, 6)).astype(np.float32)
    (tmp_path / "depth.toml").write_text('space = "depth"\nunit = "mm"\n')
    np.save(tmp_path / "c.npy", z * 1000)
    np.testing.assert_allclose(
        load_truth(find_truth(tmp_path, [photo("c.jpg", None)])[0]).values, z, rtol=1e-6
    )


def test_the_photo_s_own_camera_among_several(tmp_path: Path) -> None:
    cameras = "# x\n0 PINHOLE 10 20 1 2 3 4\n\n1 PINHOLE 20 10 1 2 3 4\n"
    (tmp_path / "cameras.txt").write_text(cameras)
    with pytest.raises(DepthTruthError, match=r"camera of B\.JPG"):
        photo_camera(read_calibration(tmp_path), "B.JPG")
    (tmp_path / "images.txt").write_text("1 1 0 0 0 0 0 0 1 dslr_images/B.JPG\n\n")
    assert photo_camera(read_calibration(tmp_path), "B.JPG").size_wh == (20, 10)
    with pytest.raises(DepthTruthError, match=r"camera of C\.JPG"):
        photo_camera(read_calibration(tmp_path), "C.JPG")


def test_scene_of() -> None:
    assert parse_scene_name(NAME) == "courtyard"
    assert parse_scene_name("courtyard/DSC_0286.JPG") is None
    assert parse_scene_name("x/" + NAME) is None


@pytest.mark.parametrize(
    ("line", "fits"),
    [
        ("invalid_value = 0", True), ("invalid_value = 65535", True),
        ("invalid_value = -1", False), ("invalid_value = 65536", False),
        ("invalid_value = true", False), ("invalid_value = 1.0", False),
        ("intrinsics_px = [1, 2, 3, 4]", True), ("intrinsics_px = [1, 2, 3]", False),
        ("intrinsics_px = [1, 2, 3, inf]", False), ('intrinsics_px = "1234"', False),
        ("focal_px = 3", True), ("focal_px = nan", False), ("focal_px = true", False),
    ],
)  # fmt: skip
def test_what_a_declaration_may_say(tmp_path: Path, line: str, fits: bool) -> None:
    (tmp_path / "depth.toml").write_text(f"{line}\n")
    key = line.split(" ", maxsplit=1)[0]
    if fits:
        value = getattr(read_declaration(tmp_path), key)
        assert value == ((1.0, 2.0, 3.0, 4.0) if key == "intrinsics_px" else float(line.split()[2]))
        return
    with pytest.raises(DepthTruthError, match=key):
        read_declaration(tmp_path)
