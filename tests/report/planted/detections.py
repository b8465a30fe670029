"""Faults of boxes, masks, amodal masks and boxes in space."""

from __future__ import annotations

import contextlib
import copy
import io
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from evaluation.detection_runs import box_mask, text_counts
from evaluation.solids import box as solid
from pycocotools.coco import COCO
from pycocotools.cocoeval import COCOeval
from report.pages import evaluate
from report.planted.plant import Plant, Planted

from legoworld.evaluation.stored import read_evaluation

Box = tuple[int, int, int, int]
IMAGES, CELL, COLUMNS, ROWS = 14, 30, 4, 3
#: Tasks whose evaluation takes longer have fewer images.
FEWER = {"amodal": 8, "boxes3d": 10}
#: Right, of a moved camera; answers are up to a pixel off besides.
SHIFT = 13


@dataclass
class Thing:
    """An object, or an answer: of an image, a category, a box in 120 x 90 pixels."""

    image: int
    category: int
    box: Box
    score: float = 1.0


@dataclass
class Set:
    """Things of known categories, answers a little off, few of them missed or invented."""

    task: str
    truth: list[Thing]
    answers: list[Thing]
    free: dict[int, list[Box]] = field(default_factory=dict)
    missing: frozenset[int] = frozenset()

    @property
    def categories(self) -> list[int]:
        return sorted({t.category for t in self.truth})

    def of(self, category: int) -> list[Thing]:
        return [t for t in self.answers if t.category == category]


