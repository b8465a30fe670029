"""Classes of pixels: the vector, hotcoco to the last digit, and every kind of ground truth."""

from __future__ import annotations

import json

import numpy as np
import pytest
from evaluation.panoptic.panoptic_files import CATEGORIES, call, write_panoptic
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays
from PIL import Image
from pycocotools import mask as coco_mask

from legoworld.evaluation.semantic.family import confusion, semantic_values

hotcoco = pytest.importorskip("hotcoco.semantic")
NOTHING = np.zeros(0, bool)


def values(*pairs, ids):
    sums = np.zeros((len(ids), 4))
    for truth, answer in pairs:
        table = confusion(np.array(truth, np.uint8), np.array(answer, np.uint8), np.array(ids))
        sums[:, 1] += np.diagonal(table)
        sums[:, 2] += table.sum(axis=1)
        sums[:, 3] += table.sum(axis=0)[:-1]
    return {name: float(v) for name, v in semantic_values(sums, NOTHING).items()}


def test_two_classes_and_an_ignored_pixel():
    found = values(([[0, 0, 1, 1, 255]], [[0, 1, 1, 1, 0]]), ids=[0, 1])
    assert found["mIoU"] == (1 / 2 + 2 / 3) / 2
    assert round(found["mIoU"], 5) == 0.58333
    assert found["aAcc"] == 0.75


def test_a_pixel_without_an_answer_is_missed_and_no_false_class():
    found = values(([[1, 1, 2, 2]], [[1, 255, 2, 2]]), ids=[1, 2])
    assert found == {"mIoU": 0.75, "fwIoU": 0.75, "mAcc": 0.75, "aAcc": 0.75}


CLASSES = [3, 7, 9, 12]
MAPS = st.tuples(
    *(
        arrays.arrays(np.uint8, (6, 7), elements=st.sampled_from(labels))
        for labels in ([*CLASSES, 255], CLASSES)  # hotcoco refuses answers without a class
    )
)


@settings(max_examples=40)
@given(st.lists(MAPS, min_size=1, max_size=3))
def test_the_metrics_are_those_of_hotcoco(pairs):
    place = np.full(256, 255, np.uint8)
    place[CLASSES] = range(4)
    theirs = hotcoco.SemanticEval(4)
    for truth, answer in pairs:
        theirs.update(place[truth], place[answer])
    found = values(*pairs, ids=CLASSES)
    report = theirs.report()["metrics"]
    assert {k: -1.0 if np.isnan(v) else v for k, v in found.items()} == {
        name: report[name] for name in found
    }


def evaluated(folder, task, truth, theirs, *more, code=0):
    """The summary and rows of a folder of PNGs that is imported."""
    call("track", "make", "--task", task, "--truth", truth, "-o", folder / "track.json", *more)
    where = ("--task", task, "--track", folder / "track.json", "-o", folder / "run")
    call("baseline", "import", "-q", theirs, *where, code=code)
    call("evaluate", "-q", folder / "run", "--truth", truth, "-o", folder / "eval", "--draws", 20)
    call("evidence", "verify", folder / "eval")
    rows = (folder / "eval/per_image.jsonl").read_text().splitlines()
    return json.loads((folder / "eval/summary.json").read_text()), [json.loads(r) for r in rows]


def write_grey(path, values):
    path.parent.mkdir(parents=True, exist_ok=True)
    Image.fromarray(np.array(values, np.uint8)).save(path)


def mask(pixels):
    rle = coco_mask.encode(np.asfortranarray(pixels, np.uint8))
    return {"size": rle["size"], "counts": rle["counts"].decode()}


def test_cocos_instances_are_voc_s_classes(tmp_path):
    """The smaller lies on top; a crowd of a class below, a crowd of others is not scored."""
    high, wide = 4, 6
    areas = {"couch": np.s_[:, :4], "cat": np.s_[1:3, 1:3], "banana": np.s_[:, 5:],
             "tv crowd": np.s_[0, :], "banana crowd": np.s_[3, 3:]}  # fmt: skip
    ids = {"couch": 63, "cat": 17, "banana": 52, "tv": 72}
    annotations = []
    for number, (name, area) in enumerate(areas.items(), start=1):
        pixels = np.zeros((high, wide), bool)
        pixels[area] = True
        annotations.append(
            {"id": number, "image_id": 1, "category_id": ids[name.split()[0]],
             "segmentation": mask(pixels), "area": int(pixels.sum()), "bbox": [0, 0, wide, high],
             "iscrowd": int("crowd" in name)}
        )  # fmt: skip
    truth = tmp_path / "instances.json"
    images = [{"id": 1, "file_name": "a.jpg", "width": wide, "height": high}]
    categories = [{"id": i, "name": name} for name, i in ids.items()]
    document = {"images": images, "annotations": annotations, "categories": categories}
    truth.write_text(json.dumps(document))
    write_grey(tmp_path / "theirs/a.png", np.full((high, wide), 18))
    summary, (row,) = evaluated(tmp_path, "voc-semantic", truth, tmp_path / "theirs")
    # Row 0: sofa x 4, tv x 2. Row 3: sofa x 4, and of the crowd of bananas two more, not scored.
    assert row["counts"] == {
        "0": [0, 4, 0], "8": [0, 4, 0], "18": [12, 12, 22], "20": [0, 2, 0],
    }  # fmt: skip
    assert summary["metrics"]["aAcc"] == 12 / 22


