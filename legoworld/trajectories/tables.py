"""Means over trials, with intervals over families; and over the images that all agents share."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import Final

import numpy as np

from legoworld.evaluation.bootstrap import draw_groups, interval
from legoworld.records.trajectories import (
    AXES,
    CAUSES,
    AgentTable,
    Axis,
    Mean,
    TrajectoryScore,
)
from legoworld.trajectories.curves import q_at

SHARES: Final = tuple(n / 20 for n in range(21))
Value = Callable[[TrajectoryScore], float | None]


def _cause_regret(cause: str) -> Value:
    return lambda trial: trial.regret_split[cause]


#: name: what is averaged, over the trials where it is not None.
MEASURES: Final[dict[str, Value]] = {
    "final_q": lambda t: t.final_q,
    "best_q": lambda t: t.best_q,
    "regret": lambda t: t.regret if t.best_q is not None else None,
    "lowering_share": lambda t: t.n_lowering / len(t.edits) if t.edits else None,
    "lowering_r_share": lambda t: t.n_lowering_r / len(t.edits) if t.edits else None,
    "lowering_a_share": lambda t: t.n_lowering_a / len(t.edits) if t.edits else None,
    "first_s": lambda t: t.first.at_s if t.first else None,
    "first_wall_share": lambda t: t.first.wall_share if t.first else None,
    "first_calls_share": lambda t: t.first.calls_share if t.first else None,
    "first_tokens_share": lambda t: t.first.tokens_share if t.first else None,
    "picked_q": lambda t: t.picked_q,
    **{f"regret_{cause}": _cause_regret(cause) for cause in CAUSES},
}


def agent_tables(
    trials: Sequence[TrajectoryScore], *, draws: int, seed: int
) -> tuple[AgentTable, ...]:
    """One table for each agent, by name."""
    names = sorted({trial.agent for trial in trials})
    return tuple(
        _table(name, [t for t in trials if t.agent == name], draws=draws, seed=seed)
        for name in names
    )


def common_images(trials: Sequence[TrajectoryScore]) -> tuple[int, ...]:
    """The images that every agent left an evaluable trajectory of, in every one of its runs."""
    evaluable = [trial for trial in trials if trial.first is not None]
    sets = [
        {t.image_id for t in evaluable if (t.agent, t.run) == key}
        for key in {(t.agent, t.run) for t in trials}
    ]
    return tuple(sorted(set.intersection(*sets))) if sets else ()


def _table(agent: str, trials: Sequence[TrajectoryScore], *, draws: int, seed: int) -> AgentTable:
    return AgentTable(
        agent=agent,
        n_trials=len(trials),
        n_evaluable=sum(t.first is not None for t in trials),
        means={
            name: mean_over_families(trials, value, draws=draws, seed=seed)
            for name, value in MEASURES.items()
        },
        curves={axis: _curve(trials, axis, draws=draws, seed=seed) for axis in AXES},
    )


def _curve(trials: Sequence[TrajectoryScore], axis: Axis, *, draws: int, seed: int) -> list[Mean]:
    return [
        mean_over_families(trials, partial(q_at, axis=axis, share=share), draws=draws, seed=seed)
        for share in SHARES
    ]


def mean_over_families(
    trials: Sequence[TrajectoryScore], value: Value, *, draws: int, seed: int
) -> Mean:
    """The mean over the trials that have the value; families are resampled whole."""
    of_family = [(t.family, v) for t in trials if (v := value(t)) is not None]
    if not of_family:
        return Mean(value=None, n=0, interval=None)
    families = [family for family, _ in of_family]
    values = np.array([v for _, v in of_family], np.float64)
    samples = draw_groups(families, draws, seed).means(values, families)
    return Mean(
        value=float(np.mean(values)), n=len(values), interval=interval(samples, unit="family")
    )
