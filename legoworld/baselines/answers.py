"""One line from a baseline's process: a message, an unreadable message, or printed output."""

from __future__ import annotations

import json
import re
from dataclasses import dataclass
from typing import Final

from legoworld.records.base import RecordError, decode_foreign
from legoworld.records.baseline_messages import Message

#: A nested mask is 6 levels deep; records put three more around an answer.
MOST_LEVELS: Final = 32
#: COCO's and LVIS's ids and counts fit; a longer integer would not fit NumPy's or a float.
_LARGEST_INTEGER: Final = 2**63 - 1
_MAY_BE_LONGER: Final = re.compile(r"[\[:, -]\d{19}")


@dataclass(frozen=True, kw_only=True)
class Unreadable:
    """A line that begins like a message but is not a valid one.

    image_id: of the answer, None if the line does not say; reason: one line.
    """

    image_id: int | None
    reason: str


def read_line(line: str) -> Message | Unreadable | None:
    """The message of a line; None for printed output and for a truncated line.

    A message is a JSON object that every file of a run can store: at most `MOST_LEVELS` deep, with
    finite numbers, 64-bit integers, and texts without lone surrogates.
    """
    if not line.startswith("{") or not line.endswith("\n"):
        return None
    try:
        if _MAY_BE_LONGER.search(line):
            json.loads(line, parse_int=_refuse_longer)
        return decode_foreign(Message, line, levels=MOST_LEVELS)
    except RecordError as error:
        return _unreadable(line, str(error))


def _refuse_longer(text: str) -> int:
    # Python reads no integer of more than 4,300 digits; the largest has 19, and a sign.
    if len(text) > 20 or abs(int(text)) > _LARGEST_INTEGER:
        raise RecordError("an integer of more than 64 bits")
    return 0


def _unreadable(line: str, reason: str) -> Unreadable | None:
    """An unreadable message; None if the line is not JSON either."""
    try:
        said = json.loads(line, parse_int=lambda text: int(text) if len(text) <= 20 else text)
    except RecursionError:
        return Unreadable(image_id=None, reason=reason)
    except ValueError:
        return None
    image_id = said.get("image_id")
    return Unreadable(image_id=image_id if type(image_id) is int else None, reason=reason)
