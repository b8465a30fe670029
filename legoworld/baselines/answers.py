"""One line of a baseline's process: a message, something that cannot be read as one, or a print."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from typing import Any, Final

Message = dict[str, Any]

#: A nested mask is 6 levels deep; records put three more around an answer.
MOST_LEVELS: Final = 32
#: COCO's and LVIS's ids and counts fit; a longer integer would not fit NumPy's or a float.
_LARGEST_INTEGER: Final = 2**63 - 1


@dataclass(frozen=True, kw_only=True)
class Unreadable:
    """A line that begins like a message and cannot be one.

    image_id: whose answer it is, None where the line does not say; reason: one line.
    """

    image_id: int | None
    reason: str


def read_line(line: str) -> Message | Unreadable | None:
    """The message of a line; None for a print that came through, and for a line cut short.

    A message is a JSON object that every file of a run can hold: at most `MOST_LEVELS` deep, its
    numbers finite and its integers of 64 bits, its texts without lone surrogates.
    """
    if not line.startswith("{") or not line.endswith("\n"):
        return None
    try:
        message = json.loads(line)
    except RecursionError:
        return Unreadable(image_id=None, reason="JSON nested too deep to be read")
    except ValueError:
        return None
    if not isinstance(message, dict):
        return None
    problem = _problem(message)
    if problem is None:
        return message
    image_id = message.get("image_id")
    return Unreadable(image_id=image_id if type(image_id) is int else None, reason=problem)


def _problem(message: Message) -> str | None:
    """What in a message no file of a run could hold; None where nothing is wrong."""
    level: list[Any] = [message]
    for _ in range(MOST_LEVELS):
        for value in level:
            wrong = _wrong_value(value)
            if wrong:
                return wrong
        level = [inner for value in level for inner in _inside(value)]
        if not level:
            return None
    return f"JSON nested more than {MOST_LEVELS} levels deep"


def _inside(value: Any) -> list[Any]:
    if isinstance(value, dict):
        return [*value, *value.values()]
    return value if isinstance(value, list) else []


def _wrong_value(value: Any) -> str | None:
    if isinstance(value, str):
        return None if _is_unicode(value) else "a text with a lone surrogate"
    if isinstance(value, float) and not math.isfinite(value):
        return f"the number {value}, which is not JSON compliant"
    if isinstance(value, int) and abs(value) > _LARGEST_INTEGER:
        return "an integer of more than 64 bits"
    return None


def _is_unicode(text: str) -> bool:
    try:
        text.encode("utf-8")
    except UnicodeEncodeError:
        return False
    return True
