"""Middlebury's motorcycle: measured disparity as truth, a stereo matcher, the example scene."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from evaluation.depth.folders import evaluate_depth, rows_of, write_run
from numpy.typing import NDArray

from legoworld import cli
from legoworld.evaluation.depth.truth import find_truth, load_truth
from legoworld.evaluation.run import RunImage

ROOT = Path(__file__).parents[3]
PHOTO = "motorcycle.png"
Array = NDArray[Any]


@pytest.fixture(scope="module")
def pair() -> tuple[Array, Array, Array]:
    """Left and right photo, and the left one's true disparity with inf where unknown."""
    skimage_data = pytest.importorskip("skimage.data", reason="scikit-image carries the pair")
    try:
        left, right, disparity = skimage_data.stereo_motorcycle()
    except (OSError, ModuleNotFoundError) as error:  # not bundled and no way to fetch it
        pytest.skip(f"scikit-image's motorcycle is not here: {error}")
    return left, right, disparity


@pytest.fixture(scope="module")
def card() -> dict[str, Any]:
    text = (ROOT / "datasets/skimage_examples/card.toml").read_text(encoding="utf-8")
    depth: dict[str, Any] = tomllib.loads(text)["depth"]
    return depth


@pytest.fixture
def truth(tmp_path: Path, pair: tuple[Array, Array, Array], card: dict[str, Any]) -> Path:
    """The disparity as it comes, declared by the dataset card's numbers."""
    folder = tmp_path / "truth"
    folder.mkdir()
    np.save(folder / "motorcycle.npy", pair[2])
    lines = ['space = "disparity"', 'unit = "px"']
    lines += [f"{key} = {card[key]}" for key in ("focal_px", "baseline_m", "doffs_px")]
    (folder / "depth.toml").write_text("\n".join(lines))
    return folder


def depth_of(disparity: Array, card: dict[str, Any]) -> Array:
    return card["focal_px"] * card["baseline_m"] / (disparity + card["doffs_px"])


def test_its_disparity_becomes_the_card_s_depth(truth: Path, card: dict[str, Any]) -> None:
    image = RunImage(image_id=4, file_name=PHOTO, size_wh=(741, 500), status="ok")
    found = load_truth(find_truth(truth, [image])[0])
    assert found.counts["truth_inf_px"] == 27_226
    valid = np.isfinite(found.values)
    limits = [found.values[valid].min(), found.values[valid].max()]
    assert limits == pytest.approx(card["z_range_m"], abs=1e-4)


def test_a_stereo_matcher(
    tmp_path: Path, truth: Path, pair: tuple[Array, Array, Array], card: dict[str, Any]
) -> None:
    import cv2

    left, right, true_disparity = pair
    matcher = cv2.StereoSGBM.create(
        minDisparity=0, numDisparities=64, blockSize=5, P1=600, P2=2400, disp12MaxDiff=1,
        uniquenessRatio=10, speckleWindowSize=100, speckleRange=2,
    )  # fmt: skip
    matched = matcher.compute(left, right).astype(np.float32) / 16
    seen = (matched > 0) & np.isfinite(true_disparity)
    z, true_z = depth_of(matched, card), depth_of(true_disparity, card)
    unaligned = np.mean(np.abs(z - true_z)[seen] / true_z[seen])
    assert unaligned == pytest.approx(0.0161, abs=5e-4)

    predictions = {PHOTO: {"values": np.where(matched > 0, matched, np.nan), "space": "disparity"}}
    run = write_run(tmp_path / "run", predictions, kind="baseline")  # type: ignore[arg-type]
    summary = evaluate_depth(run, truth, tmp_path / "e", draws=9)
    (row,) = rows_of(tmp_path / "e")
    assert (row["n_valid"], row["truth_inf_px"]) == (343_274, 27_226)
    assert row["n_predicted"] == int(seen.sum())
    values = summary.metrics["abs_rel"]
    # Least squares listens to the false matches: aligned is a little worse than metric.
    assert values["exclude"] == pytest.approx(0.0217, abs=1e-3)
    # A matcher that is right has the pair's own line: 1 / z = (d + doffs) / (focal * baseline).
    per_px = 1 / (card["focal_px"] * card["baseline_m"])
    assert row["s"] == pytest.approx(per_px, rel=0.05)
    assert values["error_1"] > values["exclude"] + 0.12  # a pixel in eight has no match
    assert summary.constant["abs_rel"]["exclude"] > 4 * values["exclude"]

    as_depth = {PHOTO: np.where(matched > 0, z, np.inf)}
    run = write_run(tmp_path / "depth_run", as_depth)  # type: ignore[arg-type]
    again = evaluate_depth(run, truth, tmp_path / "f", draws=9)
    assert again.metrics["abs_rel"]["exclude"] == pytest.approx(values["exclude"], rel=1e-6)


@pytest.mark.blender
def test_the_example_scene_end_to_end(tmp_path: Path, truth: Path) -> None:
    if not (ROOT / "examples/motorcycle/scene.blend").is_file():
        pytest.skip("examples/motorcycle has no scene.blend yet")
    track = ROOT / "datasets/skimage_examples/track_coco.json"
    arguments = ["readout", "-q", str(ROOT / "examples"), "--task", "eth3d", "--track", str(track)]
    run = tmp_path / "run"
    assert cli.run([*arguments, "--image-id", "4", "-o", str(run)]) == 0
    summary = evaluate_depth(run, truth, tmp_path / "e", draws=9)
    (row,) = rows_of(tmp_path / "e")
    assert row["status"] == "ok"
    assert summary.partial is True
    assert summary.coverage.scored == 1
    assert row["n_valid"] == 343_274
    values, constant = summary.metrics["abs_rel"], summary.constant["abs_rel"]
    assert values["exclude"] < constant["exclude"]  # it knows more than nothing of the picture
    assert values["exclude"] <= values["error_1"]
