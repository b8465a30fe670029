"""What the page of trials is given: each trial with its steps."""

from __future__ import annotations

from legoworld.records.base import Record


class PageStep(Record, frozen=True, kw_only=True):
    """One call, with the checkpoint that it left where that was scored.

    drop: what made Q fall most since the scene before; lost: by how much Q changed. shares: of the
    trial's calls, wall time and tokens. render: the last scored picture so far, as a data URL;
    shown: the call that it is of.
    """

    number: int
    at_s: float
    command: str
    status: str
    code: str
    said: str
    Q: float | None
    R: float | None
    A: float | None
    reason: str
    drop: str | None
    lost: float | None
    shares: tuple[float, float, float | None]
    render: str | None
    shown: int | None


class PageTrial(Record, frozen=True, kw_only=True):
    """One trial. photo, final: pictures as data URLs, null where there is none."""

    scene: str
    agent: str
    status: str
    ended: str
    seconds: float
    photo: str | None
    final: str | None
    final_q: float | None
    regret: float | None
    steps: tuple[PageStep, ...]
