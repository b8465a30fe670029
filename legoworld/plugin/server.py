"""The plugin's MCP server: its tools over one case, on standard input and output."""

from __future__ import annotations

import contextlib
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from legoworld.errors import UsageError
from legoworld.plugin.case import Case
from legoworld.plugin.evidence import Evidence
from legoworld.plugin.modules import MODULES, tools_off
from legoworld.plugin.server_answers import JsonObject, answer, decode_arguments, one_at_a_time
from legoworld.plugin.server_final_steps import add_finishing, kept_pictures
from legoworld.plugin.server_initialisation import add_initialisation
from legoworld.plugin.server_looks import add_looking
from legoworld.records.base import as_json
from legoworld.records.plugin_install import Module
from legoworld.records.plugin_ledger import Declaration
from legoworld.records.plugin_requirements import Requirement

if TYPE_CHECKING:
    from mcp.server import MCPServer

_INSTRUCTIONS = """\
Measure the live Blender scene against evidence from the reference photo, and guard edits to it.
Edit with the Blender tools. Around every edit call `begin` with what you will change and what has
to hold, then edit, then `commit`; when it is refused, correct the edit or call `rollback`. Verdicts
are pass, fail or unknown; unknown is never pass. A report is stale as soon as the scene changes.
At the end call `validate`, `review` (look at the render, then say what is in it) and `export`.
"""


def plugin_server(
    case: Case, evidence: Evidence | None, modules: Sequence[Module] = MODULES
) -> MCPServer[Any]:
    """A server over a case; every answer carries scene_signature and ledger_seq.

    modules: those that are on; tools of the others are not offered.
    """
    from mcp.server import MCPServer
    from mcp.server.mcpserver.exceptions import ToolError

    from legoworld.version import __version__

    server: MCPServer[Any] = MCPServer("legoworld", instructions=_INSTRUCTIONS, version=__version__)

    @server.tool()
    @one_at_a_time(case)
    def reference_evidence() -> JsonObject:
        """What the photo says: image regions, relative depth, camera; without pixels of masks."""
        if evidence is None:
            return answer(case, evidence=None)
        shown = as_json(evidence.file)
        for region in shown["regions"]:
            del region["counts"]
        return answer(case, evidence=shown)

    @server.tool()
    @one_at_a_time(case)
    def measure(requirements: list[JsonObject], pictures: bool = False) -> JsonObject:
        """Measure requirements on the scene as it is now: pass, fail or unknown, with residuals.

        pictures: also a small picture of each, as the resource legoworld://renders/SHA256.
        """
        report = case.measure(_requirements(requirements))
        drawn = {"pictures": kept_pictures(case, report)} if pictures else {}
        return answer(case, report=as_json(report), **drawn)

    @server.tool()
    @one_at_a_time(case)
    def begin(
        editable: list[str],
        kinds: list[str],
        protected: list[str] | None = None,
        requirements: list[JsonObject] | None = None,
    ) -> JsonObject:
        """Declare an edit: what it may change, how, what stays, what has to hold after it.

        unguarded: changes since the last transaction ended, which were made without one.
        """
        if requirements and "measurement" not in modules:
            raise UsageError(
                "requirements cannot be measured in this run",
                found=f"{len(requirements)} requirements; the module `measurement` is off",
                expected="a declaration without requirements",
            )
        declaration = decode_arguments(
            Declaration,
            {
                "editable": editable,
                "kinds": kinds,
                "protected": protected or [],
                "requirements": requirements or [],
            },
        )
        begun = case.begin(declaration)
        return answer(case, transaction=begun.transaction, unguarded=begun.answer["unguarded"])

    @server.tool()
    @one_at_a_time(case)
    def status() -> JsonObject:
        """Where the case stands: whether a transaction is open, its number, and if it was resumed.

        Resumed: an earlier server of this ledger ended, or was killed, with the transaction open.
        """
        entries = case.ledger.entries
        since = max((e.seq for e in entries if e.tool == "begin" and not e.error), default=0)
        resumed = case.phase == "open" and any(e.tool == "resume" for e in entries[since:])
        return answer(case, phase=case.phase, transaction=case.transaction, resumed=resumed)

    @server.tool()
    @one_at_a_time(case)
    def diff() -> JsonObject:
        """Every change since the open transaction began."""
        return answer(case, changes=as_json(case.diff()))

    @server.tool()
    @one_at_a_time(case)
    def commit(transaction: int | None = None) -> JsonObject:
        """Judge the edit; accepted with an allowed change, no violation and no blocking verdict.

        transaction: the number that begin gave; another one than the open transaction is refused.
        """
        judgement, report = case.commit(transaction)
        return answer(case, judgement=as_json(judgement), report=as_json(report))

    @server.tool()
    @one_at_a_time(case)
    def rollback(transaction: int | None = None) -> JsonObject:
        """Return to the scene as it was when the transaction began, proven by its signature.

        transaction: the number that begin gave; another one than the open transaction is refused.
        """
        return answer(case, restored=case.rollback(transaction).scene_signature)

    @server.tool()
    @one_at_a_time(case)
    def history(last: int = 20) -> JsonObject:
        """The last entries of the ledger, without requests and answers."""
        shown = [
            {"seq": e.seq, "tool": e.tool, "error": e.error, "phase": e.phase,
             "transaction": e.transaction, "scene_signature": e.scene_signature}
            for e in case.ledger.entries[-max(1, last):]
        ]  # fmt: skip
        return answer(case, entries=shown)

    add_initialisation(server, case, evidence)
    add_finishing(server, case)
    add_looking(server, case)
    for name in tools_off(modules):
        with contextlib.suppress(ToolError):
            server.remove_tool(name)
    return server


def _requirements(given: list[JsonObject]) -> tuple[Requirement, ...]:
    made: tuple[Requirement, ...] = decode_arguments(tuple[Requirement, ...], given)
    return made
