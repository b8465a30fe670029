"""Does a public chooser take the better of K reconstructions? Against a random one and the last.

    python benchmarks/plugin/candidates.py DATASET KEPT_SCENES [--only __hard__view_00] [--each 10]

A candidate is a case's scene with every object off its place, turned and scaled, some missing, and
the camera off its pose; how far is drawn for each candidate (--alike: the same for all). Choosers
see residuals alone: the mean IoU of regions and objects matched without names (`region_fit`), or,
with the names that candidates of one scene share, the requirements kept. R is the bench's.
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path

import numpy as np
from copies import (
    F64,
    StudyCase,
    about,
    moved,
    r_of,
    read_case,
    report_of,
    seen_from,
    shift,
    turn,
    without,
)

from legoworld.evaluation.reconstruction.dataset import read_dataset
from legoworld.plugin.region_fit import region_fit
from legoworld.plugin.state import LiveScene
from legoworld.scene.blender_process import BlenderProcess, Limits
from legoworld.scene.snapshot import Snapshot


def candidate(study: StudyCase, random: np.random.Generator, amount: float) -> Snapshot:
    """One reconstruction, worse with the amount."""
    copy = study.scene.snapshot
    gone = np.zeros(len(copy.surface_mesh), bool)
    for name in study.names:
        surfaces = study.surfaces(name)
        if random.random() < 0.15 * amount / 0.4:
            gone |= surfaces
        scale = np.exp(random.normal(0, 0.4 * amount))
        linear = turn(2, random.normal(0, 40 * amount)) * scale
        place = shift(random.normal(0, amount, 3) * [1, 1, 0])
        copy = moved(copy, surfaces, place @ about(study.middle(name), linear))
    pose = random.normal(0, [amount / 3, amount / 3, amount / 3, 4 * amount, 4 * amount])
    rotation = turn(0, pose[3]) @ turn(1, pose[4])
    copy = seen_from(copy, shift(pose[:3]) @ about(np.zeros(3), rotation))
    return without(copy, gone) if gone.any() else copy


def main() -> None:
    """Make candidates, choose among each K of them, print the means."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("dataset", type=Path)
    parser.add_argument("scenes", type=Path)
    parser.add_argument("--only", default="__hard__view_00")
    parser.add_argument("--each", type=int, default=10, help="candidates of each scene")
    parser.add_argument("--alike", action="store_true")
    chosen = parser.parse_args()
    dataset = read_dataset(chosen.dataset / "private")
    per_case: list[list[tuple[float, float, float]]] = []
    with tempfile.TemporaryDirectory() as made, BlenderProcess(Limits(time_s=600)) as blender:
        for case in dataset.cases.values():
            if chosen.only not in case.stem:
                continue
            blend = chosen.scenes / case.stem / "scene.blend"
            study = read_case(dataset, case, blend, Path(made) / case.stem, blender)
            rows = []
            for seed in range(chosen.each):
                random = np.random.default_rng(seed)
                amount = 0.3 if chosen.alike else float(random.uniform(0.05, 0.6))
                copy = candidate(study, random, amount)
                fit = region_fit(LiveScene(reading=copy, state=study.scene.state), study.evidence)
                kept = sum(r.verdict == "pass" for r in report_of(study, copy).results)
                rows.append((r_of(study, copy), float(np.mean(list(fit.values()))), float(kept)))
            per_case.append(rows)
            r, fit_of, kept_of = np.array(rows).T
            print(
                f"{case.stem}: R {r.min():.3f} to {r.max():.3f}, rho of R with the fit "
                f"{_rho(r, fit_of):+.2f}, with what is kept {_rho(r, kept_of):+.2f}",
                flush=True,
            )
    for k in (2, 3, 4, 8):
        picks = np.array([_picked(some) for rows in per_case for some in _groups(rows, k)])
        mean, last, fitting, keeping, best = picks.mean(axis=0)
        better = np.mean(picks[:, 2] > picks[:, 1]), np.mean(picks[:, 2] < picks[:, 1])
        print(
            f"K = {k}, {len(picks)} groups: R of a random one {mean:.3f}, the last {last:.3f}, "
            f"best fit {fitting:.3f}, most kept {keeping:.3f}, the best {best:.3f}; best fit is "
            f"the best in {np.mean(picks[:, 2] == picks[:, 4]):.0%}, better than the last in "
            f"{better[0]:.0%}, worse in {better[1]:.0%}"
        )


def _groups(rows: list[tuple[float, float, float]], k: int) -> list[F64]:
    """Neighbouring candidates, each K of them."""
    return [np.array(rows[i : i + k]) for i in range(len(rows) - k + 1)]


def _picked(some: F64) -> tuple[float, ...]:
    r, fit, kept = some.T
    return r.mean(), r[-1], r[fit.argmax()], r[kept.argmax()], r.max()


def _rho(first: F64, second: F64) -> float:
    """Spearman's."""
    from scipy.stats import spearmanr

    return float(np.asarray(spearmanr(first, second)[0]))


if __name__ == "__main__":
    main()
