"""Scene folders: which files count, what is said of a folder without a scene, and final.png."""

from __future__ import annotations

import struct
import zlib

import cv2
import numpy as np
import pytest

from legoworld.api.listener import Listener
from legoworld.api.readout import readout
from legoworld.api.scene_folders import freeze
from legoworld.errors import SceneInvalidError, SceneMissingError
from legoworld.scene.artefacts import check_picture, without_metadata
from legoworld.scene.folder import SceneFolder, find_scene
from legoworld.scene.pictures import PictureTooLargeError, decoded_picture
from legoworld.tracks.track import folders_without_scene


def test_artefacts_stand_in_a_fixed_order_and_urdf_files_are_last(tmp_path):
    for name in ("z.urdf", "provenance.json", "a.urdf", "scene.py", "final.png", "scene.glb",
                 "bell\a.urdf", "notes.txt", "frozen.json"):  # fmt: skip
        (tmp_path / name).write_text("")
    (tmp_path / "labels.json").symlink_to("nowhere")  # it is judged, though it leads nowhere
    (tmp_path / "scene.blend").symlink_to("nowhere")
    scene = SceneFolder(path=tmp_path, name="x")
    assert scene.artefacts() == (
        "scene.glb", "final.png", "scene.py", "labels.json", "provenance.json", "a.urdf", "z.urdf",
    )  # fmt: skip
    assert SceneFolder(path=tmp_path / "none", name="none").artefacts() == ()


def test_a_scene_is_found_by_either_file(tmp_path):
    for name in ("scene.blend", "scene.glb"):
        folder = tmp_path / name[-3:]
        folder.mkdir()
        (folder / name).write_text("")
        assert find_scene(tmp_path, folder.name) == SceneFolder(path=folder, name=folder.name)


def test_a_folder_that_is_not_there_and_one_without_a_scene(tmp_path):
    with pytest.raises(SceneMissingError) as caught:
        find_scene(tmp_path, "x")
    assert (caught.value.found, caught.value.expected) == (
        "no such folder", "x/scene.blend below the folder of scenes",
    )  # fmt: skip
    (tmp_path / "x").mkdir()
    with pytest.raises(SceneMissingError, match="holds no scene; found: an empty folder; expected"):
        find_scene(tmp_path, "x")
    for name in "gfedcba":
        (tmp_path / "x" / name).write_text("")
    with pytest.raises(SceneMissingError, match=r"a, b, c, d, e; expected: scene\.blend"):
        find_scene(tmp_path, "x")


def test_a_link_to_nothing_is_said_to_be_one(tmp_path):
    (tmp_path / "x").mkdir()
    (tmp_path / "x" / "scene.blend").symlink_to("elsewhere.blend")
    with pytest.raises(SceneMissingError, match=r"scene\.blend is a link to a file that does not"):
        find_scene(tmp_path, "x")


def test_folders_of_a_scene_without_its_file_are_named_where_no_track_names_them(tmp_path):
    for name in ("good/scene.glb", "bare/final.png", "textures/wood.png", "labels.json"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text("{}")
    (tmp_path / "folder" / "scene.blend").mkdir(parents=True)
    assert folders_without_scene(tmp_path) == ["bare", "folder"]
    notices: list[str] = []
    heard = Listener(notice=notices.append)
    run = readout(tmp_path, tmp_path / "run", task="coco", source="glb", listener=heard)
    assert [row.scene for row in run.rows] == ["good"]
    assert [row.scene for row in freeze(tmp_path, listener=heard)] == ["good"]
    assert notices == 2 * [
        "2 folders hold files of a scene but no scene.blend or scene.glb: bare, folder"
    ]


PICTURE = np.arange(2 * 3 * 4, dtype=np.uint8).reshape(2, 3, 4)  # BGRA


def png(picture):
    return cv2.imencode(".png", picture)[1].tobytes()


def test_a_picture_of_one_colour_shows_nothing(tmp_path):
    path = tmp_path / "final.png"
    path.write_bytes(png(PICTURE))
    check_picture(path)
    for flat in (np.full((2, 3, 3), (9, 8, 7), np.uint8), np.full((2, 3), 5, np.uint8)):
        path.write_bytes(png(flat))
        with pytest.raises(SceneInvalidError, match="one flat colour over 3x2 pixels"):
            check_picture(path)
    path.write_bytes(png(np.array([[5, 5], [5, 6]], np.uint8)))
    check_picture(path)
    path.write_bytes(b"nothing")
    with pytest.raises(SceneInvalidError, match="7 bytes that are not a picture"):
        check_picture(path)


def test_pixels_are_given_as_stored_or_as_colours():
    stored = decoded_picture(png(PICTURE))
    assert stored is not None
    assert stored.tolist() == PICTURE.tolist()
    grey = decoded_picture(png(PICTURE[..., 0]), color=True)
    assert grey is not None
    assert grey.tolist() == np.repeat(PICTURE[..., :1], 3, axis=2).tolist()
    assert decoded_picture(b"") is None
    assert decoded_picture(b"GIF89a") is None
    claim = struct.pack(">IIBBBBB", 1 << 30, 1 << 30, 8, 2, 0, 0, 0)
    head = chunk(b"IHDR", claim)
    with pytest.raises(PictureTooLargeError, match="1073741824x1073741824 pixels in 45 bytes"):
        decoded_picture(b"\x89PNG\r\n\x1a\n" + head + chunk(b"IEND", b""))


def chunk(kind, content):
    return struct.pack(">I", len(content)) + kind + content + struct.pack(
        ">I", zlib.crc32(kind + content)
    )  # fmt: skip


def test_a_png_keeps_its_pixels_and_nothing_else():
    whole = png(PICTURE)
    marked = whole[:33] + chunk(b"tEXt", b"File\0/home/alice/scene.blend") + whole[33:]
    assert without_metadata(marked) == whole
    assert without_metadata(marked + chunk(b"eXIf", b"x")) == whole
