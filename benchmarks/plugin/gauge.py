"""Does hill climbing on the residuals end in the right scene? With and without a held gauge.

    python benchmarks/plugin/gauge.py DATASET KEPT_SCENES [--only bedroom__hard__view_00 ...]

DATASET and KEPT_SCENES: as for acceptance.py. Every object begins off its place, turned and scaled,
and the camera off its pose, by as much as `initialize` leaves (3 cm, 0.3 degrees) or as a guess
does (30 cm, 3 degrees). A step changes one object, by the plugin's correction, half of it or at
random, or the camera at random: of three tries the one with the least mean residual is kept if it
is less than before. "camera held": no step changes the camera; "scale held": none changes an
object's scale; "camera first, then held": CAMERA_STEPS of the camera, then of objects alone. R at
the start and after 60 and 100 steps; the climb never sees it.
"""

from __future__ import annotations

import argparse
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np
from acceptance import Pose, Poses, corrected, off
from copies import (
    F64,
    StudyCase,
    about,
    in_tolerances,
    moved,
    pictured,
    r_of,
    read_case,
    report_of,
    seen_from,
    shift,
    turn,
)

from legoworld.evaluation.reconstruction.dataset import read_dataset
from legoworld.records.plugin_requirements import Report
from legoworld.scene.blender_process import BlenderProcess, Limits
from legoworld.scene.snapshot import Snapshot

TOLD_AT = (0, 60, 100)
#: Steps of the camera among all steps, where it is not held.
CAMERA_SHARE = 0.25
#: How far the camera begins off: metres, and ten times as many degrees.
STARTS = {"recovered": 0.03, "guessed": 0.3}
CLIMBS = ("nothing held", "scale held", "camera held", "camera first, then held")
#: The steps of "camera first", all of the camera.
CAMERA_STEPS = 30


def camera_off(random: np.random.Generator, by: float) -> F64:
    """Metres along the camera's axes, then degrees about two of them."""
    return np.asarray(random.normal(0, by, 5) * [1, 1, 1, 10, 10])


def scene_of(study: StudyCase, poses: Poses, camera: F64) -> Snapshot:
    """The case with every object where its pose says, seen from beside its camera."""
    copy = study.scene.snapshot
    for name, pose in poses.items():
        copy = moved(copy, study.surfaces(name), pose.motion(study.middle(name)))
    rotation = turn(0, camera[3]) @ turn(1, camera[4])
    return seen_from(copy, shift(camera[:3]) @ about(np.zeros(3), rotation))


def tries(
    study: StudyCase, report: Report, name: str, pose: Pose, random: np.random.Generator
) -> list[Pose]:
    """What an object may be changed to: by its correction, half of it, and at random."""
    by = float(np.exp(random.uniform(np.log(0.02), np.log(0.3))))
    made = [corrected(study, report, name, pose, share) for share in (1.0, 0.5)]
    jump = off(random, by)
    x, y, z = np.add(pose.offset, jump.offset)
    jumped = Pose(
        offset=(float(x), float(y), float(z)),
        yaw_deg=pose.yaw_deg + jump.yaw_deg,
        log_scale=pose.log_scale + jump.log_scale,
    )
    return [*(p for p in made if p is not None), jumped]


def turns_camera(held: str, step: int, random: np.random.Generator) -> bool:
    """Whether a step changes the camera."""
    if held == "camera first, then held":
        return step <= CAMERA_STEPS
    return held != "camera held" and random.random() < CAMERA_SHARE


def climb(study: StudyCase, seed: int, camera_by: float, held: str) -> list[float]:
    """R at `TOLD_AT`."""
    random = np.random.default_rng(seed)
    poses = {name: off(random, 0.3) for name in study.names}
    camera = camera_off(random, camera_by)
    copy = scene_of(study, poses, camera)
    report, told = report_of(study, copy), [r_of(study, copy)]
    for step in range(1, TOLD_AT[-1] + 1):
        options: list[tuple[Poses, F64]]
        if turns_camera(held, step, random):
            sizes = np.exp(random.uniform(np.log(0.01), np.log(0.3), 3))
            options = [(poses, camera + camera_off(random, size)) for size in sizes]
        else:
            name = str(random.choice(study.names))
            options = []
            for pose in tries(study, report, name, poses[name], random):
                kept = replace(pose, log_scale=poses[name].log_scale)
                options.append(({**poses, name: kept if held == "scale held" else pose}, camera))
        for option in options:
            tried = scene_of(study, *option)
            then = report_of(study, tried)
            if in_tolerances(then)["all"] < in_tolerances(report)["all"]:
                (poses, camera), report, copy = option, then, tried
        if step in TOLD_AT:
            told.append(r_of(study, copy))
    return told


def main() -> None:
    """Climb in every way, print R."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("dataset", type=Path)
    parser.add_argument("scenes", type=Path)
    default = ["bedroom__hard__view_00", "car_park__hard__view_00"]
    parser.add_argument("--only", nargs="+", default=default)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--climbs", nargs="+", default=CLIMBS)
    chosen = parser.parse_args()
    dataset = read_dataset(chosen.dataset / "private")
    columns = " | ".join(f"step {step}" for step in TOLD_AT)
    print(f"| scene | camera | climb | {columns} |\n|---|---|---|{'---:|' * len(TOLD_AT)}")
    with tempfile.TemporaryDirectory() as made, BlenderProcess(Limits(time_s=600)) as blender:
        for case in dataset.cases.values():
            if case.stem not in chosen.only:
                continue
            blend = chosen.scenes / case.stem / "scene.blend"
            study = pictured(read_case(dataset, case, blend, Path(made) / case.stem, blender))
            for start, by in STARTS.items():
                for held in chosen.climbs:
                    told = " | ".join(f"{r:.3f}" for r in climb(study, chosen.seed, by, held))
                    family = case.stem.split("__")[0]
                    print(f"| {family} | {start} | {held} | {told} |", flush=True)


if __name__ == "__main__":
    main()
