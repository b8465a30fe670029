"""A baseline that recovers the camera, asked about one photo by `plugin evidence --provider`."""

from __future__ import annotations

import json
import sys

import numpy as np
import pytest
from baselines.tracks import FAKE, SIZE_WH, make_photos

from legoworld.cli import run
from legoworld.files import sha256_of_file
from legoworld.plugin.evidence import EvidenceInvalidError, read_evidence
from legoworld.plugin.evidence_depth import GivenDepth, write_depth
from legoworld.plugin.make_evidence import photo_alone
from legoworld.records.base import decode
from legoworld.records.plugin_evidence import ProviderCamera


@pytest.fixture(scope="module")
def photo(tmp_path_factory):
    return make_photos(tmp_path_factory.mktemp("photos"), ["one.jpg"]) / "one.jpg"


def evidence(folder, photo, *words, weights=True):
    (folder / "w.bin").write_bytes(b"w")
    asked = ["--provider", FAKE, "--python", sys.executable]
    asked += ["--weights", folder / "w.bin"] if weights else []
    words = ["plugin", "evidence", "--photo", photo, *asked, *words, "-o", folder / "e"]
    return run([str(word) for word in words])


def test_camera_and_depth_of_a_provider_become_evidence(tmp_path, photo, capsys):
    assert evidence(tmp_path, photo) == 0
    said = capsys.readouterr().out
    assert "fx 32.00, fy 32.00, cx 32.00, cy 24.00 px of 64x48; 90.00 x 73.74 degrees" in said
    known = read_evidence(tmp_path / "e", photo)
    camera, depth = known.file.camera, known.file.depth
    assert (camera.hfov_deg, camera.hfov_source) == (pytest.approx(90.0), "fake 1")
    assert camera.world_from_cam_rotation is None
    assert camera.unknown, "the photo is noise: nothing tells up"
    assert depth is not None
    assert (depth.space, depth.source) == ("depth", "fake 1")
    assert known.disparity is not None
    assert known.disparity.shape == SIZE_WH[::-1]
    stored = decode(ProviderCamera, (tmp_path / "e" / "camera.json").read_bytes())
    assert stored.photo_sha256 == sha256_of_file(photo)
    assert (stored.source, stored.fx) == ("fake 1", 32.0)
    record = known.file.provider
    assert record
    assert (record.name, record.version, record.device) == ("fake", "1", "cpu")
    assert record.provenance["weights"][0]["name"] == "w.bin"
    assert record.options["how"] == "well"
    assert str(tmp_path) not in (tmp_path / "e" / "evidence.json").read_text()


def test_the_stored_camera_is_a_camera_file(tmp_path, photo):
    assert evidence(tmp_path, photo) == 0
    words = ["--photo", photo, "--camera", tmp_path / "e" / "camera.json", "-o", tmp_path / "again"]
    assert run(["plugin", "evidence", *map(str, words)]) == 0
    one, two = (read_evidence(tmp_path / name).file for name in ("e", "again"))
    assert one.camera == two.camera
    assert not two.provider


def test_a_camera_that_cannot_be_used_is_unknown_and_the_rest_is_kept(tmp_path, photo, capsys):
    assert evidence(tmp_path, photo, "--option", "how=skewed", "--option", "at=1") == 0
    assert "unknown: the camera of fake 1 cannot be used: fx / fy 1.1" in capsys.readouterr().out
    known = read_evidence(tmp_path / "e").file
    assert known.camera.hfov_deg is None
    assert known.depth is not None
    assert json.loads((tmp_path / "e" / "camera.json").read_text())["fx"] == pytest.approx(35.2)


@pytest.mark.parametrize(
    ("how", "why", "code"),
    [
        ("refuse", "fake: the checkpoint is another model's; found: resnet", 2),
        ("die_loading", "ended before it was ready", 4),
        ("crash", "signal SIGKILL; going down", 2),
        ("raise", "RuntimeError: out of memory", 2),
        ("no_camera", "no camera in its answer", 2),
        ("lie", "not the one it spoke of", 2),
    ],
)
def test_what_a_provider_cannot_do_is_one_line(tmp_path, photo, capsys, how, why, code):
    assert evidence(tmp_path, photo, "--option", f"how={how}", "--option", "at=1") == code
    said = capsys.readouterr().err
    assert why in said
    assert said.count("\n") == 1
    assert not (tmp_path / "e").exists()


