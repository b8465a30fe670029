"""Scene folders as a track, and folders that match no image."""

from __future__ import annotations

import pytest

from legoworld.errors import CatalogError
from legoworld.shipped.catalog import folder
from legoworld.tracks.scene_names import Stranger, lower_top, strangers
from legoworld.tracks.track import folders_without_scene, make_folder_track, serves
from legoworld.tracks.vocabulary import Vocabulary, dataset_version, find_dataset, load


def make_files(top, *names):
    for name in names:
        (top / name).parent.mkdir(parents=True, exist_ok=True)
        (top / name).write_bytes(b"")


def test_every_folder_with_a_scene_is_an_image_in_sorted_order(tmp_path):
    make_files(tmp_path, "b/scene.blend", "a/deep/scene.glb", "c/notes.txt", ".hidden/scene.blend")
    (tmp_path / "b" / "again").symlink_to(tmp_path, target_is_directory=True)
    track = make_folder_track(tmp_path)
    assert [(i.id, i.file_name, i.scene) for i in track.images] == [
        (1, "a/deep", "a/deep"), (2, "b", "b")
    ]  # fmt: skip
    assert (track.vocabulary, track.sha256, track.made_for) == (None, None, None)


def test_one_scene_folder_is_a_track_of_its_name(tmp_path):
    make_files(tmp_path, "kitchen/scene.blend")
    (image,) = make_folder_track(tmp_path / "kitchen").images
    assert (image.file_name, image.scene, image.size_wh) == ("kitchen", ".", None)


def test_a_folder_without_scenes_is_refused_by_its_name(tmp_path):
    make_files(tmp_path, "photos/a.jpg")
    with pytest.raises(CatalogError) as caught:
        make_folder_track(tmp_path / "photos")
    assert caught.value.found == f"no scene.blend or scene.glb below {tmp_path / 'photos'}"


def test_folders_that_were_meant_as_scenes(tmp_path):
    make_files(
        tmp_path, "scene.py", "good/scene.blend", "good/scene.py", "program/scene.py", "else/a.txt"
    )
    (tmp_path / "folder" / "scene.blend").mkdir(parents=True)
    make_files(tmp_path, ".hidden/scene.py")
    assert folders_without_scene(tmp_path) == ["folder", "program"]


@pytest.mark.parametrize(
    "name", ["scene.py", "final.png", "labels.json", "provenance.json", "frozen.json"]
)
def test_any_file_of_a_scene_folder_tells_that_one_was_meant(name, tmp_path):
    make_files(tmp_path, f"a/{name}", "good/scene.blend")
    assert folders_without_scene(tmp_path) == ["a"]


@pytest.mark.parametrize(
    ("name", "meant"),
    [
        ("000000000139.jpg", "000000000139"),
        ("139", "000000000139"),
        ("scene_139", "000000000139"),
        ("COCO_val2017_000000000139", "000000000139"),
        ("Living Room", "living_room"),
        ("living_room_final", "living_room"),
        ("livingroom", "living_room"),
        ("140", None),
        ("000000000138", None),
        ("garden", None),
    ],
)
def test_a_folder_is_matched_to_the_image_it_is_meant_for(name, meant):
    known = ["000000000139", "living_room"]
    assert strangers([name, *known], known, known) == [Stranger(folder=name, meant=meant)]


def test_an_image_that_has_its_scene_is_meant_by_nobody():
    assert strangers(["room.png"], ["room"], []) == [Stranger(folder="room.png", meant=None)]
    assert strangers(["1_a", "1_b"], ["1"], ["1"])[0].folder == "1_a"


def test_the_folder_below_that_holds_the_scenes():
    found = strangers(["run/a", "run/b"], ["a", "b"], ["a", "b"])
    assert lower_top(found) == "run"
    apart = strangers(["run/a", "other/b"], ["a", "b"], ["a", "b"])
    assert lower_top(apart) is None
    assert lower_top([Stranger(folder="run/x", meant=None)]) is None


def test_versions_of_datasets():
    coco, lvis = (load(folder("datasets") / n / "categories.json") for n in ("coco", "lvis"))
    assert (find_dataset("coco-masks"), find_dataset("lvis")) == ("coco", "lvis")
    assert dataset_version(coco, "coco-masks") == "2017"
    assert dataset_version(lvis, "lvis") == "1.0"
    old = Vocabulary(lvis.categories[:1] * 1230)
    assert dataset_version(old, "lvis") == "0.5"
    assert dataset_version(old, "coco") == "custom"
    assert dataset_version(Vocabulary(lvis.categories[:5]), "lvis") == "custom"


def test_a_track_serves_the_tasks_of_its_dataset(tmp_path):
    make_files(tmp_path, "a/scene.blend")
    track = make_folder_track(tmp_path)
    assert serves(track, "lvis")


@pytest.mark.parametrize(
    ("found", "meant"),
    [("dining-room-1", "dining_room_1"), ("dining room 2", "dining_room_2"),
     ("Dining-Room 2.png", "dining_room_2"), ("dining-room", None)],
)  # fmt: skip
def test_hyphens_and_spaces_stand_for_underscores_among_similar_names(found, meant):
    absent = ["dining_room_1", "dining_room_2"]
    assert strangers([found], absent, absent) == [Stranger(folder=found, meant=meant)]


@pytest.mark.parametrize(
    ("found", "meant"),
    [("139", "000000000139"), ("0000139.png", "000000000139"), ("COCO_val2017_139", "000000000139"),
     ("1390", None), ("0", None), ("00", None)],
)  # fmt: skip
def test_a_number_is_the_same_with_other_zeros_before_it(found, meant):
    absent = ["000000000139", "000000000000"]
    assert strangers([found], absent, absent) == [Stranger(folder=found, meant=meant)]


@pytest.mark.parametrize("task", ["bench", "no such task"])
def test_categories_of_a_task_without_versions_are_custom(task):
    assert dataset_version(Vocabulary(()), task) == "custom"
