"""Anything that one scene can cause is its verdict; what is the machine's ends the run."""

from __future__ import annotations

import errno
import json
import os
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec.structs import replace
from scene.gltf.documents import Document
from scene.gltf.scenes import NoBlender, scene_at

from legoworld import cli
from legoworld.errors import KernelBuildError, LegoWorldError
from legoworld.files import as_unicode, atomic_path, canonical_json
from legoworld.readouts.family import protocol
from legoworld.records.base import canonical
from legoworld.records.run_file import ImageRecord
from legoworld.records.run_rows import Unmatched
from legoworld.running import image as image_module
from legoworld.running.image import read_image
from legoworld.running.image_record import ImageOptions
from legoworld.scene.blender_process import BlenderProcess, Limits
from legoworld.scene.cache import SnapshotCache
from legoworld.tracks.track import TrackImage

STATUSES = ("ok", "missing", "invalid", "changed", "failed", "timeout")
IMAGE = TrackImage(id=1, file_name="scene.jpg", size_wh=(64, 64), scene="scene")


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return scene_at(tmp_path / "scenes" / "scene")


def read(
    scenes: Path, task: str = "coco", image: TrackImage = IMAGE, **more: Any
) -> dict[str, Any]:
    """The record as its journal holds it."""
    options = ImageOptions(
        scenes=scenes, run=scenes.parent / "run", protocol=protocol(task, None), source="glb",
        cache=None, require_frozen=False, max_side=None, threads=1,
    )  # fmt: skip
    options = ImageOptions(**{**vars(options), **more})
    return json.loads(canonical(read_image(image, options, NoBlender(Limits()))))


# Side files of any content.

ANY_TEXT = st.text(st.characters(exclude_categories=()), max_size=8)
JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | ANY_TEXT,
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(ANY_TEXT, inner, max_size=3),
    max_leaves=12,
)
ENTRY = st.dictionaries(
    st.sampled_from(["object", "collection", "category", "lvis_category", "coco_category", "x"]),
    ANY_TEXT | st.just("Chair") | JSON,
    max_size=4,
)
LABELS = st.fixed_dictionaries({"version": st.just(1), "labels": st.lists(ENTRY, max_size=4)})
HASH = st.none() | JSON | st.fixed_dictionaries({"sha256": ANY_TEXT, "bytes": st.integers()})
PLACES = st.dictionaries(
    ANY_TEXT | st.sampled_from(["scene.glb", "../x", "/x", "labels.json", "outside://1/x", "."]),
    HASH,
    max_size=3,
)
FROZEN = st.fixed_dictionaries(
    {"files": PLACES | JSON, "dependencies": PLACES | JSON, "status": ANY_TEXT | JSON},
    optional={"covers": st.lists(ANY_TEXT) | JSON},
)
DOCUMENTS = {"labels.json": LABELS, "provenance.json": JSON, "frozen.json": FROZEN,
             "execution.json": JSON}  # fmt: skip


def content_of(name: str) -> st.SearchStrategy[bytes]:
    def written(value: Any) -> bytes:
        return json.dumps(value).encode()

    whole = (DOCUMENTS[name] | JSON).map(written)
    cut = st.tuples(whole, st.integers(0, 60)).map(lambda t: t[0][: t[1]])
    return whole | cut | st.binary(max_size=40)


@pytest.mark.parametrize("name", DOCUMENTS)
@settings(max_examples=60)
@given(data=st.data())
def test_a_side_file_of_any_content_is_a_row_that_can_be_written(name, folder, data):
    (folder / name).write_bytes(data.draw(content_of(name)))
    record = read(folder.parent)
    row = record["row"]
    assert row["status"] in STATUSES
    assert row["code"] != "unforeseen", row["reason"]
    assert row["status"] == "ok" or "\n" not in row["reason"]
    canonical_json(record).encode()


# Texts of a scene that no file can hold.

BAD = "ch\udcffair"


@pytest.mark.parametrize("which", ["category", "label", "provenance"])
def test_half_a_surrogate_pair_is_one_row_of_the_run(which, folder, tmp_path):
    scene_at(folder.parent / "good")
    if which == "category":
        scene_at(folder, BAD, BAD)
    elif which == "label":
        labels = [{"object": "Chair", "category": BAD}]
        (folder / "labels.json").write_text(json.dumps({"version": 1, "labels": labels}))
    else:
        (folder / "provenance.json").write_text(json.dumps({"agent": BAD}))
    read = which == "category"  # written out where the scene is read
    rows = rows_of(run(folder.parent, tmp_path / "run", code=0 if read else 1))
    assert rows["good"]["status"] == "ok"
    assert rows["scene"]["status"] == ("ok" if read else "invalid")


