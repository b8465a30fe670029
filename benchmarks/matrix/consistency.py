"""Whether answers of different tasks to the same pictures contradict each other.

    python benchmarks/matrix/consistency.py RUNS [RUNS ...] [--min-score 0.5] [-o consistency.json]

RUNS holds RUNS/<task> of one pass, or imports of specialists. For answers of one scene every
share is 0 by construction, whatever is wrong with the scene; a check whose runs are not all there
is not measured. No ground truth is read.
"""

from __future__ import annotations

import argparse
import json
from collections import Counter, defaultdict
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image
from pycocotools import mask as coco_masks

from legoworld.files import readable_json
from legoworld.shipped import catalog

#: A pixel's surface may lie so far outside its box, for files round to a nanometre and float32.
SLACK_M = 1e-4


class Runs:
    """One folder of runs."""

    def __init__(self, folder: Path, min_score: float) -> None:
        self.folder, self.min_score = folder, min_score

    def rows(self, task: str) -> dict[str, dict[str, Any]]:
        """Rows of images that were read, by scene or photo."""
        lines = (self.folder / task / "per_image.jsonl").read_text("utf-8").splitlines()
        rows = (json.loads(line) for line in lines)
        return {Path(r["file_name"]).stem: r for r in rows if r["status"] == "ok"}

    def results(self, task: str) -> dict[int, list[dict[str, Any]]]:
        """Predictions by image id, each with its name where the row tells it."""
        of: dict[int, list[dict[str, Any]]] = defaultdict(list)
        for one in json.loads((self.folder / task / "predictions.json").read_text("utf-8")):
            of[one["image_id"]].append(one)
        for row in self.rows(task).values():
            for one, told in zip(of[row["image_id"]], row.get("exported") or (), strict=False):
                one["name"] = told["name"]
        return {
            image: [one for one in found if one["score"] >= self.min_score]
            for image, found in of.items()
        }

    def picture(self, task: str, name: str) -> np.ndarray:
        """A PNG of labels."""
        return np.asarray(Image.open(self.folder / task / "answer" / f"{name}.png"))


def decoded(rle: dict[str, Any]) -> np.ndarray:
    """A mask as booleans."""
    return np.asarray(coco_masks.decode(rle), bool)


def unequal(first: Counter[Any], second: Counter[Any]) -> tuple[int, int]:
    """How many entries of two bags have no equal in the other, and how many there are."""
    return (first - second).total() + (second - first).total(), first.total() + second.total()


def masks_and_boxes(runs: Runs) -> tuple[int, int]:
    """A box is the extent of its mask."""
    bad = n = 0
    boxes, masks = runs.results("coco"), runs.results("coco-masks")
    for image in boxes.keys() | masks.keys():
        found = unequal(
            Counter((o["category_id"], *map(float, o["bbox"])) for o in boxes.get(image, ())),
            Counter(
                (o["category_id"], *map(float, coco_masks.toBbox(o["segmentation"])))
                for o in masks.get(image, ())
            ),
        )
        bad, n = bad + found[0], n + found[1]
    return bad, n


def masks_and_visible_parts(runs: Runs) -> tuple[int, int]:
    """A mask is the visible part of an amodal mask."""
    bad = n = 0
    masks, amodal = runs.results("coco-masks"), runs.results("amodal")
    for image in masks.keys() | amodal.keys():
        shown = ((o["category_id"], o["visible_mask"]) for o in amodal.get(image, ()))
        found = unequal(
            Counter((o["category_id"], o["segmentation"]["counts"]) for o in masks.get(image, ())),
            Counter((c, rle["counts"]) for c, rle in shown if decoded(rle).any()),
        )
        bad, n = bad + found[0], n + found[1]
    return bad, n


