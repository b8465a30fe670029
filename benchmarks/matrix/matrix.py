"""Which task sees which fault: the bench's families against perturbed copies of themselves.

    python examples/bench/build.py --kaykit KAYKIT -o references
    python benchmarks/matrix/matrix.py references -o matrix [--family kitchen] [--quick]
    python benchmarks/matrix/tables.py matrix

Each reference becomes one case with labels for every vocabulary (prepare.py); what it exports is
the ground truth of every task. Copies with one fault each (copies.py), with all faults of a mix,
and with one of them put right by an oracle are read out and scored by every task, the bench
included; A of the large amounts alone. The command resumes: what is in the folder is kept.
"""

from __future__ import annotations

import argparse
import json
import logging
import shutil
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

import legoworld
from legoworld.running import submission
from legoworld.tasks.shipped import BENCH, RECONSTRUCTION, TASKS

HERE = Path(__file__).parent
SIZE_WH = (480, 270)
#: Of the pictures, and of A's renders in place of the card's 32, which would take 10 CPU s a case.
SAMPLES, CARD_SAMPLES = 16, 4
ASKED = tuple(task.name for task in TASKS if task.family != RECONSTRUCTION)
#: Each fault at a small and a large amount, as examples/bench/submit.py counts them.
FAULTS: dict[str, tuple[float, ...]] = {
    "camera": (0.02, 0.2),
    "scale": (0.01, 0.1),
    "move": (0.02, 0.2),
    "turn": (3, 30),
    "delete": (8, 2),
    "duplicate": (8, 2),
    "swap": (4, 1),
    "noise": (0.005, 0.03),
    "hollow": (4, 1),
    "relabel": (8, 2),
    "paint": (8, 2),
}
#: Faults of the whole picture at once, each of which has an oracle.
MIX: tuple[tuple[str, float], ...] = (("scale", 0.08), ("camera", 0.1), ("relabel", 4))
ORACLES = ("camera", "labels", "scale")


