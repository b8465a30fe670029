"""Cost by a price card: where a transcript tells the tokens of the whole trial, never a guess."""

from __future__ import annotations

from pathlib import Path

import pytest
from msgspec.structs import replace

from legoworld.agents.prices import (
    PRICES,
    PriceCard,
    compute_usage,
    read_prices,
    recorded_usage,
    with_usage,
)
from legoworld.errors import CatalogError
from legoworld.records.agents import ApiRequest, TranscriptFormat, Usage
from legoworld.records.atif import AtifTrajectory
from legoworld.records.base import canonical, decode
from legoworld.trajectories.transcripts import join_trajectories, read_transcript, total_usage

TRANSCRIPTS = Path(__file__).parents[1] / "trajectories" / "transcripts"
CARD = """title = "of this test"
date = "2026-01-02"
[[model]]
names = ["m-1", "m-1-latest"]
source = "none"
input_usd = 2.0
cached_input_usd = 0.5
output_usd = 10.0
"""


@pytest.fixture
def card(tmp_path: Path) -> PriceCard:
    (tmp_path / "mine.toml").write_text(CARD)
    return read_prices(tmp_path / "mine.toml")


def transcript(kind: TranscriptFormat) -> AtifTrajectory:
    path = TRANSCRIPTS / f"{kind}.jsonl"
    return read_transcript(path, kind, agent=kind, version="1", prompt="Rebuild it.")


def test_tokens_are_priced_by_kind_and_the_card_is_named(card):
    usage = compute_usage(transcript("codex"), "m-1-latest", card)
    assert usage.cost_usd == round(((25763 - 24448) * 2.0 + 24448 * 0.5 + 152 * 10.0) / 1e6, 6)
    assert usage.cost_source == f"prices of 2026-01-02, {card.sha256[:12]}"
    found = decode(AtifTrajectory, canonical(with_usage(transcript("codex"), usage)))
    assert found.final_metrics
    assert found.final_metrics.total_cost_usd == usage.cost_usd
    assert found.final_metrics.extra == {
        "legoworld": {"tokens_source": "transcript", "cost_source": usage.cost_source}
    }


@pytest.mark.parametrize("model", [None, "m-2", "m-1-turbo"])
def test_an_unknown_model_has_no_cost(card, model):
    usage = compute_usage(transcript("codex"), model, card)
    assert (usage.cost_usd, usage.cost_source) == (None, None)
    assert usage.completion_tokens == 152


def test_the_transcript_s_own_cost_stands(card):
    usage = compute_usage(transcript("claude"), "m-1", card)
    assert (usage.cost_usd, usage.cost_source) == (0.0352, "transcript")
    totals = with_usage(transcript("claude"), usage).final_metrics
    assert totals
    assert (totals.total_cost_usd, totals.extra) == (
        0.0352, {"legoworld": {"tokens_source": "transcript"}},
    )  # fmt: skip


def request(**said) -> ApiRequest:
    known = {
        "number": 1, "at_s": 0.0, "seconds": 1.0, "wire": "chat", "model": "m-1", "status": 200,
        "ended": "whole", "prompt_tokens": 100, "cached_tokens": 40, "completion_tokens": 10,
    }  # fmt: skip
    return ApiRequest(**(known | said))


CUT = request(ended="cut", completion_tokens=None)
UNREACHED = request(status=None, ended="unreachable", model=None, prompt_tokens=None,
                    cached_tokens=None, completion_tokens=None)  # fmt: skip


def test_recorded_tokens_are_the_trajectory_s_and_priced_by_each_request_s_model(card):
    rows = [request(), request(model="m-1-latest"), UNREACHED, replace(UNREACHED, wire=None)]
    usage = recorded_usage(rows, card, Usage())
    assert (usage.prompt_tokens, usage.cached_tokens, usage.completion_tokens) == (200, 80, 20)
    assert usage.cost_usd == round(2 * (60 * 2.0 + 40 * 0.5 + 10 * 10.0) / 1e6, 6)
    found = with_usage(transcript("codex"), usage)
    assert total_usage(found).prompt_tokens == 200
    assert found.steps == transcript("codex").steps
    assert found.final_metrics
    assert found.final_metrics.extra == {
        "legoworld": {"tokens_source": "recorded", "requests": 4, "uncounted": 0,
                      "cost_source": card.source}
    }  # fmt: skip


@pytest.mark.parametrize("row", [CUT, request(model="m-2"), request(model=None)])
def test_a_cost_that_a_record_does_not_tell_is_the_transcript_s(card, row):
    usage = recorded_usage([request(), row], card, Usage(cost_usd=3.5, cost_source="transcript"))
    assert (usage.cost_usd, usage.cost_source) == (3.5, "transcript")
    assert usage.uncounted == (row is CUT)
    assert (usage.prompt_tokens, usage.completion_tokens) == (200, 10 if row is CUT else 20)
    assert recorded_usage([row], card, Usage()).cost_usd is None
    assert recorded_usage([], card, Usage()).cost_usd is None


def test_what_a_killed_agent_used_is_not_known(card, tmp_path):
    lines = (TRANSCRIPTS / "codex.jsonl").read_bytes().splitlines(keepends=True)
    killed = tmp_path / "killed.jsonl"
    killed.write_bytes(b"".join(line for line in lines if b"turn.completed" not in line))
    part = read_transcript(killed, "codex", agent="codex", version="1", prompt="Rebuild it.")
    assert compute_usage(part, "m-1", card).cost_usd is None
    both = join_trajectories([part, transcript("codex")])
    assert compute_usage(both, "m-1", card).cost_usd is None
    twice = compute_usage(
        join_trajectories([transcript("codex"), transcript("codex")]), "m-1", card
    )
    once = compute_usage(transcript("codex"), "m-1", card)
    assert twice.completion_tokens == 2 * 152
    assert twice.cost_usd == pytest.approx(2 * (once.cost_usd or 0.0))


def test_totals_of_two_models_have_no_cost(card):
    found = transcript("codex")
    last = replace(found.steps[-1], model_name="m-2")
    mixed = replace(found, steps=[*found.steps[:-1], last])
    assert compute_usage(mixed, "m-1", card).cost_usd is None


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("title = 1", "title"),
        (CARD.replace("2026-01-02", "yesterday"), "date"),
        (CARD.replace("2.0", "-2.0"), "input_usd"),
        (CARD + CARD.partition("[[model]]")[1] + CARD.partition("[[model]]")[2], "two prices"),
    ],
)
def test_a_card_that_cannot_be_used_says_why(tmp_path, text, said):
    (tmp_path / "mine.toml").write_text(text)
    with pytest.raises(CatalogError, match=said):
        read_prices(tmp_path / "mine.toml")


def test_the_shipped_card_is_dated_and_names_its_sources():
    about = read_prices(None).about
    assert read_prices(PRICES).about == about
    assert about.model
    assert all(price.source.startswith("https://") for price in about.model)
    assert all(price.cached_input_usd <= price.input_usd for price in about.model)
