"""Imports match photos and categories by name; what ids mean is declared, doubted, recorded."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest
from baselines.tracks import SIZE_WH, call, make_track, run_document
from pycocotools import mask as coco_mask

from legoworld.baselines.photo_names import _Photos
from legoworld.shipped.catalog import folder as catalog_folder
from legoworld.tracks.track import TrackImage

#: COCO's own way of naming: ids that are the names' numbers, far from 1, 2, 3.
IDS = (139, 285, 632, 724, 776)
NAMES = [f"{i:012}.jpg" for i in IDS]
BOX = [10.5, 4.25, 20.0, 30.0]


@pytest.fixture
def bring(tmp_path, capfd):
    """Import a document: (exit code, predictions by file name, standard error)."""
    made = make_track(tmp_path / "made.json", NAMES)
    document = json.loads(made.read_text())
    for entry, image_id in zip(document["images"], IDS, strict=True):
        entry["id"] = image_id

    def go(given, *options, task="coco", suffix=".json", names=None):
        dataset = "lvis" if task == "lvis" else "coco"
        path = catalog_folder("datasets") / dataset / "categories.json"
        document["categories"] = json.loads(path.read_text())
        for entry, name in zip(document["images"], names or NAMES, strict=True):
            entry["file_name"] = name
        track = tmp_path / "track.json"
        track.write_text(json.dumps(document))
        source = tmp_path / f"results{suffix}"
        source.write_text(given if isinstance(given, str) else json.dumps(given))
        arguments = ["baseline", "import", source, "--task", task, "--track", track]
        code = call([*arguments, "-o", tmp_path / "run", "--overwrite", *options])
        said = capfd.readouterr().err
        if code > 1:
            return code, None, said
        run: Path = tmp_path / "run"
        return code, json.loads((run / "predictions.json").read_text()), said

    go.folder = tmp_path
    return go


def import_record(tmp_path):
    return run_document(tmp_path / "run")["configuration"]["imported"]


def box(image_id, category_id=1, bbox=BOX, score=0.5, **more):
    return {
        "image_id": image_id, "category_id": category_id, "bbox": bbox, "score": score, **more,
    }  # fmt: skip


def renumber_truth(names=NAMES, **more):
    """A whole COCO JSON as exporters write it: images from 1 in an order of their own."""
    images = [
        {"id": n, "file_name": name, "width": SIZE_WH[0], "height": SIZE_WH[1], **more}
        for n, name in enumerate(names[::-1], start=1)
    ]
    boxes = [box(i["id"], 0, [float(n), 1.0, 5.0, 5.0]) for n, i in enumerate(images)]
    return {
        "images": images,
        "annotations": boxes,
        "categories": [{"id": 0, "name": "zebra"}, {"id": 1, "name": "person"}],
    }


def ids(predictions):
    return [p["image_id"] for p in predictions]


@pytest.mark.parametrize("options", [(), ("--subset",)])
@pytest.mark.parametrize("folder", ["", "val2017/", "data\\"])
def test_a_whole_coco_file_is_matched_by_file_name(bring, tmp_path, options, folder):
    """Its ids are of its own images: taken for the track's they put boxes on other photos."""
    code, found, said = bring(renumber_truth([folder + name for name in NAMES]), *options)
    assert code == 0
    assert [(p["image_id"], p["bbox"][0]) for p in found] == list(
        zip(IDS, (4, 3, 2, 1, 0), strict=True)
    )
    assert {p["category_id"] for p in found} == {24}  # the zebra of the file's categories, id 0
    assert "images are matched by file name" in said
    assert import_record(tmp_path)["image_ids"] == "file_names"
    assert import_record(tmp_path)["category_ids"] == "names"


def test_ids_of_renumbered_images_never_reach_other_photos(bring):
    """Ids 139 and 285 are photos of the track and other photos in the file."""
    document = renumber_truth([f"other{n}.jpg" for n in range(4)] + [NAMES[4]])
    for entry, own in zip(document["images"], IDS, strict=True):
        for result in document["annotations"]:
            result["image_id"] = own if result["image_id"] == entry["id"] else result["image_id"]
        entry["id"] = own
    code, found, said = bring(document)
    assert (code, found) == (2, None)
    assert (
        "4 of 5 predictions are of images outside the track; found: image 285, 'other3.jpg'" in said
    )
    assert "pass --subset" in said
    code, found, said = bring(document, "--subset")
    assert ids(found) == [776]
    assert found[0]["bbox"][0] == 0.0
    assert "1 of 5 predictions is of the track's images" in said


