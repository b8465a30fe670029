"""What a run folder may hold, when a stored result counts, and what is said where it does not."""

from __future__ import annotations

import errno
import json
import shutil
from collections import namedtuple
from pathlib import Path
from typing import Any

import pytest
from msgspec.structs import replace
from running.run_folders import readout, results, tree
from scene.gltf.scenes import scene_at

from legoworld import cli
from legoworld.readouts.depth import DEPTH_FILE
from legoworld.records.base import canonical
from legoworld.records.folders import run_journal as journal
from legoworld.records.folders.run_folder import (
    begin,
    delete_leftovers,
    earlier_records,
    recorded_configuration,
    refuse_strangers,
)
from legoworld.records.predictions import Prediction
from legoworld.records.run_file import Configuration, ImageRecord, Shard, WholeRun
from legoworld.records.run_rows import RunRow
from legoworld.running import scene_pass
from legoworld.running.scene_pass import OutputFullError, check_disk

FIXED = ("--source", "glb", "--no-cache", "--workers", 1)


@pytest.fixture
def scenes(tmp_path: Path) -> Path:
    for name in ("a", "b"):
        scene_at(tmp_path / "scenes" / name)
    return tmp_path / "scenes"


@pytest.fixture
def done(scenes: Path) -> Path:
    output = scenes.parent / "run"
    assert readout(scenes, output, *FIXED) == 0
    return output


def read_again(scenes: Path, output: Path, capsys: Any, *more: object, task: str = "coco") -> int:
    """How many images of two the same command reads again."""
    capsys.readouterr()
    words = ["readout", str(scenes), "--task", task, "-o", str(output), *map(str, (*FIXED, *more))]
    assert cli.run(words) in (0, 1)
    said = "".join(capsys.readouterr())
    for kept, verb in ((1, "has"), (2, "have")):
        if f"{kept} of 2 images {verb} a valid result already" in said:
            return 2 - kept
    return 2


# Folders that are no run's.


@pytest.mark.parametrize("name", ["notes.txt", "summary.json", "predictions.json", "depth", ".git"])
def test_a_folder_that_holds_something_else_is_refused(name, scenes, tmp_path, capsys):
    output = tmp_path / "mine"
    output.mkdir()
    (output / name).write_text("{}")
    assert readout(scenes, output, *FIXED) == 2
    assert f"found: {name};" in capsys.readouterr().err
    assert readout(scenes, output, *FIXED, "--overwrite") == 2
    assert [path.name for path in output.iterdir()] == [name]


def test_five_of_the_files_are_named(tmp_path, scenes, capsys):
    output = tmp_path / "mine"
    output.mkdir()
    for name in "gfedcba":
        (output / name).touch()
    assert readout(scenes, output, *FIXED) == 2
    assert "found: a, b, c, d, e;" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("names", "is_a_run"),
    [
        ((), False),
        (("summary.json", "predictions.json"), False),
        (("per_image.jsonl",), True),
        (("journal.jsonl",), True),
        ((".lock", "summary.json", ".x.tmp-legoworld"), True),
        (("per_image.jsonl", "holiday.jpg"), False),
    ],
)
def test_a_damaged_run_is_begun_anew_only_where_nothing_else_lies(names, is_a_run, tmp_path):
    from legoworld.errors import ConfigurationMismatchError
    from legoworld.files import TEMPORARY_SUFFIX

    (tmp_path / "run.json").write_text("damaged")
    for name in names:
        (tmp_path / name.replace(".tmp-legoworld", TEMPORARY_SUFFIX)).touch()
    if is_a_run:
        refuse_strangers(tmp_path)
    else:
        with pytest.raises(ConfigurationMismatchError, match=r"run\.json in the output folder"):
            refuse_strangers(tmp_path)


def test_what_is_being_written_outlives_the_beginning(done):
    """A baseline writes its first result while its provenance is put on record."""
    writing = done / "depth" / ".b.npz.1.tmp"
    writing.parent.mkdir()
    writing.touch()
    begin(done, recorded_configuration(done), overwrite=False)
    assert writing.exists()
    delete_leftovers(done)
    assert not writing.exists()


