"""The rule of panopticapi's evaluation.py in plain masks and floats: what ours is held to.

The package is not on PyPI. Written from the rule, mask by mask, in the order in which the official
script adds; ours counts pairs of places in integers.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image


def ids_of(path: Path) -> np.ndarray:
    pixels = np.array(Image.open(path), np.int64)
    return pixels @ [1, 256, 65536]


def quality(truth: Path, answers: Path) -> dict[str, float]:
    """PQ, SQ, RQ over all, things and stuff, of JSON files with folders of their names."""
    true, given = json.loads(truth.read_text()), json.loads(answers.read_text())
    by_image = {entry["image_id"]: entry for entry in given["annotations"]}
    stats: dict[int, list[float]] = {c["id"]: [0.0, 0, 0, 0] for c in true["categories"]}
    for entry in true["annotations"]:
        answer = by_image[entry["image_id"]]  # the official script refuses a missing image
        of_image(
            ids_of(truth.with_suffix("") / entry["file_name"]),
            ids_of(answers.with_suffix("") / answer["file_name"]),
            entry["segments_info"],
            answer["segments_info"],
            stats,
        )
    things = {c["id"]: bool(c["isthing"]) for c in true["categories"]}
    found: dict[str, float] = {}
    for group, kept in (("", (True, False)), ("_things", (True,)), ("_stuff", (False,))):
        sums, n = [0.0, 0.0, 0.0], 0
        for number, (iou, tp, fp, fn) in stats.items():
            if things[number] in kept and tp + fp + fn:
                n += 1
                sums[0] += iou / (tp + 0.5 * fp + 0.5 * fn)
                sums[1] += iou / tp if tp else 0
                sums[2] += tp / (tp + 0.5 * fp + 0.5 * fn)
        for name, total in zip(("PQ", "SQ", "RQ"), sums, strict=True):
            found[name + group] = total / n if n else float("nan")
    return found


def of_image(
    true: np.ndarray,
    given: np.ndarray,
    true_segments: list[dict[str, Any]],
    segments: list[dict[str, Any]],
    stats: dict[int, list[float]],
) -> None:
    """Add IoU, TP, FP and FN of one image."""
    hit, met = set(), set()
    pairs = sorted((t["id"], s["id"]) for t in true_segments for s in segments)
    truth_of, answer_of = ({s["id"]: s for s in some} for some in (true_segments, segments))
    for t, s in pairs:
        of, by = truth_of[t], answer_of[s]
        if of["iscrowd"] or of["category_id"] != by["category_id"]:
            continue
        inter = int(((true == t) & (given == s)).sum())
        void = int(((true == 0) & (given == s)).sum())
        union = int((given == s).sum()) + of["area"] - inter - void
        if inter / union > 0.5:
            stats[of["category_id"]][0] += inter / union
            stats[of["category_id"]][1] += 1
            hit.add(t)
            met.add(s)
    crowd = {}
    for of in true_segments:
        if of["iscrowd"]:
            crowd[of["category_id"]] = of["id"]
        elif of["id"] not in hit:
            stats[of["category_id"]][3] += 1
    for by in segments:
        if by["id"] in met:
            continue
        mine = given == by["id"]
        ignored = int((mine & (true == 0)).sum())
        if by["category_id"] in crowd:
            ignored += int((mine & (true == crowd[by["category_id"]])).sum())
        if not ignored / int(mine.sum()) > 0.5:
            stats[by["category_id"]][2] += 1
