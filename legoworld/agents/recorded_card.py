"""A card whose agent is sent to the recorder, and what recording needs."""

from __future__ import annotations

from collections.abc import Mapping

from msgspec.structs import replace

from legoworld import extras
from legoworld.agents.agent_cards import AgentCard
from legoworld.errors import UsageError
from legoworld.files import Json


def check_recordable(card: AgentCard) -> None:
    """UsageError for a card that cannot be recorded, or a proxy that cannot be used.

    InstallationError without the extra.
    """
    if card.about.record is None:
        raise UsageError(
            f"the agent {card.name} cannot be recorded",
            found=f"no [record] in {card.path.name}",
            expected="a card with the API's address and the settings that redirect its agent",
            next_step="leave out --record, or add the table; docs/agents.md",
        )
    needed = ("httpx2", "starlette", "uvicorn")
    extras.require_extra("record", "`reconstruct --record`", needed)
    from legoworld.agents.api_recorder import open_client  # of the extra

    open_client()


def sent_to(card: AgentCard, url: str) -> AgentCard:
    """The card with the recorder's address in its variables and settings."""
    about, record = card.about, card.about.record
    if record is None:
        return card
    given = {key: _insert_url(value, url) for key, value in record.settings.items()}
    told = {key: text.replace("{api}", url) for key, text in record.variables.items()}
    return AgentCard(
        about=replace(
            about,
            variables={**about.variables, **told},
            mcp=replace(about.mcp, settings=_merge_tables(about.mcp.settings, given)),
        ),
        path=card.path,
        sha256=card.sha256,
    )


def _insert_url(value: Json, url: str) -> Json:
    if isinstance(value, dict):
        return {key: _insert_url(item, url) for key, item in value.items()}
    return value.replace("{api}", url) if isinstance(value, str) else value


def _merge_tables(below: Mapping[str, Json], above: Mapping[str, Json]) -> dict[str, Json]:
    """Both tables; where both have a value, the second's."""
    joined = {**below, **above}
    for key in below.keys() & above.keys():
        old, new = below[key], above[key]
        if isinstance(old, dict) and isinstance(new, dict):
            joined[key] = _merge_tables(old, new)
    return joined
