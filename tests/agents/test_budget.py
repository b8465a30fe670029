"""Budgets of calls, tokens and dollars: what they are read from, and trials that end at them."""

from __future__ import annotations

import json
import sys
from dataclasses import replace
from types import SimpleNamespace

import pytest
from agents.tracks import SMALL, make_track, plan, run, server_or_skip, steps_file
from msgspec.structs import replace as replace_record
from waiting import until

from legoworld import cli
from legoworld.agents.agent_cards import load_agent, read_agent_card
from legoworld.agents.budget import (
    BudgetNotWatchedError,
    BudgetWatch,
    plan_budget,
    read_usage,
    recorded_so_far,
    unheld,
    used_tokens,
)
from legoworld.agents.prices import PriceCard
from legoworld.agents.trial import _usage_so_far
from legoworld.agents.unfinished_trial import UnfinishedTrial
from legoworld.endpoint.trial_record import write_rows
from legoworld.errors import UsageError
from legoworld.records.agents import ApiRequest, Budget, ModelPrice, PriceCardFile, Usage
from legoworld.trajectories.folder import TRIAL, read_trial

PRICES = PriceCard(
    about=PriceCardFile(
        title="t",
        date="2026-11-01",
        model=(
            ModelPrice(
                names=("m",), source="s", input_usd=10.0, cached_input_usd=1.0, output_usd=100.0
            ),
        ),
    ),
    sha256="0" * 64,
)


def claude_line(number, prompt, cached, completion):
    usage = {
        "input_tokens": prompt, "cache_read_input_tokens": cached, "output_tokens": completion,
    }  # fmt: skip
    message = {"id": f"m{number}", "role": "assistant", "content": [], "usage": usage}
    return json.dumps({"type": "assistant", "message": message}) + "\n"


def test_an_unfinished_transcript_tells_tokens_and_the_price_card_dollars(tmp_path):
    first, second = tmp_path / "transcript-1", tmp_path / "transcript"
    first.write_text(claude_line(1, 100_000, 0, 10))
    second.write_text(claude_line(2, 50_000, 100_000, 1_000) + '{"type": "assis')
    used = read_usage([first, second], "claude", "m", PRICES)
    assert used.prompt_tokens == 250_000
    assert used_tokens(used) == 251_010
    assert used.cost_usd == pytest.approx(1.0 + 0.5 + 0.1 + 0.101)
    assert read_usage([first], "claude", "unknown", PRICES).cost_usd is None
    nothing = read_usage([tmp_path / "none"], "claude", "m", PRICES)
    assert (nothing.prompt_tokens, used_tokens(nothing)) == (None, None)


def test_a_cost_that_the_transcript_tells_goes_before_the_card(tmp_path):
    part = {"tokens": {"input": 5, "output": 6}, "cost": 0.25}
    lines = [
        {"type": "text", "part": {"text": "so"}},
        {"type": "step_finish", "part": part},
    ]
    (tmp_path / "t").write_text("".join(json.dumps(line) + "\n" for line in lines))
    used = read_usage([tmp_path / "t"], "opencode", "m", PRICES)
    assert (used_tokens(used), used.cost_usd) == (11, 0.25)


def test_a_recorder_counts_while_the_transcript_says_nothing(tmp_path):
    unfinished = UnfinishedTrial(folder=tmp_path, stays=True)
    (unfinished.scene_folder / TRIAL).mkdir(parents=True)
    plan = SimpleNamespace(record=True, prices=PRICES, model="m", card=load_agent("codex"))
    rows = [
        ApiRequest(
            number=number, at_s=1.0, wire="responses", status=200, seconds=1.0, ended="whole",
            model="m", prompt_tokens=1000, cached_tokens=0, completion_tokens=number,
        )
        for number in (10, 20)
    ]  # fmt: skip
    write_rows(unfinished.scene_folder / TRIAL / "requests.jsonl", rows)
    used = _usage_so_far(plan, unfinished)
    assert used_tokens(used) == 2030
    assert used.cost_usd == pytest.approx(0.02 + 0.003)


def test_a_request_that_was_not_counted_does_not_end_the_budget_of_dollars():
    whole = ApiRequest(
        number=1, at_s=1.0, wire="chat", status=200, ended="whole", model="m",
        prompt_tokens=1000, cached_tokens=0, completion_tokens=20,
    )  # fmt: skip
    cut = ApiRequest(number=2, at_s=2.0, wire="chat", status=200, model="m")
    other = replace_record(whole, number=3, model="unknown")
    so_far = [recorded_so_far([whole, one], Usage(), PRICES).cost_usd for one in (cut, other)]
    assert so_far == pytest.approx([0.012, 0.012])
    stated = recorded_so_far([whole, other], Usage(cost_usd=0.5), PRICES)
    assert stated.cost_usd == 0.5


def test_a_budget_that_nothing_counts_is_named():
    asked = Budget(calls=5, tokens=9, cost_usd=1.0)
    assert unheld(asked, Usage(prompt_tokens=3, cost_usd=0.5)) == ()
    assert unheld(asked, Usage()) == (
        "the budget was not held to: no tokens are known",
        "the budget was not held to: no dollars are known",
    )
    past = Usage(prompt_tokens=0, completion_tokens=0, tokens_source="recorded", requests=0)
    assert unheld(Budget(tokens=9), past) == ("the budget was not held to: no tokens are known",)
    assert unheld(Budget(calls=5), Usage()) == ()


