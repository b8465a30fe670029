"""baselines/hf-detector/run.py as legoworld starts it, on tiny random checkpoints in real formats.

Nothing is downloaded, and nothing was trained: what is tested is that the checkpoint on disk, its
preprocessing, its labels and its post-processing are used as transformers itself would.
"""

from __future__ import annotations

import hashlib
import json
import shutil
import sys
from pathlib import Path

import pytest
from baseline_programs import child
from baseline_programs.child import drawn_photo, importable

torch = pytest.importorskip("torch")
transformers = pytest.importorskip("transformers")
image_module = pytest.importorskip("PIL.Image")

importable("hf-detector")

from baseline_programs.tiny_detectors import (  # noqa: E402
    CATEGORIES,
    KINDS,
    MORE,
    NAMES,
    OLD_OF,
    contiguous_labels,
)

SIZE_WH = (97, 61)
COMMIT = "0123456789abcdef0123456789abcdef01234567"


@pytest.fixture(scope="module")
def folder_of(tmp_path_factory):
    """A kind's folder on disk, as save_pretrained writes it; made once."""
    made = {}

    def folder(kind):
        if kind not in made:
            torch.manual_seed(0)
            network, processor = (KINDS | MORE)[kind]()
            made[kind] = tmp_path_factory.mktemp("models") / f"tiny-{kind}"
            network.save_pretrained(made[kind])
            processor.save_pretrained(made[kind])
        return made[kind]

    return folder


@pytest.fixture
def model(folder_of, tmp_path):
    """A copy of the tiny RT-DETR to harm."""
    return Path(shutil.copytree(folder_of("rt-detr"), tmp_path / "tiny"))


@pytest.fixture(scope="module")
def photo(tmp_path_factory):
    return drawn_photo(tmp_path_factory.mktemp("photos") / "photo.png", SIZE_WH)


def request(weights, photo):
    return child.request(
        "coco",
        weights,
        photo.parent,
        [photo],
        categories=[{"id": c["id"], "name": c["name"], "synonyms": []} for c in CATEGORIES],
        label_map={old: name for name, old in OLD_OF.items()},
        options={"every_category": True, "top_k": None, "backend": "pil"},
    )


@pytest.fixture(scope="module")
def program():
    """run.py as a module, for what does not need a process of its own."""
    return child.program("hf-detector")


@pytest.fixture
def answered(program):
    """A request to (provenance, the one image's answer), in this process."""

    def answer(asked):
        detector, provenance = program.load(asked)
        return provenance, program.predict(detector, asked["images"][0])

    return answer


@pytest.fixture
def refused():
    """A request to all the words of its refusal, in this process."""

    def words(asked):
        found = child.refusal("hf-detector", asked).values()
        assert all(found)
        return " | ".join(found)

    return words


@pytest.fixture(scope="module")
def said(folder_of, photo):
    """What a whole process says, by one kind of model."""
    return child.ask("hf-detector", request(folder_of("deformable-detr"), photo))


def directly(folder, photo):
    """What transformers itself gives: (label name, score, x0, y0, x1, y1), best first."""
    network = transformers.AutoModelForObjectDetection.from_pretrained(folder).eval()
    processor = transformers.AutoImageProcessor.from_pretrained(folder, backend="pil")
    picture = image_module.open(photo).convert("RGB")
    with torch.no_grad():
        outputs = network(**processor(picture, return_tensors="pt"))
    (found,) = processor.post_process_object_detection(
        outputs, threshold=0.0, target_sizes=[(SIZE_WH[1], SIZE_WH[0])]
    )
    names = network.config.id2label
    rows = zip(found["labels"], found["scores"], found["boxes"], strict=True)
    return [(names[label.item()], s.item(), *box.tolist()) for label, s, box in rows]


@pytest.mark.parametrize("kind", KINDS | MORE)
def test_results_are_those_of_transformers_with_ids_by_name(folder_of, photo, answered, kind):
    _, answer = answered(request(folder_of(kind), photo))
    check_against_transformers(answer, folder_of(kind), photo)


def check_against_transformers(answer, folder, photo):
    id_of = {category["name"]: category["id"] for category in CATEGORIES}
    id_of |= {old: id_of[name] for name, old in OLD_OF.items()}
    expected = directly(folder, photo)
    kept = [row for row in expected if row[0] in id_of]
    assert answer["counts"] == {
        "predictions": len(kept),
        "without_category": len(expected) - len(kept),
    }
    assert len(kept) > 10
    for entry, (name, score, x0, y0, x1, y1) in zip(answer["predictions"], kept, strict=True):
        assert entry["image_id"] == 1
        assert entry["category_id"] == id_of[name]
        assert entry["score"] == pytest.approx(score, rel=1e-6)
        assert entry["bbox"] == pytest.approx([x0, y0, x1 - x0, y1 - y0], abs=1e-4)


