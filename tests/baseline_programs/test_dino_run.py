"""baselines/dino/run.py as legoworld starts it: full size, random weights, a strip of a photo."""

from __future__ import annotations

import hashlib
import json

import numpy as np
import pytest
from baseline_programs import child
from baseline_programs.child import ROOT, drawn_photo, importable

torch = pytest.importorskip("torch")
image_module = pytest.importorskip("PIL.Image")

importable("dino")

from dino_network import Dino  # noqa: E402
from dino_transformer import DinoSize  # noqa: E402
from legoworld_baseline import Refused  # noqa: E402

STRIP_WH = (1333, 64)  # keeps its size, and has more than the 900 pixels that queries need


@pytest.fixture(scope="module")
def weights(tmp_path_factory):
    """The full network, drawn at random, in the original's file format."""
    generator = torch.Generator().manual_seed(0)
    model = {}
    for name, tensor in Dino(DinoSize()).state_dict().items():
        drawn = torch.randn(tensor.shape, generator=generator) * 0.03
        centre = 1.0 if tensor.ndim == 1 and name.endswith(("weight", "var")) else 0.0
        model[name] = drawn + centre
    heads = {k: v for k, v in model.items() if k.startswith(("bbox_embed.", "class_embed."))}
    model |= {f"transformer.decoder.{name}": tensor for name, tensor in heads.items()}
    model["label_enc.weight"] = torch.zeros(92, 256)
    path = tmp_path_factory.mktemp("weights") / "checkpoint0023_4scale.pth"
    torch.save({"model": model, "epoch": 23}, path)
    return path


@pytest.fixture(scope="module")
def photo(tmp_path_factory):
    return drawn_photo(tmp_path_factory.mktemp("photos") / "strip.png", STRIP_WH)


def request(weights, photo):
    categories = json.loads((ROOT / "datasets" / "coco" / "categories.json").read_text("utf-8"))
    named = [{"id": c["id"], "name": c["name"], "synonyms": []} for c in categories]
    return child.request("coco", weights, photo.parent, [photo], categories=named, label_map={})


@pytest.fixture(scope="module")
def program():
    """run.py as a module, for what does not need a process of its own."""
    return child.program("dino")


def test_a_photo_goes_in_and_results_come_out_the_same_twice(weights, photo, program):
    asked = request(weights, photo)
    wrong = dict(asked["images"][0], image_id=2, height=99)
    asked["images"] = [wrong, asked["images"][0]]
    said = child.ask("dino", asked)
    lines = said.lines
    provenance = lines[0]["provenance"]
    assert provenance["weight_files"] == [
        {
            "name": "checkpoint0023_4scale.pth",
            "bytes": weights.stat().st_size,
            "sha256": hashlib.sha256(weights.read_bytes()).hexdigest(),
        }
    ]
    assert provenance["checkpoint"]["epochs"] == 24
    assert str(weights.parent) not in json.dumps(lines)
    answers = said.results
    assert "1333x64, the track says 1333x99" in answers[2]["failed"]
    predictions, counts = answers[1]["predictions"], answers[1]["counts"]
    assert len(predictions) == counts["predictions"] > 20
    assert counts["predictions"] + counts["without_category"] == 300
    ids = {category["id"] for category in asked["categories"]}
    for entry in predictions:
        assert entry["image_id"] == 1
        assert entry["category_id"] in ids
        assert 0 < entry["score"] < 1
        assert np.isfinite(entry["bbox"]).all()
        assert min(entry["bbox"][2:]) > 0
    loaded, again = program.load(asked)
    assert json.loads(json.dumps(again)) == provenance
    result = program.predict(loaded, asked["images"][1])
    assert json.dumps({"image_id": 1} | result) == json.dumps(answers[1])


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"task": "lvis"}, "task lvis"),
        ({"categories": [{"id": 1, "name": "person", "synonyms": []}]}, "1 categories"),
        ({"dtype": "float16"}, "float16"),
        ({"device": "nonsense"}, "nonsense"),
        ({"weights": "nowhere.pth"}, "nowhere.pth"),
    ],
)
def test_what_it_cannot_do_is_refused_before_any_photo(weights, photo, changes, said, program):
    with pytest.raises(Refused) as caught:
        program.load(request(weights, photo) | changes)
    assert said in caught.value.reason["found"]
    assert all(caught.value.reason.values())


def test_names_in_another_order_of_ids_are_refused_by_the_process(weights, photo):
    asked = request(weights, photo)
    for place, category in enumerate(asked["categories"], start=1):
        category["id"] = place
    said = child.ask("dino", asked)
    assert [list(line) for line in said.lines] == [["refused"]]
    assert "they differ in" in said.refused["found"]
