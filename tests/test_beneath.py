"""No name below a program's folder leads out of it, whatever the program swaps meanwhile."""

from __future__ import annotations

import os
import socket

import pytest
from swapping import OUTSIDE, SWAPS, swapping

from legoworld import beneath
from legoworld.beneath import Beneath, RefusedFileError, name_beneath

#: Of one part of a name: what each of them is refused for is told.
MOST = 1 << 20


@pytest.fixture(params=["openat2", "component by component"], autouse=True)
def opener(request, monkeypatch):
    if request.param == "openat2" and not beneath.has_openat2():
        pytest.skip("this kernel has no openat2, or a filter of system calls forbids it")
    monkeypatch.setattr(beneath, "has_openat2", lambda: request.param == "openat2")


def list_names(folder):
    return sorted(path.name for path in folder.iterdir())


@pytest.fixture
def inside(tmp_path):
    (tmp_path / "inside" / "d").mkdir(parents=True)
    (tmp_path / "outside").mkdir()
    (tmp_path / "outside" / "secret").write_bytes(b"secret")
    with Beneath(tmp_path / "inside") as folder:
        yield folder


def test_files_are_written_read_listed_and_removed(inside, tmp_path):
    inside.make_folder("a/b")
    inside.write("a/b/c", b"one")
    inside.write("a/b/c", b"two")
    assert inside.read("a/b/c", most_bytes=3) == b"two"
    assert inside.names("a/b") == ["c"]
    assert inside.status("a/b/c").st_size == 3
    assert inside.copy_out("a/b/c", tmp_path / "copy", most_bytes=3)
    inside.copy_in(tmp_path / "copy", "d/e")
    assert inside.read("d/e", most_bytes=3) == b"two"
    inside.unlink("d/e")
    assert inside.names("d") == []
    assert inside.move_out("a", tmp_path / "moved", folder=True)
    assert (tmp_path / "moved" / "b" / "c").read_bytes() == b"two"


def test_what_is_not_there_is_nothing(inside, tmp_path):
    for name in ("x", "x/y"):
        assert inside.read(name, most_bytes=1) is None
        assert inside.status(name) is None
        assert not inside.copy_out(name, tmp_path / "copy", most_bytes=1)
        assert not inside.move_out(name, tmp_path / "copy")
        assert inside.names(name) == []
        inside.unlink(name)
    assert not (tmp_path / "copy").exists()


@pytest.mark.parametrize(
    "name",
    ["../outside/secret", "/etc/passwd", "d/../../outside/secret", "a\0b", "", ".", "\ud900"],
)
def test_names_that_lead_out_are_refused(inside, name):
    for use in (
        lambda: inside.read(name, most_bytes=MOST),
        lambda: inside.write(name, b"x"),
        lambda: inside.unlink(name),
    ):
        with pytest.raises(RefusedFileError):
            use()


@pytest.mark.parametrize("name", ["link/secret", "link/new"])
def test_no_link_is_followed_on_the_way(inside, tmp_path, name):
    (tmp_path / "inside" / "link").symlink_to(tmp_path / "outside")
    for use in (
        lambda: inside.read(name, most_bytes=MOST),
        lambda: inside.copy_out(name, tmp_path / "copy", most_bytes=MOST),
        lambda: inside.move_out(name, tmp_path / "copy"),
        lambda: inside.write(name, b"x"),
        lambda: inside.unlink(name),
        lambda: inside.make_folder(name),
        lambda: inside.names("link"),
        lambda: inside.status(name),
    ):
        with pytest.raises(RefusedFileError, match="a link"):
            use()
    assert list_names(tmp_path / "outside") == ["secret"]
    assert not (tmp_path / "copy").exists()


def test_a_folder_that_was_exchanged_for_a_link_is_not_opened(tmp_path):
    (tmp_path / "outside").mkdir()
    (tmp_path / "output").symlink_to(tmp_path / "outside")
    with pytest.raises(RefusedFileError, match="a link"):
        Beneath(tmp_path / "output")


def test_a_link_at_the_end_is_replaced_and_never_followed(inside, tmp_path):
    (tmp_path / "inside" / "d" / "f").symlink_to(tmp_path / "outside" / "secret")
    with pytest.raises(RefusedFileError):
        inside.read("d/f", most_bytes=MOST)
    with pytest.raises(RefusedFileError):
        inside.write("d/f", b"mine", new=True)
    inside.write("d/f", b"mine")
    assert inside.read("d/f", most_bytes=MOST) == b"mine"
    assert (tmp_path / "outside" / "secret").read_bytes() == b"secret"


def test_only_regular_files_of_one_name_and_a_size_are_taken(inside, tmp_path, monkeypatch):
    folder = tmp_path / "inside" / "d"
    os.mkfifo(folder / "fifo")
    (folder / "folder").mkdir()
    os.link(tmp_path / "outside" / "secret", folder / "second")
    (folder / "large").write_bytes(b"x" * 11)
    with socket.socket(socket.AF_UNIX) as listener:
        monkeypatch.chdir(folder)  # a socket's path is short
        listener.bind("socket")
    for name, found in {
        "fifo": "a FIFO",
        "folder": "a folder",
        "second": "another name",
        "large": "11 bytes",
        "socket": "No such device",
    }.items():
        with pytest.raises(RefusedFileError, match=found):
            inside.copy_out(f"d/{name}", tmp_path / "copy", most_bytes=10)
        assert not (tmp_path / "copy").exists()
    for name in ("fifo", "folder", "second", "socket"):
        with pytest.raises(RefusedFileError):
            inside.move_out(f"d/{name}", tmp_path / "moved")
        assert not (tmp_path / "moved").exists()


def test_nothing_half_written_stays(inside, tmp_path):
    (tmp_path / "inside" / "d" / "f").mkdir()
    with pytest.raises(RefusedFileError):
        inside.write("d/f", b"x")
    assert inside.names("d") == ["f"]


def test_a_name_that_a_program_swaps_never_leads_out(inside, tmp_path):
    """Hundreds of opens, each while another process exchanges the folder for a link."""
    read, outcomes = set(), set()
    with swapping(tmp_path / "inside" / "s", tmp_path / "outside"):
        for number in range(SWAPS):
            for use in (
                lambda: read.add(inside.read(f"s/{OUTSIDE}", most_bytes=MOST)),
                lambda: inside.write(f"s/{OUTSIDE}", b"chosen"),
                lambda n=number: inside.write(f"s/new-{n}", b"chosen", new=True),
                lambda n=number: inside.make_folder(f"s/folder-{n}"),
                lambda: inside.unlink(f"s/{OUTSIDE}"),
            ):
                try:
                    use()
                    outcomes.add("done")
                except RefusedFileError:
                    outcomes.add("refused")
    assert outcomes == {"done", "refused"}
    assert list_names(tmp_path / "outside") == ["secret", OUTSIDE]
    assert (tmp_path / "outside" / OUTSIDE).read_text() == "outside"
    assert read <= {None, b"chosen", b"inside"}


def test_a_path_s_name_is_told_by_the_letter(tmp_path):
    (tmp_path / "w").mkdir()
    (tmp_path / "called").symlink_to(tmp_path / "w")
    (tmp_path / "w" / "out").symlink_to("/")
    called = tmp_path / "called"
    assert str(name_beneath(f"{tmp_path}/w/a/../b.png", called)) == "b.png"
    assert str(name_beneath(f"{called}/out/b.png", called)) == "out/b.png"
    for path in ("", "a\0", "/etc/passwd", f"{called}/../x", f"{tmp_path}/wx"):
        assert name_beneath(path, called) is None