def test_panoptic_truth_serves_classes(tmp_path):
    ids = np.array([[5, 5, 6, 0]])
    listed = [(5, 1, 0), (6, CATEGORIES[3]["id"], 0)]
    categories = json.loads((write_panoptic(tmp_path / "t.json", {1: (ids, listed)})).read_text())
    from legoworld.shipped import catalog

    shipped = catalog.folder("datasets") / "coco-panoptic/categories.json"
    document = categories | {"categories": json.loads(shipped.read_text())}
    (tmp_path / "t.json").write_text(json.dumps(document))
    write_grey(tmp_path / "theirs/1.png", [[1, 199, 199, 1]])
    summary, (row,) = evaluated(tmp_path, "coco-semantic", tmp_path / "t.json", tmp_path / "theirs")
    assert row["counts"] == {"1": [1, 2, 1], "199": [1, 1, 2]}
    assert summary["metrics"]["mIoU"] == 0.5


@pytest.mark.parametrize(
    ("task", "photo", "truth", "values", "counts"),
    [
        ("ade20k-semantic", "a.png", "a.png", [[0, 1, 1, 150]], {"1": [1, 2, 1], "150": [1, 1, 2]}),
        ("cityscapes-semantic", "ulm/x_leftImg8bit.png", "ulm/x_gtFine_labelIds.png",
         [[3, 7, 7, 33]], {"7": [1, 2, 1], "33": [1, 1, 2]}),
    ],
)  # fmt: skip
def test_folders_of_class_ids(tmp_path, task, photo, truth, values, counts):
    write_grey(tmp_path / "photos" / photo, np.zeros((1, 4)))
    write_grey(tmp_path / "truth" / truth, values)
    low, high = values[0][1], values[0][3]
    write_grey(tmp_path / "theirs" / photo, [[low, low, high, high]])
    photos = ("--photos", tmp_path / "photos")
    _, (row,) = evaluated(tmp_path, task, tmp_path / "truth", tmp_path / "theirs", *photos)
    assert row["counts"] == counts


def test_unusable_files_are_told(tmp_path, capsys):
    for name in ("a", "b", "c"):
        write_grey(tmp_path / "photos" / f"{name}.png", np.zeros((1, 2)))
        write_grey(tmp_path / "truth" / f"{name}.png", [[1, 2]])
    write_grey(tmp_path / "theirs/a.png", [[1, 2]])
    write_grey(tmp_path / "theirs/b.png", [[1, 200]])
    words = ("--task", "ade20k-semantic", "--truth", tmp_path / "truth")
    call("track", "make", *words, "-o", tmp_path / "no.json", code=2)
    assert "needs the photos" in capsys.readouterr().err
    photos = ("--photos", tmp_path / "photos")
    summary, rows = evaluated(
        tmp_path, "ade20k-semantic", tmp_path / "truth", tmp_path / "theirs", *photos, code=1
    )
    assert [row["status"] for row in rows] == ["ok", "invalid", "missing"]
    run = [json.loads(r) for r in (tmp_path / "run/per_image.jsonl").read_text().splitlines()]
    assert "values that are no category; found: 200" in run[1]["reason"]
    assert rows[1]["counts"] == {"1": [0, 1, 0], "2": [0, 1, 0]}
    assert summary["missed"] == 2
    write_grey(tmp_path / "truth/b.png", [[1, 151]])
    evaluate = ("evaluate", tmp_path / "run", "--truth", tmp_path / "truth", "-o", tmp_path / "e")
    call(*evaluate, code=2)
    assert "b.png has values that are no category; found: 151" in capsys.readouterr().err
    (tmp_path / "truth/b.png").unlink()
    call(*evaluate, code=2)
    assert "1 of 3 images of the run have no ground truth" in capsys.readouterr().err


def test_pictures_without_any_class_have_no_metrics():
    nothing = semantic_values(np.zeros((5, 0, 4)), NOTHING)  # five draws
    assert {name: value.shape for name, value in nothing.items()} == dict.fromkeys(nothing, (5,))
    assert all(np.isnan(value).all() for value in nothing.values())