def test_a_provider_that_is_silent_is_ended(tmp_path, photo, capsys):
    for seconds in ("2", "60"):  # on a busy machine the model is not loaded within the first
        words = ("--option", "how=hang", "--option", "at=1", "--time-limit", seconds)
        assert evidence(tmp_path, photo, *words) != 0
        said = capsys.readouterr().err
        if "no answer" in said:
            break
    assert f"no answer after {seconds} s" in said


def test_a_provider_that_does_not_load_is_ended(tmp_path, photo, capsys):
    words = ("--option", "how=hang_loading", "--time-limit", "1")
    assert evidence(tmp_path, photo, *words) == 4
    assert "nothing after 1 s" in (said := capsys.readouterr().err)
    assert "next: raise --time-limit" in said


@pytest.mark.parametrize(
    ("words", "weights", "why"),
    [
        (("--fov", "60"), True, "pass one of them"),
        ((), False, "needs --weights"),
        (("--option", "nothing=1"), True, "no such option"),
        (("--provider", "da3"), True, "da3 recovers no camera; found: --provider da3; expected: v"),
        (("--provider", "vgg"), True, "vggt"),
    ],
)
def test_what_was_asked_wrongly_is_refused(tmp_path, photo, capsys, words, weights, why):
    assert evidence(tmp_path, photo, *words, weights=weights) == 2
    assert why in capsys.readouterr().err


@pytest.mark.parametrize(
    "words",
    [
        ("--weights", "w.pt"),
        ("--device", "cuda"),
        ("--offline",),
        ("--time-limit", "5"),
        ("--python", sys.executable),
        ("--dtype", "float16"),
        ("--option", "a=1"),
        ("--sandbox", "limits"),
    ],
)
def test_a_provider_s_option_alone_is_refused(tmp_path, photo, capsys, words):
    asked = ["plugin", "evidence", "--photo", photo, "-o", tmp_path / "e", *words]
    assert run([str(word) for word in asked]) == 2
    assert f"{words[0]} needs a --provider" in capsys.readouterr().err


def test_a_photo_alone_is_evidence_of_itself(photo):
    known = photo_alone(photo)
    about = known.file.photo
    assert (about.file_name, about.sha256) == ("one.jpg", sha256_of_file(photo))
    assert (about.width, about.height) == known.size_wh == SIZE_WH
    assert (known.file.regions, known.file.depth, known.disparity) == ((), None, None)
    assert known.file.camera.hfov_deg is None
    assert known.photo.shape == (*SIZE_WH[::-1], 3)


def test_two_depths_are_one_too_many(tmp_path, photo, capsys):
    np.save(tmp_path / "d.npy", np.ones(SIZE_WH[::-1], np.float32))
    assert evidence(tmp_path, photo, "--depth", tmp_path / "d.npy") == 2
    assert "found: d.npy, fake 1" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("shape_wh", "of_photo", "taken", "photo_wh"),
    [
        ((518, 392), True, True, (640, 480)),  # 388.5 rows to the nearest multiple of 14
        ((518, 392), False, False, (640, 480)),
        ((320, 240), False, True, (640, 480)),
        ((518, 518), True, False, (640, 480)),
        ((8, 5), True, True, (100, 50)),  # one row of the four away
        ((8, 6), True, False, (100, 60)),  # 1.2 rows
        ((400, 210), True, True, (100, 50)),  # a twentieth
        ((400, 211), True, False, (100, 50)),
        ((100, 51), False, True, (100, 50)),  # as much as a row of the larger of both
        ((100, 52), False, False, (100, 50)),
    ],
)
def test_a_network_s_grid_is_no_other_photo(tmp_path, shape_wh, of_photo, taken, photo_wh):
    np.save(tmp_path / "d.npy", np.ones(shape_wh[::-1], np.float32))
    given = GivenDepth(
        path=tmp_path / "d.npy", space="depth", source="a network", of_photo=of_photo
    )
    if taken:
        write_depth(given, photo_wh, tmp_path)
        return
    with pytest.raises(EvidenceInvalidError, match="of another photo"):
        write_depth(given, photo_wh, tmp_path)