def test_a_record_that_no_file_can_hold_is_a_verdict(folder, tmp_path, monkeypatch):
    scene_at(folder.parent / "good")
    original = image_module.make_record

    def spoilt(*arguments: Any) -> ImageRecord:
        record = original(*arguments)
        unmatched = (Unmatched(label=BAD, count=1),) if record.row.scene == "scene" else ()
        return replace(record, row=replace(record.row, unmatched=unmatched))

    monkeypatch.setattr(image_module, "make_record", spoilt)
    output = run(folder.parent, tmp_path / "run", code=1)
    rows = rows_of(output)
    assert (rows["scene"]["status"], rows["scene"]["code"]) == ("invalid", "unwritable_record")
    assert rows["good"]["status"] == "ok"
    assert len(json.loads((output / "predictions.json").read_text())) == 1


def test_a_folder_whose_name_is_no_text_is_read_and_named(folder, tmp_path):
    odd = os.fsdecode(b"scene\xff")
    scene_at(folder.parent / odd)
    rows = rows_of(run(folder.parent, tmp_path / "run"))
    assert set(rows) == {"scene", as_unicode(odd)}
    rows = rows_of(run(folder.parent, tmp_path / "depth", task="eth3d"))
    file = rows[as_unicode(odd)]["depth"]["file"]
    assert (tmp_path / "depth" / file).is_file()


def run(scenes: Path, output: Path, *, task: str = "coco", code: int = 0) -> Path:
    arguments = ["readout", str(scenes), "--task", task, "--source", "glb", "-o", str(output)]
    assert cli.run([*arguments, "--no-cache", "-q", "--workers", "1"]) == code
    return output


def rows_of(output: Path) -> dict[str, dict[str, Any]]:
    lines = (output / "per_image.jsonl").read_text().split("\n")
    rows = [json.loads(line) for line in lines if line]
    return {row["scene"]: row for row in rows}


# Long names.


@pytest.mark.parametrize("length", [200, 250, 255, 300])
@pytest.mark.parametrize("task", ["coco", "eth3d"])
def test_a_long_name_is_read_or_its_own_verdict(task, length, folder, tmp_path):
    name = "n" * length
    if length <= 255:
        scene_at(folder.parent / name)
    image = TrackImage(id=1, file_name=f"{name}.jpg", size_wh=(64, 64), scene=name)
    row = read(folder.parent, task, image)["row"]
    fits = length <= 255 and (task == "coco" or length + len(".npz") <= 255)
    assert row["status"] == ("ok" if fits else "invalid")
    assert "File name too long" in row["reason"] if not fits else row["reason"] is None


def test_names_that_begin_alike_are_written_at_once(tmp_path):
    first, second = tmp_path / ("n" * 100 + "a"), tmp_path / ("n" * 100 + "b")
    with atomic_path(first) as one, atomic_path(second) as two:
        one.write_text("a")
        two.write_text("b")
    assert (first.read_text(), second.read_text()) == ("a", "b")


# What is unforeseen, and what is the machine's.


def raising(monkeypatch: pytest.MonkeyPatch, error: BaseException) -> None:
    def fail(*_arguments: Any) -> None:
        raise error

    monkeypatch.setattr(image_module, "make_record", fail)


SCENES_FAULT = [ZeroDivisionError("zero"), RecursionError("deep"), MemoryError(), KeyError("key"),
                AssertionError(), UnicodeDecodeError("utf-8", b"\xff", 0, 1, "no")]  # fmt: skip


@pytest.mark.parametrize("error", SCENES_FAULT, ids=repr)
def test_what_is_unforeseen_is_a_row_with_its_place(error, folder, monkeypatch):
    raising(monkeypatch, error)
    row = read(folder.parent)["row"]
    assert (row["status"], row["code"]) == ("failed", "unforeseen")
    assert f"{type(error).__name__}:" in row["reason"]
    assert "(test_wall.py, line " in row["reason"]


