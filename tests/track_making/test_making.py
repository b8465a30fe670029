"""Tracks: seeded samples of the public half, and nothing of the private one."""

from __future__ import annotations

import json

import cv2
import numpy as np
import pytest
from evaluation.detection_runs import random_truth, write_truth

from legoworld import cli
from legoworld.errors import CatalogError, LegoWorldError, UsageError
from legoworld.files import sha256_of_file
from legoworld.shipped import catalog
from legoworld.track_making.make_track import make_track
from legoworld.tracks.track import load_track

#: Numbers so odd that they can only come from an annotation.
ODD = 7919


def marked_truth(task):
    """A truth whose every private value is recognisable."""
    truth = random_truth(task, seed=1)
    for n, a in enumerate(truth["annotations"]):
        a["id"] = 1_000_000 + n
        a["area"] = float(f"{ODD}.{n}")
        a["bbox"] = [ODD + 0.125, ODD + 0.25, ODD + 0.5, ODD + 0.75]
        a["caption"] = "a private word"
    for i in truth["images"]:
        i["neg_category_ids"] = i["not_exhaustive_category_ids"] = [ODD]
        i["n_objects"] = ODD
    for c in truth["categories"]:
        c["image_count"] = c["instance_count"] = ODD
        c["synonyms"] = [c["name"]]
    truth["licenses"] = [{"id": 1, "name": "some licence"}]
    if task == "coco":
        for i in truth["images"]:
            del i["neg_category_ids"], i["not_exhaustive_category_ids"]
    return truth


def strings_and_numbers(value):
    if isinstance(value, dict):
        for key, inner in value.items():
            yield key
            yield from strings_and_numbers(inner)
    elif isinstance(value, list):
        for inner in value:
            yield from strings_and_numbers(inner)
    else:
        yield value


@pytest.mark.parametrize("sample", [None, 5])
@pytest.mark.parametrize("task", ["coco", "lvis"])
def test_no_annotation_reaches_a_track(task, sample, tmp_path):
    truth = marked_truth(task)
    path = write_truth(tmp_path / "truth.json", truth)
    make_track(task, path, tmp_path / "track.json", sample=sample, seed=0)
    text = (tmp_path / "track.json").read_text()
    track = json.loads(text)
    private = {v for a in truth["annotations"] for v in strings_and_numbers(a)} | {ODD}
    public = {
        v
        for part in ("images", "categories")
        for entry in truth[part]
        for k, inner in entry.items()
        if k in ("id", "file_name", "width", "height", "name", "frequency", "synonyms")
        for v in strings_and_numbers([k, inner])
    }
    only_private = private - public - {"image_id", "category_id", "id", 0, 1}
    assert {"caption", "a private word", "bbox", "area", 1_000_000} <= only_private
    assert not only_private & set(strings_and_numbers([track["images"], track["categories"]]))
    assert str(ODD) not in text
    assert set(track) == {"info", "images", "categories"}
    assert {k for i in track["images"] for k in i} <= {"id", "file_name", "width", "height"}
    assert {k for c in track["categories"] for k in c} <= {"id", "name", "frequency", "synonyms"}


def test_a_sample_is_seeded_and_says_where_it_is_from(tmp_path):
    path = write_truth(tmp_path / "truth.json", random_truth("coco", seed=2, images=40))
    made = [
        make_track("coco", path, tmp_path / f"{n}.json", sample=10, seed=seed)
        for n, seed in enumerate((0, 0, 1))
    ]
    assert (tmp_path / "0.json").read_bytes() == (tmp_path / "1.json").read_bytes()
    ids = [[i.id for i in m.images] for m in made]
    assert ids[0] == sorted(ids[0]) != ids[2]
    assert len(set(ids[0])) == 10
    info = made[0].info
    assert info.source_sha256 == sha256_of_file(path)
    assert (info.sample, info.seed, info.source_images) == (10, 0, 40)
    assert len(load_track(tmp_path / "0.json").images) == 10


