"""Side files of a scene folder are untrusted: nothing outside of it is read, and reading ends."""

from __future__ import annotations

import json
import os
import socket
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from scene.gltf.documents import Document
from scene.gltf.scenes import NoBlender

from legoworld.errors import LabelsInvalidError, SceneInvalidError, SideFileInvalidError
from legoworld.files import readable_json
from legoworld.readouts.family import protocol
from legoworld.records.base import canonical
from legoworld.records.run_file import ImageRecord
from legoworld.running.image import read_image, still_valid
from legoworld.running.image_record import ImageOptions
from legoworld.running.shared_scene import HashedScene
from legoworld.scene import side_files
from legoworld.scene.blender_process import Limits
from legoworld.scene.folder import SceneFolder
from legoworld.scene.freeze import checked_artefacts, hash_files, write_frozen
from legoworld.scene.side_files import NESTING_LIMIT, SIZE_LIMITS, read_side_file
from legoworld.tracks.track import TrackImage

PRIVATE = "the private key"
IMAGE = TrackImage(id=1, file_name="scene.jpg", size_wh=(64, 64), scene="scene")


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    made = Document()
    made.quad("Chair", 4, 4, extras={"category": "chair"})
    path = tmp_path / "scenes" / "scene"
    path.mkdir(parents=True)
    (path / "scene.glb").write_bytes(made.glb())
    (tmp_path / "private.json").write_text(json.dumps({"agent": PRIVATE, "version": 1}))
    return path


def options_of(folder: Path, task: str = "coco") -> ImageOptions:
    return ImageOptions(
        scenes=folder.parent, run=folder.parent.parent / "run", protocol=protocol(task, None),
        source="glb", cache=None, require_frozen=False, max_side=None, threads=1,
    )  # fmt: skip


def hashed_scene(folder: Path) -> HashedScene:
    return HashedScene(IMAGE.scene, options_of(folder))


def record_of(folder: Path, task: str = "coco") -> ImageRecord:
    return read_image(IMAGE, options_of(folder, task), NoBlender(Limits()))


def readout(folder: Path, task: str = "coco") -> dict[str, Any]:
    return json.loads(canonical(record_of(folder, task)))


def link_out(path: Path) -> None:
    path.symlink_to(path.parents[2] / "private.json")


def relative_link_out(path: Path) -> None:
    path.symlink_to("../../private.json")


def link_by_a_folder(path: Path) -> None:
    (path.parent / "below").symlink_to(path.parents[2])
    path.symlink_to("below/private.json")


def link_to_a_link(path: Path) -> None:
    (path.parent / "other.json").symlink_to(path.parents[2] / "private.json")
    path.symlink_to("other.json")


def socket_of(path: Path) -> None:
    here = Path.cwd()
    os.chdir(path.parent)  # a socket's name may have 107 characters
    try:
        with socket.socket(socket.AF_UNIX) as made:
            made.bind(path.name)
    finally:
        os.chdir(here)


def text(content: str | bytes) -> Callable[[Path], None]:
    data = content if isinstance(content, bytes) else content.encode()
    return lambda path: path.write_bytes(data) and None


HOSTILE: dict[str, Callable[[Path], None]] = {
    "link out": link_out,
    "relative link out": relative_link_out,
    "link by a folder that is a link": link_by_a_folder,
    "link to a link": link_to_a_link,
    "link to a device": lambda path: path.symlink_to("/dev/zero"),
    "link to nothing": lambda path: path.symlink_to("absent.json"),
    "fifo": os.mkfifo,
    "socket": socket_of,
    "folder": Path.mkdir,
    "nested": text("[" * 100_000),
    "nested beyond the limit": text("[" * (NESTING_LIMIT + 1) + "]" * (NESTING_LIMIT + 1)),
    "half a surrogate": text(r'{"agent": "\ud800"}'),
    "half a surrogate in a key": text(r'{"\udfff": 1}'),
    "no UTF-8": text(b'{"agent": "\xff"}'),
    "NaN": text('{"agent": NaN}'),
    "infinity": text('{"agent": -Infinity}'),
    "a number beyond": text('{"agent": 1e999}'),
    "digits": text('{"agent": ' + "9" * 5000 + "}"),
    "empty": text(""),
    "no JSON": text("{"),
}