def masks_and_segments(runs: Runs) -> tuple[int, int]:
    """Pixels: of each mask, those that its category's segment of the largest overlap lacks."""
    bad = n = 0
    masks = runs.results("coco-masks")
    for name, row in runs.rows("coco-panoptic").items():
        colors = runs.picture("coco-panoptic", name).astype(np.int64)
        ids = colors[..., 0] + 256 * colors[..., 1] + 65536 * colors[..., 2]
        for one in masks.get(row["image_id"], ()):
            mask = decoded(one["segmentation"])
            own = [s["id"] for s in row["segments"] if s["category_id"] == one["category_id"]]
            unions = [int((mask | (ids == i)).sum() - (mask & (ids == i)).sum()) for i in own]
            bad, n = bad + min(unions, default=int(mask.sum())), n + int(mask.sum())
    return bad, n


def segments_and_classes(runs: Runs) -> tuple[int, int]:
    """Pixels: the class of a pixel is the category of its segment."""
    bad = n = 0
    for name, row in runs.rows("coco-panoptic").items():
        colors = runs.picture("coco-panoptic", name).astype(np.int64)
        ids = colors[..., 0] + 256 * colors[..., 1] + 65536 * colors[..., 2]
        table = np.full(int(ids.max()) + 1, 255)
        for segment in row["segments"]:
            table[segment["id"]] = segment["category_id"]
        differs = table[ids] != runs.picture("coco-semantic", name)
        bad, n = bad + int(differs.sum()), n + differs.size
    return bad, n


def voc_ids() -> dict[int, int]:
    """COCO's category id of each of VOC's classes that it has."""
    read = {
        name: json.loads((catalog.folder("datasets") / name / "categories.json").read_text("utf-8"))
        for name in ("coco", "voc")
    }
    coco = {c["name"]: c["id"] for c in read["coco"]}
    return {
        coco[name]: c["id"]
        for c in read["voc"]
        for name in (c["name"], *c.get("synonyms", ()))
        if name in coco
    }


def classes_outside_boxes(runs: Runs) -> tuple[int, int]:
    """Pixels: a pixel of a class lies in a box of that class."""
    return _boxes_and_classes(runs)[0]


def boxes_without_class(runs: Runs) -> tuple[int, int]:
    """Boxes: a box has a pixel of its class."""
    return _boxes_and_classes(runs)[1]


def _boxes_and_classes(runs: Runs) -> tuple[tuple[int, int], tuple[int, int]]:
    known, boxes = voc_ids(), runs.results("coco")
    outside = pixels = empty = boxed = 0
    for name, row in runs.rows("voc-semantic").items():
        classes = runs.picture("voc-semantic", name)
        inside = np.zeros(classes.shape, bool)
        for one in boxes.get(row["image_id"], ()):
            if one["category_id"] in known:
                x, y, w, h = one["bbox"]
                rows = slice(int(max(y, 0)), int(np.ceil(y + h)))
                part = np.s_[rows, int(max(x, 0)) : int(np.ceil(x + w))]
                own = classes[part] == known[one["category_id"]]
                inside[part] |= own
                empty, boxed = empty + (not own.any()), boxed + 1
        shown = np.isin(classes, list(known.values()))
        outside, pixels = outside + int((shown & ~inside).sum()), pixels + int(shown.sum())
    return (outside, pixels), (empty, boxed)


def _points(runs: Runs, name: str) -> tuple[np.ndarray, np.ndarray]:
    """A picture's depth, and its (H, W, 3) points in the camera frame."""
    with np.load(runs.folder / "eth3d" / "depth" / f"{name}.npz") as arrays:
        z = arrays["depth_z_m"].astype(np.float64)
        fx, fy, cx, cy = arrays["intrinsics_px"]
    rows, columns = np.indices(z.shape)
    return z, np.stack([(columns + 0.5 - cx) / fx * z, (rows + 0.5 - cy) / fy * z, z], axis=-1)


