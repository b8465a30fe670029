"""Exports from buffers made by hand: exact boxes, masks as pycocotools encodes them, order."""

from __future__ import annotations

import json
import zipfile
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from pycocotools import mask as coco_mask
from readouts.made_views import view_of
from strategies import id_pictures

from legoworld.cards import load_card
from legoworld.depth_files.errors import DepthFileError
from legoworld.errors import UsageError
from legoworld.evaluation.depth.arrays import Declaration
from legoworld.evaluation.depth.labelled import read_labelled
from legoworld.readouts.depth import (
    DEPTH_FILE,
    write_depth,
)
from legoworld.readouts.exports import (
    box_exports,
    mask_exports,
)
from legoworld.readouts.family import AnsweredImage, protocol
from legoworld.records.base import as_json, canonical
from legoworld.scene.instances import Instance
from legoworld.tasks.shipped import TASKS
from legoworld.tracks.vocabulary import Category
from legoworld.visibility.projection import Projection
from legoworld.visibility.runs import ColumnRuns


def instances(*category_ids: int | None) -> list[Instance]:
    return [
        Instance(
            id=i,
            name=str(i),
            objects=(str(i),),
            category=None if c is None else Category(id=c, name=str(c)),
            label_text=None,
        )
        for i, c in enumerate(category_ids)
    ]


@given(id_pictures())
def test_masks_are_byte_for_byte_what_pycocotools_encodes(picture):
    n = int(picture.max()) + 2
    runs = ColumnRuns(picture, n)
    for i in range(n):
        mask = np.asfortranarray(picture == i, np.uint8)
        expected = coco_mask.encode(mask)
        assert runs.size_hw == mask.shape
        assert runs.counts(i) == expected["counts"].decode()


def test_masks_of_a_picture_of_nothing_but_edges():
    picture = (np.indices((70, 90)).sum(0) % 3).astype(np.int32) - 1
    runs = ColumnRuns(picture, 2)
    for i in range(2):
        expected = coco_mask.encode(np.asfortranarray(picture == i, np.uint8))
        assert runs.counts(i) == expected["counts"].decode()


def test_a_ring_keeps_its_hole():
    picture = np.full((60, 80), -1, np.int32)
    picture[10:50, 20:60] = 0
    picture[20:40, 30:50] = -1
    ((prediction, _),) = mask_exports(7, instances(1), view_of(picture, 1))
    document = json.loads(canonical(prediction))
    assert coco_mask.area(document["segmentation"]) == 1200
    assert document.keys() == {"image_id", "category_id", "segmentation", "score"}


def test_boxes_are_in_canonical_order_of_numbers():
    picture = np.full((200, 200), -1, np.int32)
    picture[5:15, 100:110] = 0  # as text "[100," sorts before "[9,"
    picture[5:15, 9:19] = 1
    picture[0:1, 0:1] = 2  # one pixel, another category
    picture[50:60, 50:60] = 3  # unlabelled
    found = [p for p, _ in box_exports(1, instances(5, 5, 3, None, 5), view_of(picture, 5))]
    assert [(p.category_id, [*p.bbox]) for p in found] == [
        (3, [0, 0, 1, 1]),
        (5, [9, 5, 10, 10]),
        (5, [100, 5, 10, 10]),
    ]
    assert {p.score for p in found} == {1.0}


def test_masks_are_in_canonical_order_of_category_and_rle_bytes():
    rng = np.random.default_rng(3)
    picture = rng.integers(0, 12, (20, 30)).astype(np.int32)
    categories = [2, 1, 2, 1, 2, 1, 2, 1, 2, 1, 2, 1]
    found = [p for p, _ in mask_exports(9, instances(*categories), view_of(picture, 12))]
    keys = [(p.category_id, p.segmentation.counts.encode()) for p in found]
    assert keys == sorted(keys)
    assert [category for category, _ in keys] == [1] * 6 + [2] * 6
    assert {p.image_id for p in found} == {9}


def test_no_export_is_an_empty_list():
    picture = np.full((4, 4), -1, np.int32)
    assert box_exports(1, instances(1), view_of(picture, 1)) == []
    assert mask_exports(1, instances(1), view_of(picture, 1)) == []


def test_depth_files_say_what_they_hold(tmp_path):
    depth = np.array([[1.5, np.inf]], np.float32)
    write_depth(tmp_path / "a" / "b.npz", depth)
    stored = np.load(tmp_path / "a" / "b.npz", allow_pickle=False)
    assert str(stored["space"]) == "depth"
    np.testing.assert_array_equal(stored["depth_z_m"], depth)
    assert stored["depth_z_m"].dtype == np.float32
    again = tmp_path / "again.npz"
    write_depth(again, depth)
    assert again.read_bytes() == (tmp_path / "a" / "b.npz").read_bytes()
    assert int(stored["format_version"]) == 2
    assert "intrinsics_px" not in stored.files