def test_what_a_killed_start_left_is_no_stranger(tmp_path):
    from legoworld.files import TEMPORARY_SUFFIX

    (tmp_path / ".lock").touch()
    (tmp_path / f".configuration.json.1{TEMPORARY_SUFFIX}").touch()
    refuse_strangers(tmp_path)
    (tmp_path / f".other.json.1{TEMPORARY_SUFFIX}").touch()
    with pytest.raises(Exception, match="not a run"):
        refuse_strangers(tmp_path)


# Configurations.

WHOLE = WholeRun(attempted=3, partial=False)
SHARD = Shard(index=1, of=2, whole=WHOLE)
CONFIGURATION = Configuration(task="coco", attempted=2, shard=SHARD, weights="x" * 60)


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"task": "lvis"}, 'task: "coco" -> "lvis"'),
        (
            {"shard": None},
            "shard.index: 1 -> null; shard.of: 2 -> null; shard.whole.attempted: 3 -> null",
        ),
        ({"shard": Shard(index=1, of=3, whole=WHOLE)}, "shard.of: 2 -> 3"),
        ({"options": {}}, "options: null -> {}"),
        ({"weights": "y" * 50}, f'weights: "{"x" * 36}... -> "{"y" * 36}...'),
        ({"weights": "y" * 38}, f'-> "{"y" * 38}"'),
    ],
)
def test_every_key_that_differs_is_shown_short(changes, said, tmp_path):
    begin(tmp_path, CONFIGURATION, overwrite=False)
    now = replace(CONFIGURATION, **changes)
    for check in (
        lambda: begin(tmp_path, now, overwrite=False),
        lambda: earlier_records(tmp_path, now, overwrite=False),
    ):
        with pytest.raises(Exception, match="another configuration") as caught:
            check()
        assert said in str(caught.value)
    assert earlier_records(tmp_path, now, overwrite=False, unknown=[*changes]) == []
    assert earlier_records(tmp_path, now, overwrite=True) == []
    begin(tmp_path, now, overwrite=True)
    begin(tmp_path, now, overwrite=False)


# Results that count, and those that do not.


def test_a_whole_run_reads_nothing_again(scenes, done, capsys):
    assert read_again(scenes, done, capsys) == 0


def test_a_changed_scene_is_read_again(scenes, done, capsys):
    scene_at(scenes / "a", "Dog", "dog")
    assert read_again(scenes, done, capsys) == 1
    rows = [json.loads(line) for line in (done / "per_image.jsonl").read_text().splitlines()]
    assert [row["exported"][0]["category"] for row in rows] == ["dog", "chair"]


def test_new_side_files_and_records_are_read(scenes, done, capsys):
    (scenes / "a" / "provenance.json").write_text("{}")
    assert read_again(scenes, done, capsys) == 1
    (scenes / "a" / "provenance.json").unlink()
    assert read_again(scenes, done, capsys) == 1
    assert read_again(scenes, done, capsys) == 0


def test_a_scene_that_went_is_missing(scenes, done, capsys):
    shutil.rmtree(scenes / "a")
    capsys.readouterr()
    track = done.parent / "track.json"
    images = [{"id": i, "file_name": f"{n}.jpg", "width": 64, "height": 64}
              for i, n in ((1, "a"), (2, "b"))]  # fmt: skip
    track.write_text(json.dumps({"images": images}))
    other = done.parent / "other"
    assert readout(scenes, other, *FIXED, "--track", track) == 1
    scene_at(scenes / "a")
    assert read_again(scenes, other, capsys, "--track", track) == 1  # a failure is never kept


def test_changed_predictions_are_read_again(scenes, done, capsys):
    before = tree(done)
    path = done / "predictions.json"
    path.write_text(path.read_text().replace('"score":1.0', '"score":0.5', 1))
    assert read_again(scenes, done, capsys) > 0
    assert tree(done) == before


