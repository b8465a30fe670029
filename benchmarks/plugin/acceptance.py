"""Which rule of acceptance makes scenes better? Edits of an agent that errs, by rule.

    python benchmarks/plugin/acceptance.py DATASET KEPT_SCENES [--workers 2]

DATASET and KEPT_SCENES: of `legoworld bench make references -o DATASET --size 480x270 --samples 16
--noise-seeds 0 --keep-scenes KEPT_SCENES`, over the families of examples/bench/build.py.

A scene begins with every object off its place, turned and scaled. An agent makes EDITS edits of one
object: most bring it part of the way home, the others throw it off; it cannot tell which. A rule
sees the plugin's reports before and after each edit and keeps the edit or rolls it back. The edits
are the same for each rule. R, A and S are told three times: of the edits as they are; "corrected",
with a refused edit replaced by the plugin's correction of the object, whole and then half, at most
ROUNDS times; and "limited", corrected and over after TRANSACTIONS edits. A is of small renders with
few samples (appearances.py). The copies, R and the evidence are those of copies.py: the rule never
sees the private half. Prints docs/plugin.md's tables.
"""

from __future__ import annotations

import argparse
import itertools
import sys
import tempfile
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from appearances import Appearances
from copies import (
    F64,
    PROTOCOL,
    StudyCase,
    about,
    moved,
    pictured,
    r_of,
    read_case,
    report_of,
    shift,
    turn,
)

from legoworld.evaluation.reconstruction.dataset import read_dataset
from legoworld.plugin.acceptance import list_worse
from legoworld.records import plugin_requirements as kinds
from legoworld.records.plugin_ledger import TransactionLimits
from legoworld.records.plugin_requirements import Report, Result
from legoworld.scene.blender_process import BlenderProcess, Limits

EDITS = 12
HARMFUL = (0.3, 0.6)
#: An edit that changes R by less is neither good nor harmful.
SAME_R = 1e-4
#: On these families the rule and its numbers were chosen; the others were held out.
CHOSEN_ON = ("bedroom", "crossing", "kitchen", "living_room")
TRANSACTIONS, ROUNDS = TransactionLimits().transactions, TransactionLimits().rounds
Rule = Callable[[Report, Report, str], bool]


@dataclass(frozen=True, kw_only=True)
class Pose:
    """An object against its place. offset: metres on the ground; yaw_deg; log_scale."""

    offset: tuple[float, float, float]
    yaw_deg: float
    log_scale: float

    def home(self, share: float) -> Pose:
        """What is left after a share of the way home."""
        x, y, z = (value * (1 - share) for value in self.offset)
        left = 1 - share
        return Pose(offset=(x, y, z), yaw_deg=self.yaw_deg * left, log_scale=self.log_scale * left)

    def motion(self, middle: F64) -> F64:
        """(4, 4) of the world, about the object's middle."""
        linear = turn(2, self.yaw_deg) * np.exp(self.log_scale)
        return shift(np.array(self.offset)) @ about(middle, linear)


Poses = dict[str, Pose]


def off(random: np.random.Generator, by: float) -> Pose:
    """Somewhere else: about `by` metres, 50 * `by` degrees and a factor of exp(by / 2)."""
    x, y, _ = random.normal(0, by, 3)
    return Pose(
        offset=(float(x), float(y), 0.0),
        yaw_deg=float(random.normal(0, 50 * by)),
        log_scale=float(random.normal(0, by / 2)),
    )


@dataclass(kw_only=True)
class Scene:
    """A case's copies by their poses: each is measured and rendered once."""

    study: StudyCase
    appearances: Appearances
    known: dict[tuple[Pose, ...], tuple[Report, float]] = field(default_factory=dict)

    def seen(self, poses: Poses) -> tuple[Report, float]:
        """What the plugin says, and R."""
        key = tuple(poses.values())
        if key not in self.known:
            copy = self.study.scene.snapshot
            for name, motion in self._motions(poses).items():
                copy = moved(copy, self.study.surfaces(name), motion)
            self.known[key] = report_of(self.study, copy), r_of(self.study, copy)
        return self.known[key]

    def scores(self, poses: Poses) -> tuple[float, float, float]:
        """R, A and S."""
        motions = {name: motion.tolist() for name, motion in self._motions(poses).items()}
        r, a = self.seen(poses)[1], self.appearances.a_of(motions, PROTOCOL.delta)
        return r, a, (r + a) / 2

    def _motions(self, poses: Poses) -> dict[str, F64]:
        return {name: pose.motion(self.study.middle(name)) for name, pose in poses.items()}


def edits(
    names: Sequence[str], random: np.random.Generator, harmful_share: float
) -> Iterator[tuple[str, bool, Pose, float]]:
    """Every edit: the object, whether it is thrown off, the pose it would get then, the share."""
    for _ in range(EDITS):
        harmful = bool(random.random() < harmful_share)
        name = str(random.choice(names))
        yield name, harmful, off(random, 0.4), float(random.uniform(0.4, 1.0))