@pytest.mark.parametrize("make", HOSTILE.values(), ids=HOSTILE)
@pytest.mark.parametrize("name", SIZE_LIMITS)
def test_what_is_no_json_file_of_the_folder_has_its_verdict(name, make, folder):
    make(folder / name)
    with pytest.raises(SceneInvalidError) as caught:
        read_side_file(folder, name, Any)
    assert isinstance(caught.value, LabelsInvalidError if name == "labels.json" else
                      SideFileInvalidError)  # fmt: skip
    assert name in caught.value.what
    assert caught.value.found
    assert caught.value.next_step
    str(caught.value).encode()


@pytest.mark.parametrize("make", HOSTILE.values(), ids=HOSTILE)
@pytest.mark.parametrize("name", ["labels.json", "provenance.json", "frozen.json"])
def test_it_is_that_images_verdict_and_nothing_is_told(name, make, folder):
    make(folder / name)
    record = readout(folder)
    row = record["row"]
    assert (row["status"], record["predictions"]) == ("invalid", [])
    assert row["code"] == ("invalid_labels" if name == "labels.json" else "invalid_side_file")
    assert PRIVATE not in readable_json(record)


@pytest.mark.parametrize("make", [link_out, os.mkfifo, Path.mkdir])
def test_depth_reads_no_labels_and_still_tells_no_hash_of_another_file(make, folder):
    make(folder / "labels.json")
    assert readout(folder, "eth3d")["row"]["code"] == "invalid_labels"


@pytest.mark.parametrize("name", SIZE_LIMITS)
def test_a_size_limit_ends_the_reading(name, folder, monkeypatch):
    (folder / name).write_text("[" + " " * 998 + "]")
    assert read_side_file(folder, name, Any).value == []
    monkeypatch.setitem(side_files.SIZE_LIMITS, name, 999)
    with pytest.raises(SceneInvalidError, match="more than 999 bytes"):
        read_side_file(folder, name, Any)


def test_a_link_to_a_file_of_the_folder_is_that_file(folder):
    (folder / "notes").mkdir()
    (folder / "notes" / "v2.json").write_text('{"agent": "a"}')
    (folder / "provenance.json").symlink_to("notes/v2.json")
    assert readout(folder)["scene"]["provenance"] == {"agent": "a"}


def test_no_descriptor_stays_open(folder):
    (folder / "notes").mkdir()
    (folder / "notes" / "v2.json").write_text("{}")
    (folder / "provenance.json").symlink_to("notes/v2.json")
    (folder / "labels.json").mkdir()
    (folder / "frozen.json").symlink_to("notes/absent.json")

    def look():
        assert read_side_file(folder, "provenance.json", Any) is not None
        for name in ("labels.json", "frozen.json"):
            with pytest.raises(SceneInvalidError):
                read_side_file(folder, name, Any)
        assert read_side_file(folder, "execution.json", Any) is None

    look()
    before = len(list(Path("/proc/self/fd").iterdir()))
    for _ in range(20):
        look()
    assert len(list(Path("/proc/self/fd").iterdir())) < before + 20


def test_nesting_up_to_the_limit_is_read(folder):
    (folder / "provenance.json").write_text("[" * NESTING_LIMIT + "]" * NESTING_LIMIT)
    assert read_side_file(folder, "provenance.json", Any) is not None
    assert read_side_file(folder, "labels.json", Any) is None


@pytest.mark.parametrize("value", ["[]", "3", '"agent"', "null"])
def test_provenance_is_an_object(value, folder):
    (folder / "provenance.json").write_text(value)
    assert readout(folder)["row"]["code"] == "invalid_side_file"


def test_provenance_is_hashed_like_the_rest(folder):
    before = record_of(folder)
    (folder / "provenance.json").write_text('{"agent": "a"}')
    after = record_of(folder)
    assert set(after.scene.files) == {"scene.glb", "provenance.json"}
    assert before.row.files_sha256 != after.row.files_sha256
    assert still_valid(after, hashed_scene(folder), options_of(folder))
    (folder / "provenance.json").write_text('{"agent": "b"}')
    assert not still_valid(after, hashed_scene(folder), options_of(folder))


