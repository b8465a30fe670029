"""Does the plugin's residual fall when the bench's R rises? Rank correlations over copies.

    python benchmarks/plugin/perturbations.py DATASET KEPT_SCENES [--only __hard__view_00]

DATASET and KEPT_SCENES: of `legoworld bench make ... --keep-scenes KEPT_SCENES`. Every case is
perturbed in eight ways by seven amounts, two draws each, beside itself; see copies.py for what each
side knows. Spearman's rho and Kendall's tau-b (SciPy) of R and the mean residual, over a case's
copies, then averaged over cases; a perfect signal has -1.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
from copies import (
    F64,
    StudyCase,
    about,
    in_tolerances,
    moved,
    r_of,
    read_case,
    report_of,
    seen_from,
    shift,
    turn,
    without,
)
from scipy.stats import kendalltau, spearmanr

from legoworld.evaluation.reconstruction.dataset import read_dataset
from legoworld.scene.blender_process import BlenderProcess, Limits
from legoworld.scene.snapshot import Snapshot

Perturb = Callable[[StudyCase, float, np.random.Generator], Snapshot]
DRAWS = 2
#: R that differs by less is no order.
SAME_R = 0.01


def _flat(random: np.random.Generator, size: float) -> F64:
    angle = random.uniform(0, 2 * np.pi)
    return np.array([np.cos(angle), np.sin(angle), 0.0]) * size


def _one(study: StudyCase, random: np.random.Generator) -> str:
    return str(random.choice(study.names))


def object_moved(study: StudyCase, amount: float, random: np.random.Generator) -> Snapshot:
    """One object by `amount` metres along the ground."""
    chosen = study.surfaces(_one(study, random))
    return moved(study.scene.snapshot, chosen, shift(_flat(random, amount)))


def all_moved(study: StudyCase, amount: float, random: np.random.Generator) -> Snapshot:
    """Every object by `amount` metres, each its own way."""
    copy = study.scene.snapshot
    for name in study.names:
        copy = moved(copy, study.surfaces(name), shift(_flat(random, amount)))
    return copy


def object_turned(study: StudyCase, amount: float, random: np.random.Generator) -> Snapshot:
    """One object by 90 * `amount` degrees about the upright through its middle."""
    name = _one(study, random)
    motion = about(study.middle(name), turn(2, 90 * amount))
    return moved(study.scene.snapshot, study.surfaces(name), motion)


def object_scaled(study: StudyCase, amount: float, random: np.random.Generator) -> Snapshot:
    """One object larger by the factor 1 + `amount`, about its middle."""
    name = _one(study, random)
    motion = about(study.middle(name), np.eye(3) * (1 + amount))
    return moved(study.scene.snapshot, study.surfaces(name), motion)


def objects_deleted(study: StudyCase, amount: float, random: np.random.Generator) -> Snapshot:
    """The share `amount` / 2 of all objects."""
    count = max(1, round(amount / 2 * len(study.names)))
    gone = np.zeros(len(study.scene.snapshot.surface_mesh), bool)
    for name in random.choice(study.names, count, replace=False).tolist():
        gone |= study.surfaces(name)
    return without(study.scene.snapshot, gone)


def camera_moved(study: StudyCase, amount: float, random: np.random.Generator) -> Snapshot:
    """The camera by `amount` metres."""
    way = random.normal(size=3)
    return seen_from(study.scene.snapshot, shift(way / np.linalg.norm(way) * amount))


def camera_turned(study: StudyCase, amount: float, random: np.random.Generator) -> Snapshot:
    """The camera by 10 * `amount` degrees."""
    axis = int(random.integers(3))
    return seen_from(study.scene.snapshot, about(np.zeros(3), turn(axis, 10 * amount)))


def scaled_from_camera(study: StudyCase, amount: float, _: np.random.Generator) -> Snapshot:
    """Everything farther by 1 + `amount`, as seen the same: no picture tells."""
    shot = study.scene.snapshot
    eye = np.array([row[3] for row in shot.camera.world_from_camera])
    return moved(shot, np.ones(len(shot.surface_mesh), bool), about(eye, np.eye(3) * (1 + amount)))


WAYS: dict[str, Perturb] = {
    "one object moved": object_moved,
    "all objects moved": all_moved,
    "one object turned": object_turned,
    "one object scaled": object_scaled,
    "objects deleted": objects_deleted,
    "camera moved": camera_moved,
    "camera turned": camera_turned,
    "scaled about the camera": scaled_from_camera,
}
AMOUNTS = (0.02, 0.05, 0.1, 0.2, 0.4, 0.7, 1.0)
#: No picture shows it, whatever measures: reported on its own.
UNSEEN = "scaled about the camera"

Row = tuple[str, float, dict[str, float]]  # way, R, residuals by kind


def rows_of(study: StudyCase) -> list[Row]:
    """Every copy of a case, the case itself first."""
    own = study.scene.snapshot
    rows: list[Row] = [("itself", r_of(study, own), in_tolerances(report_of(study, own)))]
    random = np.random.default_rng(1)
    for way, perturb in WAYS.items():
        for amount in AMOUNTS:
            for _ in range(DRAWS):
                copy = perturb(study, amount, random)
                rows.append((way, r_of(study, copy), in_tolerances(report_of(study, copy))))
    return rows


def agreement(r: list[float], residual: list[float]) -> tuple[float, float, int, int]:
    """Spearman's rho, Kendall's tau-b, pairs in the right order, pairs whose R differs."""
    rho, tau = spearmanr(r, residual)[0], kendalltau(r, residual)[0]
    dr = np.subtract.outer(r, r)[np.triu_indices(len(r), 1)]
    ds = np.subtract.outer(residual, residual)[np.triu_indices(len(r), 1)]
    apart = np.abs(dr) > SAME_R
    return (
        float(np.asarray(rho)),
        float(np.asarray(tau)),
        int((dr * ds < 0)[apart].sum()),
        int(apart.sum()),
    )


def tell(title: str, per_case: list[list[Row]], kind: str) -> None:
    """One line: means over the cases whose R and residuals vary."""
    found = [
        agreement([r for _, r, _ in rows], [residual[kind] for _, _, residual in rows])
        for rows in per_case
        if len(rows) > 2 and np.ptp([r for _, r, _ in rows]) > SAME_R
    ]
    found = [one for one in found if np.isfinite(one[0])]
    if not found:
        print(f"{title:26} the residual never changes, over {len(per_case)} cases")
        return
    rho, tau = np.mean([f[0] for f in found]), np.mean([f[1] for f in found])
    right, pairs = sum(f[2] for f in found), sum(f[3] for f in found)
    print(
        f"{title:26} rho {rho:+.3f}  tau {tau:+.3f}  ordered {right / pairs:.1%} of {pairs} pairs"
        f"  ({len(found)} cases)",
        flush=True,
    )


def main() -> None:
    """Read the cases, perturb them, print the tables."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("dataset", type=Path)
    parser.add_argument("scenes", type=Path)
    parser.add_argument("--only", default="__hard__view_00")
    chosen = parser.parse_args()
    dataset = read_dataset(chosen.dataset / "private")
    per_case: list[list[Row]] = []
    with tempfile.TemporaryDirectory() as made, BlenderProcess(Limits(time_s=600)) as blender:
        for case in dataset.cases.values():
            if chosen.only not in case.stem:
                continue
            blend = chosen.scenes / case.stem / "scene.blend"
            study = read_case(dataset, case, blend, Path(made) / case.stem, blender)
            per_case.append(rows_of(study))
            itself = per_case[-1][0]
            print(
                f"{case.stem}: {len(study.names)} objects, {len(per_case[-1])} copies, itself R "
                f"{itself[1]:.3f}, residual {itself[2]['all']:.2f} tolerances",
                flush=True,
            )
    seen = [[row for row in rows if row[0] != UNSEEN] for rows in per_case]
    print(f"\nby kind of requirement, all ways but {UNSEEN!r}")
    for kind in seen[0][0][2]:
        tell(kind, seen, kind)
    print("\nby way, mean residual of all requirements")
    for way in WAYS:
        tell(way, [[row for row in rows if row[0] in (way, "itself")] for rows in per_case], "all")


if __name__ == "__main__":
    main()