@pytest.mark.parametrize("damage", ["gone", "other", "unchanged"])
def test_depth_files_are_compared(damage, scenes, tmp_path, capsys):
    output = tmp_path / "depth run"
    assert readout(scenes, output, *FIXED, task="eth3d") == 0
    before = tree(output)
    path = output / "depth" / "a.npz"
    if damage == "gone":
        path.unlink()
    elif damage == "other":
        path.write_bytes(path.read_bytes()[:-1] + b"x")
    assert read_again(scenes, output, capsys, task="eth3d") == (damage != "unchanged")
    assert tree(output) == before


def test_a_run_without_its_scenes_is_read_again(scenes, done, capsys):
    before = results(done)
    document = json.loads((done / "run.json").read_text())
    document["scenes"] = {}
    (done / "run.json").write_text(json.dumps(document))
    assert read_again(scenes, done, capsys) == 2
    assert results(done) == before


# The disk.


@pytest.mark.parametrize(("free", "fits"), [(12_000_000, True), (1_000, False)])
def test_depth_that_will_not_fit_is_said_before_the_first_file(free, fits, tmp_path, monkeypatch):
    usage = namedtuple("usage", "total used free")
    monkeypatch.setattr(scene_pass.shutil, "disk_usage", lambda _folder: usage(0, 0, free))
    said: list[str] = []
    sizes = [DEPTH_FILE.most_bytes(wh) for wh in ((1000, 500), (1000, 250))]  # 3 MB of float32

    def check() -> None:
        check_disk(tmp_path, sizes, said.append, what="depth", next_step="go elsewhere")

    if fits:
        check()
    else:
        with pytest.raises(OutputFullError, match=r"found: 0 MB free; expected: 3 MB; next: go"):
            check()
    assert said == [f"depth: about 3 MB for 2 images of known size, {free // 10**6} MB free"]
    assert OutputFullError("x").exit_code == 4


def test_depth_that_just_fits_is_written(tmp_path, monkeypatch):
    usage = namedtuple("usage", "total used free")
    needed = DEPTH_FILE.most_bytes((100, 50))
    monkeypatch.setattr(scene_pass.shutil, "disk_usage", lambda _folder: usage(0, 0, needed))
    check_disk(tmp_path, [needed], lambda _text: None, what="depth", next_step="")
    with pytest.raises(OutputFullError):
        check_disk(tmp_path, [needed, 1], lambda _text: None, what="depth", next_step="")


# The journal.


class FullDisk:
    """A file that takes a few bytes and then no more."""

    name = "run/journal.jsonl"

    def __init__(self, error: OSError) -> None:
        self.error = error

    def tell(self) -> int:
        return 0

    def write(self, _data: bytes) -> int:
        raise self.error


BOX = Prediction(image_id=1, category_id=2, score=0.5, bbox=(1, 2, 3, 4))


def record(number):
    row = RunRow(image_id=number, file_name="a.jpg", status="ok")
    return ImageRecord(row=row, predictions=(BOX,))


@pytest.mark.parametrize(("named", "shown"), [(None, "run/journal.jsonl"), ("other", "other")])
def test_a_full_disk_says_which_file(named, shown):
    error = OSError(errno.ENOSPC, "No space left on device", named)
    with pytest.raises(OSError, match="No space") as caught:
        journal.append(FullDisk(error), record(1))
    assert caught.value.filename == shown


def test_a_journal_gives_back_what_was_put_in_and_only_that(tmp_path):
    kept = []
    for number in range(3):  # opened three times, as by three runs
        with journal.journal(tmp_path) as stream:
            kept.append(journal.append(stream, record(number)))
    assert [k.row.image_id for k in kept] == [0, 1, 2]
    records, damaged = journal.journal_records(tmp_path)
    assert (records, damaged) == ([record(n) for n in range(3)], 0)
    path = tmp_path / "journal.jsonl"
    whole = path.read_bytes()
    assert whole.startswith(canonical(records[0]).encode() + b"\t")
    path.write_bytes(whole[:-1])  # torn: cut when it is next opened
    assert journal.journal_records(tmp_path) == (records[:2], 0)
    assert path.read_bytes() == b"".join(whole.splitlines(keepends=True)[:2])
    path.write_bytes(whole.replace(b"bbox", b"BBOX", 1))
    assert journal.journal_records(tmp_path) == (records[1:], 1)
    assert journal.journal_records(tmp_path / "none") == ([], 0)
