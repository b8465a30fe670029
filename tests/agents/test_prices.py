"""Cost by a price card: where a transcript tells the tokens of the whole trial, never a guess."""

from __future__ import annotations

from pathlib import Path

import pytest
from msgspec.structs import replace

from legoworld.agents.prices import PRICES, PriceCard, compute_usage, read_prices, with_cost
from legoworld.errors import CatalogError
from legoworld.records.agents import TranscriptFormat
from legoworld.records.atif import AtifTrajectory
from legoworld.records.base import canonical, decode
from legoworld.trajectories.join_parts import join_trajectories
from legoworld.trajectories.transcripts import read_transcript

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
    found = decode(AtifTrajectory, canonical(with_cost(transcript("codex"), usage)))
    assert found.final_metrics
    assert found.final_metrics.total_cost_usd == usage.cost_usd
    assert found.final_metrics.extra == {"legoworld": {"cost_source": usage.cost_source}}


@pytest.mark.parametrize("model", [None, "m-2", "m-1-turbo"])
def test_an_unknown_model_has_no_cost(card, model):
    usage = compute_usage(transcript("codex"), model, card)
    assert (usage.cost_usd, usage.cost_source) == (None, None)
    assert usage.completion_tokens == 152
    assert with_cost(transcript("codex"), usage) == transcript("codex")


def test_the_transcript_s_own_cost_stands(card):
    usage = compute_usage(transcript("claude"), "m-1", card)
    assert (usage.cost_usd, usage.cost_source) == (0.0352, "transcript")
    assert with_cost(transcript("claude"), usage) == transcript("claude")


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