# The rules.


def _of(report: Report, name: str) -> list[Result]:
    return [r for r in report.results if getattr(r.requirement, "entity", None) == name]


def _residual(result: Result) -> float:
    return np.inf if result.residual is None else result.residual


def _mean(results: Sequence[Result]) -> float:
    return float(np.mean([min(_residual(r) / (r.tolerance or 0.1), 10.0) for r in results]))


def no_rule(_before: Report, _after: Report, _name: str) -> bool:
    """Everything is kept."""
    return True


def absolute(_before: Report, after: Report, name: str) -> bool:
    """Every requirement of the edited object passes."""
    return all(r.verdict == "pass" for r in _of(after, name))


def passed_still_pass(before: Report, after: Report, _name: str) -> bool:
    """What passed passes."""
    return all(
        a.verdict == "pass" or b.verdict != "pass"
        for b, a in zip(before.results, after.results, strict=True)
    )


def mean_falls(before: Report, after: Report, name: str) -> bool:
    """The edited object's mean residual in tolerances falls."""
    return _mean(_of(after, name)) < _mean(_of(before, name))


def _overlaps(report: Report) -> dict[str, float]:
    return {
        r.requirement.entity: _residual(r)
        for r in report.results
        if isinstance(r.requirement, kinds.Overlap)
    }


def overlap_holds(before: Report, after: Report, name: str) -> bool:
    """The edited object's IoU does not fall."""
    return _overlaps(after)[name] <= _overlaps(before)[name]


def closer(before: Report, after: Report, name: str) -> bool:
    """The plugin's: what the edited object and half of what the others gain in closeness."""
    mine, others = (
        [[r for r in report.results if (r.requirement.entity == name) is own] for report in both]
        for own, both in ((True, (before, after)), (False, (before, after)))
    )
    return not list_worse(mine[0] + others[0], mine[1] + others[1], len(mine[0]))


RULES: dict[str, Rule] = {
    "none": no_rule,
    "every requirement passes its tolerance": absolute,
    "what passed still passes": passed_still_pass,
    "the object's mean residual falls": mean_falls,
    "its mask IoU does not fall": overlap_holds,
    "**closeness does not fall**": closer,
}


@dataclass(kw_only=True)
class Outcome:
    """What a rule did. ends: (R, A, S) as it was, corrected, limited, of each run."""

    good: int = 0
    refused: int = 0
    harmful: int = 0
    passed: int = 0
    ends: list[list[tuple[float, float, float]]] = field(default_factory=list)

    def count(self, gain: float, *, kept: bool) -> None:
        """Count an edit as the agent made it."""
        if gain > SAME_R:
            self.good += 1
            self.refused += not kept
        elif gain < -SAME_R:
            self.harmful += 1
            self.passed += kept

    def __iadd__(self, other: Outcome) -> Outcome:
        for name in ("good", "refused", "harmful", "passed", "ends"):
            setattr(self, name, getattr(self, name) + getattr(other, name))
        return self


def corrected(study: StudyCase, report: Report, name: str, pose: Pose, share: float) -> Pose | None:
    """A pose with a share of the overlap's correction applied, on the ground where it can be."""
    for result in _of(report, name):
        fix = result.correction
        if isinstance(result.requirement, kinds.Overlap) and fix is not None:
            unit = study.scene.snapshot.render.unit_scale
            x, y, z = np.array(pose.offset) + share * np.array(fix.on_ground_m or fix.move_m) / unit
            grown = float(np.log(np.clip(fix.scale or 1.0, 0.5, 2.0)))
            return replace(
                pose,
                offset=(float(x), float(y), float(z)),
                log_scale=pose.log_scale + share * grown,
            )
    return None


def walk(
    scene: Scene, seed: int, harmful_share: float, rule: Rule, rounds: int, outcome: Outcome
) -> list[Poses]:
    """The poses after each edit."""
    random = np.random.default_rng(seed)
    poses = {name: off(random, 0.3) for name in scene.study.names}
    made = []
    for name, harmful, thrown, share in edits(scene.study.names, random, harmful_share):
        before, r = scene.seen(poses)
        pose = thrown if harmful else poses[name].home(share)
        for attempt in range(1 + rounds):
            tried = {**poses, name: pose}
            after, then = scene.seen(tried)
            kept = rule(before, after, name)
            if not attempt:
                outcome.count(then - r, kept=kept)
            if kept:
                poses = tried
                break
            # Back to where it was, and from there by what the plugin says: whole, then half.
            better = corrected(scene.study, before, name, poses[name], 1 / (1 + attempt))
            if better is None:
                break
            pose = better
        made.append(poses)
    return made


