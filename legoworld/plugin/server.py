"""The plugin's MCP server: its tools over one case, on standard input and output."""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, ParamSpec

from legoworld.errors import LegoWorldError, UsageError
from legoworld.plugin.case import Case
from legoworld.plugin.evidence import Evidence
from legoworld.records.base import RecordError, as_json, to_record
from legoworld.records.plugin_ledger import Declaration
from legoworld.records.plugin_requirements import Requirement

if TYPE_CHECKING:
    from mcp.server import MCPServer

Json = dict[str, Any]
_P = ParamSpec("_P")

_INSTRUCTIONS = """\
Measure the live Blender scene against evidence from the reference photo, and guard edits to it.
Edit with the Blender tools. Around every edit call `begin` with what you will change and what has
to hold, then edit, then `commit`; when it is refused, correct the edit or call `rollback`. Verdicts
are pass, fail or unknown; unknown is never pass. A report is stale as soon as the scene changes.
"""


def plugin_server(case: Case, evidence: Evidence | None) -> MCPServer[Any]:
    """A server over a case; every answer carries scene_signature and ledger_seq."""
    from mcp.server import MCPServer

    from legoworld import __version__

    server: MCPServer[Any] = MCPServer("legoworld", instructions=_INSTRUCTIONS, version=__version__)

    @server.tool()
    @_told
    def reference_evidence() -> Json:
        """What the photo says: image regions, relative depth, camera; without pixels of masks."""
        if evidence is None:
            return _answer(case, evidence=None)
        shown = as_json(evidence.file)
        for region in shown["regions"]:
            del region["counts"]
        return _answer(case, evidence=shown)

    @server.tool()
    @_told
    def measure(requirements: list[Json]) -> Json:
        """Measure requirements on the scene as it is now: pass, fail or unknown, with residuals."""
        return _answer(case, report=as_json(case.measure(_requirements(requirements))))

    @server.tool()
    @_told
    def begin(
        editable: list[str],
        kinds: list[str],
        protected: list[str] | None = None,
        requirements: list[Json] | None = None,
    ) -> Json:
        """Declare an edit: what it may change, how, what stays, what has to hold after it."""
        declaration = _typed(
            Declaration,
            {
                "editable": editable,
                "kinds": kinds,
                "protected": protected or [],
                "requirements": requirements or [],
            },
        )
        return _answer(case, transaction=case.begin(declaration).transaction)

    @server.tool()
    @_told
    def status() -> Json:
        """Where the case stands: whether a transaction is open, and its number."""
        return _answer(case, phase=case.phase, transaction=case.transaction)

    @server.tool()
    @_told
    def diff() -> Json:
        """Every change since the open transaction began."""
        return _answer(case, changes=as_json(case.diff()))

    @server.tool()
    @_told
    def commit() -> Json:
        """Judge the edit; accepted with an allowed change, no violation and no blocking verdict."""
        judgement, report = case.commit()
        return _answer(case, judgement=as_json(judgement), report=as_json(report))

    @server.tool()
    @_told
    def rollback() -> Json:
        """Return to the scene as it was when the transaction began, proven by its signature."""
        return _answer(case, restored=case.rollback().scene_signature)

    @server.tool()
    @_told
    def history(last: int = 20) -> Json:
        """The last entries of the ledger, without requests and answers."""
        shown = [
            {"seq": e.seq, "tool": e.tool, "error": e.error, "phase": e.phase,
             "transaction": e.transaction, "scene_signature": e.scene_signature}
            for e in case.ledger.entries[-max(1, last):]
        ]  # fmt: skip
        return _answer(case, entries=shown)

    return server


def _told(tool: Callable[_P, Json]) -> Callable[_P, Json]:
    """A tool whose errors reach the client: of any other error the server says only that it was."""

    @functools.wraps(tool)
    def told(*arguments: _P.args, **named: _P.kwargs) -> Json:
        from mcp.server.mcpserver.exceptions import ToolError

        try:
            return tool(*arguments, **named)
        except LegoWorldError as error:
            raise ToolError(str(error)) from error

    return told


def _answer(case: Case, **shown: Any) -> Json:
    entries = case.ledger.entries
    return {
        **shown,
        "scene_signature": entries[-1].scene_signature if entries else None,
        "ledger_seq": entries[-1].seq if entries else 0,
    }


def _requirements(given: list[Json]) -> tuple[Requirement, ...]:
    made: tuple[Requirement, ...] = _typed(tuple[Requirement, ...], given)
    return made


def _typed(kind: Any, given: Any) -> Any:
    try:
        return to_record(kind, given)
    except RecordError as error:
        raise UsageError("the arguments cannot be used", found=str(error)) from error
