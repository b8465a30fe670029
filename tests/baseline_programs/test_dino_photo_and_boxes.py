"""What goes into DINO and what comes out: the published resize rule, Pillow, COCO results."""

from __future__ import annotations

import json

import numpy as np
import pytest
from baseline_programs.child import ROOT, importable

torch = pytest.importorskip("torch")
image_module = pytest.importorskip("PIL.Image")

importable("dino")

from coco_categories import NAME_OF_ID  # noqa: E402
from dino_boxes import coco_results  # noqa: E402
from dino_photo import normalised, resized_wh  # noqa: E402


@pytest.mark.parametrize(
    ("size_wh", "expected_wh"),
    [
        ((640, 480), (1066, 800)),  # 1066.67 is cut down
        ((480, 640), (800, 1066)),
        ((640, 427), (1199, 800)),
        ((500, 500), (800, 800)),
        ((800, 800), (800, 800)),
        ((800, 1200), (800, 1200)),
        ((640, 360), (1333, 750)),  # 1333 * 360 / 640 = 749.8
        ((640, 200), (1334, 417)),  # 416.56 is rounded up, and the long side follows: over 1333
        ((1333, 64), (1333, 64)),
        ((6000, 4000), (1200, 800)),
        ((2666, 3), (1777, 2)),  # 1.5 rounds to 2, as Python rounds; the long side passes 1333
    ],
)
def test_sizes_follow_the_published_rule(size_wh, expected_wh):
    assert resized_wh(*size_wh) == expected_wh


@pytest.mark.parametrize("size_wh", [(91, 60), (60, 91), (70, 70), (1400, 900)])
def test_pixels_are_those_of_pillow_normalised(size_wh):
    rng = np.random.default_rng(1)
    rgb = rng.integers(0, 256, (size_wh[1], size_wh[0], 3), dtype=np.uint8)
    found = normalised(rgb)
    wanted = resized_wh(*size_wh)
    resized = np.asarray(image_module.fromarray(rgb).resize(wanted, 2), np.float64)
    expected = (resized / 255 - (0.485, 0.456, 0.406)) / (0.229, 0.224, 0.225)
    assert found.dtype == torch.float32
    assert tuple(found.shape) == (3, wanted[1], wanted[0])
    np.testing.assert_allclose(found.permute(1, 2, 0).numpy(), expected, rtol=0, atol=2e-6)


def test_the_category_ids_are_the_datasets_own():
    entries = json.loads((ROOT / "datasets" / "coco" / "categories.json").read_text("utf-8"))
    assert {entry["id"]: entry["name"] for entry in entries} == NAME_OF_ID


def results_by_loop(logits, boxes, image_id, size_wh, ids, top=300):
    pairs = [
        (1 / (1 + np.exp(-logits[q, c])), q, c)
        for q in range(logits.shape[0])
        for c in range(logits.shape[1])
    ]
    pairs.sort(key=lambda pair: -pair[0])
    found = []
    for score, query, category in pairs[:top]:
        if category in ids:
            cx, cy, w, h = boxes[query]
            box = [(cx - w / 2) * size_wh[0], (cy - h / 2) * size_wh[1]]
            box += [w * size_wh[0], h * size_wh[1]]
            found.append(
                {"image_id": image_id, "category_id": category, "bbox": box, "score": score}
            )
    return found


def test_results_equal_a_loop_over_every_query_and_class():
    generator = torch.Generator().manual_seed(3)
    logits = torch.randn(40, 91, generator=generator, dtype=torch.float64)
    boxes = torch.rand(40, 4, generator=generator, dtype=torch.float64)
    found, dropped = coco_results(
        logits, boxes, image_id=17, size_wh=(640, 427), category_ids=NAME_OF_ID
    )
    expected = results_by_loop(logits.numpy(), boxes.numpy(), 17, (640, 427), NAME_OF_ID)
    assert len(found) + dropped == 300
    assert dropped > 0
    assert len(found) == len(expected)
    for ours, loops in zip(found, expected, strict=True):
        assert {k: ours[k] for k in ("image_id", "category_id")} == {
            k: loops[k] for k in ("image_id", "category_id")
        }
        assert ours["score"] == pytest.approx(loops["score"], abs=1e-15)
        assert ours["bbox"] == pytest.approx(loops["bbox"], abs=1e-10)


def test_a_slot_without_category_takes_a_place_and_gives_no_result():
    logits = torch.full((400, 91), -9.0)
    logits[:, 12] = 5.0  # 12 is no id of COCO's
    logits[7, 90] = 6.0
    found, dropped = coco_results(
        logits, torch.full((400, 4), 0.5), image_id=1, size_wh=(8, 8), category_ids=NAME_OF_ID
    )
    assert [entry["category_id"] for entry in found] == [90]
    assert dropped == 299


def test_boxes_are_not_clipped_to_the_photo():
    boxes = torch.tensor([[0.0, 1.0, 0.5, 0.5]])
    logits = torch.full((1, 91), -9.0)
    logits[0, 1] = 1.0
    found, _ = coco_results(logits, boxes, image_id=1, size_wh=(100, 200), category_ids=NAME_OF_ID)
    assert found[0]["bbox"] == [-25.0, 150.0, 50.0, 100.0]
