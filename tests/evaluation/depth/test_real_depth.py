"""Real depth cameras' files in the unit conventions of their four datasets, scored end to end."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from evaluation.depth.folders import evaluate_depth, rows_of, write_run
from numpy.typing import NDArray

from legoworld import cli
from legoworld.depth_files.errors import DepthFileError
from legoworld.evaluation.depth.arrays import Declaration
from legoworld.evaluation.depth.labelled import read_labelled

pytestmark = pytest.mark.real_data

Array = NDArray[Any]


@pytest.fixture(scope="module")
def rgbd(real_data: Path) -> Path:
    folder = real_data / "depth/open3d/RGBD"
    if not folder.is_dir():
        pytest.skip("the four RGB-D conventions are not among the real data here")
    return folder


def primesense(rgbd: Path) -> Array:
    return pixels(rgbd / "depth/00000.png") / 1000


def tum(rgbd: Path) -> Array:
    return pixels(rgbd / "other_formats/TUM_depth.png") / 5000


def sun(rgbd: Path) -> Array:
    stored = pixels(rgbd / "other_formats/SUN_depth.png").astype(np.int64)
    return (stored // 8 + stored % 8 * 8192) / 1000


def kinect_raw(rgbd: Path) -> Array:
    """NYU's raw disparity, from the bytes behind the header."""
    data = (rgbd / "other_formats/NYU_depth.pgm").read_bytes()
    assert data.startswith(b"P5 640 480 65535\n")
    return np.frombuffer(data[17:], "<u2").reshape(480, 640).astype(np.float64)


def pixels(path: Path) -> Array:
    from PIL import Image

    return np.array(Image.open(path)).astype(np.float64)


#: file, unit, its own reading, share of pixels with a depth, their median and maximum in metres.
CASES = {
    "mm": ("depth/00000.png", primesense, 0.869560546875, 1.861, 2.702),
    "m/5000": ("other_formats/TUM_depth.png", tum, 0.80810546875, 2.415, 9.331),
    "sun_rgbd": ("other_formats/SUN_depth.png", sun, 0.8176692708333333, 2.723, 9.87),
}


def declared(folder: Path, source: Path, unit: str) -> Path:
    folder.mkdir()
    shutil.copy(source, folder / f"photo{source.suffix}")
    (folder / "depth.toml").write_text(f'space = "depth"\nunit = "{unit}"\n')
    return folder


@pytest.mark.parametrize("unit", CASES)
def test_a_real_file_in_its_unit(rgbd: Path, tmp_path: Path, unit: str) -> None:
    file, own_reading, share, median, maximum = CASES[unit]
    z = own_reading(rgbd)
    found = read_labelled(rgbd / file, Declaration(space="depth", unit=unit))
    np.testing.assert_allclose(found.values, z, rtol=1e-15)
    assert np.mean(z > 0) == share
    assert [float(np.median(z[z > 0])), float(z.max())] == pytest.approx([median, maximum])
    # The camera's own depth against itself: only its holes could cost, and truth has them too.
    truth = declared(tmp_path / "truth", rgbd / file, unit)
    run = write_run(tmp_path / "run", {"photo.jpg": np.where(z > 0, z, np.inf)})
    summary = evaluate_depth(run, truth, tmp_path / "e", draws=9)
    assert summary.metrics["abs_rel"]["error_1"] < 1e-6
    (row,) = rows_of(tmp_path / "e")
    assert row["n_valid"] == int((z > 0).sum())
    assert row["truth_non_positive_px"] == int((z == 0).sum())


def test_the_wrong_unit_is_not_the_same_picture(rgbd: Path) -> None:
    # SUN's rotated bits read as millimetres reach past any room; nothing can detect that but the
    # declaration, so a missing one is refused.
    path = rgbd / "other_formats/SUN_depth.png"
    as_mm = read_labelled(path, Declaration(space="depth", unit="mm")).values
    assert as_mm.max() > 60 > 10 > sun(rgbd).max()
    with pytest.raises(DepthFileError, match="without a declared unit"):
        read_labelled(path, Declaration(space="depth"))


