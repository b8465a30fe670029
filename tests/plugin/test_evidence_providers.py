"""Evidence from runs of baselines and from a provider's camera; of other photos it is refused."""

from __future__ import annotations

import json
import math
import shutil

import numpy as np
import pytest
from baselines.tracks import SIZE_WH, call, make_photos, make_track, run_arguments

from legoworld.cli import run
from legoworld.files import sha256_of_file
from legoworld.plugin.evidence import EvidenceInvalidError, read_evidence

NAMES = ["one.jpg", "two.jpg"]
ROTATION = [[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]]


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """Photos, and runs of the tests' own baseline over them: boxes and depth."""
    folder = tmp_path_factory.mktemp("runs")
    photos = make_photos(folder / "photos", NAMES)
    track = make_track(folder / "track.json", NAMES)
    (folder / "w.bin").write_bytes(b"w")
    for task in ("coco", "eth3d"):
        words = run_arguments(track, photos, folder / "w.bin", folder / task, task=task)
        assert call(words) == 0
    return folder


@pytest.fixture
def copied(made, tmp_path):
    for task in ("coco", "eth3d"):
        shutil.copytree(made / task, tmp_path / task)
    return tmp_path


def evidence(folder, made, *words, photo="one.jpg"):
    words = ["plugin", "evidence", "--photo", made / "photos" / photo, *words, "-o", folder / "e"]
    return run([str(word) for word in words])


def test_runs_give_regions_and_depth_of_their_photo(tmp_path, made):
    assert evidence(tmp_path, made, "--run", made / "coco", "--run", made / "eth3d") == 0
    known = read_evidence(tmp_path / "e", made / "photos" / "one.jpg")
    entries = json.loads((made / "coco" / "predictions.json").read_text())
    kept = [e for e in entries if e["image_id"] == 1 and e["score"] >= 0.3]
    assert len(known.file.regions) == len(kept) > 0
    assert {r.category for r in known.file.regions} <= {"dog", "cat"}
    assert known.file.regions[0].source.startswith("fake ")
    with np.load(made / "eth3d" / "depth" / "one.npz") as stored:
        depth = stored["values"].astype(float)
    assert known.disparity == pytest.approx(1 / depth)
    assert known.photo is not None
    assert known.photo.shape == (SIZE_WH[1], SIZE_WH[0], 3)


def changed_run(folder, change):
    path = folder / "coco" / "run.json"
    document = json.loads(path.read_text())
    change(document)
    path.write_text(json.dumps(document))


def other_photos(folder):
    changed_run(folder, lambda d: [s.update(photo_sha256="0" * 64) for s in d["scenes"].values()])


def prompt_by_truth(folder):
    changed_run(
        folder,
        lambda d: d["configuration"].update(used_truth={"sha256": "0" * 64, "what": "categories"}),
    )


@pytest.mark.parametrize(
    ("change", "why"),
    [
        (other_photos, "is about other photos"),
        (prompt_by_truth, "prompted with ground truth"),
        (
            lambda folder: (folder / "coco" / "run.json").write_text("{"),
            "not a finished baseline run",
        ),
        (lambda folder: (folder / "coco" / "run.json").unlink(), "not a finished baseline run"),
    ],
)
def test_a_run_that_cannot_be_used_is_refused_in_one_line(copied, made, capsys, change, why):
    change(copied)
    assert evidence(copied, made, "--run", copied / "coco") == 2
    said = capsys.readouterr().err
    assert why in said
    assert said.count("\n") == 1
    assert not (copied / "e").exists()


def test_depth_that_was_changed_or_given_twice_is_refused(copied, made, capsys):
    (copied / "eth3d" / "depth" / "one.npz").write_bytes(b"")
    assert evidence(copied, made, "--run", copied / "eth3d") == 2
    both = ("--run", made / "eth3d", "--depth", made / "eth3d" / "depth" / "one.npz")
    assert evidence(copied, made, *both) == 2
    assert "two depths" in capsys.readouterr().err


def camera_file(folder, made, **changes):
    photo = made / "photos" / "one.jpg"
    camera = {
        "schema_version": 1, "source": "provider 1", "photo_sha256": sha256_of_file(photo),
        "width": 128, "height": 96, "fx": 64.0, "fy": 64.0, "cx": 64.0, "cy": 48.0,
        "world_from_cam_rotation": ROTATION, **changes,
    }  # fmt: skip
    path = folder / "camera.json"
    path.write_text(json.dumps(camera))
    return path


def test_a_provider_s_camera_is_taken_as_it_is(tmp_path, made):
    assert evidence(tmp_path, made, "--camera", camera_file(tmp_path, made)) == 0
    camera = read_evidence(tmp_path / "e").file.camera
    assert camera.hfov_deg == pytest.approx(90.0)
    assert camera.world_from_cam_rotation == tuple(map(tuple, ROTATION))
    assert (camera.hfov_source, camera.rotation_source) == ("provider 1", "provider 1")


def test_a_rotation_that_the_provider_lacks_is_estimated_or_unknown(tmp_path, made):
    path = camera_file(tmp_path, made, world_from_cam_rotation=None, fx=110.9, fy=110.9)
    assert evidence(tmp_path, made, "--camera", path) == 0
    camera = read_evidence(tmp_path / "e").file.camera
    assert camera.hfov_deg == pytest.approx(2 * math.degrees(math.atan(64 / 110.9)))
    assert camera.unknown  # the photo is noise
    assert camera.world_from_cam_rotation is None


@pytest.mark.parametrize(
    ("changes", "why"),
    [
        ({"photo_sha256": "0" * 64}, "this photo's hash"),
        ({"height": 128}, "the shape of"),
        ({"fy": 80.0}, "square pixels"),
        ({"cx": 70.0}, "in the middle"),
        ({"fx": -1.0}, "fx"),
        ({"source": ""}, "source"),
        ({"world_from_cam_rotation": [[1, 0, 0], [0, 1, 0], [0, 0, -1]]}, "a rotation"),
        ({"world_from_cam_rotation": [[2, 0, 0], [0, 1, 0], [0, 0, 1]]}, "a rotation"),
    ],
)
def test_a_camera_that_cannot_be_used_is_refused(tmp_path, made, capsys, changes, why):
    assert evidence(tmp_path, made, "--camera", camera_file(tmp_path, made, **changes)) == 2
    said = capsys.readouterr().err
    assert why in said
    assert said.count("\n") == 1


def test_a_camera_and_a_field_of_view_are_one_too_many(tmp_path, made, capsys):
    assert evidence(tmp_path, made, "--fov", 60, "--camera", camera_file(tmp_path, made)) == 2


def test_a_server_refuses_evidence_of_another_photo(tmp_path, made):
    assert evidence(tmp_path, made) == 0
    with pytest.raises(EvidenceInvalidError, match="of another photo"):
        read_evidence(tmp_path / "e", made / "photos" / "two.jpg")
