"""MaskFormer and Mask2Former: the cut, masks at the photo's size, labels by name, end to end."""

from __future__ import annotations

import json

import numpy as np
import pytest
from baseline_programs.child import (
    ask,
    defaults,
    importable,
    program,
    refusal,
    request,
    resized_by_hand,
    some_photo,
)
from PIL import Image

torch = pytest.importorskip("torch")
transformers = pytest.importorskip("transformers")
coco_mask = pytest.importorskip("pycocotools.mask")
importable("hf-segmenter")

import segmenter_input  # noqa: E402
import segmenter_instances  # noqa: E402
import segmenter_network  # noqa: E402
from baseline_programs.tiny_segmenters import (  # noqa: E402
    QUERIES,
    mask2former,
    maskformer,
    save_tiny,
)
from legoworld_baseline import Refused  # noqa: E402
from segmenter_instances import Rules  # noqa: E402
from segmenter_network import Queries  # noqa: E402

CATEGORIES = [{"id": 17, "name": "cat"}, {"id": 63, "name": "couch"}]
LABEL_MAP = {"sofa": "couch"}


@pytest.fixture(scope="module")
def checkpoint(tmp_path_factory):
    folder = tmp_path_factory.mktemp("mask2former") / "model"
    return save_tiny(mask2former, transformers.Mask2FormerImageProcessorPil, folder)


@pytest.fixture(scope="module")
def photo():
    return some_photo()


def segment_request(task, weights, photo, output="unused", **more):
    asked = request(
        task,
        weights,
        output,
        [photo],
        categories=CATEGORIES,
        label_map=LABEL_MAP,
        options=defaults("hf-segmenter"),
    )
    return {**asked, **more}


def rules(per_image=100, min_score=0.0, boxes=False):
    return Rules(categories={0: 63, 2: 17}, per_image=per_image, min_score=min_score, boxes=boxes)


# The cut


@pytest.mark.parametrize("per_image", [1, 5, 100])
def test_the_cut_is_a_plain_sort_over_queries_and_classes(per_image):
    shares = np.random.default_rng(0).integers(0, 4, (9, 3)) / 4
    everything = sorted(
        (-shares[query, number], {0: 63, 2: 17}[number], query, number)
        for query in range(9)
        for number in (0, 2)
    )
    found = segmenter_instances.kept_pairs(torch.from_numpy(shares), rules(per_image))
    assert found == [(query, number) for _, _, query, number in everything[:per_image]]


# The masks


def test_detections_are_those_of_a_plain_loop_and_padding_is_cut_off():
    generator = np.random.default_rng(6)
    logits = generator.normal(size=(QUERIES, 4, 6)).astype(np.float32)
    logits[2] = -1  # without a pixel
    shares = torch.from_numpy(generator.random((QUERIES, 3)).astype(np.float32))
    said = Queries(
        class_shares=shares,
        mask_logits=torch.from_numpy(logits),
        input_hw=(16, 24),
        valid_hw=(13, 24),
    )
    entries, counts = segmenter_instances.detections(said, rules(), 5, (31, 17))
    boxes, _ = segmenter_instances.detections(said, rules(boxes=True), 5, (31, 17))
    pairs = [p for p in segmenter_instances.kept_pairs(shares, rules()) if p[0] != 2]
    assert counts == {
        "candidates": 2 * QUERIES,
        "cut_image": 0,
        "empty": 2,
        "below_score": 0,
    }
    assert len(entries) == len(boxes) == len(pairs) == 2 * QUERIES - 2
    for entry, box, (query, number) in zip(entries, boxes, pairs, strict=True):
        whole = resized_by_hand(logits[query].astype(np.float64), 16, 24)
        photo = resized_by_hand(whole[:13], 17, 31)
        assert np.abs(photo).min() > 1e-6  # so that rounding cannot turn a pixel
        mask = coco_mask.decode(entry["segmentation"]).astype(bool)
        assert np.array_equal(mask, photo > 0)
        assert entry["segmentation"]["size"] == [17, 31]
        inside = (1 / (1 + np.exp(-photo[mask]))).mean()
        assert entry["score"] == pytest.approx(float(shares[query, number]) * inside, rel=1e-5)
        assert entry["category_id"] == {0: 63, 2: 17}[number]
        assert box["bbox"] == coco_mask.toBbox(entry["segmentation"]).tolist()
        assert "segmentation" not in box


def test_low_scores_are_left_out_and_counted():
    said = Queries(
        class_shares=torch.tensor([[0.9, 0.0, 0.1]]),
        mask_logits=torch.full((1, 2, 2), 20.0),
        input_hw=(4, 4),
        valid_hw=(4, 4),
    )
    entries, counts = segmenter_instances.detections(said, rules(min_score=0.5), 1, (6, 6))
    assert [e["category_id"] for e in entries] == [63]
    assert counts["below_score"] == 1


