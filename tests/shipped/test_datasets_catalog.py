"""What the shipped cards, vocabularies, tracks and hand-drawn truth must hold to."""

import hashlib
import json
import tomllib
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pycocotools import mask as mask_api
from pycocotools.coco import COCO

from legoworld.tasks.shipped import TASKS as TASKS_THAT_SHIP

ROOT = Path(__file__).parents[2]
DATASETS = ROOT / "datasets"
READOUTS = ROOT / "readouts"
EXAMPLES = DATASETS / "skimage_examples"
TASKS = ("coco", "lvis")
DATASET_NAMES = tuple(sorted(path.parent.name for path in DATASETS.glob("*/card.toml")))
ETH3D_SCENES = Counter(
    {"courtyard": 38, "delivery_area": 44, "electro": 45, "facade": 76, "kicker": 31}
    | {"meadow": 15, "office": 26, "pipes": 14, "playground": 38}
    | {"relief": 31, "relief_2": 31, "terrace": 23, "terrains": 42}
)
CARD_TEXTS = ("name", "version", "title", "url", "source", "licence")
CARD_LISTS = ("serves", "public", "private", "facts", "traps", "files")
PHOTOS = {
    "astronaut.png": (1, 512, 512),
    "chelsea.png": (2, 451, 300),
    "coffee.png": (3, 600, 400),
    "motorcycle.png": (4, 741, 500),
}


def load_json(path: Path) -> Any:
    """The JSON value of a UTF-8 file."""
    return json.loads(path.read_text(encoding="utf-8"))


def load_toml(path: Path) -> dict[str, Any]:
    """The tables of a TOML file."""
    return tomllib.loads(path.read_text(encoding="utf-8"))


def keys_of(value: object) -> Iterator[str]:
    """Every object key at any depth of a JSON value."""
    if isinstance(value, dict):
        for key, inner in value.items():
            yield str(key)
            yield from keys_of(inner)
    elif isinstance(value, list):
        for inner in value:
            yield from keys_of(inner)


def truth_of(task: str) -> dict[str, Any]:
    """The hand-drawn truth of a task."""
    truth: dict[str, Any] = load_json(EXAMPLES / f"truth_{task}.json")
    return truth


@pytest.mark.parametrize("folder", ["readouts", "datasets", "baselines"])
def test_no_python_directly_inside_the_catalogue(folder: str) -> None:
    assert (ROOT / folder).is_dir()
    found = sorted(path.name for path in (ROOT / folder).glob("*.py"))
    assert found == [], f"{folder}/ must stay importable by nobody"


def test_no_python_anywhere_inside_cards_and_readouts() -> None:
    assert sorted(READOUTS.rglob("*.py")) + sorted(DATASETS.rglob("*.py")) == []


def test_coco_vocabulary() -> None:
    rows = load_json(DATASETS / "coco" / "categories.json")
    ids = [row["id"] for row in rows]
    assert all(set(row) == {"id", "name", "supercategory"} for row in rows)
    assert len(rows) == len(set(ids)) == len({row["name"] for row in rows}) == 80
    assert ids == sorted(ids)
    unused = {12, 26, 29, 30, 45, 66, 68, 69, 71, 83}
    assert set(ids) == set(range(1, 91)) - unused
    assert (rows[0]["name"], rows[-1]["name"]) == ("person", "toothbrush")
    assert len({row["supercategory"] for row in rows}) == 12


def test_lvis_vocabulary() -> None:
    rows = load_json(DATASETS / "lvis" / "categories.json")
    assert [row["id"] for row in rows] == list(range(1, 1204))
    assert len({row["name"] for row in rows}) == 1203
    assert len({row["synset"] for row in rows}) == 1203
    assert Counter(row["frequency"] for row in rows) == {"f": 405, "c": 461, "r": 337}
    for row in rows:
        assert set(row) - {"coco_id"} == {"id", "name", "synset", "synonyms", "frequency"}


