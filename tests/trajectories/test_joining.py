"""A trial that was killed and continued, as one document."""

from __future__ import annotations

from legoworld.records.atif import AtifAgent, AtifFinalMetrics, AtifStep, AtifTrajectory
from legoworld.trajectories.transcripts import join_trajectories


def part(*messages, **totals):
    return AtifTrajectory(
        schema_version="ATIF-v1.6", session_id="s", agent=AtifAgent(name="a", version="1"),
        steps=[AtifStep(step_id=i, source="agent", message=m) for i, m in enumerate(messages, 1)],
        final_metrics=AtifFinalMetrics(**totals),
    )  # fmt: skip


def test_parts_follow_each_other_after_a_step_that_says_so():
    found = join_trajectories([part("a", "b"), part("c"), part("d")])
    assert [(s.step_id, s.source, s.message) for s in found.steps] == [
        (1, "agent", "a"),
        (2, "agent", "b"),
        (3, "system", "The run was killed; here its part 2 begins."),
        (4, "agent", "c"),
        (5, "system", "The run was killed; here its part 3 begins."),
        (6, "agent", "d"),
    ]
    assert found.final_metrics.total_steps == 6


def test_a_total_is_there_where_every_part_tells_it():
    first = part("a", total_prompt_tokens=10, total_completion_tokens=3, total_cost_usd=0.5)
    second = part("b", total_prompt_tokens=5, total_completion_tokens=4)
    found = join_trajectories([first, second]).final_metrics
    assert (found.total_prompt_tokens, found.total_completion_tokens) == (15, 7)
    assert not isinstance(found.total_cost_usd, float)


def test_one_part_is_itself():
    alone = part("a")
    assert join_trajectories([alone]) is alone
