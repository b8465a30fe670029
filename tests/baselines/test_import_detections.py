"""Imports of results: what is taken, under which name, and everything that is refused."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from baselines.tracks import call, make_track, results, rows, run_document
from evaluation.solids import box as solid

NAMES = ["a.jpg", "b.jpg", "c.jpg"]
BOX = [10.5, 4.25, 20.0, 30.0]


@pytest.fixture
def track(tmp_path: Path) -> Path:
    categories = [
        {"id": 18, "name": "dog"}, {"id": 63, "name": "couch"}, {"id": 4, "name": "motorcycle"},
        {"id": 64, "name": "potted plant"},
    ]  # fmt: skip
    return make_track(tmp_path / "track.json", NAMES, categories=categories)


@pytest.fixture
def bring(track, tmp_path, capfd):
    """Import a document: (exit code, run folder, standard error)."""

    def go(document, *options, task="coco", name="run"):
        path = tmp_path / "results.json"
        path.write_text(document if isinstance(document, str) else json.dumps(document))
        folder = tmp_path / name
        arguments = ["baseline", "import", path, "--task", task, "--track", track, "-o", folder]
        code = call([*arguments, *options])
        return code, folder, capfd.readouterr().err

    return go


def predictions(folder: Path) -> list[dict]:
    found: list[dict] = json.loads((folder / "predictions.json").read_text())
    return found


def box(image_id=1, category_id=18, bbox=BOX, score=0.5, **more) -> dict:
    return {
        "image_id": image_id, "category_id": category_id, "bbox": bbox, "score": score, **more,
    }  # fmt: skip


def test_results_come_back_as_they_were_image_by_image_in_their_own_order(bring):
    given = [box(2), box(1, 63), box(1, 18, score=0.123456789012345), box(1, 18, score=0.9)]
    code, folder, _ = bring(given)
    assert code == 0
    assert predictions(folder) == [given[1], given[2], given[3], given[0]]
    found = rows(folder)
    assert [found[i]["n_predictions"] for i in (1, 2, 3)] == [3, 1, 0]
    assert {row["status"] for row in found.values()} == {"ok"}
    document = run_document(folder)
    assert document["configuration"]["prediction_order"] == "given"
    assert document["configuration"]["kind"] == "baseline"
    assert document["configuration"]["baseline"] == "results"
    assert len(document["configuration"]["imported"]["sha256"]) == 64


@pytest.mark.parametrize(
    ("options", "name"),
    [
        (["--box-format", "xywh", "--subset"], "results"),
        (["--name", "DINO", "--category-ids", "dataset"], "DINO"),
    ],
)
def test_the_baseline_has_the_name_that_is_given_or_the_files(bring, options, name):
    code, folder, _ = bring([box()], *options)
    assert code == 0
    assert run_document(folder)["configuration"]["baseline"] == name


def test_images_in_another_order_are_the_same_run_but_for_its_hash(bring):
    given = [box(i, c, [x, 4.0, 5.0, 6.0]) for i in (1, 2) for c in (18, 63) for x in (1.5, 9.25)]
    _, one, _ = bring(given, name="one")
    _, two, _ = bring([*given[4:], *given[:4]], name="two")
    _, three, _ = bring(given[::-1], name="three")
    assert results(one) == results(two)
    assert results(one) != results(three)  # equal scores: their order in the file is their rank


@pytest.mark.parametrize(
    ("box_format", "bbox"),
    [("xywh", BOX), ("xyxy", [10.5, 4.25, 30.5, 34.25]), ("cxcywh", [20.5, 19.25, 20.0, 30.0])],
)
def test_the_three_box_formats(bring, box_format, bbox):
    code, folder, _ = bring([box(bbox=bbox)], "--box-format", box_format)
    assert code == 0
    assert predictions(folder)[0]["bbox"] == BOX


def test_a_box_format_that_is_not_the_one_declared_is_refused(bring):
    corners = [box(n % 3 + 1, bbox=[30 + n, 20 + n, 40 + n, 35 + n]) for n in range(12)]
    code, folder, said = bring(corners)
    assert code == 2
    assert "the boxes are not xywh in pixels" in said
    assert "9 of 12 boxes leave their image" in said
    assert "next: pass --box-format xyxy or cxcywh" in said
    assert not folder.exists()
    code, _, said = bring([box(bbox=[30, 20, 5, 5])], "--box-format", "xyxy")
    assert code == 2
    assert "the boxes are not xyxy in pixels; found: as x, y, width, height: image 1" in said
    assert "a width and height of at least 0" in said
    assert "next: pass --box-format xywh or cxcywh" in said


@pytest.mark.parametrize(
    ("bbox", "fitting"), [([1, 1, 60, 44], "xywh or xyxy"), ([32, 24, 20, 44], "cxcywh")]
)
def test_the_formats_that_would_do_are_named(bring, bbox, fitting):
    declared = "cxcywh" if "cxcywh" not in fitting else "xywh"
    code, _, said = bring([box(bbox=bbox)] * 9, "--box-format", declared)
    assert code == 2
    assert f"next: pass --box-format {fitting}, in which" in said


def test_a_declared_format_has_to_be_the_one_that_explains_the_boxes(bring):
    """x, y, width, height read as centres: a third of the boxes leave their image, no more."""
    right = [box(bbox=[20 + n, 15 + n, 12, 9]) for n in range(8)]
    given = [*right, *(box(bbox=[n, 1, 30, 30]) for n in range(4))]
    code, folder, said = bring(given, "--box-format", "cxcywh")
    assert code == 2
    assert "the boxes are not cxcywh in pixels; found: 33.3% of 12 boxes" in said
    assert "next: pass --box-format xywh, in which" in said
    assert not folder.exists()
    assert bring(given)[0] == 0


def test_boxes_of_a_detector_that_does_not_clip_are_taken(bring):
    """Some leave their image in every format: then the declared one is believed."""
    given = [box(bbox=[20, 15, 12, 9]), box(bbox=[-30, 5, 60, 40]), box(bbox=[40, 5, 60, 40])]
    assert bring([given[0]] * 18 + given[1:])[0] == 0
    assert bring([given[0]] * 18 + given[1:], "--box-format", "cxcywh", name="centres")[0] == 0


def test_fractions_of_the_size_are_refused(bring):
    code, _, said = bring([box(bbox=[0.1, 0.2, 0.5, 0.25])])
    assert code == 2
    assert "fractions of the image's size" in said


REFUSED = {
    "no list": ({"images": []}, "contains no results"),
    "an unknown image": ([box(9)], "1 of 1 prediction is of images outside the track"),
    "an unknown category": ([box(1, 19)], "of categories the vocabulary does not have"),
    "contiguous ids": ([box(1, 0), box(1, 1)], "look like positions 0..3"),
    "ids without names": ([box(1, 0)], "map categories by name, with --label-map FILE"),
    "no score": ([{k: v for k, v in box().items() if k != "score"}], "no score"),
    "a score that is a text": ([box(score="high")], "got str at $[0].score"),
    "three numbers": ([box(bbox=[1, 2, 3])], "expected array of length 4, got 3 at $[0].bbox"),
    "no boxes": ([{"image_id": 1, "category_id": 18, "score": 1.0}], "no bbox"),
    "a boolean image": ([box(True)], "got bool at $[0].image_id"),
    "brackets without end": ("[" * 50_000 + "]" * 50_000, "cannot be read"),
    "half a file": (json.dumps([box()] * 9)[:200], "cannot be read"),
    "a file of truth": (
        {"annotations": [{k: v for k, v in box().items() if k != "score"}], "images": []},
        "no score",
    ),
}


@pytest.mark.parametrize("case", REFUSED)
def test_what_evaluate_would_refuse(bring, case):
    document, words = REFUSED[case]
    code, folder, said = bring(document)
    assert code == 2
    assert words in said
    assert said.count("\n") == 1
    assert not folder.exists()


def test_an_infinite_score_is_refused(bring, track, tmp_path, capfd):
    path = tmp_path / "r.json"
    path.write_text(json.dumps([box()]).replace("0.5}", "Infinity}"))
    code = call(
        ["baseline", "import", path, "--task", "coco", "--track", track, "-o", tmp_path / "r"]
    )
    assert code == 2
    assert "no usable score" in capfd.readouterr().err


def named_entry(name: str, **more) -> dict:
    return {"image_id": 1, "category_name": name, "bbox": BOX, "score": 0.5, **more}


def test_names_win_over_ids(bring):
    _, folder, _ = bring([named_entry("Potted_Plant", category_id=18), named_entry("motorbike")])
    assert [p["category_id"] for p in predictions(folder)] == [64, 4]


def test_the_six_old_names_are_known(bring):
    code, folder, _ = bring(
        [named_entry("motorbike"), named_entry("sofa"), named_entry("pottedplant")]
    )
    assert code == 0
    assert [p["category_id"] for p in predictions(folder)] == [4, 63, 64]


def test_categories_of_the_file_itself(bring):
    document = {
        "annotations": [box(1, 0), box(1, 1)],
        "categories": [{"id": 0, "name": "dog"}, {"id": 1, "name": "sofa"}],
    }
    _, folder, _ = bring(document)
    assert [p["category_id"] for p in predictions(folder)] == [18, 63]


def test_a_label_map_by_name_by_id_and_to_nothing(bring, tmp_path):
    names = tmp_path / "names.json"
    names.write_text(json.dumps({"doggy": "dog", "7": "Couch", "zebra": None}))
    given = [named_entry("doggy"), box(1, 7), named_entry("zebra"), named_entry("zebra")]
    code, folder, said = bring(given, "--label-map", names)
    assert code == 0
    assert [p["category_id"] for p in predictions(folder)] == [18, 63]
    assert "label 'zebra': 2 predictions left out" in said
    assert run_document(folder)["configuration"]["imported"]["left_out"] == {"zebra": 2}


def test_unmapped_names_come_with_the_nearest(bring):
    code, _, said = bring([named_entry("dogs"), named_entry("motor cycle"), named_entry("unicorn")])
    assert code == 2
    assert "3 labels name no category" in said
    assert "'dogs' (near: dog)" in said
    assert "'motor cycle' (near: motorcycle)" in said
    assert "'unicorn'" in said


@pytest.mark.parametrize(("n", "more"), [(6, ""), (7, ", ...")])
def test_six_unmapped_names_are_listed(bring, n, more):
    code, _, said = bring([named_entry(f"q{k}") for k in range(n)])
    assert code == 2
    listed = ", ".join(f"'q{k}'" for k in range(6))
    assert f"{n} labels name no category; found: {listed}{more}; expected" in said


def test_a_label_map_to_an_unknown_name_is_refused(bring, tmp_path):
    names = tmp_path / "names.json"
    names.write_text(json.dumps({"dog": "dogg"}))
    code, _, said = bring([box()], "--label-map", names)
    assert code == 2
    assert "'dogg' (near: dog)" in said


def test_images_it_was_not_run_on_are_missing(bring, tmp_path):
    listed = tmp_path / "list.txt"
    listed.write_text("a.jpg\n3\n")
    code, folder, said = bring([box(1)], "--images-run", listed)
    assert code == 1
    found = rows(folder)
    assert [found[i]["status"] for i in (1, 2, 3)] == ["ok", "missing", "ok"]
    assert [found[i]["code"] for i in (1, 2, 3)] == ["ok", "missing_result", "ok"]
    assert found[2]["reason"] == "not among the images it was run on"
    depends = [run_document(folder)["configuration"]["images_run_sha256"]]
    for name, text in (("same", "c.jpg\n1\n"), ("fewer", "1\n")):
        listed.write_text(text)
        _, again, _ = bring([box(1)], "--images-run", listed, name=name)
        depends.append(run_document(again)["configuration"]["images_run_sha256"])
    assert depends[0] == depends[1] != depends[2]
    listed.write_text("a.jpg\n3\n")
    code, _, said = bring([box(2)], "--images-run", listed, name="other")
    assert code == 2
    assert "images the run calls unread" in said


def test_an_image_list_with_a_stranger_is_refused(bring, tmp_path):
    listed = tmp_path / "list.json"
    listed.write_text('["a.jpg", 99]')
    code, _, said = bring([box(1)], "--images-run", listed)
    assert code == 2
    assert "does not list images of the track; found: 99" in said


def test_an_image_list_that_is_no_text_is_refused(bring, tmp_path):
    listed = tmp_path / "list.bin"
    listed.write_bytes(b"\xff\xfe\x00")
    code, folder, said = bring([box(1)], "--images-run", listed)
    assert code == 2
    assert "list.bin is not a list of images" in said
    assert not folder.exists()


def test_results_of_more_images_are_cut_only_when_asked(bring):
    code, folder, said = bring([box(1), box(77)], name="whole")
    assert code == 2
    assert "next: pass --subset" in said
    assert not folder.exists()
    code, folder, said = bring([box(1), box(77)], "--subset")
    assert code == 0
    assert "1 of 2 predictions is of the track's images" in said
    assert len(predictions(folder)) == 1
    code, _, said = bring([box(77)], "--subset", name="none")
    assert code == 2
    assert "1 of 1 prediction is of images outside the track" in said
    assert "--subset" not in said


def test_another_file_is_another_run(bring):
    _, folder, _ = bring([box(1)])
    before = results(folder)
    code, _, said = bring([box(2)])
    assert code == 2
    assert "imported.sha256" in said
    assert results(folder) == before
    code, _, _ = bring([box(2)], "--overwrite")
    assert code == 0
    assert predictions(folder)[0]["image_id"] == 2


def mask(**more) -> dict:
    rle = {"size": [48, 64], "counts": [96, 40, 48 * 64 - 136]}
    return {"image_id": 1, "category_id": 18, "segmentation": rle, "score": 0.5, **more}


def test_masks(bring):
    empty = {"size": [48, 64], "counts": [48 * 64]}
    code, folder, said = bring([mask(), mask(segmentation=empty)], task="lvis")
    assert code == 0
    (found,) = predictions(folder)
    assert isinstance(found["segmentation"]["counts"], str)
    assert "2 masks with uncompressed RLE" in said
    assert run_document(folder)["configuration"]["imported"]["empty_masks_dropped"] == 1


def test_a_bbox_beside_a_mask_is_left_out(bring):
    """The official evaluator would take the box's area for the mask's."""
    code, folder, said = bring([mask(bbox=[1, 2, 3, 4])], task="lvis")
    assert code == 0
    assert "bbox" not in predictions(folder)[0]
    assert "1 masks with a bbox, which was left out" in said


@pytest.mark.parametrize(
    ("document", "words"),
    [
        ([mask(segmentation={"size": [64, 48], "counts": "P`2"})], "[height, width]"),
        ([mask(segmentation=[[1, 1, 5, 5]])], "expected object, got array at $[0].segmentation"),
        (
            [mask(segmentation=[[1, 1, 5, 1, 5, 5, 7]])],
            "expected object, got array at $[0].segmentation",
        ),
        ([box()], "no segmentation"),
    ],
)
def test_masks_that_are_refused(bring, document, words):
    code, _, said = bring(document, task="lvis")
    assert code == 2
    assert words in said


@pytest.mark.parametrize(
    ("task", "options"),
    [
        ("coco", ["--space", "depth"]),
        ("coco", ["--unit", "m"]),
        ("lvis", ["--box-format", "xyxy"]),
        ("eth3d", ["--box-format", "xyxy"]),
        ("eth3d", ["--subset"]),
        ("eth3d", []),
    ],
)
def test_options_of_another_task_are_wrong_usage(bring, task, options):
    code, folder, _ = bring([], *options, task=task)
    assert code == 2
    assert not folder.exists()


def in_space(number, corners, **more):
    return {"image_id": 1, "category_name": "dog", "score": 0.5 + number / 10,
            "bbox3D": corners.tolist(), **more}  # fmt: skip


def test_boxes_in_space_of_a_detector(bring):
    """Omni3D's own results have a bbox in pixels and more beside the corners."""
    boxes = [solid((k, 0, 4)) for k in range(4)]
    extra = {"bbox": [1, 2, 3, 4], "depth": 4.0, "pose": [], "dimensions": [1, 1, 1]}
    document = [in_space(k, b, **extra) for k, b in enumerate(boxes)]
    code, folder, err = bring(document, task="boxes3d")
    assert code == 0, err
    assert [p["bbox3D"] for p in predictions(folder)] == [b.tolist() for b in boxes]
    assert {p["category_id"] for p in predictions(folder)} == {18}


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda b: b * [1, -1, -1], "4 of 4 boxes behind the camera"),
        (lambda b: b * 1000, "a median depth of 4000 m"),
        (lambda b: b[:4], "8"),
    ],
)
def test_boxes_in_space_in_other_words_are_refused(change, said, bring):
    document = [in_space(k, change(solid((k, 0, 4)))) for k in range(4)]
    code, folder, err = bring(document, task="boxes3d")
    assert code != 0
    assert said in err
    assert not folder.exists()


def test_boxes_of_the_picture_are_no_boxes_in_space(bring):
    document = [{"image_id": 1, "category_name": "dog", "score": 1.0, "bbox": BOX}]
    code, _, err = bring(document, task="boxes3d")
    assert code != 0
    assert "has no bbox3D" in err
