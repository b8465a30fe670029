"""Panoptic segments of MaskFormer and Mask2Former: as transformers post-processes them."""

from __future__ import annotations

import numpy as np
import pytest
from baseline_programs.child import ask, defaults, importable, program, refusal, request, some_photo
from PIL import Image

torch = pytest.importorskip("torch")
transformers = pytest.importorskip("transformers")
coco_mask = pytest.importorskip("pycocotools.mask")
importable("hf-panoptic")

import panoptic_network  # noqa: E402
from baseline_programs.tiny_segmenters import mask2former, maskformer, save_tiny  # noqa: E402

CATEGORIES = [
    {"id": 17, "name": "cat"},
    {"id": 63, "name": "couch"},
    {"id": 187, "name": "sky-other-merged"},
]
BY_CLASS = {0: 63, 1: 187, 2: 17}


def panoptic_request(weights, photo, **options):
    return request(
        "coco-panoptic",
        weights,
        "unused",
        [photo],
        categories=CATEGORIES,
        label_map={"sofa": "couch"},
        options={**defaults("hf-panoptic"), **options},
    )


@pytest.mark.parametrize(
    ("build", "processor"),
    [(mask2former, "Mask2FormerImageProcessorPil"), (maskformer, "MaskFormerImageProcessorPil")],
)
def test_segments_are_those_of_plain_calls(build, processor, tmp_path):
    folder, photo = save_tiny(build, getattr(transformers, processor), tmp_path), some_photo()
    certain = transformers.AutoModelForUniversalSegmentation.from_pretrained(folder)
    certain.class_predictor.bias.data += torch.tensor([4.0, 0, 0, -9])  # sofa, and not nothing
    certain.save_pretrained(folder)
    asked = panoptic_request(folder, photo, threshold=0.0, overlap=0.0)
    run = program("hf-panoptic")
    model, provenance = run.load(asked)
    assert provenance["labels"] == {"sofa": 63, "sky-other-merged": 187, "Cat": 17}
    found = run.predict(model, asked["images"][0])
    network = transformers.AutoModelForUniversalSegmentation.from_pretrained(folder).eval()
    prepare = transformers.AutoImageProcessor.from_pretrained(folder, backend="pil")
    with Image.open(photo) as picture:
        inputs = prepare(images=picture.convert("RGB"), return_tensors="pt")
        size_hw = picture.size[::-1]
    with torch.inference_mode():
        out = network(**{k: inputs[k] for k in ("pixel_values", "pixel_mask")})
    expected = prepare.post_process_panoptic_segmentation(
        out, threshold=0.0, overlap_mask_area_threshold=0.0, label_ids_to_fuse=set(),
        target_sizes=[size_hw],
    )[0]  # fmt: skip
    ids = expected["segmentation"].numpy()
    assert found["counts"] == {"segments": len(expected["segments_info"]), "no_category": 0}
    assert found["predictions"]
    for entry, one in zip(found["predictions"], expected["segments_info"], strict=True):
        mask = coco_mask.decode(entry["segmentation"]).astype(bool)
        assert (mask == (ids == one["id"])).mean() > 0.999
        assert entry["category_id"] == BY_CLASS[one["label_id"]]


def test_segments_of_no_category_are_left_out_and_counted():
    ids = np.array([[1, 1, 2], [0, 3, 3]])
    found, counts = panoptic_network.entries(ids, [(1, 0), (2, 5), (3, 2)], BY_CLASS)
    assert [entry["category_id"] for entry in found] == [63, 17]
    assert coco_mask.decode(found[1]["segmentation"]).tolist() == [[0, 0, 0], [0, 1, 1]]
    assert counts == {"segments": 3, "no_category": 1}


def test_the_process_answers_and_refuses(tmp_path):
    folder = save_tiny(maskformer, transformers.MaskFormerImageProcessorPil, tmp_path / "m")
    said = ask("hf-panoptic", panoptic_request(folder, some_photo(), threshold=0.0))
    assert set(said.results[1]) == {"image_id", "predictions", "counts"}
    wrong = refusal("hf-panoptic", panoptic_request(folder, some_photo(), threshold=1.5))
    assert "out of range" in wrong["message"]
    other = transformers.SegformerConfig(num_labels=3)
    other.save_pretrained(tmp_path / "other")
    (tmp_path / "other/model.safetensors").write_bytes(b"")
    refused = refusal("hf-panoptic", panoptic_request(tmp_path / "other", some_photo()))
    assert refused["expected"] == "mask2former or maskformer"