@pytest.mark.parametrize("options", [(), ("--subset",)])
def test_subset_is_no_advice_where_all_names_disagree(bring, options):
    code, _, said = bring(renumber_truth([f"other{n}.jpg" for n in range(5)]), *options)
    assert code == 2
    assert "5 of 5 predictions are of images outside the track" in said
    assert "'other4.jpg'" in said
    assert "under the track's file names" in said
    assert "--subset" not in said


def test_the_files_own_images_have_to_hold_its_results(bring):
    document = renumber_truth()
    document["annotations"][0]["image_id"] = 77
    code, _, said = bring(document)
    assert code == 2
    assert "1 of 5 predictions is of images outside the track; found: image 77" in said


def test_two_images_of_one_photo_and_resized_images_are_refused(bring):
    names = ["a/000000000139.jpg", "b/000000000139.jpg", *NAMES[2:]]
    code, _, said = bring(renumber_truth(names), "--subset")
    assert code == 2
    assert "two of the file's images are one photo of the track" in said
    code, _, said = bring(renumber_truth(width=640, height=480))
    assert code == 2
    assert "5 of the file's images have another size than the track's" in said
    first = NAMES[-1]
    assert f"found: {first!r} of 640x480; expected: 64x48" in said


@pytest.mark.parametrize("text", ["{:012}", "{:012}.jpg", "val2017/{:012}.jpg", "{}", "{:012}.png"])
def test_image_ids_may_be_texts(bring, text):
    code, found, _ = bring([box(text.format(i), bbox=[i / 100, 1.0, 5.0, 5.0]) for i in IDS])
    assert code == 0
    assert [(p["image_id"], p["bbox"][0]) for p in found] == [(i, i / 100) for i in IDS]


def test_a_text_is_a_name_before_it_is_an_id(bring):
    """Of a track whose photo 285 is named 139.jpg."""
    _, found, _ = bring([box("139")], names=["x.jpg", "139.jpg", *NAMES[2:]])
    assert ids(found) == [285]


def test_a_name_of_two_photos_names_neither(bring):
    names = ["a/x.jpg", "b/x.jpg", *NAMES[2:]]
    assert ids(bring([box("b/x.jpg")], names=names)[1]) == [285]
    code, _, said = bring([box("x.jpg")], names=names)
    assert code == 2
    assert "1 of 1 prediction is of images outside the track; found: image 'x.jpg'" in said


def test_ids_without_a_gap_that_hold_the_tracks_are_ids(bring):
    _, found, _ = bring([box(i) for i in range(1, 800)], "--subset")
    assert ids(found) == list(IDS)


def test_a_file_name_in_the_result_wins_over_its_id(bring):
    _, found, _ = bring([box(139, file_name=NAMES[3])])
    assert ids(found) == [724]


def test_places_in_a_list_are_no_ids(bring):
    """12 photos without a gap from 0, of a track whose ids are others."""
    given = [box(i) for i in range(12)]
    for options in ((), ("--subset",)):
        code, _, said = bring(given, *options)
        assert code == 2
        assert "look like positions in a list" in said
        assert "ids 0 to 11 without a gap; expected: ids such as 139, 285, 632" in said
        assert "--subset" not in said


def own_ids():
    path = catalog_folder("datasets") / "coco" / "categories.json"
    return [c["id"] for c in json.loads(path.read_text())]


@pytest.mark.parametrize(("option", "first"), [("coco80-0", 0), ("coco80-1", 1)])
def test_declared_numberings(bring, tmp_path, option, first):
    given = [box(139, k + first, [k / 2, 1.0, 5.0, 5.0]) for k in range(80)]
    code, found, said = bring(given, "--category-ids", option)
    assert code == 0
    assert [(p["category_id"], p["bbox"][0]) for p in found] == [
        (own, k / 2) for k, own in enumerate(own_ids())
    ]
    assert import_record(tmp_path)["category_ids"] == option
    assert "80 categories: person 1, bicycle 1," in said


