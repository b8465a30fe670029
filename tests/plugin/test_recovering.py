"""A rollback that ended between its renames: no byte of the user's is lost, nor of anyone's."""

from __future__ import annotations

from pathlib import Path

import pytest

from legoworld.plugin.live import _ASIDE, _RECOVER


def recover(kept: Path | str) -> str | None:
    """What Blender runs before every copy and every rollback."""
    names: dict = {}
    exec(_RECOVER, names)
    return names["recover"](str(kept))


def contents(folder: Path) -> dict[str, bytes]:
    return {p.name: p.read_bytes() for p in folder.iterdir()}


@pytest.mark.parametrize("saved", [None, b"half of a save"])
def test_the_user_s_file_comes_back_and_what_stood_in_its_place_stays(saved, tmp_path):
    kept = tmp_path / "room.blend"
    Path(f"{kept}{_ASIDE}").write_bytes(b"the user's")
    if saved is not None:
        kept.write_bytes(saved)
    assert recover(kept) == str(kept)
    assert kept.read_bytes() == b"the user's"
    beside = {k: v for k, v in contents(tmp_path).items() if k != kept.name}
    assert list(beside.values()) == ([] if saved is None else [saved])
    assert recover(kept) is None


def test_a_second_time_overwrites_nothing_of_the_first(tmp_path):
    kept = tmp_path / "room.blend"
    for number in (1, 2, 3):
        kept.write_bytes(b"save %d" % number)
        Path(f"{kept}{_ASIDE}").write_bytes(b"user %d" % number)
        recover(kept)
    assert sorted(contents(tmp_path).values()) == [b"save 1", b"save 2", b"save 3", b"user 3"]


def test_nothing_aside_and_no_name_is_nothing_to_do(tmp_path):
    kept = tmp_path / "room.blend"
    kept.write_bytes(b"the user's")
    assert recover(kept) is None
    assert recover("") is None
    assert contents(tmp_path) == {"room.blend": b"the user's"}
