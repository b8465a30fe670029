"""A user without HOME, without a passwd entry, or with a home that cannot be written."""

from __future__ import annotations

import json
import pwd
from pathlib import Path

import pytest

from legoworld import cli
from legoworld.api.folders import written_at
from legoworld.baselines.cards import baseline_cards
from legoworld.baselines.environments import environment_folder
from legoworld.files import home_folder
from legoworld.scene.cache import (
    CacheFolderError,
    SnapshotCache,
    default_cache_folder,
    why_unwritable,
)

NOWHERE = "/proc/nowhere"
SCENES = """
fresh(); camera(); quad("Card", category="chair"); save("one")
"""


@pytest.fixture
def no_home(monkeypatch: pytest.MonkeyPatch) -> None:
    def unknown(uid: int) -> None:
        raise KeyError(f"getpwuid(): uid not found: {uid}")

    for name in ("HOME", "XDG_CACHE_HOME", "XDG_DATA_HOME", "LEGOWORLD_CACHE"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr(pwd, "getpwuid", unknown)


@pytest.fixture
def bad_home(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("XDG_CACHE_HOME", "XDG_DATA_HOME", "LEGOWORLD_CACHE"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("HOME", NOWHERE)


@pytest.mark.usefixtures("no_home")
def test_without_a_home_everything_has_a_place() -> None:
    assert home_folder() == Path("/")
    assert default_cache_folder() == Path("/.cache/legoworld/snapshots")
    assert str(environment_folder(baseline_cards()[0])).startswith("/.local/share/legoworld/")
    assert cli.run(["agent", "check", "claude"]) in (0, 1)


@pytest.mark.blender
@pytest.mark.usefixtures("bad_home")
def test_a_cache_that_nobody_chose_is_left_out_and_said(
    scenes: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["readout", str(scenes), "--task", "coco", "-o", str(tmp_path / "run"), "-q"]
    assert cli.run(words) == 0
    said = capsys.readouterr().err
    assert f"the snapshot cache {NOWHERE}/.cache/legoworld/snapshots cannot be written" in said
    assert "continuing without one; --cache DIR or LEGOWORLD_CACHE" in said
    assert "--no-cache" in said


@pytest.mark.blender
def test_a_chosen_cache_that_cannot_be_written_is_named_and_no_scene_is_blamed(
    scenes: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["readout", str(scenes), "--task", "coco", "-o", str(tmp_path / "run"), "-q"]
    assert cli.run([*words, "--cache", NOWHERE]) == 4
    (said,) = capsys.readouterr().err.splitlines()
    assert said.startswith("legoworld: the snapshot cache cannot be written; found: /proc/nowhere")
    assert "--cache DIR or LEGOWORLD_CACHE, or pass --no-cache" in said


@pytest.mark.usefixtures("bad_home")
def test_a_url_needs_a_place_too() -> None:
    with (
        pytest.raises(CacheFolderError, match="cannot be written"),
        written_at("memory://bucket/run", last="run.json"),
    ):
        pass


def test_a_full_disk_stays_what_it_is() -> None:
    with (
        pytest.raises(OSError, match="No space"),
        SnapshotCache(Path("x")).translate_write_errors(),
    ):
        raise OSError(28, "No space left on device")


@pytest.mark.blender
@pytest.mark.usefixtures("bad_home")
def test_doctor_names_the_cache(capsys: pytest.CaptureFixture[str]) -> None:
    cli.run(["doctor", "--json"])
    findings = {f["name"]: f for f in json.loads(capsys.readouterr().out)["findings"]}
    cache = findings["snapshot cache"]
    assert not cache["good"]
    assert not cache["needed"]
    assert cache["found"].startswith(f"{NOWHERE}/.cache/legoworld/snapshots cannot be written")
    assert "--cache DIR" in cache["next_step"]


def test_a_folder_that_can_be_written_is_made_once_and_kept(tmp_path):
    for _ in range(2):
        assert why_unwritable(tmp_path / "a" / "cache") == ""
    (tmp_path / "file").touch()
    assert why_unwritable(tmp_path / "file")