def test_raw_kinect_disparity_is_affine_in_inverse_depth(rgbd: Path, tmp_path: Path) -> None:
    raw = kinect_raw(rgbd)
    measured = raw < 1092.5
    truth = declared(tmp_path / "truth", rgbd / "other_formats/NYU_depth.pgm", "nyu_raw")
    prediction = {"values": np.where(measured, -raw, np.nan), "space": "disparity"}
    run = write_run(tmp_path / "run", {"photo.jpg": prediction}, kind="baseline")
    evaluate_depth(run, truth, tmp_path / "e", draws=9)
    (row,) = rows_of(tmp_path / "e")
    assert row["n_valid"] == int(measured.sum()) > 200_000
    assert row["s"] == pytest.approx(1 / 351.3, rel=1e-11)
    assert row["t"] == pytest.approx(1092.5 / 351.3, rel=1e-11)
    assert row["metrics"]["abs_rel"]["error_1"] < 1e-9
    assert row["clamped_share"] < 1e-4  # rounding at the deepest pixel itself


def test_the_next_frame_of_a_moving_camera_is_close_but_not_the_same(
    rgbd: Path, tmp_path: Path
) -> None:
    truth = declared(tmp_path / "truth", rgbd / "depth/00000.png", "mm")
    z = pixels(rgbd / "depth/00001.png") / 1000
    run = write_run(tmp_path / "run", {"photo.jpg": np.where(z > 0, z, np.inf)})
    summary = evaluate_depth(run, truth, tmp_path / "e", draws=9)
    values = summary.metrics["abs_rel"]
    (row,) = rows_of(tmp_path / "e")
    assert 0.001 < values["exclude"] < 0.03 < summary.constant["abs_rel"]["exclude"]
    assert values["error_1"] == pytest.approx(
        values["exclude"] * (1 - row["hole_share"]) + row["hole_share"], rel=1e-12
    )


#: By unit: the photo and its depth as their datasets name them.
PAIRS = {
    "mm": ("color/00000.jpg", "depth/00000.png"),
    "m/5000": ("other_formats/TUM_color.png", "other_formats/TUM_depth.png"),
    "sun_rgbd": ("other_formats/SUN_color.jpg", "other_formats/SUN_depth.png"),
    "nyu_raw": ("other_formats/NYU_color.ppm", "other_formats/NYU_depth.pgm"),
}


@pytest.mark.parametrize("unit", PAIRS)
def test_a_real_camera_s_folder_from_track_to_score(rgbd: Path, tmp_path: Path, unit: str) -> None:
    for source, kind in zip(PAIRS[unit], ("photos", "depths"), strict=True):
        (tmp_path / kind).mkdir()
        shutil.copy(rgbd / source, tmp_path / kind / f"view{Path(source).suffix}")
    depths, track = tmp_path / "depths", tmp_path / "t.json"
    declared = ["--space", "depth", "--unit", unit]
    for command in (
        ["track", "make", "--task", "eth3d", "--truth", depths, "--photos", tmp_path / "photos",
         *declared, "--dataset", "desk", "-o", track],
        ["baseline", "import", depths, "--task", "eth3d", "--track", track, *declared,
         "-o", tmp_path / "run"],
        ["evaluate", tmp_path / "run", "--truth", depths, "-o", tmp_path / "e", "--draws", "9"],
    ):  # fmt: skip
        assert cli.run([str(word) for word in command]) == 0
    (row,) = rows_of(tmp_path / "e")
    assert row["truth_wh"] == [640, 480] or unit == "sun_rgbd"
    assert row["n_valid"] > 200_000
    assert row["metrics"]["abs_rel"]["error_1"] < 1e-12