def test_no_lvis_synonym_is_ambiguous() -> None:
    rows = load_json(DATASETS / "lvis" / "categories.json")
    words = Counter(
        word
        for row in rows
        for word in {text.lower().replace("_", " ") for text in [row["name"], *row["synonyms"]]}
    )
    assert [word for word, count in words.items() if count > 1] == []


def test_every_coco_category_but_hot_dog_has_one_lvis_category() -> None:
    coco = {row["id"]: row["name"] for row in load_json(DATASETS / "coco" / "categories.json")}
    lvis = load_json(DATASETS / "lvis" / "categories.json")
    name_of = {row["coco_id"]: row["name"] for row in lvis if "coco_id" in row}
    assert sum("coco_id" in row for row in lvis) == len(name_of) == 79
    assert [coco[i] for i in coco if i not in name_of] == ["hot dog"]
    by_name = {coco[i]: name for i, name in name_of.items()}
    assert by_name["couch"] == "sofa"
    assert by_name["mouse"] == "mouse_(computer_equipment)"
    assert by_name["potted plant"] == "flowerpot"


def test_eth3d_images() -> None:
    rows = load_json(DATASETS / "eth3d" / "images.json")
    names = [row["file_name"] for row in rows]
    assert [row["id"] for row in rows] == list(range(1, 455))
    assert names == sorted(set(names))
    for name in names:
        _scene, middle, folder, last = name.split("/")
        assert (middle, folder) == ("images", "dslr_images")
        assert last.endswith(".JPG")
    assert Counter(name.split("/")[0] for name in names) == ETH3D_SCENES


@pytest.mark.parametrize("name", DATASET_NAMES)
def test_dataset_card(name: str) -> None:
    card = load_toml(DATASETS / name / "card.toml")
    for keys, kind in ((CARD_TEXTS, str), (CARD_LISTS, list)):
        for key in keys:
            assert isinstance(card[key], kind), f"{name}: {key} must be {kind.__name__}"
            assert card[key], f"{name}: {key} is empty"
    assert set(card) - {*CARD_TEXTS, *CARD_LISTS} - {"depth"} == {"schema_version"}
    assert card["schema_version"] == 1
    assert card["name"] == name
    assert set(card["serves"]) <= {task.dataset.name for task in TASKS_THAT_SHIP}
    assert not set(card["public"]) & set(card["private"])


@pytest.mark.parametrize("name", DATASET_NAMES)
def test_dataset_card_files(name: str) -> None:
    folder = DATASETS / name
    card = load_toml(folder / "card.toml")
    shipped = {row["pattern"]: row for row in card["files"] if row["shipped"]}
    assert set(shipped) == {path.name for path in folder.iterdir()} - {"card.toml"}
    for pattern, row in shipped.items():
        content = (folder / pattern).read_bytes()
        assert hashlib.sha256(content).hexdigest() == row["sha256"], f"{name}/{pattern}"
        assert content.endswith(b"\n")
    for row in card["files"]:
        assert row["access"] in {"public", "private"}
        assert row["what"]
        if row["shipped"]:
            assert row["pattern"] in card[row["access"]]


@pytest.mark.parametrize("task", TASKS)
def test_track_is_public(task: str) -> None:
    track = load_json(EXAMPLES / f"track_{task}.json")
    assert set(track) == {"info", "images", "categories"}
    private = {
        "annotations",
        "bbox",
        "segmentation",
        "area",
        "iscrowd",
        "neg_category_ids",
        "not_exhaustive_category_ids",
    }
    assert not private & set(keys_of(track))
    assert all(set(row) == {"id", "file_name", "width", "height"} for row in track["images"])