def made(task: str, random: np.random.Generator) -> Set:
    """A set without a fault that is worth a word."""
    ids = sorted(random.choice(np.arange(3, 60, 2), 6, replace=False).tolist())
    found = Set(task, [], [])
    for image in range(10, 10 + FEWER.get(task, IMAGES)):
        cells = random.permutation(COLUMNS * ROWS).tolist()
        n = int(random.integers(5, 8))
        for at, cell in enumerate(cells):
            w, h = (int(v) for v in random.integers(17, 24, 2))
            box = (CELL * (cell % COLUMNS) + 3, CELL * (cell // COLUMNS) + 3, w, h)
            if at >= n:
                found.free.setdefault(image, []).append(box)
                continue
            thing = Thing(image, int(random.choice(ids)), box)
            found.truth.append(thing)
            x, y = (int(v) for v in random.integers(0, 2, 2))
            moved = (box[0] + x, box[1] + y, w, h)
            found.answers.append(Thing(image, thing.category, moved, random.uniform(0.3, 1)))
    return found


def documents(given: Set) -> tuple[dict[str, Any], list[dict[str, Any]]]:
    """Truth and predictions as their files have them."""
    names = {c: f"thing {k}" for k, c in enumerate(given.categories)}
    images: list[dict[str, Any]] = [
        {"id": i, "file_name": f"{i}.jpg", "width": 120, "height": 90}
        for i in sorted({t.image for t in given.truth})
    ]
    for image in images:
        if given.task == "lvis":
            image |= {"neg_category_ids": given.categories, "not_exhaustive_category_ids": []}
        if given.task == "boxes3d":
            image["file_path"] = f"x/{image['file_name']}"
            image["K"] = [[100.0, 0, 60], [0, 100, 45], [0, 0, 1]]
    annotations = [
        {"id": k, "image_id": t.image, "category_id": t.category, **_true(given.task, t.box)}
        for k, t in enumerate(given.truth, start=1)
    ]
    truth = {
        "images": images,
        "annotations": annotations,
        "categories": [{"id": c, "name": n, "frequency": "c"} for c, n in names.items()],
    }
    predictions = [
        {"image_id": t.image, "category_id": t.category, "score": t.score,
         **_shape(given.task, t.box)}
        for t in given.answers
    ]  # fmt: skip
    return truth, predictions


def _shape(task: str, box: Box) -> dict[str, Any]:
    if task == "coco":
        return {"bbox": list(box)}
    if task == "boxes3d":
        return {"bbox3D": _corners(box).tolist()}
    mask = text_counts(box_mask(box))
    return {"segmentation": mask} | ({"visible_mask": mask} if task == "amodal" else {})


def _true(task: str, box: Box) -> dict[str, Any]:
    if task == "boxes3d":
        return {"bbox3D_cam": _corners(box).tolist(), "valid3D": True, "dimensions": [1, 1, 1],
                "truncation": 0.0, "visibility": 1.0}  # fmt: skip
    area = {"bbox": list(box), "area": box[2] * box[3]} | ({} if task == "lvis" else {"iscrowd": 0})
    return {"segmentation": text_counts(box_mask(box)), **_shape(task, box), **area}


def _corners(box: Box) -> np.ndarray:
    x, y, w, h = box
    return solid(((x + w / 2 - 60) / 25, (y + h / 2 - 45) / 25, 8), (w / 25, h / 25, 1))


def ap(given: Set, folder: Path) -> float:
    """AP by the official evaluator: pycocotools here for boxes, else in the evaluation of them."""
    truth, predictions = documents(given)
    if given.task != "coco":
        return float(read_evaluation(page(given, folder)).detection.metrics["AP"] or 0)
    with contextlib.redirect_stdout(io.StringIO()):
        true = COCO()
        true.dataset = truth
        true.createIndex()
        shown = [p for p in predictions if p["image_id"] not in given.missing]
        scored = COCOeval(true, true.loadRes(shown), "bbox")
        scored.evaluate()
        scored.accumulate()
        scored.summarize()
    return float(scored.stats[0])


def page(given: Set, folder: Path, name: str = "scene") -> Path:
    """An evaluation folder of a set."""
    truth, predictions = documents(given)
    kind = {} if name == "scene" else {"kind": "baseline", "baseline": name}
    statuses = dict.fromkeys(given.missing, "missing")
    return evaluate(
        folder, given.task, truth=truth, predictions=predictions, statuses=statuses, **kind
    )


def faulty(
    task: str,
    fault: Callable[[Set, Set, np.random.Generator], tuple[str, int | None, Iterable[int]]],
    folder: Path,
    random: np.random.Generator,
    *,
    within: float = 1e-9,
    advice: str = "",
    sides: int = 1,
) -> Planted:
    """A fault in the answers of a set; the second set is what mending it makes of them."""
    clean = made(task, random)
    bad, mended = copy.deepcopy(clean), copy.deepcopy(clean)
    kind, category, images = fault(bad, mended, random)
    gain = ap(mended, folder / "mended") - ap(bad, folder / "bad")
    evaluations = [page(bad, folder / "bad")]
    if sides > 1:
        evaluations.append(page(clean, folder / "bad", "theirs"))
    names = () if category is None else (f"thing {clean.categories.index(category)}",)
    there = frozenset(images)
    return Planted(
        evaluations=tuple(evaluations), kind=kind, says=names, size=gain, within=within,
        images=there,
        advice=dict.fromkeys(there, advice) if advice else {},
    )  # fmt: skip


def confused(bad: Set, mended: Set, random: np.random.Generator) -> Any:
    one, other = random.choice(bad.categories, 2, replace=False).tolist()
    taken = bad.of(one)[::2]
    for answer in taken:
        answer.category = other
    return "classification", one, {t.image for t in taken}


def shifted(bad: Set, mended: Set, random: np.random.Generator) -> Any:
    return _put(bad, mended, random, lambda x, y, w, h: (x + w // 2, y, w, h))


def shrunk(bad: Set, mended: Set, random: np.random.Generator) -> Any:
    """Wrong scale: three fifths as wide and high about the middle."""
    return _put(
        bad, mended, random, lambda x, y, w, h: (x + w // 5, y + h // 5, w * 3 // 5, h * 3 // 5)
    )


def _put(bad: Set, mended: Set, random: np.random.Generator, to: Callable[..., Box]) -> Any:
    category = int(random.choice(bad.categories))
    true = {(t.image, t.box[0] // CELL, t.box[1] // CELL): t.box for t in bad.truth}
    moved = bad.of(category)[::2]
    for answer in moved:
        cell = answer.image, answer.box[0] // CELL, answer.box[1] // CELL
        mended.answers[bad.answers.index(answer)].box = true[cell]
        answer.box = to(*answer.box)
    return "localisation", category, {t.image for t in moved}


def missed(bad: Set, mended: Set, random: np.random.Generator) -> Any:
    category = int(random.choice(bad.categories))
    gone = bad.of(category)[::2]
    top = max(t.score for t in bad.answers if t not in gone)
    for answer in gone:
        like = mended.answers[next(k for k, t in enumerate(bad.answers) if t is answer)]
        cell = like.box[0] // CELL, like.box[1] // CELL
        like.box = next(t.box for t in bad.truth if t.image == like.image
                        and (t.box[0] // CELL, t.box[1] // CELL) == cell)  # fmt: skip
        like.score = top
    images = {t.image for t in gone}
    lost = [any(t is g for g in gone) for t in bad.answers]
    bad.answers = [t for t, no in zip(bad.answers, lost, strict=True) if not no]
    # What is found stands first among equal scores.
    order = sorted(range(len(lost)), key=lambda k: not lost[k])
    mended.answers = [mended.answers[k] for k in order]
    return "missed", category, images


def invented(bad: Set, mended: Set, random: np.random.Generator) -> Any:
    category = int(random.choice(bad.categories))
    images = random.choice(sorted(bad.free), 6, replace=False).tolist()
    bad.answers += [Thing(i, category, bad.free[i][0], random.uniform(0.9, 1)) for i in images]
    return "background", category, images


def twice(bad: Set, mended: Set, random: np.random.Generator) -> Any:
    category = int(random.choice(bad.categories))
    again = [Thing(t.image, category, t.box, t.score - 0.001) for t in bad.of(category)]
    bad.answers += again
    return "duplicate", category, {t.image for t in again}


def camera(bad: Set, mended: Set, random: np.random.Generator) -> Any:
    images = random.choice(sorted(bad.free), 3, replace=False).tolist()
    for answer, like in zip(bad.answers, mended.answers, strict=True):
        if answer.image in images:
            x, y, w, h = answer.box
            answer.box = (x + SHIFT, y, w, h)
            if bad.task != "coco":  # what of a mask left the picture does not come back
                like.box = (x, y, min(w, 120 - x - SHIFT), h)
    return "camera", None, images


def absent(bad: Set, mended: Set, random: np.random.Generator) -> Any:
    images = random.choice(sorted(bad.free), 5, replace=False).tolist()
    bad.missing = frozenset(images)
    mended.truth = [t for t in mended.truth if t.image not in images]
    mended.answers = [t for t in mended.answers if t.image not in images]
    return "failed", None, images


def parts(folder: Path, random: np.random.Generator) -> Planted:
    """Half of each object of a category is cut out of it by a label of its own."""

    def fault(bad: Set, mended: Set, random: np.random.Generator) -> Any:
        category, other = random.choice(bad.categories, 2, replace=False).tolist()
        cut = bad.of(category)[::2]
        for answer in cut:
            at = next(k for k, t in enumerate(bad.answers) if t is answer)
            x, y, w, h = answer.box
            answer.box = (x, y, w, h * 2 // 5)
            like = mended.answers[at]
            like.box = next(
                t.box for t in bad.truth if t.image == like.image
                and (t.box[0] // CELL, t.box[1] // CELL) == (x // CELL, y // CELL)
            )  # fmt: skip
            part = Thing(like.image, other, (x, y + h * 2 // 5, w, h - h * 2 // 5), 0.2)
            bad.answers.append(part)
            mended.answers.append(copy.copy(part))
        return "localisation", category, {t.image for t in cut}

    return faulty(
        "coco-masks", fault, folder, random, advice=r"=> count thing \d in, if part of it"
    )


_FAULTS: dict[str, tuple[Any, dict[str, Any]]] = {
    "confused class": (confused, {}),
    "shifted": (shifted, {}),
    "wrong scale": (shrunk, {}),
    "missed": (missed, {}),
    "invented": (invented, {}),
    "predicted twice": (twice, {"within": 0.01}),
    "moved camera": (
        camera,
        {"within": 0.03, "advice": "everything is displaced: .*1[234] px left"},
    ),
    "missing scenes": (absent, {}),
    "in one of two sides": (missed, {"sides": 2}),
}
_OF_TASK = {
    "coco": tuple(_FAULTS),
    "coco-masks": ("confused class", "wrong scale", "moved camera", "missing scenes"),
    "lvis": ("confused class", "missed", "invented", "missing scenes"),
    "amodal": ("confused class", "missed", "missing scenes"),
    "boxes3d": ("confused class", "wrong scale", "missed"),
}
PLANTS = (
    *(
        Plant(task, name, partial(faulty, task, _FAULTS[name][0], **_FAULTS[name][1]))
        for task, names in _OF_TASK.items()
        for name in names
    ),
    Plant("coco-masks", "nested parts", parts),
)
