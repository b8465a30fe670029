"""Which rule of acceptance makes scenes better? Edits of an agent that errs, by rule.

    python benchmarks/plugin/acceptance.py DATASET KEPT_SCENES [--only __hard__view_00] [--each 2]

A scene begins with every object off its place, turned and scaled. An agent makes EDITS edits of one
object: most bring it part of the way home, the others throw it off; it cannot tell which. A rule
sees the plugin's reports before and after each edit and keeps the edit or rolls it back. R and the
share of good edits refused and of harmful ones passed are told for each rule, over the same edits.
The copies, R and the evidence are those of copies.py: the rule never sees the private half.
"""

from __future__ import annotations

import argparse
import itertools
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from copies import F64, StudyCase, about, moved, r_of, read_case, report_of, shift, turn

from legoworld.evaluation.reconstruction.dataset import read_dataset
from legoworld.records import plugin_requirements as kinds
from legoworld.records.plugin_requirements import Report, Result
from legoworld.scene.blender_process import BlenderProcess, Limits
from legoworld.scene.snapshot import Snapshot

EDITS = 12
#: An edit that changes R by less is neither good nor harmful.
SAME_R = 1e-4
Rule = Callable[[Report, Report, str], bool]


@dataclass(frozen=True, kw_only=True)
class Pose:
    """An object against its place. offset: metres on the ground; yaw_deg; log_scale."""

    offset: F64
    yaw_deg: float
    log_scale: float

    def home(self, share: float) -> Pose:
        """What is left after a share of the way home."""
        left = 1 - share
        return Pose(
            offset=self.offset * left,
            yaw_deg=self.yaw_deg * left,
            log_scale=self.log_scale * left,
        )


def off(random: np.random.Generator, by: float) -> Pose:
    """Somewhere else: about `by` metres, 50 * `by` degrees and a factor of exp(by / 2)."""
    return Pose(
        offset=np.asarray(random.normal(0, by, 3) * [1, 1, 0]),
        yaw_deg=float(random.normal(0, 50 * by)),
        log_scale=float(random.normal(0, by / 2)),
    )


def scene_of(study: StudyCase, poses: dict[str, Pose]) -> Snapshot:
    """The case with every object where its pose says."""
    copy = study.scene.snapshot
    for name, pose in poses.items():
        linear = turn(2, pose.yaw_deg) * np.exp(pose.log_scale)
        motion = shift(pose.offset) @ about(study.middle(name), linear)
        copy = moved(copy, study.surfaces(name), motion)
    return copy


def edits(
    study: StudyCase, random: np.random.Generator, harmful_share: float
) -> list[tuple[str, bool, Pose, float]]:
    """Every edit: the object, whether it is thrown off, the pose it would get then, the share."""
    made = []
    for _ in range(EDITS):
        harmful = bool(random.random() < harmful_share)
        name = str(random.choice(study.names))
        made.append((name, harmful, off(random, 0.4), float(random.uniform(0.4, 1.0))))
    return made


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


def overlaps_hold(slack: float) -> Rule:
    """Neither the edited object's IoU falls nor, beyond a slack, another's."""

    def rule(before: Report, after: Report, name: str) -> bool:
        was, now = _overlaps(before), _overlaps(after)
        return now[name] <= was[name] and all(now[n] <= was[n] + slack for n in was)

    return rule


def votes(before: Report, after: Report, name: str) -> bool:
    """More of the edited object's residuals fall than rise, and its IoU does not fall."""
    pairs = zip(_of(before, name), _of(after, name), strict=True)
    fall = [np.sign(_residual(b) - _residual(a)) for b, a in pairs if b.residual != a.residual]
    return overlap_holds(before, after, name) and sum(fall) >= 0


def all_hold(slack: float) -> Rule:
    """No residual of the edited object rises by more than a share of its tolerance."""

    def rule(before: Report, after: Report, name: str) -> bool:
        pairs = zip(_of(before, name), _of(after, name), strict=True)
        return all(_residual(a) <= _residual(b) + slack * a.tolerance for b, a in pairs)

    return rule


def votes_and_others(slack: float) -> Rule:
    """`votes`, and no other object's IoU falls beyond a slack."""

    def rule(before: Report, after: Report, name: str) -> bool:
        was, now = _overlaps(before), _overlaps(after)
        return votes(before, after, name) and all(now[n] <= was[n] + slack for n in was)

    return rule


RULES: dict[str, Rule] = {
    "none": no_rule,
    "absolute tolerances": absolute,
    "what passed still passes": passed_still_pass,
    "mean residual falls": mean_falls,
    "IoU does not fall": overlap_holds,
    "no residual rises by .1": all_hold(0.1),
    "IoU and votes": votes,
    "IoU and votes, others .05": votes_and_others(0.05),
}
#: Refused edits that a transaction may correct before it is rolled back.
ROUNDS = 2


@dataclass(kw_only=True)
class Counts:
    """What a rule did with edits that raise R, and with those that lower it."""

    good: int = 0
    refused: int = 0
    harmful: int = 0
    passed: int = 0

    def add(self, gain: float, *, kept: bool) -> None:
        """Count an edit as it was first made."""
        if gain > SAME_R:
            self.good += 1
            self.refused += not kept
        elif gain < -SAME_R:
            self.harmful += 1
            self.passed += kept


