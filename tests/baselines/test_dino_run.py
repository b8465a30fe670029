"""baselines/dino/run.py as legoworld starts it: full size, random weights, a strip of a photo."""

from __future__ import annotations

import hashlib
import importlib.util
import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

torch = pytest.importorskip("torch")
image_module = pytest.importorskip("PIL.Image")

ROOT = Path(__file__).parents[2]
sys.path[:0] = [str(ROOT / "baselines" / "shared"), str(ROOT / "baselines" / "dino")]

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
    rows, columns = np.mgrid[: STRIP_WH[1], : STRIP_WH[0]]
    rgb = np.stack((columns * 255 // STRIP_WH[0], rows * 3 % 256, (rows ^ columns) % 256), -1)
    path = tmp_path_factory.mktemp("photos") / "strip.png"
    image_module.fromarray(rgb.astype(np.uint8)).save(path)
    return path


def request(weights, photo):
    categories = json.loads((ROOT / "datasets" / "coco" / "categories.json").read_text("utf-8"))
    size = {"width": STRIP_WH[0], "height": STRIP_WH[1]}
    image = {"file_name": photo.name, "path": str(photo), "batch": 0, **size}
    return {
        "schema_version": 1,
        "task": "coco",
        "images": [{"image_id": 7, **image}],
        "categories": [{"id": c["id"], "name": c["name"], "synonyms": []} for c in categories],
        "label_map": {},
        "weights": str(weights),
        "device": "cpu",
        "dtype": "float32",
        "batch_size": 1,
        "offline": True,
        "options": {},
        "prompts": None,
        "output": str(photo.parent),
    }


def ran(asked):
    """(exit code, the JSON lines). Standard input stays open until the process ends."""
    with subprocess.Popen(
        [sys.executable, str(ROOT / "baselines" / "dino" / "run.py")],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        env=os.environ | {"PYTHONPATH": str(ROOT / "baselines" / "shared")},
    ) as process:
        assert process.stdin is not None
        assert process.stdout is not None
        process.stdin.write(json.dumps(asked) + "\n")
        process.stdin.flush()
        lines = [json.loads(line) for line in process.stdout if line.strip()]
    return process.returncode, lines


@pytest.fixture(scope="module")
def program():
    """run.py as a module, for what does not need a process of its own."""
    path = ROOT / "baselines" / "dino" / "run.py"
    spec = importlib.util.spec_from_file_location("dino_run", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module  # dataclasses look their module up
    spec.loader.exec_module(module)
    return module


def test_a_photo_goes_in_and_results_come_out_the_same_twice(weights, photo, program):
    asked = request(weights, photo)
    wrong = dict(asked["images"][0], image_id=8, height=99)
    asked["images"] = [wrong, asked["images"][0]]
    code, lines = ran(asked)
    assert code == 0
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
    answers = {line["image_id"]: line for line in lines if "image_id" in line}
    assert "1333x64, the track says 1333x99" in answers[8]["failed"]
    predictions, counts = answers[7]["predictions"], answers[7]["counts"]
    assert len(predictions) == counts["predictions"] > 20
    assert counts["predictions"] + counts["without_category"] == 300
    ids = {category["id"] for category in asked["categories"]}
    for entry in predictions:
        assert entry["image_id"] == 7
        assert entry["category_id"] in ids
        assert 0 < entry["score"] < 1
        assert np.isfinite(entry["bbox"]).all()
        assert min(entry["bbox"][2:]) > 0
    assert lines[-1] == {"done": True}
    loaded, again = program.load(asked)
    assert json.loads(json.dumps(again)) == provenance
    result = program.predict(loaded, asked["images"][1])
    assert json.dumps({"image_id": 7} | result) == json.dumps(answers[7])


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
    code, lines = ran(asked)
    assert code == 2
    assert [list(line) for line in lines] == [["refused"]]
    assert "they differ in" in lines[0]["refused"]["found"]
