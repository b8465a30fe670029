"""trajectory.json: the Agent Trajectory Interchange Format (ATIF), read from v1.2 to v1.8.

https://github.com/harbor-framework/harbor/blob/main/rfcs/0001-trajectory-format.md. Everything that
a version may leave out is optional; what no version names is ignored, and goes into `extra` when
it is written.
"""

from __future__ import annotations

from typing import Any, Literal

from legoworld.records.base import UNSET, Record, UnsetType

#: What is written.
ATIF_VERSION = "ATIF-v1.6"
#: Text, or parts such as {"type": "text", "text": ...} and {"type": "image", "source": {...}}.
Content = str | list[dict[str, Any]]
Extra = dict[str, Any]


class AtifToolCall(Record, frozen=True, kw_only=True):
    """One call of a tool."""

    tool_call_id: str
    function_name: str
    arguments: dict[str, Any]
    extra: Extra | UnsetType | None = UNSET


class AtifResult(Record, frozen=True, kw_only=True):
    """What a call, or something that is no call, came back with."""

    source_call_id: str | UnsetType | None = UNSET
    content: Content | UnsetType | None = UNSET
    subagent_trajectory_ref: Any = UNSET
    extra: Extra | UnsetType | None = UNSET


class AtifObservation(Record, frozen=True, kw_only=True):
    """The results of a step's calls."""

    results: list[AtifResult]


class AtifMetrics(Record, frozen=True, kw_only=True):
    """A step's tokens and cost; prompt_tokens include the cached ones."""

    prompt_tokens: int | UnsetType | None = UNSET
    completion_tokens: int | UnsetType | None = UNSET
    cached_tokens: int | UnsetType | None = UNSET
    cost_usd: float | UnsetType | None = UNSET
    prompt_token_ids: list[int] | UnsetType | None = UNSET
    completion_token_ids: list[int] | UnsetType | None = UNSET
    logprobs: list[float] | UnsetType | None = UNSET
    extra: Extra | UnsetType | None = UNSET


class AtifStep(Record, frozen=True, kw_only=True):
    """A prompt, a message, or one turn of the agent with its calls. step_id: from 1."""

    step_id: int
    source: Literal["system", "user", "agent"]
    message: Content = ""
    timestamp: str | UnsetType | None = UNSET
    model_name: str | UnsetType | None = UNSET
    reasoning_effort: str | float | UnsetType | None = UNSET
    reasoning_content: str | UnsetType | None = UNSET
    tool_calls: list[AtifToolCall] | UnsetType | None = UNSET
    observation: AtifObservation | UnsetType | None = UNSET
    metrics: AtifMetrics | UnsetType | None = UNSET
    llm_call_count: int | UnsetType | None = UNSET
    is_copied_context: bool | UnsetType | None = UNSET
    extra: Extra | UnsetType | None = UNSET


class AtifAgent(Record, frozen=True, kw_only=True):
    """Who acted."""

    name: str
    version: str
    model_name: str | UnsetType | None = UNSET
    tool_definitions: list[dict[str, Any]] | UnsetType | None = UNSET
    extra: Extra | UnsetType | None = UNSET


class AtifFinalMetrics(Record, frozen=True, kw_only=True):
    """Sums over all steps."""

    total_prompt_tokens: int | UnsetType | None = UNSET
    total_completion_tokens: int | UnsetType | None = UNSET
    total_cached_tokens: int | UnsetType | None = UNSET
    total_cost_usd: float | UnsetType | None = UNSET
    total_steps: int | UnsetType | None = UNSET
    extra: Extra | UnsetType | None = UNSET


class AtifTrajectory(Record, frozen=True, kw_only=True):
    """The whole document."""

    schema_version: str
    agent: AtifAgent
    steps: list[AtifStep]
    session_id: str | UnsetType | None = UNSET
    trajectory_id: str | UnsetType | None = UNSET
    notes: str | UnsetType | None = UNSET
    final_metrics: AtifFinalMetrics | UnsetType | None = UNSET
    continued_trajectory_ref: str | UnsetType | None = UNSET
    subagent_trajectories: list[Any] | UnsetType | None = UNSET
    extra: Extra | UnsetType | None = UNSET
