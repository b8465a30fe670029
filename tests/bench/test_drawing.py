"""`legoworld bench make --procedural` without assets; tests/real draws from them."""

from __future__ import annotations

import pytest

from legoworld import cli
from legoworld.bench.procedural import PACKS


@pytest.fixture
def assets(tmp_path):
    for pack in PACKS:
        (tmp_path / "kaykit" / pack).mkdir(parents=True)
    return tmp_path / "kaykit"


def draw_scenes(scenes, *more: str) -> int:
    place = ["-o", str(scenes.parent / "bench")]
    return cli.run(["bench", "make", str(scenes), *place, "--procedural", "7", *more])


def test_without_assets_nothing_is_drawn(tmp_path, capsys, monkeypatch):
    monkeypatch.delenv("LEGOWORLD_KAYKIT", raising=False)
    assert draw_scenes(tmp_path / "scenes") == 2
    assert "name it with --assets or LEGOWORLD_KAYKIT" in capsys.readouterr().err
    assert draw_scenes(tmp_path / "scenes", "--assets", str(tmp_path)) == 2
    assert "found: " + str(tmp_path) in capsys.readouterr().err
    assert not (tmp_path / "scenes").exists()


def test_scenes_of_others_are_not_mixed_in(tmp_path, capsys, assets):
    for name in ("kitchen-7-0000", "kitchen-8-0000"):
        (tmp_path / "scenes" / name).mkdir(parents=True)
        (tmp_path / "scenes" / name / "scene.blend").touch()
    assert draw_scenes(tmp_path / "scenes", "--assets", str(assets), "--count", "1") == 2
    assert "found: kitchen-8-0000" in capsys.readouterr().err


def test_a_program_that_ends_without_a_scene_is_named(tmp_path, capsys, assets):
    assert draw_scenes(tmp_path / "scenes", "--assets", str(assets), "--count", "1") == 2
    told = capsys.readouterr().err
    assert "scene 0 of seed 7 cannot be drawn" in told
    assert "there is no asset furniture/rug_oval_" in told
    assert list((tmp_path / "scenes").iterdir()) == []


def test_without_a_seed_the_scenes_must_be_there(tmp_path, capsys):
    out = ["-o", str(tmp_path / "bench")]
    assert cli.run(["bench", "make", str(tmp_path / "none"), *out]) == 2
    assert "none' does not exist" in capsys.readouterr().err


@pytest.mark.parametrize("option", ["--count=3", "--assets=."])
def test_options_of_drawing_need_a_seed(option, tmp_path, capsys):
    (tmp_path / "scenes").mkdir()
    command = ["bench", "make", str(tmp_path / "scenes"), "-o", str(tmp_path / "bench"), option]
    assert cli.run(command) == 2
    assert "needs --procedural" in capsys.readouterr().err