def try_rules(scene: Scene, seeds: Sequence[int], harmful_share: float) -> dict[str, Outcome]:
    """Every rule over the same edits of one scene."""
    outcomes = {}
    for name, rule in RULES.items():
        outcome = outcomes[name] = Outcome()
        for seed in seeds:
            plain = walk(scene, seed, harmful_share, rule, 0, outcome)[-1]
            mended = walk(scene, seed, harmful_share, rule, ROUNDS, Outcome())
            ends = (plain, mended[-1], mended[TRANSACTIONS - 1])
            outcome.ends.append([scene.scores(poses) for poses in ends])
    return outcomes


def table(outcomes: dict[str, Outcome]) -> str:
    """Markdown, and how much the plugin's rule ends above the simplest, with its standard error."""
    rows = [
        "| rule | R, A, S | corrected | limited | good edits refused | harmful passed |",
        "|---|---|---|---|---:|---:|",
    ]
    for name, o in outcomes.items():
        means = np.mean(o.ends, axis=0)
        said = [", ".join(f"{v:.3f}".removeprefix("0") for v in mean) for mean in means]
        counts = [f"{o.refused} of {o.good}", f"{o.passed} of {o.harmful}"]
        rows.append(f"| {' | '.join([name, *said, *counts])} |")
    ours, simplest = (np.array(outcomes[n].ends)[..., 0] for n in list(outcomes)[:-3:-1])
    lead, runs = ours - simplest, len(ours)
    errors = lead.std(axis=0, ddof=1) / np.sqrt(runs)
    pairs = zip(lead.mean(axis=0), errors, strict=True)
    said = [f"{mean:+.3f} ({error:.3f})" for mean, error in pairs]
    return "\n".join([*rows, "", f"R above the IoU's rule, mean of {runs} runs: {', '.join(said)}"])


@dataclass(frozen=True, kw_only=True)
class Job:
    """One case to try all rules on."""

    dataset: Path
    kept: Path
    pictures: Path
    stem: str
    runs: int


@dataclass(frozen=True, kw_only=True)
class Tried:
    """itself: A of the scene unchanged; outcomes: by share and rule."""

    family: str
    itself: float
    outcomes: dict[float, dict[str, Outcome]]


def try_scene(job: Job) -> Tried:
    """Every rule on one case."""
    dataset = read_dataset(job.dataset / "private")
    case = next(c for c in dataset.cases.values() if c.stem == job.stem)
    blend = job.kept / case.stem / "scene.blend"
    with tempfile.TemporaryDirectory() as made:
        with BlenderProcess(Limits(time_s=600)) as blender:
            study = read_case(dataset, case, blend, Path(made) / "evidence", blender)
        photo = dataset.folders.reference(case)
        appearances = Appearances(blend, photo, job.pictures / case.stem)
        scene = Scene(study=pictured(study), appearances=appearances)
        seeds = range(job.runs)
        tried = Tried(
            family=case.stem.split("__")[0],
            itself=appearances.a_of({}, PROTOCOL.delta),
            outcomes={share: try_rules(scene, seeds, share) for share in HARMFUL},
        )
        appearances.close()
    print(f"{case.stem}: {len(study.names)} objects", file=sys.stderr, flush=True)
    return tried


def main() -> None:
    """Run every rule over the same edits, print the tables."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("dataset", type=Path)
    parser.add_argument("scenes", type=Path)
    parser.add_argument("--only", default="__hard__view_00")
    parser.add_argument("--runs", type=int, default=2, help="of each scene: seeds from 0")
    parser.add_argument("--pictures", type=Path, help="renders that stay [default: none do]")
    parser.add_argument("--workers", type=int, default=1, help="processes, one a scene")
    chosen = parser.parse_args()
    cases = read_dataset(chosen.dataset / "private").cases.values()
    with tempfile.TemporaryDirectory() as made, ProcessPoolExecutor(chosen.workers) as pool:
        pictures = chosen.pictures or Path(made)
        jobs = [
            Job(
                dataset=chosen.dataset,
                kept=chosen.scenes,
                pictures=pictures,
                stem=case.stem,
                runs=chosen.runs,
            )
            for case in cases
            if chosen.only in case.stem
        ]
        tried = list(pool.map(try_scene, jobs))
    print(f"A of the scenes as themselves: {np.mean([t.itself for t in tried]):.3f}")
    held_out = [t for t in tried if t.family not in CHOSEN_ON]
    for share, (whose, some) in itertools.product(
        HARMFUL, (("all", tried), ("held-out", held_out))
    ):
        sums = {name: Outcome() for name in RULES}
        for one in some:
            for name, outcome in one.outcomes[share].items():
                sums[name] += outcome
        if some:
            print(f"\n{share:.0%} harmful, {len(some)} scenes ({whose})\n\n{table(sums)}")


if __name__ == "__main__":
    main()