def test_the_provenance_names_files_and_settings_and_no_path(folder_of, said):
    folder, found = folder_of("deformable-detr"), said.provenance
    weights = folder / "model.safetensors"
    assert found["weight_files"] == [
        {
            "name": "model.safetensors",
            "bytes": weights.stat().st_size,
            "sha256": hashlib.sha256(weights.read_bytes()).hexdigest(),
        }
    ]
    assert [f["name"] for f in found["config_files"]] == ["config.json", "preprocessor_config.json"]
    assert found["model"] == "tiny-deformable-detr"
    assert found["revision"] is None
    assert found["network"] == "DeformableDetrForObjectDetection"
    assert found["preprocessing"]["class"] == "DeformableDetrImageProcessorPil"
    assert found["preprocessing"]["backend"] == "pil"
    assert found["preprocessing"]["settings"]["size"] == {"longest_edge": 100, "shortest_edge": 64}
    assert found["postprocessing"] == {"top_k": 100}
    assert found["labels"] == {
        "matched": 80,
        "without_category": ["N/A"],
        "categories_without_label": [],
    }
    assert str(folder.parent) not in json.dumps(said.lines)


def test_another_process_gives_the_same_answer(folder_of, said, photo, answered):
    provenance, again = answered(request(folder_of("deformable-detr"), photo))
    assert json.dumps({"image_id": 1} | again) == json.dumps(said.results[1])
    assert json.loads(json.dumps(provenance)) == said.provenance


@pytest.mark.parametrize("kind", KINDS | MORE)
def test_no_kind_leaves_anything_to_chance(folder_of, photo, answered, kind):
    """Loaded twice from other random states: a parameter or a buffer left undrawn would show."""
    found = []
    for seed in (1, 2):
        torch.manual_seed(seed)
        found.append(answered(request(folder_of(kind), photo)))
    assert json.dumps(found[0]) == json.dumps(found[1])


def test_more_detections_can_be_asked_for_where_the_model_takes_it(
    folder_of, photo, answered, refused
):
    options = {"options": {"every_category": True, "top_k": 250, "backend": "pil"}}
    provenance, answer = answered(request(folder_of("deformable-detr"), photo) | options)
    assert provenance["postprocessing"] == {"top_k": 250}
    assert sum(answer["counts"].values()) == 250
    text = refused(request(folder_of("rt-detr"), photo) | options)
    assert "RTDetrImageProcessorPil" in text


def changed_config(folder, **changes):
    path = folder / "config.json"
    path.write_text(json.dumps(json.loads(path.read_text("utf-8")) | changes), "utf-8")


def renamed(folder, names):
    changed_config(
        folder,
        id2label={str(index): name for index, name in names.items()},
        label2id={name: index for index, name in names.items()},
    )


def test_labels_without_names_need_a_map(model, photo, answered, refused):
    renamed(model, {index: f"LABEL_{index}" for index in range(80)})
    text = refused(request(model, photo))
    assert "LABEL_0" in text
    assert "--label-map" in text
    found = []
    for order in (NAMES, NAMES[::-1]):
        label_map = {f"LABEL_{index}": name for index, name in enumerate(order)}
        _, answer = answered(request(model, photo) | {"label_map": label_map})
        found.append([entry["category_id"] for entry in answer["predictions"]])
    ids = [category["id"] for category in CATEGORIES]
    assert [ids[79 - ids.index(category)] for category in found[1]] == found[0]
    assert len(set(found[0])) > 1


def test_every_category_must_have_a_label_unless_said_otherwise(model, photo, answered, refused):
    renamed(model, contiguous_labels() | {79: "wig"})
    text = refused(request(model, photo))
    assert "toothbrush" in text
    assert "wig" in text
    subset = {"options": {"every_category": False, "top_k": None, "backend": "pil"}}
    provenance, answer = answered(request(model, photo) | subset)
    assert provenance["labels"] == {
        "matched": 79,
        "without_category": ["wig"],
        "categories_without_label": ["toothbrush"],
    }
    assert 90 not in {entry["category_id"] for entry in answer["predictions"]}


def test_old_names_need_their_map(model, photo, refused):
    text = refused(request(model, photo) | {"label_map": {}})
    assert "6 of 80 categories" in text
    assert "motorcycle" in text


def test_one_name_at_two_indices_is_refused(model, photo, refused):
    changed_config(
        model, id2label={str(k): v for k, v in (contiguous_labels() | {80: "person"}).items()}
    )
    assert "'person'" in refused(request(model, photo))


def test_a_checkpoint_that_leaves_parameters_unset_is_refused(model, photo, refused):
    from safetensors.torch import load_file, save_file

    path = model / "model.safetensors"
    tensors = load_file(path)
    name = next(name for name in sorted(tensors) if "encoder_input_proj.0.0.weight" in name)
    del tensors[name]
    save_file(tensors, path, metadata={"format": "pt"})
    text = refused(request(model, photo))
    assert "encoder_input_proj.0.0.weight" in text
    assert "random" in text


