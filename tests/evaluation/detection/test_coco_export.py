"""`legoworld export`: a COCO file that other tools open, and that means what the run means."""

from __future__ import annotations

import contextlib
import io
import json

import pytest
from evaluation.detection_runs import by_canonical_key, random_predictions, random_truth, write_run
from evaluation.official import direct, direct_coco
from pycocotools import mask as coco_mask
from pycocotools.coco import COCO
from pycocotools.cocoeval import COCOeval

from legoworld.cli import run as call
from legoworld.shipped.catalog import folder

TASKS = ("coco", "coco-masks", "lvis")


@pytest.fixture
def exported(tmp_path, capfd):
    """A run's export through the command line: (exit code, document or None, standard error)."""

    def go(task, truth, predictions, *options, rows=None, **configuration):
        run = write_run(tmp_path / "run", task, truth, predictions, **configuration)
        if rows is not None:
            path = run / "per_image.jsonl"
            old = [json.loads(line) for line in path.read_text().splitlines()]
            new = [{**row, **rows.get(row["image_id"], {})} for row in old]
            path.write_text("".join(json.dumps(row) + "\n" for row in new))
        (tmp_path / "track.json").write_text(
            json.dumps({**{k: truth[k] for k in ("images", "categories")}, "info": {}})
        )
        output = tmp_path / "coco.json"
        code = call(["export", str(run), "-o", str(output), *map(str, options)])
        document = json.loads(output.read_text()) if code == 0 else None
        return code, document, capfd.readouterr().err

    return go


def loaded(path):
    with contextlib.redirect_stdout(io.StringIO()):
        return COCO(str(path))


@pytest.mark.parametrize("task", TASKS)
def test_pycocotools_loads_it_and_finds_every_prediction(task, exported, tmp_path):
    truth = random_truth(task, seed=1)
    predictions = random_predictions(task, truth, seed=2)
    code, document, _ = exported(task, truth, predictions, "--track", tmp_path / "track.json")
    assert code == 0
    assert set(document) == {"info", "images", "annotations", "categories"}
    coco = loaded(tmp_path / "coco.json")
    assert sorted(coco.getImgIds()) == [i["id"] for i in truth["images"]]
    assert [c["name"] for c in coco.loadCats(coco.getCatIds())] == [
        c["name"] for c in truth["categories"]
    ]
    annotations = coco.loadAnns(coco.getAnnIds())
    assert [a["id"] for a in annotations] == list(range(1, len(predictions) + 1))
    payload = "bbox" if task == "coco" else "segmentation"
    expected = sorted(predictions, key=by_canonical_key)
    for annotation, prediction in zip(annotations, expected, strict=True):
        keys = ("image_id", "category_id", "score", payload)
        assert [annotation[k] for k in keys] == [prediction[k] for k in keys]
        assert set(annotation) == {
            "id", "image_id", "category_id", "bbox", "area", "segmentation", "iscrowd", "score",
        }  # fmt: skip
        assert annotation["iscrowd"] == 0
        x, y, w, h = annotation["bbox"]
        if task == "coco":
            assert (annotation["segmentation"], annotation["area"]) == ([], w * h)
        else:
            pixels = coco.annToMask(annotation)
            assert annotation["area"] == pixels.sum()
            assert pixels[int(y) : int(y + h), int(x) : int(x + w)].sum() == pixels.sum()
            assert annotation["bbox"] == coco_mask.toBbox(annotation["segmentation"]).tolist()


@pytest.mark.parametrize("task", ["coco", "coco-masks"])
def test_its_annotations_as_results_score_as_the_run_does(task, exported, tmp_path):
    """By loadRes on the truth, and as a truth that finds itself."""
    truth = random_truth(task, seed=3)
    predictions = random_predictions(task, truth, seed=4)
    _, document, _ = exported(task, truth, predictions, "--track", tmp_path / "track.json")
    path = tmp_path / "truth.json"
    path.write_text(json.dumps(truth))
    payload = "bbox" if task == "coco" else "segmentation"
    keys = ("image_id", "category_id", payload, "score")
    results = [{k: a[k] for k in keys} for a in document["annotations"]]
    ordered = sorted(predictions, key=by_canonical_key)
    assert (direct(task)(path, results)[0] == direct(task)(path, ordered)[0]).all()
    if task == "coco":
        whole, _ = direct_coco(path, document["annotations"], "bbox")
        assert (whole == direct(task)(path, ordered)[0]).all()
    with contextlib.redirect_stdout(io.StringIO()):
        itself = loaded(tmp_path / "coco.json")
        evaluation = COCOeval(itself, itself.loadRes(results), "bbox" if task == "coco" else "segm")
        evaluation.evaluate()
        evaluation.accumulate()
        evaluation.summarize()
    assert evaluation.stats[0] > 0.9


@pytest.mark.parametrize("task", TASKS)
def test_it_comes_back_by_import(task, exported, tmp_path, capfd):
    truth = random_truth(task, seed=5)
    predictions = random_predictions(task, truth, seed=6)
    exported(task, truth, predictions, "--track", tmp_path / "track.json")
    words = ["baseline", "import", tmp_path / "coco.json", "--task", task, "--track"]
    assert call([*map(str, [*words, tmp_path / "track.json", "-o", tmp_path / "back"])]) == 0
    back = json.loads((tmp_path / "back" / "predictions.json").read_text())
    assert sorted(back, key=by_canonical_key) == sorted(predictions, key=by_canonical_key)
    assert "images are matched by file name" in capfd.readouterr().err


