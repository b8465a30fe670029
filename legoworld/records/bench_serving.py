"""What `legoworld bench serve` reads and writes, one JSON line each."""

from __future__ import annotations

from typing import Literal

from legoworld.records.base import Record
from legoworld.records.reconstruction_rows import Flag, ObjectRow
from legoworld.records.submission import Check


class ServeRequest(Record, frozen=True, kw_only=True):
    """One submission to score. scene: its folder; id: given back as it is."""

    scene: str
    image_id: int
    id: str | int | None = None


class ServeAnswer(Record, frozen=True, kw_only=True):
    """Its scores; zeros for a submission that is missing or invalid, and why.

    status: ok, the readout's verdict, `refused` for a line that is not a request, or
    `evaluator_error`; V, R, A and S are null for the last two, and A and S with --no-render.
    validity: the checks of V that were made.
    """

    id: str | int | None
    scene: str | None
    image_id: int | None
    status: str
    reason: str | None
    V: Literal[0, 1] | None
    R: float | None
    A: float | None
    S: float | None
    objects: tuple[ObjectRow, ...]
    validity: dict[str, Check] | None
    flags: tuple[Flag, ...]
    warnings: tuple[str, ...]