@pytest.mark.parametrize(
    ("harm", "said"),
    [
        (lambda folder: (folder / "model.safetensors").unlink(), "holds no weights"),
        (
            lambda folder: (folder / "preprocessor_config.json").unlink(),
            "does not describe its preprocessing",
        ),
        (lambda folder: (folder / "config.json").write_text("{}"), "config.json cannot be used"),
        (lambda folder: (folder / "model.safetensors").write_bytes(bytes(40)), "cannot be loaded"),
        (
            lambda folder: changed_config(folder, model_type="vit"),
            "not a closed-set object detector",
        ),
    ],
)
def test_a_folder_that_is_not_whole_is_refused(model, photo, harm, said, refused):
    harm(model)
    assert said in refused(request(model, photo))


@pytest.mark.parametrize(
    ("config", "next_step"),
    [
        ({"model_type": "owlv2"}, "baseline run hf-zero-shot"),
        ({"model_type": "grounding-dino"}, "baseline run hf-zero-shot"),
        ({"model_type": "mask2former"}, "baseline run hf-segmenter"),
        ({"model_type": "glpn"}, "baseline run hf-depth"),
        ({"model_type": "vit"}, "baseline import"),
    ],
)
def test_another_kind_of_model_is_sent_where_it_belongs(
    tmp_path, model, photo, refused, config, next_step
):
    (model / "config.json").write_text(json.dumps(config))
    assert next_step in refused(request(model, photo))


def test_a_processor_for_torchvision_only_is_named(model, photo, refused, monkeypatch):
    """RF-DETR's, in a Python with torchvision or without: Pillow is the default."""
    path = model / "preprocessor_config.json"
    path.write_text(json.dumps({"image_processor_type": "RfDetrImageProcessor"}))
    text = refused(request(model, photo))
    assert "for torchvision only" in text
    assert "--option backend=torchvision" in text
    options = {"every_category": True, "top_k": None, "backend": "torchvision"}
    monkeypatch.setitem(sys.modules, "torchvision", None)  # as where it is not installed
    text = refused(request(model, photo) | {"options": options})
    assert "torchvision cannot be imported" in text
    assert "--with torchvision==" in text


def test_a_single_file_and_a_mistyped_folder_are_named(tmp_path, photo, refused, monkeypatch):
    (tmp_path / "yolo11n.pt").write_bytes(b"PK")
    text = refused(request(tmp_path / "yolo11n.pt", photo))
    assert "single file" in text
    assert "Ultralytics" in text
    assert "baseline import" in text
    (tmp_path / "models" / "rtdetr_r50").mkdir(parents=True)
    monkeypatch.chdir(tmp_path)
    text = refused(request("models/rtdert_r50", photo))
    assert "no folder here" in text
    assert "near: models/rtdetr_r50" in text
    assert "check the path" in text


def test_a_backbone_of_timm_is_refused_in_words(folder_of, photo, tmp_path, refused):
    folder = Path(shutil.copytree(folder_of("detr"), tmp_path / "timm"))
    changed_config(folder, backbone_config={"model_type": "timm_backbone", "backbone": "resnet50"})
    assert "timm" in refused(request(folder, photo))


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"dtype": "int8"}, "int8"),
        ({"device": "nonsense"}, "nonsense"),
        ({"weights": "nowhere/at/all"}, "nowhere/at/all"),
        ({"weights": "nobody/has-this"}, "no model that can be had offline"),
    ],
)
def test_what_cannot_be_done_is_refused(folder_of, photo, change, said, hub_cache, refused):
    assert said in refused(request(folder_of("rt-detr"), photo) | change)


def test_a_refusal_is_the_processs_only_line(folder_of, photo):
    said = child.ask("hf-detector", request(folder_of("rt-detr"), photo) | {"batch_size": 2})
    assert said.exit_code == 2, said.log[-2000:]
    assert [list(line) for line in said.lines] == [["refused"]]


@pytest.fixture
def hub_cache(tmp_path, monkeypatch):
    constants = pytest.importorskip("huggingface_hub.constants")
    monkeypatch.setattr(constants, "HF_HUB_CACHE", str(tmp_path))
    return tmp_path


def test_a_hub_id_in_the_cache_is_resolved_to_its_commit(
    folder_of, photo, hub_cache, answered, refused
):
    repository = hub_cache / "models--someone--tiny"
    shutil.copytree(folder_of("rt-detr"), repository / "snapshots" / COMMIT)
    (repository / "refs").mkdir()
    (repository / "refs" / "main").write_text(COMMIT)
    by_id = answered(request("someone/tiny", photo))
    assert by_id[0]["model"] == "someone/tiny"
    assert by_id[0]["revision"] == COMMIT
    assert answered(request(repository / "snapshots" / COMMIT, photo)) == by_id
    assert answered(request(f"someone/tiny@{COMMIT}", photo)) == by_id
    assert "someone/tiny@v9" in refused(request("someone/tiny@v9", photo))