# The models


@pytest.mark.parametrize(
    ("build", "processor"),
    [(mask2former, "Mask2FormerImageProcessorPil"), (maskformer, "MaskFormerImageProcessorPil")],
)
def test_each_kind_of_checkpoint(build, processor, tmp_path, photo):
    pad = {"height": 160, "width": 160}  # padded, so that cutting it off matters
    folder = save_tiny(build, getattr(transformers, processor), tmp_path, pad_size=pad)
    run = program("hf-segmenter")
    asked = segment_request("lvis", folder, photo)
    model, provenance = run.load(asked)
    assert provenance["labels"] == {"sofa": 63, "Cat": 17}
    found = run.predict(model, asked["images"][0])["predictions"]
    assert len(found) > 3
    # the same through plain calls
    network = transformers.AutoModelForUniversalSegmentation.from_pretrained(folder).eval()
    with Image.open(photo) as picture:
        width, height = picture.size
        inputs = transformers.AutoImageProcessor.from_pretrained(folder, backend="pil")(
            images=picture.convert("RGB"), return_tensors="pt"
        )
    assert inputs["pixel_values"].shape[-2:] == (160, 160)
    rows = int(inputs["pixel_mask"][0, :, 0].sum())
    cols = int(inputs["pixel_mask"][0, 0].sum())
    assert (rows, cols) != (160, 160)
    with torch.inference_mode():
        out = network(pixel_values=inputs["pixel_values"], pixel_mask=inputs["pixel_mask"])
    resize = torch.nn.functional.interpolate
    input_logits = resize(out.masks_queries_logits, size=(160, 160), mode="bilinear")
    logits = resize(input_logits[..., :rows, :cols], size=(height, width), mode="bilinear")[0]
    shares = out.class_queries_logits[0].softmax(-1)
    expected = []
    for query in range(QUERIES):
        mask = logits[query] > 0
        for number, category_id in ((0, 63), (2, 17)):
            if mask.any():
                score = shares[query, number] * logits[query][mask].sigmoid().mean()
                expected.append((score.item(), category_id, int(mask.sum())))
    got = [(p["score"], p["category_id"], int(coco_mask.area(p["segmentation"]))) for p in found]
    for one, other in zip(sorted(got), sorted(expected), strict=True):
        assert one[0] == pytest.approx(other[0], rel=1e-4)
        assert one[1] == other[1]
        assert abs(one[2] - other[2]) <= 2


@pytest.mark.parametrize(
    ("photo_hw", "resized_hw"),
    [
        ((480, 640), (800, 1067)),  # 1066.67 rounds up; transformers cuts it to 1066
        ((427, 640), (800, 1199)),
        ((640, 427), (1199, 800)),
        ((200, 1000), (267, 1333)),
        ((800, 800), (800, 800)),
    ],
)
def test_the_authors_sizes(photo_hw, resized_hw):
    assert segmenter_input.authors_size_hw(photo_hw, 800, 1333) == resized_hw


def test_the_authors_input_is_padded_and_the_checkpoints_is_stretched(checkpoint, photo):
    rgb = np.random.default_rng(0).integers(0, 256, (60, 70, 3)).astype(np.uint8)
    stretched, record = segmenter_input.preparation(checkpoint, "checkpoint")
    assert record["input"] == "checkpoint"
    assert (record["class"], record["backend"]) == ("Mask2FormerImageProcessorPil", "pil")
    pixels, shown = stretched(rgb)
    assert (pixels.shape[2:], shown.all().item()) == ((64, 96), True)
    padded, record = segmenter_input.preparation(checkpoint, "authors")
    assert record["input"] == "authors"
    pixels, shown = padded(rgb)
    # detectron2's steps by hand: Pillow's bilinear resize of bytes, mean and deviation, zeros
    assert (pixels.shape[2:], int(shown.sum())) == ((64, 96), 64 * 75)
    resized = np.asarray(Image.fromarray(rgb).resize((75, 64), Image.Resampling.BILINEAR))
    mean, std = np.array([0.485, 0.456, 0.406]), np.array([0.229, 0.224, 0.225])
    expected = np.zeros((64, 96, 3))
    expected[:, :75] = (resized / 255 - mean) / std
    assert np.allclose(pixels[0].permute(1, 2, 0).numpy(), expected, atol=1e-5)