def test_lvis_from_zero(bring, tmp_path):
    rle = {"size": [48, 64], "counts": [96, 40, 48 * 64 - 136]}
    given = [
        {"image_id": 139, "category_id": k, "segmentation": rle, "score": 0.5} for k in (0, 1202)
    ]
    code, _, said = bring(given, task="lvis")
    assert code == 2
    assert "pass --category-ids lvis-0" in said
    code, found, _ = bring(given, "--category-ids", "lvis-0", task="lvis")
    assert code == 0
    assert [p["category_id"] for p in found] == [1, 1203]


@pytest.mark.parametrize(
    ("given", "hint", "options"),
    [
        (range(80), "positions 0..79, not", "coco80-0"),
        (range(1, 81), "positions 1..80, not", "coco80-1"),
        (range(1, 80), "positions 0..79 or 1..80, not", "coco80-0 or coco80-1"),
        ((1, 12), "positions 0..79 or 1..80, not", "coco80-0 or coco80-1"),
        ((0, 12), "positions 0..79, not", "coco80-0"),
    ],
)
def test_refused_ids_are_told_only_what_fits(bring, given, hint, options):
    code, _, said = bring([box(139, k) for k in given])
    assert code == 2
    assert hint in said
    assert "with --label-map FILE, or pass --category-ids" in said
    assert "; expected: one of 80 ids between 1 and 90; next: " in said
    assert re.findall(r"--category-ids (\S+) \(", said) == options.split(" or ")


def test_ids_that_fit_two_numberings_are_asked_about(bring, tmp_path):
    given = [box(139, k) for k in (1, 1, 1, 3, 18, 62)]
    code, _, said = bring(given)
    assert code == 2
    assert "the file does not say what numbering its category ids are of" in said
    assert "found: dataset (person 3, car 1, dog 1, ...) or coco80-1 (person 3, car 1," in said
    assert "next: pass --category-ids dataset or --category-ids coco80-1" in said
    assert not (tmp_path / "run").exists()
    code, found, said = bring(given, "--category-ids", "dataset")
    assert code == 0
    assert [p["category_id"] for p in found] == [1, 1, 1, 3, 18, 62]
    assert "as dataset: person 3, car 1, dog 1, ...; they would fit --category-ids" in said
    assert import_record(tmp_path)["category_ids"] == "dataset"


@pytest.mark.parametrize(
    "ids",
    [
        [1, 1, 1, 3, 18, 62, 90],  # 90 is the dataset's alone
        [1, *range(1, 12)],  # 1 to 11 are the same from 1 on, and the person is the most frequent
        [k for k in range(1, 91) if k not in (12, 26, 29, 30, 45, 66, 68, 69, 71, 83)],
    ],
)
def test_ids_that_are_the_datasets_are_taken_for_those(bring, ids):
    code, found, said = bring([box(139, k) for k in ids])
    assert code == 0
    assert [p["category_id"] for p in found] == ids
    assert "--category-ids" not in said


def test_positions_without_a_person_are_not_taken_for_ids(bring):
    """0 to 79 without the 0, all of them ids of the dataset."""
    code, _, said = bring([box(139, k) for k in (2, 2, 3)])
    assert code == 2
    assert "found: dataset (bicycle 2, car 1) or coco80-0 (car 2, motorcycle 1)" in said


def test_what_other_photos_have_tells_too(bring):
    """Of the track's photo every id is the dataset's; of another it is none."""
    given = [box(139, k) for k in (1, 1, 3)] + [box(999, 12)]
    code, _, said = bring(given, "--subset")
    assert code == 2
    assert "found: coco80-1 (person 2, car 1, stop sign 1)" in said
    assert "next: pass --category-ids coco80-1" in said


def test_lvis_ids_that_name_rarer_things_are_doubted(bring):
    path = catalog_folder("datasets") / "lvis" / "categories.json"
    frequent = [c["id"] for c in json.loads(path.read_text()) if c["frequency"] == "f"][:60]
    rle = {"size": [48, 64], "counts": [96, 40, 48 * 64 - 136]}

    def masks(shift):
        return [
            {"image_id": 139, "category_id": k + shift, "segmentation": rle, "score": 0.5}
            for k in frequent
        ]

    code, _, said = bring(masks(-1), task="lvis")
    assert code == 2
    assert "pass --category-ids dataset or --category-ids lvis-0" in said
    code, _, said = bring(masks(0), task="lvis")
    assert code == 0
    assert "--category-ids" not in said