def surfaces_and_boxes(runs: Runs) -> tuple[int, int]:
    """Pixels: what is seen of an instance lies in its box in space."""
    bad = n = 0
    amodal, boxes = runs.results("amodal"), runs.results("boxes3d")
    for name, row in runs.rows("eth3d").items():
        _, points = _points(runs, name)
        by_name = {o["name"]: o for o in boxes.get(row["image_id"], ())}
        for one in amodal.get(row["image_id"], ()):
            box = by_name.get(one["name"])
            if box is None:
                continue
            seen = points[decoded(one["visible_mask"])] - np.array(box["center_cam"])
            length, height, width = (box["dimensions"][i] for i in (2, 1, 0))
            along = np.abs(seen @ np.array(box["R_cam"]))
            half = np.array([length, height, width]) / 2 + SLACK_M
            bad, n = bad + int((along > half).any(axis=1).sum()), n + len(seen)
    return bad, n


def order_and_depth(runs: Runs) -> tuple[int, int]:
    """Pairs: every pixel of what is in front is nearer than every pixel of what is behind."""
    bad = n = 0
    amodal = runs.results("amodal")
    for name, row in runs.rows("relations").items():
        facts = json.loads((runs.folder / "relations" / row["answer"]["file"]).read_text("utf-8"))
        z, _ = _points(runs, name)
        masks = {o["instance"]: decoded(o["visible_mask"]) for o in amodal[row["image_id"]]}
        pairs = facts["facts"]["pairs"]
        for a, b, front in zip(pairs["a"], pairs["b"], pairs["front_m"], strict=True):
            if front and a in masks and b in masks:
                near, far = (a, b) if front > 0 else (b, a)
                bad += bool(z[masks[near]].max() > z[masks[far]].min() + SLACK_M)
                n += 1
    return bad, n


CHECKS: dict[str, tuple[Callable[[Runs], tuple[int, int]], tuple[str, ...], str]] = {
    "a box is the extent of its mask": (masks_and_boxes, ("coco", "coco-masks"), "instances"),
    "a mask is the visible part of its amodal mask": (
        masks_and_visible_parts, ("coco-masks", "amodal"), "instances"),
    "a mask is its panoptic segment": (
        masks_and_segments, ("coco-masks", "coco-panoptic"), "pixels"),
    "a pixel's class is its segment's": (
        segments_and_classes, ("coco-panoptic", "coco-semantic"), "pixels"),
    "a pixel of a class lies in a box of it": (
        classes_outside_boxes, ("voc-semantic", "coco"), "pixels"),
    "a box has a pixel of its class": (boxes_without_class, ("voc-semantic", "coco"), "boxes"),
    "a surface lies in its box in space": (
        surfaces_and_boxes, ("eth3d", "amodal", "boxes3d"), "pixels"),
    "what is in front is nearer": (
        order_and_depth, ("relations", "eth3d", "amodal"), "pairs"),
}  # fmt: skip


def consistency(folder: Path, min_score: float = 0.0) -> dict[str, dict[str, Any]]:
    """Each check: how many contradict, of how many; None where it is not measured."""
    runs, found = Runs(folder, min_score), {}
    for name, (check, tasks, unit) in CHECKS.items():
        here = all((folder / task / "per_image.jsonl").is_file() for task in tasks)
        bad, n = check(runs) if here else (None, 0)
        found[name] = {"contradict": bad, "of": n, "unit": unit, "tasks": tasks}
    return found


def main() -> None:
    """Print a line for each check; write them all."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("runs", type=Path, nargs="+")
    parser.add_argument("--min-score", type=float, default=0.0)
    parser.add_argument("-o", "--output", type=Path)
    chosen = parser.parse_args()
    every = {folder.name: consistency(folder, chosen.min_score) for folder in chosen.runs}
    for name in CHECKS:
        rows = [found[name] for found in every.values() if found[name]["contradict"] is not None]
        bad, n = (sum(row[key] for row in rows) for key in ("contradict", "of"))
        share = f"{bad:,} of {n:,} = {bad / n:.4f}" if n else "not measured"
        print(f"{name:48} {share} {CHECKS[name][2] if n else ''}")
    if chosen.output:
        chosen.output.write_text(readable_json(every), "utf-8")


if __name__ == "__main__":
    main()
