"""The server's tools before the first edit: the room, the camera and the plan."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from legoworld.errors import UsageError
from legoworld.plugin.case import Case
from legoworld.plugin.evidence import Evidence
from legoworld.plugin.initial_room import install_room
from legoworld.plugin.initialisation import recover
from legoworld.plugin.plan import construction_plan, plan_markdown
from legoworld.plugin.room import assign_structures
from legoworld.plugin.server_answers import JsonObject, answer, decode_arguments, one_at_a_time
from legoworld.records.base import as_json
from legoworld.records.plugin_evidence import Structure

if TYPE_CHECKING:
    from mcp.server import MCPServer


def add_initialisation(server: MCPServer[Any], case: Case, evidence: Evidence | None) -> None:
    """Offer initialize and plan."""

    @server.tool()
    @one_at_a_time(case)
    def initialize(
        structures: dict[str, str] | None = None, camera_height_m: float = 1.5
    ) -> JsonObject:
        """Recover the room and the camera from the photo, and install both as one transaction.

        structures: by region name, which of floor, ceiling, left, right, far, near or wall it
        shows; without it, the regions' own names and categories say so. camera_height_m sets the
        scale, which the photo does not tell.
        """
        if not 0.01 <= camera_height_m <= 1000:
            raise UsageError(
                "the camera's height cannot be used",
                found=f"{camera_height_m:g}",
                expected="metres from 0.01 to 1000",
            )
        initialisation = recover(
            _require_evidence(evidence), _structures(structures), camera_height_m
        )
        kept = install_room(case, initialisation)
        return answer(
            case, room=as_json(initialisation.room), plan=as_json(initialisation.plan), kept=kept
        )

    @server.tool()
    @one_at_a_time(case)
    def plan(structures: dict[str, str] | None = None) -> JsonObject:
        """The construction plan: each object's place, extent and relative depth in the photo."""
        known = _require_evidence(evidence)
        made = construction_plan(known, assign_structures(known, _structures(structures)))
        return answer(case, plan=as_json(made), markdown=plan_markdown(made))


def _require_evidence(evidence: Evidence | None) -> Evidence:
    if evidence is None:
        raise UsageError(
            "there is no evidence of the photo",
            found="a server without --evidence",
            expected="regions and the camera of the photo",
            next_step="run `legoworld plugin evidence`, then serve with --evidence",
        )
    return evidence


def _structures(given: dict[str, str] | None) -> dict[str, Structure] | None:
    if given is None:
        return None
    made: dict[str, Structure] = decode_arguments(dict[str, Structure], given)
    return made
