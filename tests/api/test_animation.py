"""The looping picture of a scene: its stills, its swing, and that it is the same bytes again."""

from __future__ import annotations

import numpy as np
import pytest
from checkout import CHECKOUT
from PIL import Image

import legoworld
from legoworld import cli
from legoworld.api.animation import _SWING, _fit, _frames, _swing
from legoworld.errors import LegoWorldError

SCENE = CHECKOUT / "examples" / "chelsea"


@pytest.fixture(scope="module")
def scene():
    return legoworld.open_scene(SCENE)


@pytest.fixture(scope="module")
def written(scene, tmp_path_factory):
    file = tmp_path_factory.mktemp("animation") / "scene.webp"
    scene.animate(file)
    return file


def pictures(file):
    with Image.open(file) as opened:
        for number in range(opened.n_frames):
            opened.seek(number)
            yield np.asarray(opened.convert("RGB"), np.float64)


def test_it_begins_with_the_render_and_ends_near_it(written):
    with Image.open(SCENE / "final.png") as file:
        size = next(pictures(written)).shape[1::-1]
        render = np.asarray(file.convert("RGB").resize(size, Image.Resampling.BOX), np.float64)
    first, *_, last = pictures(written)
    assert max(size) == 640 or size == file.size
    assert np.abs(first - render).mean() < 6  # WebP is lossy
    assert np.abs(last - render).mean() < np.abs(last - first[::-1]).mean()


def test_a_photo_comes_first_and_sets_the_shape(scene, tmp_path):
    Image.new("RGB", (200, 100), (10, 200, 30)).save(tmp_path / "photo.png")
    scene.animate(tmp_path / "a.webp", tmp_path / "photo.png")
    first = next(pictures(tmp_path / "a.webp"))
    assert first.shape == (100, 200, 3)
    assert np.abs(first - (10, 200, 30)).max() < 12


def test_the_same_bytes_again(scene, written, tmp_path):
    assert cli.run(["inspect", str(SCENE), "--animation", str(tmp_path / "b.webp"), "-q"]) == 0
    assert (tmp_path / "b.webp").read_bytes() == written.read_bytes()


def test_the_camera_swings_about_what_it_looks_at(scene):
    view = scene.view(size_wh=(64, 48))
    poses = _swing(view)
    assert poses.shape == (_SWING, 4, 4)
    np.testing.assert_allclose(poses[0], view.world_from_cam, atol=1e-9)
    depth = float(np.median(view.depth_z_m[view.instance >= 0]))
    middles = (poses @ [0.0, 0.0, depth, 1.0])[:, :3]
    np.testing.assert_allclose(middles, np.tile(middles[0], (_SWING, 1)), atol=1e-9)
    np.testing.assert_allclose(poses[:, 2, 3], poses[0, 2, 3], atol=1e-9)  # stays at its height
    assert np.linalg.norm(poses[12, :3, 3] - poses[36, :3, 3]) > 0.1


def test_stills_fade_into_each_other_and_back():
    black, white = np.zeros((2, 2, 3), np.uint8), np.full((2, 2, 3), 240, np.uint8)
    frames = [int(frame[0, 0, 0]) for frame in _frames([black, white], [white] * 3)]
    assert frames[:12] == [0] * 12
    assert frames[12:19] == [30, 60, 90, 120, 150, 180, 210]
    assert frames[19:22] == [240] * 3
    assert frames[22:] == [210, 180, 150, 120, 90, 60, 30]


def test_a_still_of_another_shape_keeps_its_own():
    still = np.full((10, 40, 3), 200, np.uint8)
    fitted = _fit(still, (20, 20))
    assert (fitted[8:12] > 190).all()  # 20 x 5, between bars
    assert {*fitted[:6].ravel(), *fitted[14:].ravel()} == {24}
    assert (_fit(still, (80, 20)) == 200).all()


def test_what_cannot_be_shown(scene, tmp_path):
    with pytest.raises(LegoWorldError):
        scene.animate(tmp_path / "c.webp", SCENE / "scene.py")
    assert not (tmp_path / "c.webp").exists()
