"""Arrays in a file: what comes back, and that no damaged file is taken for a whole one."""

from __future__ import annotations

import numpy as np
import pytest

from legoworld.scene.array_file import read_arrays, write_arrays

ARRAYS = {
    "empty": np.empty((0, 3, 2), np.float32),
    "bytes": np.arange(7, dtype=np.uint8),
    "text": np.frombuffer("Größe\n".encode(), np.uint8),
    "matrix": np.arange(24, dtype=np.float64).reshape(2, 3, 4),
    "turned": np.arange(6, dtype=np.int32).reshape(2, 3).T,
    "one": np.array(5, np.int64),
}


def test_arrays_come_back_with_their_types_shapes_and_order(tmp_path):
    write_arrays(tmp_path / "a", ARRAYS)
    read = read_arrays(tmp_path / "a")
    assert list(read) == list(ARRAYS)
    for name, array in ARRAYS.items():
        assert read[name].dtype == array.dtype
        assert read[name].shape == array.shape
        assert np.array_equal(read[name], array)


def test_arrays_lie_aligned_for_their_type_and_cannot_be_changed(tmp_path):
    write_arrays(tmp_path / "a", ARRAYS)
    for array in read_arrays(tmp_path / "a").values():
        assert array.flags.aligned
        with pytest.raises(ValueError, match="read-only"):
            array[...] = 1


def test_no_byte_can_be_changed_unnoticed(tmp_path):
    path = tmp_path / "a"
    write_arrays(path, ARRAYS)
    whole = path.read_bytes()
    for place in range(len(whole)):
        damaged = bytearray(whole)
        damaged[place] ^= 0x10
        path.write_bytes(damaged)
        with pytest.raises(ValueError, match=r"it is (not a legoworld array file|damaged)"):
            read_arrays(path)


def test_a_file_with_more_or_less_than_was_written_is_refused(tmp_path):
    path = tmp_path / "a"
    write_arrays(path, ARRAYS)
    whole = path.read_bytes()
    for content in (whole + b"\0", whole[:-1], whole[: len(whole) // 2], whole[:25], b""):
        path.write_bytes(content)
        with pytest.raises(ValueError, match=r"it is (not a legoworld array file|damaged)"):
            read_arrays(path)


def test_equal_arrays_give_equal_bytes(tmp_path):
    write_arrays(tmp_path / "a", ARRAYS)
    write_arrays(tmp_path / "b", read_arrays(tmp_path / "a"))
    assert (tmp_path / "a").read_bytes() == (tmp_path / "b").read_bytes()


def test_what_is_passed_on_replaces_what_was_there_whole(tmp_path):
    path = tmp_path / "a"
    longer = {"long": np.arange(1000, dtype=np.int64)}
    for arrays in (ARRAYS, longer, ARRAYS):
        write_arrays(path, arrays, passing=True)
        read = read_arrays(path, passing=True)
        assert list(read) == list(arrays)
        assert all(np.array_equal(read[name], array) for name, array in arrays.items())


def test_what_is_passed_on_is_never_taken_for_what_is_kept(tmp_path):
    write_arrays(tmp_path / "passed", ARRAYS, passing=True)
    write_arrays(tmp_path / "kept", ARRAYS)
    with pytest.raises(ValueError, match="it is damaged"):
        read_arrays(tmp_path / "passed")
    with pytest.raises(ValueError, match="it is damaged"):
        read_arrays(tmp_path / "kept", passing=True)