@pytest.mark.parametrize("task", TASKS)
def test_track_and_truth_name_the_same_images_and_categories(task: str) -> None:
    track = load_json(EXAMPLES / f"track_{task}.json")
    truth = truth_of(task)
    keys = ("id", "file_name", "width", "height")
    rows = [{key: row[key] for key in keys} for row in truth["images"]]
    assert track["images"] == rows
    found = {row["file_name"]: (row["id"], row["width"], row["height"]) for row in rows}
    assert found == PHOTOS
    assert [row["file_name"] for row in rows] == sorted(PHOTOS)
    vocabulary = load_json(DATASETS / task / "categories.json")
    assert track["categories"] == truth["categories"] == vocabulary


@pytest.mark.parametrize("task", TASKS)
def test_truth_annotations_are_sorted_and_numbered_from_one(task: str) -> None:
    truth = truth_of(task)
    rows = truth["annotations"]
    assert [row["id"] for row in rows] == list(range(1, len(rows) + 1))
    assert [row["image_id"] for row in rows] == sorted(row["image_id"] for row in rows)
    assert {row["image_id"] for row in rows} == {row["id"] for row in truth["images"]}
    assert {row["category_id"] for row in rows} <= {row["id"] for row in truth["categories"]}


@pytest.mark.parametrize("task", TASKS)
def test_truth_polygons_boxes_and_areas_agree(task: str) -> None:
    truth = truth_of(task)
    size_wh = {row["id"]: (row["width"], row["height"]) for row in truth["images"]}
    for row in truth["annotations"]:
        width, height = size_wh[row["image_id"]]
        for polygon in row["segmentation"]:
            assert len(polygon) >= 6
            assert len(polygon) % 2 == 0
        xy_px = np.concatenate([np.reshape(p, (-1, 2)) for p in row["segmentation"]])
        low, high = xy_px.min(axis=0), xy_px.max(axis=0)
        assert (low >= 0).all(), row["id"]
        assert (high <= (width, height)).all(), row["id"]
        np.testing.assert_allclose(row["bbox"], [*low, *(high - low)], atol=1e-6)
        rle = mask_api.merge(mask_api.frPyObjects(row["segmentation"], height, width))
        assert row["area"] == mask_api.area(rle) > 0, row["id"]


@pytest.mark.parametrize("task", TASKS)
def test_truth_loads_in_pycocotools(task: str) -> None:
    coco = COCO(str(EXAMPLES / f"truth_{task}.json"))
    assert len(coco.imgs) == 4
    assert len(coco.anns) == {"coco": 10, "lvis": 21}[task]
    for row in coco.anns.values():
        assert coco.annToMask(row).sum() == row["area"]


def test_coco_truth_has_no_crowd() -> None:
    assert {row["iscrowd"] for row in truth_of("coco")["annotations"]} == {0}


def test_lvis_truth_verifies_absence_apart_from_presence() -> None:
    truth = truth_of("lvis")
    for image in truth["images"]:
        present = {r["category_id"] for r in truth["annotations"] if r["image_id"] == image["id"]}
        absent = image["neg_category_ids"]
        partial = image["not_exhaustive_category_ids"]
        assert absent == sorted(set(absent))
        assert len(absent) >= 8
        assert partial == sorted(set(partial))
        assert not present & set(absent)
        assert set(partial) <= present
        assert present | set(absent) <= {row["id"] for row in truth["categories"]}


def test_same_object_is_drawn_once_for_both_vocabularies() -> None:
    lvis = {row["id"]: row for row in load_json(DATASETS / "lvis" / "categories.json")}
    drawn = [
        (row["image_id"], lvis[row["category_id"]].get("coco_id"), row["segmentation"])
        for row in truth_of("lvis")["annotations"]
    ]
    table_id = 67  # COCO's dining table includes what stands on it, LVIS's table does not.
    for row in truth_of("coco")["annotations"]:
        if row["category_id"] != table_id:
            assert (row["image_id"], row["category_id"], row["segmentation"]) in drawn


