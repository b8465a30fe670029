"""Q over time: the first evaluable scene, the edits that lower it, regret, and what caused each.

Everything here is a function of rows; nothing is read and nothing is run.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from legoworld.records.trajectories import (
    CAUSES,
    Axis,
    Cause,
    Edit,
    Moment,
    ScoredScene,
    TrajectoryScore,
)

#: A smaller change of Q is none.
TIE: Final = 1e-6


@dataclass(frozen=True, kw_only=True)
class Trajectory:
    """A trial's scored scenes. checkpoints: in order; final: the submission."""

    image_id: int
    scene: str
    family: str
    agent: str
    run: int
    seconds: float
    checkpoints: Sequence[ScoredScene]
    final: ScoredScene


def score_trajectory(trajectory: Trajectory) -> TrajectoryScore:
    """The diagnostics of one trial.

    The submission is the last scene: an edit leads to it where it differs from the last checkpoint.
    A submission that is not eligible has Q_T = 0, and all its regret is validity's. Regret is over
    the checkpoints and the submission, and so never below 0.
    """
    scenes = [*trajectory.checkpoints, trajectory.final]
    eligible = [scene for scene in scenes if scene.Q is not None]
    edits = list_edits(scenes)
    final_q = trajectory.final.Q or 0.0
    best = max(eligible, key=lambda scene: scene.Q or 0.0, default=None)
    best_q = best.Q if best else None
    regret = max((best_q or 0.0) - final_q, 0.0)
    return TrajectoryScore(
        image_id=trajectory.image_id,
        scene=trajectory.scene,
        family=trajectory.family,
        agent=trajectory.agent,
        run=trajectory.run,
        seconds=trajectory.seconds,
        scenes=tuple(scenes),
        edits=tuple(edits),
        first=eligible[0].when if eligible else None,
        n_lowering=sum(edit.d_q < -TIE for edit in edits),
        n_lowering_r=sum(edit.d_r < -TIE for edit in edits),
        n_lowering_a=sum(edit.d_a < -TIE for edit in edits),
        best=best.ordinal if best else None,
        best_q=best_q,
        final_valid=trajectory.final.Q is not None,
        final_q=final_q,
        regret=regret,
        regret_split=_split(trajectory, best, edits, regret),
    )


def list_edits(scenes: Sequence[ScoredScene]) -> list[Edit]:
    """Consecutive eligible scenes. A submission equal to the last checkpoint is no edit."""
    edits, before, skipped = [], None, 0
    for scene in scenes:
        if scene.Q is None:
            skipped += 1
            continue
        if before is not None and not _is_same(before, scene):
            edits.append(_edit(before, scene, skipped))
        before, skipped = scene, 0
    return edits


def _is_same(before: ScoredScene, scene: ScoredScene) -> bool:
    same = (before.R, before.A, before.snapshot_sha256, before.camera_sha256)
    return scene.ordinal is None and same == (
        scene.R, scene.A, scene.snapshot_sha256, scene.camera_sha256
    )  # fmt: skip


def _edit(before: ScoredScene, after: ScoredScene, skipped: int) -> Edit:
    d_r = (after.R or 0.0) - (before.R or 0.0)
    d_a = (after.A or 0.0) - (before.A or 0.0)
    d_q = (d_r + d_a) / 2
    causes: dict[str, float] = dict.fromkeys(CAUSES, 0.0)
    for cause, part in _causes(before, after, d_r / 2, d_a / 2):
        causes[cause] += part
    assert before.ordinal is not None
    return Edit(
        before=before.ordinal,
        after=after.ordinal,
        call=after.call,
        d_q=d_q,
        d_r=d_r,
        d_a=d_a,
        skipped=skipped,
        cause=causes,
    )


def _causes(
    before: ScoredScene, after: ScoredScene, of_r: float, of_a: float
) -> list[tuple[Cause, float]]:
    """Which kind of change has which part of an edit.

    A moved camera gets all of the change. Otherwise changed geometry has R's
    half, and A's half is appearance's, unless nothing but geometry can have changed it: R and A
    fell or rose together. Unchanged geometry leaves appearance.
    """
    if before.camera_sha256 != after.camera_sha256:
        return [("camera", of_r), ("camera", of_a)]
    if before.snapshot_sha256 != after.snapshot_sha256:
        together = of_r * of_a > 0
        return [("geometry", of_r), ("geometry" if together else "appearance", of_a)]
    return [("appearance", of_r), ("appearance", of_a)]


def _split(
    trajectory: Trajectory, best: ScoredScene | None, edits: Sequence[Edit], regret: float
) -> dict[str, float]:
    """Regret by cause: what the edits after the best scene took, less what they gave."""
    split: dict[str, float] = dict.fromkeys(CAUSES, 0.0)
    if best is None or regret <= 0:
        return split
    if trajectory.final.Q is None:
        return {**split, "validity": regret}
    order = {
        scene.ordinal: n for n, scene in enumerate([*trajectory.checkpoints, trajectory.final])
    }
    for edit in edits:
        if order[edit.before] >= order[best.ordinal]:
            for cause, part in edit.cause.items():
                split[cause] -= part
    return split


def q_at(score: TrajectoryScore, axis: Axis, share: float) -> float | None:
    """Q of the last eligible checkpoint within a share of the budget, 0 before the first.

    At 1 it is the submission's. None where the axis is not counted.
    """
    if share >= 1:
        return score.final_q
    q = 0.0
    for scene in score.scenes[:-1]:
        at = axis_share(scene.when, axis)
        if at is None:
            return None
        if at <= share and scene.Q is not None:
            q = scene.Q
    return q


def axis_share(when: Moment, axis: Axis) -> float | None:
    """Position on one of the three axes."""
    if axis == "tokens":
        return when.tokens_share
    return when.wall_share if axis == "wall" else when.calls_share


def moments(
    at_s: Sequence[float],
    calls: Sequence[int],
    *,
    seconds: float,
    n_calls: int,
    tokens: Sequence[tuple[int, int]],
) -> list[Moment]:
    """The moments of scenes that followed these calls.

    tokens: (call, output tokens until it was made) in order, the last with the trial's total;
    empty where they are not counted.
    """
    total = tokens[-1][1] if tokens else 0
    moments = []
    for at, call in zip(at_s, calls, strict=True):
        until = max((used for number, used in tokens if number <= call), default=0)
        moments.append(
            Moment(
                at_s=at,
                wall_share=min(at / seconds, 1.0) if seconds > 0 else 1.0,
                calls_share=call / n_calls if n_calls else 1.0,
                tokens_share=until / total if total else None,
            )
        )
    return moments


def drops(score: TrajectoryScore) -> list[Edit]:
    """The edits that lowered Q, worst first."""
    return sorted((e for e in score.edits if e.d_q < -TIE), key=lambda e: e.d_q)
