"""PQ of many images by us, by hotcoco and by panopticapi: seconds, and that all are equal.

    python benchmarks/panoptic/compare_scorers.py [--images 5000] [--workers 2] [--panopticapi DIR]

Makes ground truth and answers of 640 x 480 (about 20 segments an image, of which some are shifted,
split, relabelled or missing) below --folder, imports and scores them. panopticapi is no package of
an index: DIR is a checkout of it. It is timed on one core (`pq_compute_single_core`), whose sums
are the reference; its own entry point starts a process for each core.
"""

from __future__ import annotations

import argparse
import json
import resource
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from legoworld import cli
from legoworld.shipped import catalog

SIZE_HW = (480, 640)
CELLS = 24


def picture(rng: np.random.Generator) -> np.ndarray:
    """Ids of a picture's segments: nearest of some points, as blobs of one colour."""
    n = int(rng.integers(12, CELLS))
    points = rng.random((n, 2)) * SIZE_HW
    rows, cols = np.mgrid[: SIZE_HW[0] : 4, : SIZE_HW[1] : 4]
    distance = (rows[..., None] - points[:, 0]) ** 2 + (cols[..., None] - points[:, 1]) ** 2
    ids = rng.choice(np.arange(1, 1 << 20), n, replace=False)[distance.argmin(axis=2)]
    return np.repeat(np.repeat(ids, 4, axis=0), 4, axis=1)


def write(path: Path, ids: np.ndarray) -> None:
    """A PNG of ids."""
    bgr = np.stack([ids >> 16, ids >> 8 & 255, ids & 255], -1).astype(np.uint8)
    cv2.imwrite(str(path), bgr)


def listed(ids: np.ndarray, categories: dict[int, int], crowd: int = -1) -> list[dict[str, Any]]:
    """segments_info; 0 is VOID."""
    found, areas = np.unique(ids[ids > 0], return_counts=True)
    return [
        {"id": int(i), "category_id": categories[int(i)], "area": int(n),
         "iscrowd": int(i == crowd), "bbox": [0, 0, 1, 1]}
        for i, n in zip(found, areas, strict=True)
    ]  # fmt: skip


def make(folder: Path, images: int, seed: int = 0) -> tuple[Path, Path]:
    """Ground truth and answers."""
    rng = np.random.default_rng(seed)
    file = catalog.folder("datasets") / "coco-panoptic/categories.json"
    categories = json.loads(file.read_text(encoding="utf-8"))
    every = np.array([category["id"] for category in categories])
    true, given, infos = [], [], []
    for name in ("truth", "answers"):
        (folder / name).mkdir(parents=True, exist_ok=True)
    for number in range(1, images + 1):
        ids = picture(rng)
        seen = np.unique(ids)
        of = {int(i): int(rng.choice(every)) for i in seen}
        answer = np.roll(ids, rng.integers(-15, 16, 2), (0, 1))
        answer[np.isin(answer, seen[rng.random(len(seen)) < 0.1])] = 0
        ids[np.isin(ids, seen[rng.random(len(seen)) < 0.1])] = 0
        theirs = {i: c if rng.random() < 0.8 else int(rng.choice(every)) for i, c in of.items()}
        for name, pixels in (("truth", ids), ("answers", answer)):
            write(folder / name / f"{number:012}.png", pixels)
        entry = {"image_id": number, "file_name": f"{number:012}.png"}
        crowd = int(seen[0]) if rng.random() < 0.2 else -1
        true.append({**entry, "segments_info": listed(ids, of, crowd)})
        given.append({**entry, "segments_info": listed(answer, theirs)})
        infos.append({"id": number, "file_name": f"{number:012}.jpg",
                      "width": SIZE_HW[1], "height": SIZE_HW[0]})  # fmt: skip
    truth, answers = folder / "truth.json", folder / "answers.json"
    document = {"images": infos, "annotations": true, "categories": categories}
    truth.write_text(json.dumps(document), encoding="utf-8")
    answers.write_text(json.dumps({"annotations": given}), encoding="utf-8")
    return truth, answers


