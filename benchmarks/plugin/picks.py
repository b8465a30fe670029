"""How much regret `trajectory pick --by residuals` recovers, over trajectories of edits.

    python benchmarks/plugin/picks.py DATASET KEPT_SCENES [--only __hard__view_00] [--each 10]

A trajectory begins with every object off its place and the camera off its pose, and makes 14 edits
of one object or the camera: 70 % bring it half-way home, 30 % throw it off again (29.6 % of an
agent's edits lower Q); --harmful takes another share. The submission is the last checkpoint. Regret
is of R, the half of Q that needs no render: the best checkpoint's R minus the submission's. The
pick is that of
`trajectories.clearly_better`, by the plugin's residuals alone.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Iterator
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
)

from legoworld.evaluation.reconstruction.dataset import read_dataset
from legoworld.scene.blender_process import BlenderProcess, Limits
from legoworld.scene.snapshot import Snapshot
from legoworld.trajectories.clearly_better import clearly_best

EDITS = 14


def checkpoints(
    study: StudyCase, random: np.random.Generator, harmful_share: float
) -> Iterator[Snapshot]:
    """The scene after each edit."""
    offset = {name: _off(random, 0.6) for name in study.names}
    camera = _camera(random)
    for _ in range(EDITS):
        yield _scene(study, offset, camera)
        harmful = random.random() < harmful_share
        chosen = str(random.choice([*study.names, "camera"]))
        if chosen == "camera":
            camera = _camera(random) if harmful else camera / 2
        else:
            offset[chosen] = _off(random, 0.8) if harmful else offset[chosen] / 2
    yield _scene(study, offset, camera)


def _off(random: np.random.Generator, sd: float) -> F64:
    return np.asarray(random.normal(0, sd, 3) * [1, 1, 0])


def _camera(random: np.random.Generator) -> F64:
    """Metres along three axes, then degrees about two."""
    return np.asarray(random.normal(0, [0.3, 0.3, 0.3, 3, 3]))


def _scene(study: StudyCase, offset: dict[str, F64], camera: F64) -> Snapshot:
    copy = study.scene.snapshot
    for name, by in offset.items():
        copy = moved(copy, study.surfaces(name), shift(by))
    rotation = turn(0, camera[3]) @ turn(1, camera[4])
    return seen_from(copy, shift(camera[:3]) @ about(np.zeros(3), rotation))


def main() -> None:
    """Make the trajectories, pick, print the means."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("dataset", type=Path)
    parser.add_argument("scenes", type=Path)
    parser.add_argument("--only", default="__hard__view_00")
    parser.add_argument("--each", type=int, default=10)
    parser.add_argument("--harmful", type=float, default=0.3, help="share of edits")
    chosen = parser.parse_args()
    dataset = read_dataset(chosen.dataset / "private")
    rows: list[tuple[float, float, float]] = []
    lowered = edits = 0
    with tempfile.TemporaryDirectory() as made, BlenderProcess(Limits(time_s=600)) as blender:
        for case in dataset.cases.values():
            if chosen.only not in case.stem:
                continue
            blend = chosen.scenes / case.stem / "scene.blend"
            study = read_case(dataset, case, blend, Path(made) / case.stem, blender)
            for seed in range(chosen.each):
                scenes = list(checkpoints(study, np.random.default_rng(seed), chosen.harmful))
                r = [r_of(study, scene) for scene in scenes]
                chosen_one = clearly_best([report_of(study, scene) for scene in scenes])
                lowered += int((np.diff(r) < -1e-6).sum())
                edits += len(r) - 1
                rows.append((max(r), r[-1], r[chosen_one]))
            print(f"{case.stem}: {len(study.names)} objects", flush=True)
    best, last, picked = np.array(rows).T
    regret = (best - last).mean()
    print(f"{len(rows)} trajectories, {lowered / edits:.1%} of {edits} edits lower R")
    print(
        f"best R {best.mean():.4f}, submitted {last.mean():.4f}, regret {100 * regret:.2f} points"
    )
    saved = picked - last
    print(
        f"picked: R {picked.mean():.4f}, recovers {saved.mean() / regret:.1%} of the regret; "
        f"better than the last in {np.count_nonzero(saved > 1e-6)}, worse in "
        f"{np.count_nonzero(saved < -1e-6)}"
    )


if __name__ == "__main__":
    main()