def test_a_numbering_that_does_not_go_with_the_task_or_the_ids(bring):
    code, _, said = bring([box(139)], "--category-ids", "lvis-0")
    assert code == 2
    assert "expected: dataset or coco80-0 or coco80-1" in said
    code, _, said = bring([box(139, 0), box(139, 80)], "--category-ids", "coco80-1")
    assert code == 2
    assert "1 of 2 predictions has no category id of coco80-1; found: category ids [0]" in said


def test_a_declared_numbering_leaves_names_alone(bring, tmp_path):
    given = [{**box(139), "category_name": "dog"}]
    _, found, said = bring(given, "--category-ids", "coco80-0")
    assert [p["category_id"] for p in found] == [18]
    assert "the file names its categories: --category-ids coco80-0 is not used" in said
    assert import_record(tmp_path)["category_ids"] == "names"


OUTPUT = {"boxes": [[1.0, 2.0, 11.0, 22.0], [3.0, 4.0, 13.0, 24.0]], "labels": [18, 1],
          "scores": [0.5, 0.25]}  # fmt: skip


@pytest.mark.parametrize(
    "document",
    [
        {"139": OUTPUT},
        {NAMES[0]: OUTPUT},
        [{"image_id": 139, **OUTPUT}],
        [{"file_name": NAMES[0], **OUTPUT, "labels": ["dog", "person"]}],
    ],
)
def test_torchvisions_outputs_are_corners_in_their_order(bring, tmp_path, document):
    code, found, _ = bring(document)
    assert code == 0
    assert found == [
        box(139, 18, [1.0, 2.0, 10.0, 20.0], 0.5),
        box(139, 1, [3.0, 4.0, 10.0, 20.0], 0.25),
    ]
    assert import_record(tmp_path)["box_format"] == "xyxy"


@pytest.mark.parametrize(
    "change", [{"scores": [0.5]}, {"labels": None}, {"masks": [1, 2, 3]}], ids=str
)
def test_outputs_whose_lists_differ(bring, change):
    code, _, said = bring([{"image_id": 139, **OUTPUT, **change}])
    assert code == 2
    assert "output 1 of results.json cannot be used" in said


@pytest.mark.parametrize("key", ["boxes", "labels", "scores", "image_id"])
def test_outputs_without_one_of_their_lists(bring, key):
    output = {"image_id": 139, **OUTPUT}
    del output[key]
    code, _, said = bring([output])
    assert code == 2
    assert said.count("\n") == 1


def test_json_lines(bring):
    lines = "\n".join(json.dumps(box(i)) for i in IDS) + "\n"
    code, found, _ = bring(lines, suffix=".jsonl")
    assert code == 0
    assert ids(found) == list(IDS)
    assert bring(lines + "{", suffix=".jsonl")[0] == 2


@pytest.mark.parametrize("suffix", [".json", ".jsonl"])
@pytest.mark.parametrize("end", ["", "\n", "\n\n"])
def test_json_lines_of_one_line(bring, suffix, end):
    """One line of JSON lines is a JSON object, which is no list."""
    code, found, _ = bring(json.dumps(box(285)) + end, suffix=suffix)
    assert code == 0
    assert ids(found) == [285]


def test_whole_ids_may_be_written_as_fractions(bring):
    given = [{**box(139), "image_id": 139.0, "category_id": 90.0}, box(285, 90)]
    code, found, said = bring(given)
    assert code == 0
    assert [(p["image_id"], p["category_id"]) for p in found] == [(139, 90), (285, 90)]
    assert "1 prediction with ids written as fractions, such as 139.0" in said
    assert "fractions" not in bring([box(139, 90)])[2]


@pytest.mark.parametrize("key", ["image_id", "category_id"])
@pytest.mark.parametrize("value", [139.5, 1e308])
def test_fractions_are_no_ids(bring, key, value):
    code, _, said = bring([box(139, 90), {**box(139, 90), key: value}])
    assert code == 2
    assert len(said.strip().splitlines()) == 1
    assert f"a result whose {key} is not an integer; found: {value}" in said


