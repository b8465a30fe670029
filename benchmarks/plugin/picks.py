"""How much regret `trajectory pick --by residuals` recovers, over trajectories of edits.

    python benchmarks/plugin/picks.py DATASET KEPT_SCENES [--only __hard__view_00] [--each 6]

A trajectory begins with every object off its place and the camera off its pose, and makes 14 edits
of one object or the camera: most bring it half-way home, 30 or 60 % throw it off again (29.6 % of
an agent's edits lower Q). The submission is the last checkpoint. R, the half of Q that needs no
render, of what is picked: the last; the oracle's, of the largest R; by the least mean residual; by
the largest closeness; and as `trajectory pick` does, by closeness where it is clearly larger than
the last one's. Only the oracle sees R.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import numpy as np
from acceptance import CHOSEN_ON
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
)

from legoworld.evaluation.reconstruction.dataset import read_dataset
from legoworld.plugin.acceptance import clearly_closest, mean_closeness
from legoworld.records.plugin_requirements import Report
from legoworld.scene.blender_process import BlenderProcess, Limits
from legoworld.scene.snapshot import Snapshot

EDITS = 14
HARMFUL = (0.3, 0.6)
Picking = Callable[[Sequence[Report]], int]
PICKINGS: dict[str, Picking] = {
    "the least mean residual": lambda reports: int(
        np.argmin([in_tolerances(report)["all"] for report in reports])
    ),
    "the largest closeness": lambda reports: int(
        np.argmax([mean_closeness(report.results) for report in reports])
    ),
    "**clearly larger closeness, else the last**": lambda reports: clearly_closest(
        [report.results for report in reports]
    ),
}


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


def trajectory(study: StudyCase, seed: int, harmful_share: float) -> tuple[list[float], list[int]]:
    """R of each checkpoint, and the position that each picking takes."""
    scenes = list(checkpoints(study, np.random.default_rng(seed), harmful_share))
    reports = [report_of(study, scene) for scene in scenes]
    return [r_of(study, s) for s in scenes], [picking(reports) for picking in PICKINGS.values()]


def table(rows: Sequence[tuple[list[float], list[int]]]) -> str:
    """Markdown: mean R, points above the last with their standard error, better and worse."""
    last = np.array([r[-1] for r, _ in rows])
    taken = {"the last": last, "oracle: the largest R": np.array([max(r) for r, _ in rows])}
    for at, name in enumerate(PICKINGS):
        taken[name] = np.array([r[picked[at]] for r, picked in rows])
    lines = ["| picked | R | points above the last | better / worse |", "|---|---:|---:|---:|"]
    for name, values in taken.items():
        gain = 100 * (values - last)
        error = gain.std(ddof=1) / np.sqrt(len(gain))
        counts = f"{np.count_nonzero(gain > 1e-4)} / {np.count_nonzero(gain < -1e-4)}"
        lines.append(
            f"| {name} | {values.mean():.4f} | {gain.mean():+.2f} ({error:.2f}) | {counts} |"
        )
    return "\n".join(lines)


def main() -> None:
    """Make the trajectories, pick, print the tables."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("dataset", type=Path)
    parser.add_argument("scenes", type=Path)
    parser.add_argument("--only", default="__hard__view_00")
    parser.add_argument("--each", type=int, default=6, help="trajectories of each scene")
    chosen = parser.parse_args()
    dataset = read_dataset(chosen.dataset / "private")
    found: dict[tuple[float, bool], list[tuple[list[float], list[int]]]] = {}
    with tempfile.TemporaryDirectory() as made, BlenderProcess(Limits(time_s=600)) as blender:
        for case in dataset.cases.values():
            if chosen.only not in case.stem:
                continue
            blend = chosen.scenes / case.stem / "scene.blend"
            study = read_case(dataset, case, blend, Path(made) / case.stem, blender)
            held_out = case.stem.split("__")[0] not in CHOSEN_ON
            for share in HARMFUL:
                rows = found.setdefault((share, held_out), [])
                rows += [trajectory(study, seed, share) for seed in range(chosen.each)]
            print(f"{case.stem}: {len(study.names)} objects", flush=True)
    for (share, held_out), rows in sorted(found.items()):
        whose = "held-out" if held_out else "chosen-on"
        print(f"\n{share:.0%} harmful, {len(rows)} of {whose} families\n\n{table(rows)}")


if __name__ == "__main__":
    main()
