"""Rewards as callables: TRL's `reward_funcs` and verl's `custom_reward_function`."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any

from legoworld_environments.cases import dataset_folder, program_of
from legoworld_environments.scorer import ScoringError, reward_of, shared_scorer

#: Completions that are executed at the same time.
AT_ONCE = 4


def lego_bench_reward(
    completions: Sequence[Any], image_id: Sequence[int], *, dataset: str | None = None,
    render: bool = False, **_columns: Any,
) -> list[float | None]:  # fmt: skip
    """TRL: the reward of each completion, R unless render. `image_id` is a column of the data.

    A completion is a text or a list of messages. What could not be scored is None, which TRL
    leaves out of the advantages; it is never a zero.
    """
    scorer = shared_scorer(dataset_folder(dataset), render=render)

    def reward(pair: tuple[Any, int]) -> float | None:
        completion, number = pair
        text = completion if isinstance(completion, str) else completion[-1]["content"]
        try:
            return reward_of(scorer.score_program(int(number), program_of(text)))
        except ScoringError:
            return None

    with ThreadPoolExecutor(AT_ONCE) as pool:
        return list(pool.map(reward, zip(completions, image_id, strict=True)))


def compute_score(
    data_source: str, solution_str: str, ground_truth: Any, extra_info: Any = None,
    *, dataset: str | None = None, render: bool = False,
) -> dict[str, Any]:  # fmt: skip
    """verl: `score`, V, R and what went wrong; ground_truth: image id. Raises ScoringError."""
    del data_source, extra_info
    scorer = shared_scorer(dataset_folder(dataset), render=render)
    answer = scorer.score_program(int(ground_truth), program_of(solution_str))
    why = answer["program_error"] or answer["reason"] or ""
    return {"score": reward_of(answer), "V": answer["V"], "R": answer["R"], "why": why}
