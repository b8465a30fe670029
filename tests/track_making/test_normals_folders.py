"""Normals as datasets lay them out: beside the photos, coded or as numbers, pointing away."""

from __future__ import annotations

import json

import cv2
import numpy as np
import pytest
from evaluation.normals.folders import evaluate, wall, write_run

from legoworld import cli
from legoworld.depth_files.errors import DepthFileError
from legoworld.evaluation.normals.arrays import Declaration, read_normals

SIZE = (8, 6)
SLANTED = -wall(SIZE, 20)  # away from the camera


def encode_normals(dtype):
    most = np.iinfo(dtype).max
    values = np.rint((SLANTED + 1) / 2 * most).astype(dtype)
    values[0] = 0
    return values[..., ::-1]


def write_exr(path, values):
    openexr = pytest.importorskip("OpenEXR")
    header = {"type": openexr.scanlineimage}
    openexr.File(header, {"RGB": values.astype(np.float32)}).write(str(path))


def unknown_at_0():
    values = SLANTED.astype(np.float32)
    values[0] = 0
    return values


LAYOUTS = {
    "nyuv2": ("test/000000_img.png", "test/000000_normal.png"),
    "scannet": ("scene0000_00/000100_img.jpg", "scene0000_00/000100_normal.png"),
    "ibims": ("ibims/corridor_01_img.png", "ibims/corridor_01_normal.exr"),
    "diode": ("indoors/scene_00019/00019_0.png", "indoors/scene_00019/00019_0_normal.npy"),
}


def write_layout(name, folder):
    photo, normals = (folder / part for part in LAYOUTS[name])
    photo.parent.mkdir(parents=True)
    cv2.imwrite(str(photo), np.full((*SIZE[::-1], 3), 90, np.uint8))
    if name == "ibims":
        write_exr(normals, unknown_at_0())
    elif name == "diode":
        np.save(normals, unknown_at_0().astype(np.float64))
        np.save(folder / "indoors/scene_00019/00019_0_depth_mask.npy", np.ones(SIZE[::-1]))
    else:
        cv2.imwrite(str(normals), encode_normals(np.uint8 if name == "nyuv2" else np.uint16))


@pytest.mark.parametrize("name", LAYOUTS)
def test_a_datasets_own_folder_becomes_a_track_and_is_scored(name, tmp_path):
    folder, track = tmp_path / "data", tmp_path / "track.json"
    write_layout(name, folder)
    words = ["track", "make", "--task", "normals", "--truth", folder, "--photos", folder]
    words += ["--sign", "away_from_camera", "-o", track]
    assert cli.run([str(word) for word in words]) == 0
    assert (folder / "normals.toml").read_text() == 'sign = "away_from_camera"\n'
    made = json.loads(track.read_text())
    photo = LAYOUTS[name][0]
    assert [image["file_name"] for image in made["images"]] == [photo]
    assert "photos_left_out" not in made["info"] or not made["info"]["photos_left_out"]
    run = write_run(tmp_path / "run", {photo: wall(SIZE, 30)})
    summary = evaluate(run, folder, tmp_path / "evaluation")
    assert summary.pooled_px == SIZE[0] * (SIZE[1] - 1)
    tolerance = 0.5 if name == "nyuv2" else 0.01
    assert summary.pooled["mean_deg"]["exclude"] == pytest.approx(10, abs=tolerance)


def test_a_sign_that_the_folder_states_otherwise_is_not_overwritten(tmp_path, capsys):
    folder = tmp_path / "data"
    write_layout("diode", folder)
    (folder / "normals.toml").write_text('sign = "towards_camera"\n')
    words = ["track", "make", "--task", "normals", "--truth", folder, "--photos", folder]
    words += ["--sign", "away_from_camera", "-o", tmp_path / "track.json"]
    assert cli.run([str(word) for word in words]) == 2
    assert "normals.toml declares data differently" in capsys.readouterr().err
    assert (
        cli.run([str(word) for word in words[:-6]] + ["--sign", "towards_camera", "-o", "t"]) == 2
    )
    assert "--sign is for a folder's files, with --photos" in capsys.readouterr().err


def test_a_sign_must_be_stated(tmp_path, capsys):
    folder = tmp_path / "data"
    write_layout("diode", folder)
    words = ["track", "make", "--task", "normals", "--truth", folder, "--photos", folder]
    assert cli.run([str(word) for word in [*words, "-o", tmp_path / "track.json"]]) == 2
    assert "does not say which way its normals point" in capsys.readouterr().err


def test_an_exr_of_other_channels_is_no_picture_of_normals(tmp_path):
    openexr = pytest.importorskip("OpenEXR")
    for name, channels in (("two", ("R", "G")), ("depth", ("Z",))):
        values = {c: np.ones(SIZE[::-1], np.float32) for c in channels}
        openexr.File({"type": openexr.scanlineimage}, values).write(str(tmp_path / f"{name}.exr"))
        with pytest.raises(DepthFileError, match="not a single 3-channel picture"):
            read_normals(tmp_path / f"{name}.exr", Declaration(sign="towards_camera"))