def test_outputs_of_one_image_on_one_line(bring):
    code, found, _ = bring(json.dumps({"image_id": 139, **OUTPUT}), suffix=".jsonl")
    assert code == 0
    assert {*ids(found)} == {139}


def test_one_line_that_is_no_result_is_refused(bring):
    line = box(285)
    del line["bbox"]
    code, _, said = bring(json.dumps(line), suffix=".jsonl")
    assert code == 2
    assert "results.jsonl contains no results" in said
    masks = {"segmentation": {"size": [1, 1], "counts": "1"}, "predicted_iou": 0.5}
    code, _, said = bring(json.dumps(masks), suffix=".jsonl", task="lvis")
    assert "holds SAM's automatic masks" in said


def test_results_without_scores_are_said_in_a_sentence(bring):
    """Ground truth given for results, or an exporter that drops the confidences."""
    lines = [{k: v for k, v in box(i, area=600.0).items() if k != "score"} for i in IDS]
    code, _, said = bring(lines)
    assert code == 2
    assert (
        "5 of 5 predictions have no score; found: the first of them has image_id, category_id, "
        "bbox and area; expected: score in every prediction; next: add each detection's confidence"
    ) in said
    code, _, said = bring([box(139), {}])
    assert "1 of 2 predictions has no image_id; found: the first of them has no keys;" in said
    code, _, said = bring([box(139), [1, 2]])
    assert "1 of 2 predictions is no JSON object; found: [1, 2];" in said


def test_a_photo_in_another_folder_is_named_with_the_remedy(bring):
    names = [f"val2017/{i}.jpg" for i in range(5)]
    other = [{"file_name": "images/2.jpg", "category_id": 1, "bbox": BOX, "score": 0.5}]
    code, _, said = bring(other, names=names)
    assert code == 2
    assert "image None" not in said
    assert "found: 'images/2.jpg'; expected: 'val2017/2.jpg', as the track has it" in said
    assert "write the track's folder or none into the results\n" in said
    for remedy in ("val2017/2.jpg", "2.jpg"):
        assert bring([{**other[0], "file_name": remedy}], names=names)[0] == 0
    mine = {**other[0], "file_name": "val2017/1.jpg"}
    code, _, said = bring([mine, *other], names=names)
    assert code == 2
    assert said.rstrip().endswith("; if not, pass --subset to leave it out")
    listed = bring.folder / "ran_on.txt"
    listed.write_text("images/2.jpg\n")
    code, _, said = bring([mine], "--images-run", listed, names=names)
    assert code == 2
    assert "found: 'images/2.jpg'; expected: 'val2017/2.jpg', as the track has it" in said
    assert f"list the track's name or {IDS[2]}, its id" in said
    for remedy in ("val2017/1.jpg", str(IDS[1])):
        listed.write_text(remedy)
        assert bring([mine], "--images-run", listed, names=names)[0] == 1  # the others: missing


def test_polygons_are_filled_as_pycocotools_fills_them(bring):
    triangle, square = [1, 1, 40.5, 3, 20, 30], [50, 30, 60, 30, 60, 40, 50, 40]
    given = [{**box("139", 18), "segmentation": [triangle, square]}]
    code, found, said = bring(given, "--category-ids", "dataset", task="lvis")
    assert code == 0
    expected = coco_mask.merge(coco_mask.frPyObjects([triangle, square], 48, 64))
    assert found[0]["segmentation"]["counts"] == expected["counts"].decode()
    assert "1 mask of polygons, filled as pycocotools does" in said


OTHERS = {
    "SAM": ([{"segmentation": {}, "area": 1, "bbox": BOX, "predicted_iou": 0.9}], ".json",
        "SAM's automatic masks: of no image and of no category", "predicted_iou as score"),
    "LabelMe": ({"shapes": [], "imagePath": "x"}, ".json", "one photo's file of LabelMe",
        "labelme2coco.py"),
    "YOLO": ("0 0.5 0.5 0.1 0.1\n1 0.2 0.2 0.1 0.1\n", ".txt", "cannot be read",
        "save_json=True"),
    "VOC": ("<annotation></annotation>", ".xml", "cannot be read", "from_pascal_voc"),
    "a table": ("image,x,y\n1,2,3\n", ".csv", "cannot be read", "one object a row"),
    "tensors": ("PK", ".pt", "cannot be read", "v.tolist()"),
}  # fmt: skip