@pytest.mark.parametrize("name", PHOTOS)
def test_photo_of_scikit_image_is_the_one_drawn_on(name: str) -> None:
    data = pytest.importorskip("skimage.data", reason="scikit-image holds the photos")
    stem = name.removesuffix(".png")
    rgb = data.stereo_motorcycle()[0] if stem == "motorcycle" else getattr(data, stem)()
    card = load_toml(EXAMPLES / "card.toml")
    row = next(row for row in card["files"] if row["pattern"] == f"PHOTOS/{name}")
    assert (rgb.shape[1], rgb.shape[0]) == PHOTOS[name][1:]
    assert hashlib.sha256(rgb.tobytes()).hexdigest() == row["pixels_sha256"]


def test_depth_constants_give_the_recorded_range() -> None:
    data = pytest.importorskip("skimage.data", reason="scikit-image holds the disparity")
    depth = load_toml(EXAMPLES / "card.toml")["depth"]
    disparity_px = data.stereo_motorcycle()[2].astype(np.float64)
    known = np.isfinite(disparity_px)
    assert disparity_px.shape == (500, 741)
    assert np.isinf(disparity_px).sum() == 27226 == (~known).sum()
    z_m = depth["focal_px"] * depth["baseline_m"] / (disparity_px[known] + depth["doffs_px"])
    np.testing.assert_allclose([z_m.min(), z_m.max()], depth["z_range_m"], atol=5e-5)


def test_readout_cards_share_what_they_share() -> None:
    names = ("coco", "coco-masks", "lvis", "eth3d")
    cards = {task: load_toml(READOUTS / f"{task}.toml") for task in names}
    assert cards["coco"]["visibility"] == cards["lvis"]["visibility"]
    masks = cards["coco-masks"]
    for table in ("vocabulary", "visibility"):
        assert masks[table] == cards["coco"][table]
    of_lvis = {**cards["lvis"]["export"], "format": "coco_results"}
    assert masks["export"] == of_lvis
    assert masks["scoring"] == {**cards["coco"]["scoring"], "protocol": "segm"}
    assert cards["coco"]["visibility"] == cards["eth3d"]["visibility"]
    differs = {"file", "size", "override_property", "synonyms", "qualifier"}
    coco, lvis = cards["coco"]["vocabulary"], cards["lvis"]["vocabulary"]
    assert set(coco) == set(lvis)
    assert {key for key in coco if coco[key] != lvis[key]} == differs
    for task, card in cards.items():
        assert card["readout"]["name"] == card["readout"]["task"] == task
        assert (DATASETS / card["readout"]["dataset"] / "card.toml").is_file()
        for dotted in card["adjustable"]:
            table, key = dotted.split(".")
            assert key in card[table], f"{task}: {dotted} is no key of the card"


@pytest.mark.parametrize("task", TASKS)
def test_readout_vocabulary_is_the_dataset_s(task: str) -> None:
    vocabulary = load_toml(READOUTS / f"{task}.toml")["vocabulary"]
    assert len(load_json(DATASETS / vocabulary["file"])) == vocabulary["size"]


def test_readout_cards_state_the_protocol() -> None:
    coco, lvis, eth3d = (load_toml(READOUTS / f"{t}.toml") for t in ("coco", "lvis", "eth3d"))
    assert coco["export"]["score"] == lvis["export"]["score"] == 1.0
    assert coco["scoring"]["max_detections"] == 100
    assert coco["scoring"]["max_detections_per"] == "image_and_category"
    assert lvis["scoring"]["max_detections"] == 300
    assert lvis["scoring"]["max_detections_per"] == "image"
    assert "bbox" not in lvis["export"]["fields"]
    assert eth3d["export"]["array"] == "depth_z_m"
    assert eth3d["export"]["hole"] == np.inf
    assert eth3d["holes"]["policies"] == ["error_1", "exclude", "far"]
    assert eth3d["holes"]["primary"] == "error_1"
    assert eth3d["alignment"]["space"] == "disparity"
    assert eth3d["scoring"]["min_valid_px"] == 10