@pytest.mark.parametrize("options", [[], ["-q"], ["-v"], ["-v", "-q"], ["-v", "--json"]], ids=str)
def test_the_traceback_of_what_is_unforeseen_is_printed_with_v_alone(
    options, folder, monkeypatch, tmp_path, capsys
):
    """On standard error; it names files of this machine and goes into no result."""
    raising(monkeypatch, ZeroDivisionError("zero"))
    track = {"info": {}, "categories": [], "images": [
        {"id": 1, "file_name": "scene.jpg", "width": 64, "height": 48},
    ]}  # fmt: skip
    (tmp_path / "track.json").write_text(json.dumps(track))
    command = ["readout", str(folder.parent), "--task", "coco", "--source", "glb", "--no-cache"]
    command += ["--track", str(tmp_path / "track.json"), "-o", str(tmp_path / "run")]
    assert cli.run([*command, *options]) == 1
    shown = capsys.readouterr()
    traced = 'scene.jpg: Traceback (most recent call last):\n  File "'
    assert (traced in shown.err) is ("-v" in options)
    assert ("in fail\n" in shown.err) is ("-v" in options)
    assert "Traceback" not in shown.out
    for path in (tmp_path / "run").rglob("*"):
        assert path.is_dir() or b"Traceback" not in path.read_bytes()


@pytest.mark.blender
def test_what_is_unforeseen_in_blender_carries_its_traceback_too():
    with BlenderProcess(Limits()) as blender, pytest.raises(LegoWorldError) as caught:
        blender.request({"kind": "nonsense"})
    assert "KeyError: 'nonsense' (worker.py, line " in caught.value.found
    assert caught.value.trace.startswith("Traceback (most recent call last):\n")
    assert caught.value.trace.endswith("KeyError: 'nonsense'\n")
    assert "Traceback" not in str(caught.value)


def test_a_refused_file_is_the_scenes(folder, monkeypatch):
    raising(monkeypatch, OSError(errno.EIO, "Input/output error", str(folder / "font.ttf")))
    row = read(folder.parent)["row"]
    assert (row["status"], row["code"]) == ("invalid", "invalid_scene")
    assert "Input/output error" in row["reason"]


@pytest.mark.parametrize(
    "error",
    [OSError(errno.ENOSPC, "No space left"), OSError(errno.EMFILE, "Too many open files"),
     OSError(errno.EROFS, "Read-only"), KernelBuildError("no kernel"), ImportError("no numpy"),
     "run", "cache"],
    ids=str,
)  # fmt: skip
def test_what_is_the_machines_ends_the_run(error, folder, monkeypatch, tmp_path):
    if isinstance(error, str):
        error = PermissionError(errno.EACCES, "Permission denied", str(tmp_path / error / "x"))
    raising(monkeypatch, error)
    with pytest.raises(type(error)):
        read(folder.parent, cache=SnapshotCache(tmp_path / "cache"))


def test_ctrl_c_is_no_verdict(folder, monkeypatch):
    raising(monkeypatch, KeyboardInterrupt())
    with pytest.raises(KeyboardInterrupt):
        read(folder.parent)


def test_a_depth_file_that_cannot_be_written_ends_the_run(folder, tmp_path):
    (tmp_path / "run").write_text("a file where the folder should be")
    with pytest.raises(OSError, match=r"Not a directory|File exists"):
        read(folder.parent, "eth3d")


def test_a_file_that_cannot_be_read_is_one_row(folder, tmp_path, monkeypatch):
    """As a font on a bad disk: it can be looked at, opened, and not read."""
    scene_at(folder.parent / "good")
    (folder / "final.png").write_bytes(b"x")

    def refuse(stream: Any, *_arguments: Any) -> Any:
        if stream.name and os.fstat(stream.fileno()).st_size == 1:
            raise OSError(errno.EIO, "Input/output error")
        return digest(stream, *_arguments)

    import hashlib

    digest = hashlib.file_digest
    monkeypatch.setattr("legoworld.scene.freeze.hashlib.file_digest", refuse)
    rows = rows_of(run(folder.parent, tmp_path / "run", code=1))
    assert rows["good"]["status"] == "ok"
    assert "final.png cannot be read; found: Input/output error" in rows["scene"]["reason"]


# What a prediction is of.


def test_each_prediction_names_its_objects_in_order(tmp_path):
    made = Document()
    made.quad("Table", 4, 4, extras={"category": "dining table"})
    chair = made.quad("Chair", 20, 20, extras={"category": "chair"})
    made.json["nodes"][chair]["name"] = "Chair"
    scene = tmp_path / "scenes" / "scene"
    scene.mkdir(parents=True)
    (scene / "scene.glb").write_bytes(made.glb())
    record = read(scene.parent)
    names = {c.id: c.name for c in protocol("coco", None).vocabulary.categories}
    assert record["row"]["exported"] == [
        {"name": "Chair", "category": "chair", "objects": ["Chair"]},
        {"name": "Table", "category": "dining table", "objects": ["Table"]},
    ]
    assert [names[p["category_id"]] for p in record["predictions"]] == [
        e["category"] for e in record["row"]["exported"]
    ]
