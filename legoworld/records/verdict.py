"""The verdict of a check, as records of scenes carry it."""

from __future__ import annotations

from typing import Final

from legoworld.records.base import Record


class Verdict(Record, frozen=True, kw_only=True):
    """What a check found. reason: in words, null where all is well."""

    status: str
    code: str
    reason: str | None


OK: Final = Verdict(status="ok", code="ok", reason=None)
