"""A baseline that makes depth: files, hashes, and a score like any other run's."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
from baselines.tracks import call, make_photos, make_track, results, rows, run_arguments

NAMES = [f"hall/images/dslr_images/{name}.JPG" for name in "ABC"]


def write_inputs(tmp_path: Path) -> tuple[Path, Path, Path]:
    photos = make_photos(tmp_path / "photos", NAMES)
    weights = tmp_path / "w.bin"
    weights.write_bytes(b"w")
    return make_track(tmp_path / "track.json", NAMES), photos, weights


def test_depth_files_are_read_back_and_scored(tmp_path):
    track, photos, weights = write_inputs(tmp_path)
    run = tmp_path / "run"
    assert call(run_arguments(track, photos, weights, run, task="eth3d")) == 0
    row = rows(run)[1]
    assert row["depth"]["file"] == "depth/hall/images/dslr_images/A.npz"
    assert (row["depth"]["space"], row["depth"]["unit"]) == ("depth", None)
    assert row["depth"]["finite_px"] == 64 * 48
    assert not (run / "predictions.json").exists()
    for name in NAMES:
        with np.load(run / "depth" / name.replace(".JPG", ".npz")) as arrays:
            truth = tmp_path / "truth" / name.replace("images/", "ground_truth_depth/", 1)
            truth.parent.mkdir(parents=True, exist_ok=True)
            (3 * arrays["values"]).astype("<f4").tofile(truth)
            calibration = tmp_path / "truth" / "hall" / "dslr_calibration_jpg"
    calibration.mkdir()
    (calibration / "cameras.txt").write_text("0 PINHOLE 64 48 50 50 32 24\n")
    call(["evaluate", run, "--truth", tmp_path / "truth", "-o", tmp_path / "e", "--draws", "5"])
    summary = json.loads((tmp_path / "e" / "summary.json").read_text())
    assert summary["coverage"]["scored"] == 3
    assert summary["metrics"]["abs_rel"]["error_1"] < 1e-6  # a factor of 3 is the fit's to find


def test_a_file_that_was_tampered_with_is_made_again(tmp_path):
    track, photos, weights = write_inputs(tmp_path)
    run = tmp_path / "run"
    arguments = run_arguments(track, photos, weights, run, task="eth3d")
    assert call(arguments) == 0
    before = results(run)
    (run / "depth/hall/images/dslr_images/B.npz").write_bytes(b"not what was recorded")
    (run / "depth/hall/images/dslr_images/C.npz").unlink()
    assert call(arguments) == 0
    assert results(run) == before


def test_overwriting_begins_once_whatever_crashes(tmp_path):
    track, photos, weights = write_inputs(tmp_path)
    run = tmp_path / "run"
    assert call(run_arguments(track, photos, weights, run, task="eth3d")) == 0
    before = results(run)
    options = ["--option", "how=crash_once", "--option", "at=3", "--sandbox", "limits"]
    again = run_arguments(track, photos, weights, run, *options, "--overwrite", task="eth3d")
    assert call(again) == 0
    assert weights.with_suffix(".crashed").exists(), "it was started twice"
    assert results(run) == before, "what was answered before the crash is kept"


def test_a_file_the_baseline_did_not_speak_of_is_a_failure(tmp_path):
    track, photos, weights = write_inputs(tmp_path)
    options = ["--option", "how=lie", "--option", "at=2"]
    run = tmp_path / "run"
    assert call(run_arguments(track, photos, weights, run, *options, task="eth3d")) == 1
    found = rows(run)
    assert found[2]["code"] == "baseline_answer"
    assert [found[i]["status"] for i in (1, 3)] == ["ok", "ok"]
