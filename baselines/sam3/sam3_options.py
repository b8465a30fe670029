"""What card.toml lets a user set, checked for what a type cannot say."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from legoworld_baseline import Refused


@dataclass(frozen=True, kw_only=True)
class Limits:
    """min_score: candidates below it are left out. per_category, per_image: how many are kept.

    The order of every cut: score, highest first; then the lower category id; then the lower
    query of the network.
    """

    min_score: float
    per_category: int
    per_image: int


@dataclass(frozen=True, kw_only=True)
class Options:
    """prompts_at_once: phrases in one pass; prompt_names: a rule of `sam3_prompts`."""

    prompts_at_once: int
    prompt_names: str
    limits: Limits


def read_options(given: dict[str, Any]) -> Options:
    """The request's options. Refused for a value out of its range."""
    for name in ("prompts_at_once", "per_category", "per_image"):
        if given[name] < 1:
            raise Refused(
                "an option is not a positive integer",
                found=f"{name}={given[name]}",
                expected="1, 2, ...",
            )
    if not 0.0 <= given["min_score"] <= 1.0:
        raise Refused(
            "an option is not a score", found=f"min_score={given['min_score']}", expected="0 to 1"
        )
    return Options(
        prompts_at_once=given["prompts_at_once"],
        prompt_names=given["prompt_names"],
        limits=Limits(
            min_score=given["min_score"],
            per_category=given["per_category"],
            per_image=given["per_image"],
        ),
    )