@pytest.mark.parametrize(
    ("budget", "used", "over"),
    [
        (Budget(tokens=100), Usage(prompt_tokens=60, completion_tokens=40), "tokens"),
        (Budget(tokens=101, cost_usd=2.0), Usage(prompt_tokens=100, cost_usd=2.5), "cost"),
        (Budget(tokens=10, cost_usd=1.0), Usage(), None),
    ],
)
def test_what_is_spent_ends_the_agent_and_is_remembered(budget, used, over):
    ended = []
    looked = []
    watch = BudgetWatch(budget, refused=lambda: False, usage=lambda: looked.append(1) or used)
    with watch.ends(lambda: ended.append(1)):
        until(lambda: ended if over else len(looked) > 1)
    assert watch.over == over
    assert bool(ended) == (over is not None)


def test_a_budget_that_cannot_be_watched_ends_the_agent_and_is_said():
    ended = []

    def unreadable():
        raise ValueError("no number")

    watch = BudgetWatch(Budget(tokens=9), refused=lambda: False, usage=unreadable)
    with (
        pytest.raises(BudgetNotWatchedError, match="agent was ended; found: ValueError: no number"),
        watch.ends(lambda: ended.append(1)),
    ):
        until(lambda: ended)
    assert watch.over is None


def test_a_budget_is_the_card_s_unless_another_is_asked_for(tmp_path):
    codex = load_agent("codex")
    card = tmp_path / "own.toml"
    text = codex.path.read_text().replace('name = "codex"', 'name = "own"')
    text = text.replace('[transcript]\nformat = "codex"', '[transcript]\nformat = "claude"')
    card.write_text(text + "\n[budget]\ncalls = 40\ntokens = 1000\n")
    own = read_agent_card(card)
    assert plan_budget(own, Budget(), record=False) == Budget(calls=40, tokens=1000)
    asked = Budget(calls=5, cost_usd=1.0)
    assert plan_budget(own, asked, record=False) == Budget(calls=5, tokens=1000, cost_usd=1.0)
    assert plan_budget(codex, Budget(calls=3), record=False) == Budget(calls=3)
    with pytest.raises(UsageError, match=r"codex cannot be held .*counts them when it has ended"):
        plan_budget(codex, Budget(tokens=5), record=False)
    with pytest.raises(UsageError, match="cannot be held"):
        plan_budget(load_agent("gemini"), Budget(cost_usd=5), record=False)
    assert plan_budget(codex, Budget(tokens=5), record=True) == Budget(tokens=5)


@pytest.mark.blender
def test_a_trial_ends_at_its_calls_and_keeps_what_they_built(tmp_path):
    """The server's own question is the first call; the fourth is refused."""
    server_or_skip()
    make_track(tmp_path, ["one"], task="bench")
    add = "bpy.ops.mesh.primitive_cube_add(location=({}, 3, 0))"
    codes = [f"{SMALL}\n{add.format(0)}", *(add.format(n) for n in range(1, 400))]
    steps_file(tmp_path / "programs" / "one.steps.jsonl", codes)
    made = replace(plan(tmp_path), budget=Budget(calls=3))
    (row,) = run(made, tmp_path / "scenes")
    about = read_trial(tmp_path / "scenes" / "one").about
    assert (row.status, row.calls, row.checkpoints) == ("ok", 3, 2)
    assert (about.ended, about.exit_code, about.budget) == ("calls", None, made.budget)
    assert row.reason == "the agent: ended at its calls limit"
    with pytest.raises(UsageError, match=r"another campaign.*budget calls 3;.*budget none"):
        run(plan(tmp_path), tmp_path / "scenes")
    (kept,) = run(made, tmp_path / "scenes")
    assert kept.kept


#: An agent that asks its model again and again, and is never done.
TALKS = """
import json, sys, time
number = 0
while True:
    number += 1
    usage = {"input_tokens": 100, "output_tokens": 5}
    message = {"id": f"m{number}", "role": "assistant", "model": "m", "content": [], "usage": usage}
    print(json.dumps({"type": "assistant", "message": message}), flush=True)
    time.sleep(0.05)
"""
CARD = """
name = "talks"
title = "Talks"
version = "1"
documentation = "none"
run = true
checked = "here"
command = ["{python}", "{program}"]
shown = ["{program}"]
network = false
time_limit_s = 900.0

[mcp]
format = "mcp_servers"
path = "{{home}}/mcp.json"

[transcript]
format = "claude"

[needs]
install = "nothing"
"""


@pytest.mark.blender
def test_a_trial_ends_at_its_tokens_while_its_agent_talks(tmp_path, capsys):
    server_or_skip()
    make_track(tmp_path, ["one"], task="bench")
    (tmp_path / "card").mkdir()
    program = tmp_path / "card" / "talks.py"
    program.write_text(TALKS)
    card = tmp_path / "card" / "talks.toml"
    card.write_text(CARD.format(python=sys.executable, program=program))
    words = ["reconstruct", str(tmp_path / "track.json"), "--photos", str(tmp_path / "photos")]
    words += ["--agent", str(card), "-o", str(tmp_path / "scenes")]
    budget = ["--max-tokens", "700", "--max-cost", "9.5", "--max-calls", "50"]
    assert cli.run([*words, *budget, "--json"]) == 1
    (row,) = json.loads(capsys.readouterr().out)["trials"]
    about = read_trial(tmp_path / "scenes" / "one").about
    assert (about.ended, row["status"]) == ("tokens", "no_scene")
    assert "ended at its tokens limit" in row["reason"]
    assert used_tokens(about.usage) >= 700
    assert about.budget == Budget(calls=50, tokens=700, cost_usd=9.5)