def test_a_sample_does_not_depend_on_annotations_or_on_the_order_of_the_file(tmp_path):
    truth = random_truth("coco", seed=3, images=40)
    first = make_track(
        "coco", write_truth(tmp_path / "a.json", truth), tmp_path / "1.json", sample=9, seed=4
    )
    bare = {**truth, "annotations": [], "images": truth["images"][::-1]}
    second = make_track(
        "coco", write_truth(tmp_path / "b.json", bare), tmp_path / "2.json", sample=9, seed=4
    )
    assert first.images == second.images


def test_every_image_is_drawn_equally_often(tmp_path):
    path = write_truth(tmp_path / "truth.json", random_truth("coco", seed=3, images=10))
    counts = dict.fromkeys(range(10), 0)
    for seed in range(300):
        for i in make_track("coco", path, tmp_path / "t.json", sample=3, seed=seed).images:
            counts[(i.id - 10) // 3] += 1
    assert min(counts.values()) > 50
    assert max(counts.values()) < 130


def test_a_track_carries_its_truths_own_version(tmp_path):
    shipped = catalog.folder("datasets") / "skimage_examples"
    for task, version in (("coco", "2017"), ("lvis", "1.0")):
        made = make_track(
            task, shipped / f"truth_{task}.json", tmp_path / "t.json", sample=None, seed=0
        )
        assert made.info.dataset_version == version
        again = load_track(tmp_path / "t.json").vocabulary
        assert again.sha256 == load_track(shipped / f"track_{task}.json").vocabulary.sha256
    custom = write_truth(tmp_path / "c.json", random_truth("coco", seed=1))
    made = make_track("coco", custom, tmp_path / "t.json", sample=None, seed=0)
    assert made.info.dataset_version == "custom"


@pytest.mark.real_data
def test_lvis_v05_stays_v05(real_data, tmp_path):
    path = real_data / "lvis" / "lvis_val_100.json"
    made = make_track("lvis", path, tmp_path / "t.json", sample=None, seed=0)
    assert made.info.dataset_version == "0.5"
    assert len(made.categories) == 1230
    track = load_track(tmp_path / "t.json")
    assert all(len(i.scene) == 12 for i in track.images), "named by coco_url, not COCO_val2014_..."


def test_what_cannot_be_sampled_is_refused(tmp_path):
    path = write_truth(tmp_path / "truth.json", random_truth("coco", seed=2))
    out = tmp_path / "t.json"
    with pytest.raises(UsageError, match="at most 12"):
        make_track("coco", path, out, sample=13, seed=0)
    with pytest.raises(CatalogError, match="not ground truth of lvis"):
        make_track("lvis", path, out, sample=None, seed=0)
    lvis = write_truth(tmp_path / "lvis.json", random_truth("lvis", seed=2))
    with pytest.raises(CatalogError, match="not ground truth of coco"):
        make_track("coco", lvis, out, sample=None, seed=0)
    (tmp_path / "broken.json").write_text("{")
    with pytest.raises(CatalogError, match="cannot be read"):
        make_track("coco", tmp_path / "broken.json", out, sample=None, seed=0)
    with pytest.raises(UsageError, match="folder"):
        make_track("eth3d", path, out, sample=None, seed=0)
    assert not out.exists()


def photos_of(track, folder):
    for i in load_track(track).images:
        width, height = i.size_wh
        (folder / i.file_name).parent.mkdir(parents=True, exist_ok=True)
        cv2.imwrite(str(folder / i.file_name), np.zeros((height, width, 3), np.uint8))


def test_check_finds_what_is_missing_broken_or_of_another_size(tmp_path, capsys):
    path = write_truth(tmp_path / "truth.json", random_truth("coco", seed=2))
    track = tmp_path / "t.json"
    make = ["track", "make", "--task", "coco", "--truth", str(path), "-o", str(track)]
    assert cli.run(make) == 0
    assert cli.run(make) == 2, "there already"
    assert cli.run([*make, "--overwrite"]) == 0
    photos = tmp_path / "photos"
    photos_of(track, photos / "val2017")
    check = ["track", "check", str(track), "--photos", str(photos)]
    assert cli.run(check) == 0
    capsys.readouterr()
    (photos / "val2017" / "000.jpg").unlink()
    (photos / "val2017" / "001.jpg").write_bytes(b"no picture")
    cv2.imwrite(str(photos / "val2017" / "002.jpg"), np.zeros((120, 90, 3), np.uint8))
    assert cli.run(check) == 1
    shown = capsys.readouterr().out
    assert "missing: 000.jpg" in shown
    assert "unreadable: 001.jpg" in shown
    assert "90x120, the track says 120x90" in shown
    assert "9 of 12 photos" in shown
    assert cli.run(["track", "make", "--task", "coco"]) == 2
    assert cli.run(["track", "check"]) == 2
    capsys.readouterr()
    assert cli.run([*make, "--overwrite", "--seed", "3"]) == 2, "nothing is drawn"
    assert "--seed is for --sample" in capsys.readouterr().err


def test_images_are_chosen_by_id_or_name(tmp_path):
    document = random_truth("coco", seed=1)
    path = write_truth(tmp_path / "truth.json", document)
    first, last = document["images"][0], document["images"][-1]
    for chosen in ([str(first["id"]), last["file_name"]], [last["file_name"], str(first["id"])]):
        made = make_track("coco", path, tmp_path / "t.json", sample=None, seed=0, chosen=chosen)
        assert {i.id for i in made.images} == {first["id"], last["id"]}
        assert made.info.chosen
        assert made.info.seed is None


def test_lvis_images_are_chosen_by_the_name_in_their_url(tmp_path):
    document = random_truth("lvis", seed=1)
    for image in document["images"]:
        image.pop("file_name", None)
        image["coco_url"] = f"http://images.cocodataset.org/val2017/{image['id']:012d}.jpg"
    path = write_truth(tmp_path / "truth.json", document)
    name = f"{document['images'][2]['id']:012d}.jpg"
    made = make_track("lvis", path, tmp_path / "t.json", sample=None, seed=0, chosen=[name])
    assert [i.id for i in made.images] == [document["images"][2]["id"]]


@pytest.mark.parametrize("chosen", [[], ["nothing.jpg"]])
def test_an_image_the_truth_has_not_is_refused(chosen, tmp_path):
    path = write_truth(tmp_path / "truth.json", random_truth("coco", seed=1))
    with pytest.raises(UsageError, match="no such image"):
        make_track("coco", path, tmp_path / "t.json", sample=None, seed=0, chosen=chosen)
    assert not (tmp_path / "t.json").exists()


def test_a_chosen_image_of_another_folder_is_named_with_the_remedy(tmp_path):
    document = random_truth("coco", seed=1)
    image = document["images"][3]
    image["file_name"] = "val2017/x.jpg"
    path = write_truth(tmp_path / "truth.json", document)
    with pytest.raises(UsageError) as caught:
        make_track("coco", path, tmp_path / "t.json", sample=None, seed=0, chosen=["images/x.jpg"])
    assert str(caught.value) == (
        "the ground truth has no such image; found: 'images/x.jpg'; expected: 'val2017/x.jpg', as "
        "truth.json has it in another folder; next: if it is that photo, list that name or "
        f"{image['id']}, its id"
    )
    for remedy in ("val2017/x.jpg", str(image["id"])):
        made = make_track("coco", path, tmp_path / "t.json", sample=None, seed=0, chosen=[remedy])
        assert [i.id for i in made.images] == [image["id"]]


def test_a_truth_that_makes_no_track_leaves_the_earlier_one(tmp_path):
    truth, output = tmp_path / "truth.json", tmp_path / "track.json"
    output.write_text("an earlier track")
    images = [
        {"id": i, "file_name": n, "width": 4, "height": 4} for i, n in ((1, "a.jpg"), (2, "a.png"))
    ]
    document = {"images": images, "annotations": [], "categories": [{"id": 1, "name": "x"}]}
    truth.write_text(json.dumps(document))
    with pytest.raises(LegoWorldError, match=r"truth\.json"):
        make_track("coco", truth, output, sample=None, seed=0)
    document["images"] = [dict(images[0], id=-1)]
    truth.write_text(json.dumps(document))
    with pytest.raises(LegoWorldError, match="image id"):
        make_track("coco", truth, output, sample=None, seed=0)
    assert output.read_text() == "an earlier track"
    assert sorted(p.name for p in tmp_path.iterdir()) == ["track.json", "truth.json"]