def main() -> None:
    """All steps."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("references", type=Path)
    parser.add_argument("-o", "--output", type=Path, required=True)
    parser.add_argument("--family", action="append", default=[])
    parser.add_argument("--quick", action="store_true", help="large amounts, no A")
    chosen = parser.parse_args()
    logging.disable(logging.INFO)
    plan: list[dict[str, Any]] = [{"name": "itself", "changes": []}]
    plan += [
        {"name": f"{fault}_{amount:g}", "changes": [[fault, amount]]}
        for place in ((-1,) if chosen.quick else (-1, 0))
        for fault, amounts in FAULTS.items()
        for amount in [amounts[place]]
    ]
    mix = {"name": "mix", "changes": [list(change) for change in MIX]}
    small = {f"{fault}_{amounts[0]:g}" for fault, amounts in FAULTS.items()}
    study = Study(chosen.output, unrendered=None if chosen.quick else small)
    study.make_truth(chosen.references, chosen.family)
    study.ask([plan[0], mix, *plan[1:]])
    sizes = study.scale_of("mix")
    oracles = [{**mix, "name": f"mix+{o}", "oracles": [o], "scale_by": sizes} for o in ORACLES]
    oracles.append({**mix, "name": "mix+all", "oracles": list(ORACLES), "scale_by": sizes})
    study.ask(oracles)


class Study:
    """The folder of one study: itself, truths, copies, runs and evals.

    unrendered: copies without A; None: all.
    """

    def __init__(self, folder: Path, *, unrendered: set[str] | None) -> None:
        self.folder, self.unrendered = folder, unrendered

    @property
    def truths(self) -> dict[str, Path]:
        """The ground truth of every task."""
        below = self.folder / "truths"
        files = {"coco-panoptic": below / "coco-panoptic" / "panoptic.json"}
        for task in ASKED:
            file = below / f"{task}.json"
            files.setdefault(task, file if file.exists() else below / task)
        return {**files, BENCH: self.folder / "bench" / "private"}

    def make_truth(self, references: Path, families: list[str]) -> None:
        """Cases, and what the references themselves answer, as each task's ground truth."""
        if (self.folder / "truths").exists():
            return
        named = [word for family in families for word in ("--family", family)]
        run(HERE / "prepare.py", references, "-o", self.folder / "references", *named)
        legoworld.bench_make(
            self.folder / "references", self.folder / "bench", size_wh=SIZE_WH, samples=SAMPLES,
            noise_seeds=0, keep_scenes=self.folder / "itself", workers=1,
        )  # fmt: skip
        runs, made = self.folder / "truth-runs", self.folder / "making-truths"
        shutil.rmtree(made, ignore_errors=True)
        made.mkdir()
        legoworld.readout(self.folder / "itself", runs, task=ASKED, workers=1)
        forms = {"amodal": "kins", "boxes3d": "omni3d", "coco": "coco", "coco-masks": "coco",
                 "lvis": "lvis"}  # fmt: skip
        for task, form in forms.items():
            legoworld.export(runs / task, made / f"{task}.json", format=form)
        legoworld.export(runs / "coco-panoptic", made / "coco-panoptic", format="panoptic")
        arrays = {"eth3d": "depth", "normals": "normals", "relations": "."}
        for task in ASKED:
            if task in arrays or task.endswith("semantic"):
                shutil.copytree(runs / task / arrays.get(task, "answer"), made / task)
        made.rename(self.folder / "truths")

    def ask(self, plan: list[dict[str, Any]]) -> None:
        """Make the copies of a plan that are missing, ask each every task, score the answers."""
        todo = [e for e in plan if not (self.folder / "copies" / e["name"]).exists()]
        if todo:
            making = self.folder / "making-copies"
            shutil.rmtree(making, ignore_errors=True)
            file = self.folder / "plan.json"
            file.write_text(json.dumps(todo), "utf-8")
            run(HERE / "copies.py", self.folder / "itself", "-o", making, "--plan", file)
            for entry in todo:
                target = self.folder / "copies" / entry["name"]
                target.parent.mkdir(exist_ok=True)
                (making / entry["name"]).rename(target)
        for entry in plan:
            self.score(entry["name"])
            print(entry["name"], flush=True)

    def score(self, copy: str) -> None:
        """Read a copy out for every task and score its answers, the bench last."""
        scenes, runs = self.folder / "copies" / copy, self.folder / "runs" / copy
        evals = self.folder / "evals" / copy
        if (evals / BENCH / "evidence.json").exists():
            return
        render = self.unrendered is not None and copy not in self.unrendered
        track = self.folder / "bench" / "public" / "track.json"
        legoworld.readout(scenes, runs, task=ASKED, workers=1, cache=False, overwrite=True)
        with few_samples():
            legoworld.readout(
                scenes, runs / BENCH, task=BENCH, track=track, workers=1, render=render,
                cache=False, overwrite=True,
            )  # fmt: skip
        for task, truth in self.truths.items():
            legoworld.evaluate(
                runs / task, evals / task, truth=truth, draws=2, workers=1, overwrite=True
            )

    def scale_of(self, copy: str) -> dict[str, float]:
        """Of each case the factor that makes a copy's median depth the reference's."""
        return {
            case.stem: float(np.median(depth(case) / depth(self.depths(copy) / case.name)))
            for case in sorted((self.folder / "truths" / "eth3d").glob("*.npz"))
        }

    def depths(self, copy: str) -> Path:
        """Where a copy's depth arrays are."""
        return self.folder / "runs" / copy / "eth3d" / "depth"


def depth(file: Path) -> np.ndarray:
    """A readout's depth; without a hit NaN, which a median over both would not survive: 1e9."""
    with np.load(file) as arrays:
        z: np.ndarray = arrays["depth_z_m"].astype(np.float64)
    return np.where(np.isfinite(z), z, 1e9)


@contextmanager
def few_samples() -> Iterator[None]:
    """The render card's pictures with fewer samples, in this process."""
    whole = submission.card_render

    def quick(*given: Any) -> Any:
        return replace(whole(*given), samples=CARD_SAMPLES)

    submission.card_render = quick
    try:
        yield
    finally:
        submission.card_render = whole


def run(*command: object) -> None:
    """A program of this folder; ends this one where it fails."""
    words = [sys.executable, *map(str, command)]
    subprocess.run(words, check=True, stdout=subprocess.DEVNULL)


if __name__ == "__main__":
    main()
