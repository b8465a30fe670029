"""Pairs of checkpoints that judges are shown: chosen by their gap, and the scores of each."""

from __future__ import annotations

from collections import Counter
from itertools import combinations
from pathlib import Path
from typing import Final

from legoworld.errors import LegoWorldError, cause
from legoworld.files import sha256_of_text
from legoworld.records.base import RecordError, decode
from legoworld.records.bench_results import Gap, JudgePair
from legoworld.records.trajectories import (
    TRAJECTORIES,
    ScoredScene,
    TrajectoryFile,
    TrajectoryScore,
)

#: Pairs of each builder at each kind of gap.
PAIRS_EACH: Final = 20
#: The submission's name beside the checkpoints' ordinals.
SUBMITTED: Final = "final"


class TrajectoryScoresError(LegoWorldError):
    """Scores of trajectories cannot be used."""

    code = "trajectory_scores"


def read_trajectories(folder: Path) -> TrajectoryFile:
    """trajectories.json of a folder of scores. TrajectoryScoresError."""
    try:
        return decode(TrajectoryFile, (folder / TRAJECTORIES).read_bytes())
    except (OSError, RecordError) as error:
        raise TrajectoryScoresError(
            f"{folder} holds no scores of trajectories",
            found=cause(error),
            expected=f"a folder of `legoworld trajectory score`, with {TRAJECTORIES}",
        ) from error


def trial_name(trial: TrajectoryScore) -> str:
    """A trial as an item of judgements."""
    return f"{trial.agent}/run_{trial.run}/{trial.scene}"


def scene_name(scene: ScoredScene) -> str:
    """A scene as one of the two shown."""
    return SUBMITTED if scene.ordinal is None else str(scene.ordinal)


def pair_scores(file: TrajectoryFile) -> dict[str, dict[str, tuple[float | None, float | None]]]:
    """R and A of every eligible scene, by its name and its trial's. TrajectoryScoresError."""
    repeated = [n for n, k in Counter(map(trial_name, file.trials)).items() if k > 1]
    if repeated:
        raise TrajectoryScoresError(
            "two trials have the same agent, run and scene",
            found=repeated[0],
            expected="trials that their names tell apart",
            next_step="score their folders apart, or repeat an agent's runs with --repeat",
        )
    scores: dict[str, dict[str, tuple[float | None, float | None]]] = {}
    for trial in file.trials:
        for scene in _eligible(trial):
            scores.setdefault(scene_name(scene), {})[trial_name(trial)] = scene.R, scene.A
    return scores


def choose_pairs(file: TrajectoryFile, seed: int) -> list[JudgePair]:
    """At most `PAIRS_EACH` of each builder and gap; which, and in what order shown, by the seed.

    A builder's pairs depend on the seed and on its own trajectories alone.
    """
    drawn: dict[tuple[str, Gap], dict[str, JudgePair]] = {}
    for trial in file.trials:
        for (i, first), (j, second) in combinations(enumerate(_eligible(trial)), 2):
            one, other, item = scene_name(first), scene_name(second), trial_name(trial)
            lot, gap = sha256_of_text(f"{seed} {item} {one} {other}"), _gap(j - i)
            shown = (one, other) if int(lot[-1], 16) % 2 else (other, one)
            pair = JudgePair(builder=trial.agent, item=item, gap=gap, shown=shown)
            drawn.setdefault((trial.agent, gap), {})[lot] = pair
    return [lots[lot] for _, lots in sorted(drawn.items()) for lot in sorted(lots)[:PAIRS_EACH]]


def _gap(edits: int) -> Gap:
    return "1-2" if edits <= 2 else "3-5" if edits <= 5 else ">=6"


def _eligible(trial: TrajectoryScore) -> list[ScoredScene]:
    """The scenes that edits join; the submission where it is not the last checkpoint."""
    own = any(edit.after is None for edit in trial.edits)
    return [s for s in trial.scenes if s.Q is not None and (own or s.ordinal is not None)]