def ours(folder: Path, truth: Path, workers: int) -> dict[str, float]:
    """Evaluate the imported run."""
    words = ["evaluate", "-q", folder / "run", "--truth", truth, "-o", folder / "eval"]
    assert cli.run([*map(str, words), "--workers", str(workers), "--overwrite"]) == 0
    summary = json.loads((folder / "eval/summary.json").read_text(encoding="utf-8"))
    found: dict[str, float] = summary["metrics"]
    return found


def official(checkout: Path, truth: Path, answers: Path) -> dict[str, float]:
    """panopticapi on one core."""
    sys.path.insert(0, str(checkout))
    from panopticapi.evaluation import pq_compute_single_core

    true, given = (json.loads(path.read_text(encoding="utf-8")) for path in (truth, answers))
    by_image = {entry["image_id"]: entry for entry in given["annotations"]}
    pairs = [(entry, by_image[entry["image_id"]]) for entry in true["annotations"]]
    categories = {category["id"]: category for category in true["categories"]}
    folders = (str(path.with_suffix("")) for path in (truth, answers))
    stat = pq_compute_single_core(0, pairs, *folders, categories)
    return by_group(lambda isthing: stat.pq_average(categories, isthing=isthing)[0])


def by_group(values: Any) -> dict[str, float]:
    """Our names of theirs."""
    groups = {"": None, "_things": True, "_stuff": False}
    found = {}
    for group, isthing in groups.items():
        of = values(isthing)
        found |= {f"{name.upper()}{group}": of[name] for name in ("pq", "sq", "rq")}
    return found


def by_hotcoco(truth: Path, answers: Path) -> dict[str, float]:
    """hotcoco, with its own threads."""
    from hotcoco.panoptic import PanopticEval

    scorer = PanopticEval(str(truth), str(answers))
    scorer.evaluate()
    results = scorer.results()
    names = {None: "All", True: "Things", False: "Stuff"}
    return by_group(lambda isthing: results[names[isthing]])


def cpu_seconds() -> float:
    """Of this process and of those it has waited for."""
    used = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(one.ru_utime + one.ru_stime for one in used)


def main() -> None:
    """Time each, and compare."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--images", type=int, default=5000)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--panopticapi", type=Path)
    parser.add_argument("--folder", type=Path)
    given = parser.parse_args()
    folder = given.folder or Path(tempfile.mkdtemp())
    truth, answers = folder / "truth.json", folder / "answers.json"
    if not answers.is_file():
        make(folder, given.images)
    track = folder / "track.json"
    for words in (
        ["track", "make", "--task", "coco-panoptic", "--truth", truth, "-o", track, "--overwrite"],
        ["baseline", "import", "-q", answers, "--task", "coco-panoptic", "--track", track,
         "-o", folder / "run", "--overwrite"],
    ):  # fmt: skip
        assert cli.run([str(word) for word in words]) == 0
    scorers = {
        f"legoworld evaluate, {given.workers} workers": lambda: ours(folder, truth, given.workers),
        "hotcoco": lambda: by_hotcoco(truth, answers),
    }
    if given.panopticapi:
        scorers["panopticapi, one core"] = lambda: official(given.panopticapi, truth, answers)
    found = {}
    for name, score in scorers.items():
        start, cpu = time.perf_counter(), cpu_seconds()
        found[name] = score()
        wall, cpu = time.perf_counter() - start, cpu_seconds() - cpu
        print(f"{name}: {wall:.1f} s, {cpu:.1f} CPU s, PQ {found[name]['PQ']!r}")
    first, *others = found.values()
    for name, other in zip(list(found)[1:], others, strict=True):
        gap = max(abs(first[key] - other[key]) for key in first)
        print(f"{name}: largest difference of nine numbers {gap:.3g}")


if __name__ == "__main__":
    main()