def corrected(study: StudyCase, report: Report, name: str, pose: Pose, share: float) -> Pose | None:
    """A pose with a share of the overlap's correction applied, on the ground where it can be."""
    for result in _of(report, name):
        fix = result.correction
        if isinstance(result.requirement, kinds.Overlap) and fix is not None:
            move = np.array(fix.on_ground_m or fix.move_m) / study.scene.snapshot.render.unit_scale
            grown = float(np.log(np.clip(fix.scale or 1.0, 0.5, 2.0)))
            return replace(
                pose,
                offset=pose.offset + share * move,
                log_scale=pose.log_scale + share * grown,
            )
    return None


def run(
    study: StudyCase, seed: int, harmful_share: float, rule: Rule, rounds: int, counts: Counts
) -> float:
    """R of the scene that the rule ends with."""
    random = np.random.default_rng(seed)
    poses = {name: off(random, 0.3) for name in study.names}
    planned = edits(study, random, harmful_share)
    shown = scene_of(study, poses)
    before, r = report_of(study, shown), r_of(study, shown)
    for name, harmful, thrown, share in planned:
        pose = thrown if harmful else poses[name].home(share)
        for attempt in range(1 + rounds):
            tried = {**poses, name: pose}
            copy = scene_of(study, tried)
            after, then = report_of(study, copy), r_of(study, copy)
            kept = rule(before, after, name)
            if not attempt:
                counts.add(then - r, kept=kept)
            if kept:
                poses, before, r = tried, after, then
            if kept or attempt == rounds:
                break
            # Back to where it was, and from there by what the plugin says: whole, then half.
            better = corrected(study, before, name, poses[name], 1 / (1 + attempt))
            if better is None:
                break
            pose = better
    return r


def follow(study: StudyCase, seed: int, rule: Rule) -> float:
    """R after as many edits that take the worst object's correction, each kept by a rule."""
    random = np.random.default_rng(seed)
    poses = {name: off(random, 0.3) for name in study.names}
    shown = scene_of(study, poses)
    before, r = report_of(study, shown), r_of(study, shown)
    tried: dict[str, int] = {}
    for _ in range(EDITS):
        worst = max(study.names, key=lambda n: _mean(_of(before, n)) / 2 ** tried.get(n, 0))
        tried[worst] = tried.get(worst, 0) + 1
        pose = corrected(study, before, worst, poses[worst], 1.0)
        if pose is None:
            continue
        copy = scene_of(study, {**poses, worst: pose})
        after = report_of(study, copy)
        if rule(before, after, worst):
            poses, before, r = {**poses, worst: pose}, after, r_of(study, copy)
    return r


def main() -> None:
    """Run every rule over the same edits, print a table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("dataset", type=Path)
    parser.add_argument("scenes", type=Path)
    parser.add_argument("--only", default="__hard__view_00")
    parser.add_argument("--each", type=int, default=2, help="scenes of each family")
    parser.add_argument("--first", type=int, default=0, help="the first seed")
    parser.add_argument("--families", default="", help="separated by commas [default: all]")
    parser.add_argument("--rules", default="", help="separated by semicolons [default: all]")
    chosen = parser.parse_args()
    rules = {n: r for n, r in RULES.items() if not chosen.rules or n in chosen.rules.split(";")}
    dataset = read_dataset(chosen.dataset / "private")
    wanted = set(chosen.families.split(",")) - {""}
    studies = []
    with tempfile.TemporaryDirectory() as made, BlenderProcess(Limits(time_s=600)) as blender:
        for case in dataset.cases.values():
            if chosen.only in case.stem and (not wanted or case.stem.split("__")[0] in wanted):
                blend = chosen.scenes / case.stem / "scene.blend"
                study = read_case(dataset, case, blend, Path(made) / case.stem, blender)
                four = tuple(r for r in study.requirements if not isinstance(r, kinds.DepthOrder))
                studies.append(replace(study, requirements=four))
    seeds = range(chosen.first, chosen.first + chosen.each)
    for name in ("none", "IoU does not fall", "IoU and votes"):
        ends = [follow(study, seed, RULES[name]) for study in studies for seed in seeds]
        print(f"corrections alone, {name}: R {np.mean(ends):.3f}", flush=True)
    for share in (0.3, 0.6):
        print(f"{share:.0%} harmful, {len(studies)} scenes, {chosen.each} runs each")
        for (name, rule), rounds in itertools.product(rules.items(), (0, ROUNDS)):
            counts = Counts()
            if rounds and name == "none":
                continue
            ends = [
                run(study, seed, share, rule, rounds, counts) for study in studies for seed in seeds
            ]
            said = name + (", corrected" if rounds else "")
            print(
                f"  {said:40s} R {np.mean(ends):.3f}  good refused {counts.refused} of "
                f"{counts.good}, harmful passed {counts.passed} of {counts.harmful}",
                flush=True,
            )


if __name__ == "__main__":
    main()
