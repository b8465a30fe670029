"""Average recall of estimated poses, by the rules of the BOP Challenge (6D localisation)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from legoworld.evaluation.pose.errors import Floats, Model, Photo, mspd, mssd, vsd
from legoworld.evaluation.pose.folder import (
    BopFolder,
    Estimate,
    PoseInputError,
    TruePose,
    read_results,
)

TAUS: Final = tuple(round(0.05 * k, 2) for k in range(1, 11))
#: Of VSD and of MSSD over the diameter; MSPD's are 100 times these, in pixels of 640 columns.
THRESHOLDS: Final = TAUS
MIN_VISIBLE: Final = 0.1


@dataclass(frozen=True, kw_only=True)
class PoseError:
    """An estimate against a truth of its object and image. truth: place in the image."""

    scene_id: int
    im_id: int
    obj_id: int
    score: float
    truth: int
    vsd: tuple[float, ...]
    mssd: float
    mspd: float


@dataclass(frozen=True, kw_only=True)
class PoseScores:
    """AR of each error and their mean; n_truths: annotated instances that are visible enough."""

    ar: float
    ar_vsd: float
    ar_mssd: float
    ar_mspd: float
    n_truths: int
    n_estimates: int
    errors: tuple[PoseError, ...]


def score_poses(folder: Path, results: Path, *, split: str = "test") -> PoseScores:
    """Score a results file (BOP19's CSV) against the poses of a BOP folder.

    Of an object in an image, as many estimates count as it has instances that are visible to a
    tenth, by confidence; one that no annotation asks for is left out. PoseInputError.
    """
    dataset = BopFolder(folder, split)
    by_cell: dict[tuple[int, int, int], list[Estimate]] = {}
    for one in read_results(results):
        by_cell.setdefault((one.scene_id, one.im_id, one.obj_id), []).append(one)
    images = dataset.images()
    unknown = sorted({key[:2] for key in by_cell} - set(images))
    if unknown:
        raise PoseInputError(
            "results are of an image that the folder does not have",
            found=f"scene {unknown[0][0]}, image {unknown[0][1]}",
            expected=f"one of {len(images)} images",
        )
    errors: list[PoseError] = []
    hits, n_truths, n_estimates = np.zeros(3), 0, 0
    for scene_id, im_id in images:
        truths = dataset.truths(scene_id, im_id)
        photo = dataset.photo(scene_id, im_id)
        for obj_id in sorted({t.obj_id for t in truths}):
            places = [
                k for k, t in enumerate(truths) if t.obj_id == obj_id and t.visible >= MIN_VISIBLE
            ]
            mine = by_cell.get((scene_id, im_id, obj_id), [])
            mine = sorted(mine, key=lambda e: -e.score)[: len(places)]
            n_truths, n_estimates = n_truths + len(places), n_estimates + len(mine)
            if not mine:
                continue
            model = dataset.model(obj_id)
            table = [[_error(e, k, truths[k], model, photo) for k in places] for e in mine]
            errors += [one for row in table for one in row]
            hits += _hits(table, model.diameter, photo.depth_mm.shape[1] / 640)
    recalls = hits / n_truths if n_truths else np.full(3, np.nan)
    return PoseScores(
        ar=float(recalls.mean()),
        ar_vsd=float(recalls[0]),
        ar_mssd=float(recalls[1]),
        ar_mspd=float(recalls[2]),
        n_truths=n_truths,
        n_estimates=n_estimates,
        errors=tuple(errors),
    )


def _error(one: Estimate, place: int, truth: TruePose, model: Model, photo: Photo) -> PoseError:
    return PoseError(
        scene_id=one.scene_id,
        im_id=one.im_id,
        obj_id=one.obj_id,
        score=one.score,
        truth=place,
        vsd=tuple(vsd(model, one.pose, truth.pose, photo, TAUS)),
        mssd=mssd(model, one.pose, truth.pose),
        mspd=mspd(model, one.pose, truth.pose, photo),
    )


def _hits(table: Sequence[Sequence[PoseError]], diameter: float, columns: float) -> Floats:
    """(3,) truths that are found, averaged over thresholds (and tolerances)."""
    by_tau = [[[e.vsd[k] for e in row] for row in table] for k in range(len(TAUS))]
    return np.array(
        [
            np.mean([_count_hits(values, t) for values in by_tau for t in THRESHOLDS]),
            np.mean([_count_hits([[e.mssd for e in r] for r in table], t * diameter)
                     for t in THRESHOLDS]),
            np.mean([_count_hits([[e.mspd for e in r] for r in table], 100 * t * columns)
                     for t in THRESHOLDS]),
        ]
    )  # fmt: skip


def _count_hits(errors: Sequence[Sequence[float]], threshold: float) -> int:
    """Truths that estimates take, best first, each the free one of smallest error below it."""
    taken: set[int] = set()
    for row in errors:
        free = [(e, k) for k, e in enumerate(row) if k not in taken and e < threshold]
        if free:
            taken.add(min(free)[1])
    return len(taken)
