"""Locks between processes, and file systems that have none."""

from __future__ import annotations

import errno
import fcntl
import os
from pathlib import Path

import pytest
from agents.tracks import make_track, plan, run

from legoworld import exit_codes, locks
from legoworld.errors import UsageError

REFUSED = UsageError("held")


def taken_by_another_process(folder: Path) -> bool:
    """Whether a process that tries now is refused."""
    pid = os.fork()
    if pid == 0:
        descriptor = os.open(folder, os.O_RDONLY)
        os._exit(0 if locks.take(descriptor, folder, wait=False) else 1)
    return os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1]) == 1


def test_a_folder_is_held_until_the_end_of_the_block_and_nothing_is_left_in_it(tmp_path):
    folder = tmp_path / "new"
    with locks.held_folder(folder, REFUSED):
        assert taken_by_another_process(folder)
        with pytest.raises(UsageError, match="held"), locks.held_folder(folder, REFUSED):
            pass
    assert not taken_by_another_process(folder)
    assert list(folder.iterdir()) == []


@pytest.mark.parametrize("number", [errno.ENOLCK, errno.ENOTSUP, errno.ENOSYS])
def test_a_file_system_without_locks_is_refused_unless_there_is_one_writer(
    number, tmp_path, monkeypatch
):
    def flock(_descriptor: int, _operation: int) -> None:
        raise OSError(number, os.strerror(number))

    monkeypatch.setattr(fcntl, "flock", flock)
    uses = [
        lambda: locks.held_alone(tmp_path / ".lock", REFUSED),
        lambda: locks.held_folder(tmp_path, REFUSED),
        lambda: locks.held_folder(tmp_path),
    ]
    for use in uses:
        with pytest.raises(locks.NoLocksError, match="LEGOWORLD_UNLOCKED=1") as refused, use():
            pass
        assert refused.value.exit_code == exit_codes.BLOCKED
    monkeypatch.setenv(locks.UNLOCKED, "1")
    for use in uses:
        with use():
            pass


def test_another_error_of_a_lock_is_no_missing_lock(tmp_path, monkeypatch):
    def flock(_descriptor: int, _operation: int) -> None:
        raise OSError(errno.EBADF, os.strerror(errno.EBADF))

    monkeypatch.setattr(fcntl, "flock", flock)
    with pytest.raises(OSError, match="Bad file") as failed, locks.held_folder(tmp_path):
        pass
    assert failed.value.errno == errno.EBADF


def test_a_second_run_into_a_folder_of_scenes_is_refused_before_it_deletes_anything(tmp_path):
    make_track(tmp_path, ["one"], task="bench")
    (tmp_path / "programs").mkdir()
    made = plan(tmp_path)
    (tmp_path / "scenes" / "one").mkdir(parents=True)
    before = sorted(tmp_path.rglob("*"))
    with (
        locks.held_folder(tmp_path / "scenes", REFUSED),
        pytest.raises(UsageError, match=r"another run makes trials in .*scenes"),
    ):
        run(made, tmp_path / "scenes")
    assert sorted(tmp_path.rglob("*")) == before
