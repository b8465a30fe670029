"""What all tools of the server share: typed arguments, errors in words, answers with the state."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from typing import Any, ParamSpec, TypeVar

from legoworld.errors import LegoWorldError, UsageError, cause
from legoworld.files import Json
from legoworld.plugin.case import Case
from legoworld.records.base import RecordError, canonical, to_record

#: Arguments and answers of a tool, as its client sees them.
JsonObject = dict[str, Any]
_P = ParamSpec("_P")
_T = TypeVar("_T")


def one_at_a_time(case: Case) -> Callable[[Callable[_P, _T]], Callable[_P, _T]]:
    """Decorator: run a tool alone on its case; report LegoWorldError and OSError to the client.

    Clients send calls in parallel, and a cancelled call still runs to its end: each call waits for
    the one before it. Other exceptions stay generic.
    """

    def decorate(tool: Callable[_P, _T]) -> Callable[_P, _T]:
        @functools.wraps(tool)
        def run(*arguments: _P.args, **named: _P.kwargs) -> _T:
            from mcp.server.mcpserver.exceptions import ToolError

            try:
                with case.calling:
                    return tool(*arguments, **named)
            except LegoWorldError as error:
                raise ToolError(str(error)) from error
            except OSError as error:
                where = f" of {error.filename}" if error.filename else ""
                text = f"the operating system refused a file{where}; found: {cause(error)}"
                raise ToolError(text) from error

        return run

    return decorate


def answer(case: Case, **shown: Json) -> JsonObject:
    """An answer with the signature of the last state that was read, and the ledger's last line."""
    entries = case.ledger.entries
    recovered = case.live and case.live.recovered
    if recovered:
        shown["notice"] = (
            f"a rollback had ended early: {recovered} is your file again; what the rollback had "
            "saved under that name is beside it"
        )
    return {
        **shown,
        "scene_signature": entries[-1].scene_signature if entries else None,
        "ledger_seq": entries[-1].seq if entries else 0,
    }


def answer_text(case: Case, **shown: Json) -> str:
    """`answer` as JSON text, for answers that have a picture beside it."""
    return canonical(answer(case, **shown))


def decode_arguments(kind: type[_T], given: Json) -> _T:
    """Arguments as a record. UsageError names the place of what does not fit."""
    if (place := _no_number(given)) is not None:
        raise UsageError("the arguments cannot be used", found=place, expected="finite numbers")
    try:
        return to_record(kind, given)
    except RecordError as error:
        raise UsageError("the arguments cannot be used", found=str(error)) from error


def _no_number(value: Json, place: str = "$") -> str | None:
    """Path of a NaN or infinity in a JSON value; a ledger cannot store them."""
    if isinstance(value, float) and not math.isfinite(value):
        return f"{value} at {place}"
    inside: list[tuple[str | int, Json]] = []
    if isinstance(value, dict):
        inside = list(value.items())
    elif isinstance(value, list):
        inside = list(enumerate(value))
    places = (_no_number(item, f"{place}[{key!r}]") for key, item in inside)
    return next((found for found in places if found), None)