def test_depth_files_hold_the_pinhole_they_were_made_with(tmp_path):
    depth = np.arange(6, dtype=np.float32).reshape(2, 3)
    camera = Projection(orthographic=False, fx=1 / 3, fy=70.5, cx=1.5, cy=-2, z_near=0.1, z_far=9)
    write_depth(tmp_path / "a.npz", depth)
    write_depth(tmp_path / "b.npz", depth, camera)
    write_depth(tmp_path / "c.npz", depth, replace(camera, orthographic=True))
    stored = np.load(tmp_path / "b.npz", allow_pickle=False)
    assert stored["intrinsics_px"].dtype == np.float64
    assert stored["intrinsics_px"].tolist() == [1 / 3, 70.5, 1.5, -2]
    read = read_labelled(tmp_path / "b.npz", Declaration())
    assert read.intrinsics_px == (1 / 3, 70.5, 1.5, -2)
    assert np.array_equal(read.values, depth)
    assert (tmp_path / "c.npz").read_bytes() == (tmp_path / "a.npz").read_bytes()
    card = load_card("eth3d")
    assert set(stored.files) == set(card.value("export.fields"))
    assert card.value("export.format_version") == DEPTH_FILE.version
    arrays = []
    for name in "ab":  # the array itself is the same bytes
        with zipfile.ZipFile(tmp_path / f"{name}.npz") as archive:
            arrays.append(archive.read("depth_z_m.npy"))
    assert arrays[0] == arrays[1]


@pytest.mark.parametrize("version", [0, 3, 2.0, [2]])
def test_a_depth_file_of_another_version_is_refused(tmp_path, version):
    path = tmp_path / "a.npz"
    np.savez(path, depth_z_m=np.ones((2, 3), np.float32), space="depth", format_version=version)
    with pytest.raises(DepthFileError, match="has an unknown format version"):
        read_labelled(path, Declaration())


@pytest.mark.parametrize("size_wh", [(1, 1), (7, 300), (640, 480)])
def test_the_expected_size_of_a_depth_file_is_a_little_over(size_wh, tmp_path):
    camera = Projection(orthographic=False, fx=1, fy=1, cx=0, cy=0, z_near=0.1, z_far=9)
    write_depth(tmp_path / "a.npz", np.ones(size_wh[::-1], np.float32), camera)
    over = DEPTH_FILE.most_bytes(size_wh) - (tmp_path / "a.npz").stat().st_size
    assert 0 <= over < 4096


def test_a_depth_file_is_named_by_its_scene():
    assert DEPTH_FILE.path("a/b") == "depth/a/b.npz"


@pytest.mark.parametrize("exports", [box_exports, mask_exports])
def test_every_prediction_comes_with_its_own_instance(exports):
    picture = np.full((8, 12), -1, np.int32)
    for i, x in enumerate((9, 3, 6, 0)):
        picture[2:5, x : x + 2 + i % 2] = i
    found = exports(4, instances(2, 2, 1, 1), view_of(picture, 4))
    assert sorted(instance.id for _, instance in found) == [0, 1, 2, 3]
    for prediction, instance in found:
        mask = np.asfortranarray(picture == instance.id, np.uint8)
        assert prediction.image_id == 4
        assert prediction.score == 1.0
        assert prediction.category_id == instance.category.id
        if exports is box_exports:
            box = coco_mask.toBbox(coco_mask.encode(mask)).tolist()
            assert [*prediction.bbox] == box
        else:
            assert prediction.segmentation.counts == coco_mask.encode(mask)["counts"].decode()


def test_one_visible_pixel_is_enough_and_none_is_not():
    picture = np.array([[0, -1], [-1, -1]], np.int32)
    for exports in (box_exports, mask_exports):
        assert len(exports(1, instances(1, 1), view_of(picture, 2))) == 1


def test_every_task_reads_out_what_its_card_says(tmp_path):
    for task in TASKS:
        name = task.name
        reading = protocol(name, None)
        assert reading.task is task
        assert task.name == name == reading.card.task
        if reading.card.reads in ("amodal", "boxes_3d"):
            continue  # of surfaces, not of a picture: test_amodal.py, test_boxes3d.py
        payload = {"boxes": "bbox", "masks": "segmentation", "depth": None, "normals": None,
                   "segments": None, "category_map": None, "relations": None,
                   "surface_and_render": None}  # fmt: skip
        payload = payload[reading.card.value("readout.reads")]
        if task.family.labelled:
            assert reading.override_property == reading.card.value("vocabulary.override_property")
            assert len(reading.vocabulary.categories) == reading.card.value("vocabulary.size")
        if payload is None:
            assert reading.readout.exports is None
            assert (reading.vocabulary is None) == (reading.override_property is None)
            assert (reading.vocabulary is not None) == task.family.labelled
            continue
        image = AnsweredImage(
            image_id=1,
            name="a",
            run=tmp_path,
            instances=instances(1),
            view=view_of(np.zeros((2, 2), np.int32), 1),
        )
        found = reading.readout.exports(reading.card.reads, image)
        document = as_json(found[0][0])
        assert sorted(document) == sorted(reading.card.value("export.fields"))
        assert payload in document
    with pytest.raises(UsageError, match="unknown task 'boxes'; expected: coco or "):
        protocol("boxes", None)
