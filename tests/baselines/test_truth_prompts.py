"""The one declared place before scoring that reads truth."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path

import pytest
from baselines.tracks import (
    CATEGORIES,
    FAKE_BATCHED,
    SIZE_WH,
    call,
    make_track,
    run_arguments,
    run_document,
)

NAMES = ["001.jpg", "002.jpg"]


@pytest.fixture
def truth(tmp_path: Path) -> Path:
    images = [
        {"id": n, "file_name": name, "width": SIZE_WH[0], "height": SIZE_WH[1],
         "neg_category_ids": negative, "not_exhaustive_category_ids": []}
        for n, (name, negative) in enumerate(zip(NAMES, ([17], []), strict=True), start=1)
    ]  # fmt: skip
    annotations = [{"id": 1, "image_id": 2, "category_id": 18}]
    document = {"images": images, "annotations": annotations, "categories": CATEGORIES}
    path = tmp_path / "lvis_truth.json"
    path.write_text(json.dumps(document))
    return path


def categories_by_image(run: Path) -> dict[int, set[int]]:
    found: dict[int, set[int]] = {}
    for p in json.loads((run / "predictions.json").read_text()):
        found.setdefault(p["image_id"], set()).add(p["category_id"])
    return found


def test_each_image_gets_its_own_verified_categories_and_the_run_says_so(
    truth, photos, weights, tmp_path
):
    track = make_track(tmp_path / "t.json", NAMES)
    given = ["--prompts-from-truth", str(truth)]
    run = tmp_path / "run"
    assert call(run_arguments(track, photos, weights, run, *given, task="lvis")) == 0
    assert categories_by_image(run) == {1: {17}, 2: {18}}
    used = run_document(run)["configuration"]["used_truth"]
    assert used["sha256"] == hashlib.sha256(truth.read_bytes()).hexdigest()
    # Without truth it is another run: the folder is refused.
    assert call(run_arguments(track, photos, weights, run, task="lvis")) == 2
    plain = tmp_path / "plain"
    assert call(run_arguments(track, photos, weights, plain, task="lvis")) == 0
    assert categories_by_image(plain) == {1: {17, 18}, 2: {17, 18}}
    assert run_document(plain)["configuration"]["used_truth"] is None


@pytest.mark.parametrize("case", ["coco", "no prompts", "not lvis truth", "other images"])
def test_where_it_is_refused(case, truth, photos, weights, tmp_path, capsys):
    names = ["001.jpg", "002.jpg", "003.jpg"] if case == "other images" else NAMES
    track = make_track(tmp_path / "t.json", names)
    if case == "not lvis truth":
        truth.write_text(json.dumps({"images": [{"id": 1}], "annotations": []}))
    arguments = run_arguments(
        track, photos, weights, tmp_path / "run", "--prompts-from-truth", str(truth),
        task="coco" if case in ("coco", "no prompts") else "lvis",
        **({"baseline": FAKE_BATCHED} if case == "no prompts" else {}),
    )  # fmt: skip
    assert call(arguments) == 2
    assert not (tmp_path / "run").exists()
    capsys.readouterr()