@pytest.mark.parametrize("name", OTHERS)
def test_other_forms_are_told_the_way(bring, name):
    document, suffix, what, advice = OTHERS[name]
    code, _, said = bring(document, suffix=suffix)
    assert code == 2
    assert what in said
    assert advice in said
    assert said.count("\n") == 1


def test_a_folder_of_yolo_labels_is_told_the_way(bring, tmp_path, capfd):
    labels = tmp_path / "labels"
    labels.mkdir()
    (labels / "000000000139.txt").write_text("0 0.5 0.5 0.1 0.1\n")
    bring([])
    arguments = ["baseline", "import", labels, "--task", "coco", "--track", tmp_path / "track.json"]
    assert call([*arguments, "-o", tmp_path / "other"]) == 2
    assert "save_json=True" in capfd.readouterr().err


def test_one_base_name_in_two_folders_is_two_photos(bring):
    names = ["a/1.jpg", "a/2.jpg", "c/3.jpg", "c/4.jpg", "5.jpg"]
    mine = [{"file_name": "a/1.jpg", "category_id": 1, "bbox": BOX, "score": 0.5}]
    other = [{"file_name": "b/2.jpg", "category_id": 1, "bbox": BOX, "score": 0.5}]
    code, _, said = bring(mine + other, names=names)
    assert code == 2
    assert "1 of 2 predictions is of images outside the track" in said
    code, kept, _ = bring(mine + other, "--subset", names=names)
    assert code == 0
    assert [p["image_id"] for p in kept] == [139]
    # A path that ends in the other is the same photo.
    longer = [{"file_name": "data/c/4.jpg", "category_id": 1, "bbox": BOX, "score": 0.5}]
    code, kept, _ = bring(longer, names=names)
    assert [p["image_id"] for p in kept] == [724]


def test_an_id_that_the_files_own_images_lack_is_no_photo_of_the_track(bring):
    document = renumber_truth()
    document["images"] = document["images"][:1]
    stray = dict(document["annotations"][0], image_id=IDS[1])
    document["annotations"] = [
        a for a in document["annotations"] if a["image_id"] == document["images"][0]["id"]
    ] + [stray]
    code, _, said = bring(document)
    assert code == 2
    assert "1 of 2 predictions is of images outside the track" in said


@pytest.mark.parametrize(
    ("document", "said"),
    [
        ({"annotations": [], "images": 5}, "has images that cannot be used"),
        ({"annotations": [], "categories": [{"id": 1e400, "name": "x"}]}, "categories that cannot"),
    ],
)
def test_tables_that_are_none_are_one_line(bring, document, said):
    code, _, error = bring(document)
    assert code == 2
    assert said in error
    assert "Traceback" not in error


def test_a_line_separator_inside_a_text_ends_no_json_line(bring):
    lines = [json.dumps(box(i, note="a\u2028b"), ensure_ascii=False) for i in IDS[:2]]
    code, kept, _ = bring("\n".join(lines), suffix=".jsonl")
    assert code == 0
    assert len(kept) == 2


def test_a_polygon_that_would_end_pycocotools_is_refused(bring):
    far = [[0, 0, 4.9e8, 0, 0, 10]]
    given = [{"image_id": IDS[0], "category_id": 1, "segmentation": far, "score": 0.5}]
    code, _, said = bring(given, task="coco-masks")
    assert code == 2
    assert "Traceback" not in said


@pytest.mark.parametrize(
    ("name", "image_id"),
    [
        ("1.jpg", 1),  # its own path, though b/1.jpg ends in it
        ("1", 1),
        ("b/1.jpg", 2),
        ("b\\1", 2),
        ("x/b/1.png", None),  # so does 1.jpg of no folder
        ("c/2.jpg", 3),
        ("2.jpg", 3),
        ("d/2.jpg", None),
        ("3", 3),  # an id
        ("4", None),
    ],
)
def test_a_photo_s_own_path_comes_before_what_ends_in_it(name, image_id):
    files = ["1.jpg", "b/1.jpg", "c/2.jpg"]
    images = [
        TrackImage(id=k, file_name=file, size_wh=SIZE_WH, scene=file)
        for k, file in enumerate(files, start=1)
    ]
    assert _Photos(images).find(name) == image_id