def test_the_authors_input_is_on_record_and_gives_other_masks(checkpoint, tmp_path):
    photo = tmp_path / "photo.png"
    rgb = np.random.default_rng(0).integers(0, 256, (60, 70, 3)).astype(np.uint8)
    Image.fromarray(rgb).save(photo)
    run = program("hf-segmenter")
    found = {}
    for how in ("checkpoint", "authors"):
        options = {**defaults("hf-segmenter"), "input": how}
        asked = segment_request("lvis", checkpoint, photo, options=options)
        model, provenance = run.load(asked)
        assert provenance["preprocessing"]["input"] == how
        found[how] = run.predict(model, asked["images"][0])["predictions"]
    assert found["checkpoint"]
    assert found["checkpoint"] != found["authors"]


def test_end_to_end(checkpoint, tmp_path, photo):
    said = ask("hf-segmenter", segment_request("coco", checkpoint, photo, tmp_path))
    predictions = said.results[1]["predictions"]
    assert predictions
    with Image.open(photo) as picture:
        width, height = picture.size
    for entry in predictions:
        assert entry.keys() == {"image_id", "category_id", "bbox", "score"}
        x, y, w, h = entry["bbox"]
        assert min(x, y) >= 0
        assert min(w, h) >= 1
        assert x + w <= width
        assert y + h <= height
        assert entry["category_id"] in (17, 63)
        assert 0 < entry["score"] < 1
    assert said.provenance["architecture"] == "Mask2FormerForUniversalSegmentation"
    assert said.provenance["cap"]["per_image"] == 100


def test_coco_masks_are_masks(checkpoint, photo):
    run = program("hf-segmenter")
    found = {}
    for task in ("coco-masks", "lvis"):
        asked = segment_request(task, checkpoint, photo)
        model, _ = run.load(asked)
        found[task] = run.predict(model, asked["images"][0])["predictions"]
    assert found["coco-masks"] == found["lvis"]
    assert all("segmentation" in entry for entry in found["coco-masks"])


# Refusals


def test_a_semantic_head_is_refused(tmp_path, photo):
    config = transformers.SegformerConfig(
        depths=[1, 1, 1, 1], hidden_sizes=[8, 8, 16, 16], decoder_hidden_size=16
    )
    transformers.SegformerForSemanticSegmentation(config).save_pretrained(tmp_path)
    words = refusal("hf-segmenter", segment_request("lvis", tmp_path, photo))
    assert "no instances" in words["message"]
    assert "segformer" in words["found"]
    assert "baseline import" in words["next_step"]


@pytest.mark.parametrize(
    ("model_type", "next_step"),
    [
        ("detr", "baseline run hf-detector"),
        ("bert", "baseline import"),
        ("oneformer", "baseline import"),
        ("eomt", "baseline import"),
        ("grounding-dino", "baseline run hf-zero-shot"),
        ("sam3", "baseline run sam3"),
        ("dpt", "baseline run hf-depth"),
    ],
)
def test_a_model_that_is_not_read_here_is_refused(model_type, next_step, tmp_path):
    (tmp_path / "config.json").write_text(json.dumps({"model_type": model_type}))
    with pytest.raises(Refused, match=r"not one that is read here|no instances") as refusal:
        segmenter_network.load_config(tmp_path)
    assert next_step in refusal.value.reason["next_step"]


def test_a_processor_on_another_backend_is_refused(checkpoint, photo, monkeypatch):
    """transformers falls back to torchvision without a word where it has no other class."""

    class OnTorchvision:
        backend = "torchvision"

    monkeypatch.setattr(
        transformers.AutoImageProcessor, "from_pretrained", lambda *_a, **_k: OnTorchvision()
    )
    with pytest.raises(Refused, match="for torchvision only"):
        program("hf-segmenter").load(segment_request("coco", checkpoint, photo))


def test_labels_that_do_not_name_every_category_are_refused(checkpoint, photo):
    asked = segment_request("coco", checkpoint, photo, label_map=None)
    with pytest.raises(Refused) as refusal:
        program("hf-segmenter").load(asked)
    assert "couch" in refusal.value.reason["found"]


def test_a_checkpoint_with_another_number_of_classes_is_refused(tmp_path, photo):
    folder = save_tiny(mask2former, transformers.Mask2FormerImageProcessorPil, tmp_path)
    config = json.loads((folder / "config.json").read_text())
    labels = {"0": "sofa", "1": "cat"}
    (folder / "config.json").write_text(
        json.dumps({**config, "id2label": labels, "label2id": {"sofa": 0, "cat": 1}})
    )
    with pytest.raises(Refused, match="does not fill the network"):
        program("hf-segmenter").load(segment_request("coco", folder, photo))


@pytest.mark.parametrize("option", [{"per_image": 0}, {"min_score": 2.0}])
def test_options_out_of_range_are_refused(checkpoint, photo, option):
    options = {**defaults("hf-segmenter"), **option}
    asked = segment_request("coco", checkpoint, photo, options=options)
    with pytest.raises(Refused, match="out of range"):
        program("hf-segmenter").load(asked)
