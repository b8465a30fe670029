"""A file that was hashed is looked at again after it was read: by its stamp, or by its content."""

from __future__ import annotations

import hashlib
import os

import pytest

from legoworld.errors import SceneInvalidError
from legoworld.scene import freeze
from legoworld.scene.freeze import hash_files, is_still

NAME = "scene.blend"


@pytest.fixture
def settled(monkeypatch):
    """Files count as settled at once: no test waits."""
    monkeypatch.setattr(freeze, "_SETTLED_NS", -(1 << 62))


@pytest.fixture
def hashed(monkeypatch):
    """How often a file's content was hashed."""
    times: list[int] = []
    digest = hashlib.file_digest
    monkeypatch.setattr(hashlib, "file_digest", lambda *args: times.append(1) or digest(*args))
    return times


def write_scene(folder, content=b"one"):
    (folder / NAME).write_bytes(content)
    return hash_files(folder, [NAME])[NAME]


def rewrite(path, content):
    """New content of the same size under the old time, once the file system's clock has ticked."""
    before = path.stat()
    while path.stat().st_ctime_ns == before.st_ctime_ns:
        path.write_bytes(content)
        os.utime(path, ns=(before.st_atime_ns, before.st_mtime_ns))


def test_a_settled_file_is_hashed_once(tmp_path, settled, hashed):
    before = write_scene(tmp_path)
    assert is_still(tmp_path, NAME, before)
    assert len(hashed) == 1


def test_a_file_changed_just_now_is_hashed_again(tmp_path, hashed):
    before = write_scene(tmp_path)
    assert before.stamp is None
    assert is_still(tmp_path, NAME, before)
    assert len(hashed) == 2
    (tmp_path / NAME).write_bytes(b"two")
    assert not is_still(tmp_path, NAME, before)


def test_an_old_file_is_settled(tmp_path, monkeypatch):
    (tmp_path / NAME).write_bytes(b"one")
    now = freeze.time.time_ns()
    monkeypatch.setattr(freeze.time, "time_ns", lambda: now + 10_000_000_000)
    assert hash_files(tmp_path, [NAME])[NAME].stamp is not None


def test_a_change_that_restores_size_and_time_is_noticed(tmp_path, settled):
    before = write_scene(tmp_path)
    rewrite(tmp_path / NAME, b"two")
    assert (tmp_path / NAME).stat().st_size == before.bytes
    assert not is_still(tmp_path, NAME, before)


def test_a_file_that_took_its_place_is_noticed(tmp_path, settled):
    (tmp_path / "other").write_bytes(b"two")
    before = write_scene(tmp_path)
    (tmp_path / "other").replace(tmp_path / NAME)
    assert not is_still(tmp_path, NAME, before)


def test_the_same_content_under_another_stamp_is_the_same(tmp_path, settled, hashed):
    before = write_scene(tmp_path)
    (tmp_path / "other").write_bytes(b"one")
    (tmp_path / "other").replace(tmp_path / NAME)
    assert is_still(tmp_path, NAME, before)
    assert len(hashed) == 2


def test_a_file_that_went_or_became_something_else_is_noticed(tmp_path, settled):
    before = write_scene(tmp_path)
    (tmp_path / NAME).unlink()
    assert not is_still(tmp_path, NAME, before)
    os.mkfifo(tmp_path / NAME)
    with pytest.raises(SceneInvalidError, match="FIFO"):
        is_still(tmp_path, NAME, before)


def test_a_stamp_is_no_part_of_what_a_hash_is(tmp_path, settled):
    one = write_scene(tmp_path)
    (tmp_path / "elsewhere").mkdir()
    other = write_scene(tmp_path / "elsewhere")
    assert one.stamp != other.stamp
    assert one == other
    assert hash(one) == hash(other)
