"""Normals of others from a folder to a score: track make, import, evaluate."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pytest
from evaluation.normals.folders import wall, write_truth

from legoworld import cli
from legoworld.evaluation.normals.protocol import SHARES

NAMES = ("kitchen/a.png", "kitchen/b.png")
SIZE = (8, 6)


@pytest.fixture
def track(tmp_path):
    (tmp_path / "photos/kitchen").mkdir(parents=True)
    for name in (*NAMES, "kitchen/unmeasured.png"):
        cv2.imwrite(str(tmp_path / "photos" / name), np.zeros((*SIZE[::-1], 3), np.uint8))
    write_truth(tmp_path / "truth/kitchen", {Path(n).name: wall(SIZE) for n in NAMES}, sign=None)
    (tmp_path / "truth/normals.toml").write_text('sign = "towards_camera"\n')
    track = tmp_path / "track.json"
    words = ["--truth", tmp_path / "truth", "--photos", tmp_path / "photos", "-o", track]
    assert call("track", "make", "--task", "normals", *words) == 0
    return track


def call(*words: object) -> int:
    return cli.run([str(word) for word in words])


def write_theirs(folder: Path, degrees: float, sign: int = 1) -> Path:
    (folder / "kitchen").mkdir(parents=True)
    for name in NAMES:
        stem = Path(name).with_suffix("")
        np.save(folder / f"{stem}_normal.npy", (sign * wall(SIZE, degrees)).astype(np.float32))
    return folder


def bring(track: Path, theirs: Path, run: Path, *more: object) -> int:
    words = ["--task", "normals", "--track", track, "-o", run, *more]
    return call("baseline", "import", theirs, *words)


def test_a_track_has_the_photos_with_normals_and_none_of_the_normals(track):
    document = json.loads(track.read_text())
    assert [image["file_name"] for image in document["images"]] == list(NAMES)
    assert [(i["width"], i["height"]) for i in document["images"]] == [SIZE, SIZE]


def test_a_photo_of_another_size_than_its_normals_makes_no_track(track, tmp_path, capsys):
    cv2.imwrite(str(tmp_path / "photos" / NAMES[0]), np.zeros((7, 7, 3), np.uint8))
    words = ["--truth", tmp_path / "truth", "--photos", tmp_path / "photos"]
    assert call("track", "make", "--task", "normals", *words, "-o", tmp_path / "other.json") != 0
    assert "different sizes" in capsys.readouterr().err


@pytest.mark.parametrize(("stated", "sign"), [("towards_camera", 1), ("away_from_camera", -1)])
def test_an_import_scores_as_its_sign_states(track, tmp_path, stated, sign):
    theirs = write_theirs(tmp_path / "theirs", 9.0, sign)
    assert bring(track, theirs, tmp_path / "run", "--sign", stated) == 0
    run = json.loads((tmp_path / "run/run.json").read_text())
    assert run["configuration"]["imported"]["sign"] == stated
    words = [tmp_path / "run", "--truth", tmp_path / "truth", "-o", tmp_path / "evaluation"]
    assert call("evaluate", *words) == 0
    summary = json.loads((tmp_path / "evaluation/summary.json").read_text())
    assert summary["pooled"]["mean_deg"]["error_90"] == pytest.approx(9, abs=1e-4)
    assert [summary["pooled"][name]["fails"] for name in SHARES] == [0, 0, 1, 1, 1]


def test_a_wrong_sign_is_told_when_it_is_scored(track, tmp_path):
    theirs = write_theirs(tmp_path / "theirs", 9.0, -1)
    assert bring(track, theirs, tmp_path / "run", "--sign", "towards_camera") == 0
    words = [tmp_path / "run", "--truth", tmp_path / "truth", "-o", tmp_path / "evaluation"]
    call("evaluate", *words)
    summary = json.loads((tmp_path / "evaluation/summary.json").read_text())
    assert summary["coverage"]["scored"] == 0
    assert "state sign = away_from_camera" in summary["not_scored"][0]["reason"]


def test_an_import_without_a_sign_is_refused(track, tmp_path, capsys):
    theirs = write_theirs(tmp_path / "theirs", 9.0)
    assert bring(track, theirs, tmp_path / "run") != 0
    assert "does not say which way its normals point" in capsys.readouterr().err
    assert not (tmp_path / "run/run.json").exists()


def test_an_array_without_a_normal_or_of_another_size_is_its_row(track, tmp_path):
    theirs = write_theirs(tmp_path / "theirs", 9.0)
    np.save(theirs / "kitchen/a_normal.npy", np.full((*SIZE[::-1], 3), np.nan, np.float32))
    assert bring(track, theirs, tmp_path / "run", "--sign", "towards_camera") == 1
    np.save(theirs / "kitchen/a_normal.npy", np.zeros((3, 40, 3), np.float32))
    assert bring(track, theirs, tmp_path / "run2", "--sign", "towards_camera") == 1
    rows = [(tmp_path / run / "per_image.jsonl").read_text() for run in ("run", "run2")]
    assert "no normal at any pixel" in rows[0]
    assert "of another size" in rows[1]