def test_a_frozen_scene_vouches_for_its_provenance(folder):
    scene = SceneFolder(path=folder, name="scene")
    (folder / "provenance.json").write_text('{"agent": "a"}')
    write_frozen(scene, hash_files(folder, scene.artefacts()), {}, {})
    assert readout(folder)["row"]["status"] == "ok"
    (folder / "provenance.json").write_text('{"agent": "b"}')
    row = readout(folder)["row"]
    assert (row["status"], "provenance.json" in row["reason"]) == ("changed", True)
    (folder / "provenance.json").unlink()
    assert readout(folder)["row"]["status"] == "changed"


def test_a_record_from_before_provenance_was_hashed_stays_good(folder):
    scene = SceneFolder(path=folder, name="scene")
    write_frozen(scene, hash_files(folder, scene.artefacts()), {}, {})
    document = json.loads((folder / "frozen.json").read_text())
    assert "provenance.json" in document.pop("covers")
    (folder / "frozen.json").write_text(json.dumps(document))
    (folder / "provenance.json").write_text('{"agent": "a"}')
    record = readout(folder)
    assert (record["row"]["status"], record["row"]["frozen"]) == ("ok", "frozen.json")
    assert record["scene"]["provenance"] == {"agent": "a"}
    (folder / "labels.json").write_text('{"version": 1, "labels": []}')
    assert readout(folder)["row"]["status"] == "changed"


@pytest.mark.parametrize(
    ("files", "found"),
    [
        ([], "expected object, got array at $.files"),
        ({"scene.glb": {"sha256": 5, "bytes": 1}}, "expected str, got int at $.files[...].sha256"),
        ({"scene.glb": {"sha256": "0"}}, "missing required field bytes at $.files[...]"),
    ],
)
def test_a_record_that_is_none_has_its_verdict(files, found, folder):
    document = {"status": "ok", "files": files, "dependencies": {}}
    (folder / "frozen.json").write_text(json.dumps(document))
    row = readout(folder)["row"]
    assert row["code"] == "invalid_side_file"
    assert found in row["reason"]


def test_a_record_cannot_leave_out_what_it_has_to_cover(folder):
    scene = SceneFolder(path=folder, name="scene")
    write_frozen(scene, {}, {}, {})
    document = {**json.loads((folder / "frozen.json").read_text()), "covers": []}
    (folder / "frozen.json").write_text(json.dumps(document))
    assert readout(folder)["row"]["status"] == "changed"


@pytest.mark.parametrize("name", ["labels.json", "provenance.json"])
def test_what_is_read_is_what_was_hashed(name, folder, monkeypatch):
    """A side file that is replaced between its hash and its use."""
    content = '{"version": 1, "labels": []}'
    (folder / name).write_text(content)
    hashed = checked_artefacts(SceneFolder(path=folder, name="scene"), require_frozen=False)
    (folder / name).write_text(content + " ")
    monkeypatch.setattr("legoworld.scene.read_scene.checked_artefacts", lambda *_a, **_n: hashed)
    row = readout(folder)["row"]
    assert (row["status"], "changed while it was read" in row["reason"]) == ("invalid", True)


ARTEFACTS = {"fifo": os.mkfifo, "folder": Path.mkdir, "socket": socket_of,
             "device": lambda path: path.symlink_to("/dev/zero")}  # fmt: skip


@pytest.mark.parametrize("make", ARTEFACTS.values(), ids=ARTEFACTS)
@pytest.mark.parametrize("name", ["scene.blend", "scene.glb", "final.png", "scene.py"])
def test_an_artefact_that_is_no_regular_file_has_its_verdict(name, make, folder):
    (folder / name).unlink(missing_ok=True)
    make(folder / name)
    row = readout(folder)["row"]
    assert (row["status"], row["code"]) == ("invalid", "invalid_scene")
    assert f"{name} cannot be read; found: it is a" in row["reason"]


def test_an_artefact_that_claims_any_size_is_not_hashed(folder):
    with (folder / "final.png").open("wb") as stream:
        stream.truncate(1 << 41)
    assert (
        "final.png cannot be read; found: 2,199,023,255,552 bytes"
        in (readout(folder)["row"]["reason"])
    )


def test_artefacts_may_be_links(folder):
    elsewhere = folder.parents[1] / "store.glb"
    (folder / "scene.glb").rename(elsewhere)
    (folder / "scene.glb").symlink_to(elsewhere)
    assert readout(folder)["row"]["n_predictions"] == 1