def test_annotations_keep_the_order_of_an_imported_run(exported, tmp_path):
    truth = random_truth("coco", seed=1)
    given = sorted(random_predictions("coco", truth, seed=2), key=lambda p: p["image_id"])
    track = tmp_path / "track.json"
    _, document, _ = exported("coco", truth, given, "--track", track, prediction_order="given")
    assert [a["score"] for a in document["annotations"]] == [p["score"] for p in given]
    assert given != sorted(given, key=by_canonical_key)


def test_a_scenes_annotations_name_their_objects(exported, tmp_path):
    truth = random_truth("coco", seed=1, images=3)
    predictions = [p for p in random_predictions("coco", truth, seed=2) if p["image_id"] != 13]
    of_image = {10: [], 16: []}
    for n, p in enumerate(sorted(predictions, key=by_canonical_key)):
        of_image[p["image_id"]].append(
            {"name": f"Owner {n}", "category": "x", "objects": [f"Leg {n}", f"Top {n}"]}
        )
    rows = {i: {"exported": e, "n_predictions": len(e)} for i, e in of_image.items()}
    track = tmp_path / "track.json"
    _, document, _ = exported("coco", truth, predictions, "--track", track, rows=rows)
    assert [a["attributes"] for a in document["annotations"]] == [
        {"name": f"Owner {n}", "objects": [f"Leg {n}", f"Top {n}"]} for n in range(len(predictions))
    ]


def test_the_shipped_names_need_no_track_and_others_do(exported, tmp_path):
    truth = random_truth("coco", seed=1)
    code, _, said = exported("coco", truth, [])
    assert code == 2
    assert "the names of the run's categories are unknown" in said
    assert "pass --track" in said
    categories = json.loads((folder("datasets") / "coco" / "categories.json").read_text())
    code, document, _ = exported("coco", {**truth, "categories": categories}, [])
    assert code == 0
    assert document["annotations"] == []
    assert [c["name"] for c in document["categories"]][:2] == ["person", "bicycle"]
    assert len(document["images"]) == 12


def test_a_scene_s_run_names_its_categories_itself(exported, tmp_path, monkeypatch):
    """Those that it predicts: run.json has the others as a hash alone."""
    truth = random_truth("coco", seed=1)
    names = {c["id"]: c["name"] for c in truth["categories"]}
    predictions = random_predictions("coco", truth, seed=2)
    rows: dict = {}
    for one in sorted(predictions, key=by_canonical_key):
        row = rows.setdefault(one["image_id"], {"exported": []})
        row["exported"].append({"name": "x", "category": names[one["category_id"]], "objects": []})
        row["n_predictions"] = len(row["exported"])
    code, document, _ = exported("coco", truth, predictions, rows=rows)
    assert code == 0
    used = {one["category_id"] for one in predictions}
    assert {c["id"]: c["name"] for c in document["categories"]} == {i: names[i] for i in used}
    _, whole, _ = exported(
        "coco", truth, predictions, "--track", tmp_path / "track.json", "--overwrite", rows=rows
    )
    assert whole["annotations"] == document["annotations"]
    assert whole["info"] == document["info"]
    monkeypatch.chdir(tmp_path)
    assert call(["export", "run", "--track", "track.json"]) == 0
    assert json.loads((tmp_path / "legoworld-runs" / "run-coco.json").read_text()) == whole


def test_images_without_a_result_stay_and_are_named(exported, tmp_path):
    truth = random_truth("coco", seed=1)
    rows = {13: {"status": "missing"}}
    _, document, _ = exported("coco", truth, [], "--track", tmp_path / "track.json", rows=rows)
    assert len(document["images"]) == 12
    assert document["info"]["images_without_result"] == [13]


def test_what_is_refused(exported, tmp_path, capfd):
    truth = random_truth("coco", seed=1)
    track = ("--track", tmp_path / "track.json")
    assert exported("coco", truth, [], *track)[0] == 0
    code, _, said = exported("coco", truth, [], *track)
    assert code == 2
    assert "coco.json already exists" in said
    assert exported("coco", truth, [], *track, "--overwrite")[0] == 0
    code, _, said = exported("eth3d", truth, [], *track, "--overwrite")
    assert code == 2
    assert "a run of eth3d has no boxes or masks" in said
    bad = [{"image_id": 10, "category_id": 5, "bbox": [1, 2, 3], "score": 1.0}]
    code, _, said = exported("coco", truth, bad, *track, "--overwrite")
    assert code == 2
    assert "expected array of length 4 at $[0].bbox" in said
    sizeless = {i["id"]: {"size_wh": None} for i in truth["images"]}
    code, _, said = exported("coco", truth, [], *track, "--overwrite", rows=sizeless)
    assert code == 2
    assert "image 10 of the run has no size" in said
    assert call(["export", str(tmp_path), "-o", str(tmp_path / "x.json")]) == 2
    assert not (tmp_path / "x.json").exists()
    capfd.readouterr()
