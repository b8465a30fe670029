"""Track files, and scenes named by their photos."""

from __future__ import annotations

import json

import pytest

from legoworld.errors import CatalogError
from legoworld.records.track import ImageInfo
from legoworld.tracks.track import load_track, photo_names, scene_name, serves


def write(tmp_path, images, **more):
    path = tmp_path / "track.json"
    path.write_text(json.dumps({"info": {}, "images": images, "categories": [], **more}))
    return path


IMAGE = {"id": 5, "file_name": "a/b.c.JPG", "width": 4, "height": 3}


def test_a_scene_is_named_by_its_photo(tmp_path):
    assert scene_name("courtyard/images/dslr_images/DSC_0286.JPG") == (
        "courtyard/images/dslr_images/DSC_0286"
    )
    track = load_track(write(tmp_path, [{**IMAGE, "id": 9, "file_name": "z.png"}, IMAGE]))
    assert [(i.id, i.scene, i.size_wh) for i in track.images] == [
        (5, "a/b.c", (4, 3)),
        (9, "z", (4, 3)),
    ]


def test_a_field_of_view_is_the_image_s_own(tmp_path):
    wide = {**IMAGE, "id": 9, "file_name": "z.png", "hfov_deg": 70.5}
    track = load_track(write(tmp_path, [IMAGE, wide]))
    assert [i.hfov_deg for i in track.images] == [None, 70.5]


@pytest.mark.parametrize(
    ("said", "names"),
    [
        ({"file_name": "a/b.jpg"}, ["a/b.jpg"]),
        ({"coco_url": "http://x/val/b.jpg"}, ["b.jpg"]),
        ({"file_name": "a.jpg", "coco_url": "http://x/val/b.jpg"}, ["a.jpg", "b.jpg"]),
        ({}, []),
    ],
)
def test_a_photo_has_the_names_of_its_file_and_its_url(said, names):
    assert photo_names(ImageInfo(id=1, width=4, height=3, **said)) == names


def test_an_lvis_image_is_named_by_its_coco_url(tmp_path):
    url = "http://images.cocodataset.org/val2017/000000000139.jpg"
    v1 = {"id": 1, "coco_url": url, "width": 4, "height": 3}
    v05 = {**v1, "id": 2, "file_name": "COCO_val2017_000000000139.jpg"}
    for image in (v1, v05):
        assert load_track(write(tmp_path, [image])).images[0].scene == "000000000139"


def test_copies_of_a_photo_have_one_url_and_names_of_their_own(tmp_path):
    url = "http://images.cocodataset.org/val2017/000000000139.jpg"
    copies = [
        {"id": k, "file_name": f"copy_{k}.jpg", "coco_url": url, "width": 4, "height": 3}
        for k in (1, 2)
    ]
    assert [i.scene for i in load_track(write(tmp_path, copies)).images] == ["copy_1", "copy_2"]


@pytest.mark.parametrize(
    "images",
    [
        [],
        [{**IMAGE, "width": 0}],
        [{**IMAGE, "height": "3"}],
        [{**IMAGE, "id": "5"}],
        [{**IMAGE, "id": -5}],
        [{**IMAGE, "id": True}],
        [{**IMAGE, "id": 10**30}],
        [{**IMAGE, "file_name": "../outside.jpg"}],
        [{**IMAGE, "file_name": "/absolute.jpg"}],
        [IMAGE, {**IMAGE, "file_name": "other.jpg"}],
        [IMAGE, {**IMAGE, "id": 6}],
        ["not an image"],
        [{**IMAGE, "bbox": [0, 0, 1, 1]}],
    ],
)
def test_a_broken_track_is_refused(images, tmp_path):
    with pytest.raises(CatalogError):
        load_track(write(tmp_path, images))


def test_annotations_have_no_place_in_a_track(tmp_path):
    with pytest.raises(CatalogError, match="public"):
        load_track(write(tmp_path, [IMAGE], annotations=[]))
    (tmp_path / "track.json").write_text("{")
    with pytest.raises(CatalogError, match="cannot be read"):
        load_track(tmp_path / "track.json")


def test_a_track_says_what_it_was_made_for(tmp_path):
    made = load_track(write(tmp_path, [IMAGE], info={"task": "lvis"}))
    assert made.made_for == "lvis"
    assert (serves(made, "lvis"), serves(made, "coco")) == (True, False)
    coco = load_track(write(tmp_path, [IMAGE], info={"task": "coco"}))
    assert serves(coco, "coco-masks")
    assert load_track(write(tmp_path, [IMAGE])).made_for is None
