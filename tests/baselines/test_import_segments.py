"""Segments of others: what the official script refuses is that image's row, in a sentence."""

from __future__ import annotations

import json

import numpy as np
import pytest
from evaluation.panoptic.panoptic_files import call, write_panoptic
from pycocotools import mask as coco_mask

from legoworld.baselines import panoptic, semantic
from legoworld.baselines.records import AnswerRules, answered_record
from legoworld.evaluation.label_maps.png import read_ids, read_values
from legoworld.readouts.family import protocol
from legoworld.records.baseline_messages import Message
from legoworld.records.run_file import ImageSource
from legoworld.tracks.track import TrackImage

PERSON, WALL = 1, 199
PICTURE = (np.array([[1, 1, 2], [2, 2, 0]]), [(1, PERSON, 0), (2, WALL, 0)])


@pytest.fixture
def theirs(tmp_path):
    truth = write_panoptic(tmp_path / "truth.json", {1: PICTURE, 2: PICTURE})
    track = tmp_path / "track.json"
    call("track", "make", "--task", "coco-panoptic", "--truth", truth, "-o", track)
    return write_panoptic(tmp_path / "theirs.json", {1: PICTURE, 2: PICTURE}, truth=False)


def import_segments(theirs, *more, code=0):
    folder = theirs.parent
    words = ("--task", "coco-panoptic", "--track", folder / "track.json", "-o", folder / "run")
    call("baseline", "import", theirs, *words, *more, code=code)
    if (folder / "run/per_image.jsonl").is_file():
        return [json.loads(x) for x in (folder / "run/per_image.jsonl").read_text().splitlines()]
    return []


def change(theirs, how):
    document = json.loads(theirs.read_text())
    first = document["annotations"][0]
    if how == "png alone":
        first["segments_info"].pop()
    elif how == "json alone":
        first["segments_info"].append({"id": 8, "category_id": WALL})
    elif how == "category":
        first["segments_info"][0]["category_id"] = 26
    elif how == "void":
        first["segments_info"][0]["id"] = 0
    elif how == "size":
        write_panoptic(theirs.parent / "theirs.json", {1: (np.ones((1, 1), int), [])}, truth=False)
    elif how == "image":
        document["annotations"].pop(0)
    elif how == "twice":
        document["annotations"].append(first)
    elif how == "stranger":
        document["annotations"].append(first | {"image_id": 77})
    theirs.write_text(json.dumps(document))


def test_ids_of_others_are_kept_and_areas_are_counted(theirs):
    rows = import_segments(theirs)
    assert [s["id"] for s in rows[0]["segments"]] == [1, 2]
    assert rows[0]["segments"][1] == {
        "id": 2, "category_id": WALL, "area": 3, "bbox": [0, 0, 3, 2], "iscrowd": 0,
    }  # fmt: skip
    stored = read_ids(theirs.parent / "run" / rows[0]["answer"]["file"], ValueError)
    assert (stored == PICTURE[0]).all()


@pytest.mark.parametrize(
    ("how", "status", "said"),
    [("png alone", "invalid", "segments that are not in the JSON file; found: id 2 on 3 pixels"),
     ("json alone", "invalid", "found: segment 8 in the JSON file alone"),
     ("category", "invalid", "category 26"), ("size", "invalid", "another size than its image"),
     ("image", "missing", "no segments for this photo")],
)  # fmt: skip
def test_an_image_that_cannot_be_scored_is_a_row(theirs, how, status, said):
    change(theirs, how)
    first, second = import_segments(theirs, code=1)
    assert (first["status"], second["status"]) == (status, "ok")
    assert said in first["reason"]
    written = json.loads((theirs.parent / "run/answer.json").read_text())["annotations"]
    assert written[0]["segments_info"] == []
    assert not read_ids(theirs.parent / "run/answer/1.png", ValueError).any()


@pytest.mark.parametrize(
    ("how", "said"),
    [("void", "cannot be imported"), ("twice", "image 1 twice"),
     ("stranger", "images that the track does not have; found: image 77")],
)  # fmt: skip
def test_a_file_that_cannot_be_read_is_no_run(theirs, capsys, how, said):
    change(theirs, how)
    assert import_segments(theirs, code=2) == []
    assert said in capsys.readouterr().err
    if how == "stranger":
        assert len(import_segments(theirs, "--subset")) == 2


def mask(area):
    pixels = np.zeros((2, 3), np.uint8, order="F")
    pixels[area] = 1
    return {"size": [2, 3], "counts": coco_mask.encode(pixels)["counts"].decode()}


def record_answer(tmp_path, task, *entries):
    message = Message(
        image_id=1,
        predictions=tuple({"category_id": c, "segmentation": m} for c, m in entries),
    )
    rules = AnswerRules(run=tmp_path, task=task, vocabulary=protocol(task, None).vocabulary)
    image = TrackImage(id=1, file_name="a.jpg", size_wh=(3, 2), scene="a")
    return answered_record(image, message, rules, ImageSource()).row


def test_masks_of_a_process_are_segments_and_stuff_is_merged(tmp_path):
    entries = [(WALL, mask(np.s_[0, :1])), (PERSON, mask(np.s_[1, :2])), (WALL, mask(np.s_[0, 2:])),
               (PERSON, mask(np.s_[1, 2:])), (WALL, mask(np.s_[:0]))]  # fmt: skip
    row = record_answer(tmp_path, "coco-panoptic", *entries)
    assert [(s.id, s.category_id, s.area) for s in row.segments] == [
        (1, WALL, 2), (2, PERSON, 2), (3, PERSON, 1),
    ]  # fmt: skip
    assert read_ids(tmp_path / row.answer.file, ValueError).tolist() == [[1, 0, 1], [2, 2, 3]]
    assert panoptic.BASELINE.own_file(row) == semantic.BASELINE.own_file(row) == row.answer.file
    row = record_answer(
        tmp_path, "voc-semantic", (15, mask(np.s_[:, :2])), (20, mask(np.s_[0, 1:]))
    )
    values = read_values(tmp_path / row.answer.file, ValueError)
    assert values.tolist() == [[15, 20, 20], [15, 15, 255]]


@pytest.mark.parametrize(
    ("entry", "said"),
    [((PERSON, mask(np.s_[:, :])), "two segments overlap"),
     ((26, mask(np.s_[0])), "category_id 26"),
     ((PERSON, {"size": [3, 2], "counts": "06"}), "size"),
     ((PERSON, {"size": [2, 3], "counts": "0"}), "pixels expected")],
)  # fmt: skip
def test_masks_that_are_no_segments_fail_the_image(tmp_path, entry, said):
    row = record_answer(tmp_path, "coco-panoptic", (PERSON, mask(np.s_[0])), entry)
    assert row.status == "invalid" or row.code == "baseline_answer"
    assert said in row.reason
