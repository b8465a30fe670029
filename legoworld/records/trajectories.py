"""trajectories.json: Q over time, for every checkpoint of every trial; private, like an evaluation.

Q = (R + A) / 2, as bench scores a submission. Shares are of the trial's own wall time, Blender
calls and output tokens. `PageTrial` is what the page of trials is given.
"""

from __future__ import annotations

from typing import Final, Literal

from legoworld.records.base import Record
from legoworld.records.evaluation import Interval

#: The file in a folder of scores.
TRAJECTORIES: Final = "trajectories.json"
Cause = Literal["validity", "camera", "geometry", "appearance"]
CAUSES: tuple[Cause, ...] = ("validity", "camera", "geometry", "appearance")
Axis = Literal["wall", "calls", "tokens"]
AXES: tuple[Axis, ...] = ("wall", "calls", "tokens")


class Moment(Record, frozen=True, kw_only=True):
    """When something was. tokens_share: null where the transcript does not count them."""

    at_s: float
    wall_share: float
    calls_share: float
    tokens_share: float | None


class ScoredScene(Record, frozen=True, kw_only=True):
    """A checkpoint, or the submission (ordinal null), as it was scored.

    R, A, Q: null where it is not eligible: not valid, or not scored; reason says why. changed: what
    differs from the scene scored before it, empty where that is unknown.
    """

    ordinal: int | None
    call: int
    when: Moment
    R: float | None
    A: float | None
    Q: float | None
    reason: str = ""
    camera_sha256: str | None = None
    snapshot_sha256: str | None = None


class Edit(Record, frozen=True, kw_only=True):
    """Two eligible scenes, one after the other. skipped: the ineligible ones between them.

    cause: the part of d_q that each kind of change has; they sum to d_q.
    """

    before: int
    after: int | None
    call: int
    d_q: float
    d_r: float
    d_a: float
    skipped: int
    cause: dict[str, float]


class TrajectoryScore(Record, frozen=True, kw_only=True):
    """One trial.

    first: its first evaluable scene; best: the best scene's ordinal; regret: the best scene's Q
    minus the submission's; regret_split: regret by cause, which sum to it.
    """

    image_id: int
    scene: str
    family: str
    agent: str
    run: int
    seconds: float
    scenes: tuple[ScoredScene, ...]
    edits: tuple[Edit, ...]
    first: Moment | None
    n_lowering: int
    n_lowering_r: int
    n_lowering_a: int
    best: int | None
    best_q: float | None
    final_valid: bool
    final_q: float
    regret: float
    regret_split: dict[str, float]
    picked: int | None = None
    picked_q: float | None = None


class Mean(Record, frozen=True, kw_only=True):
    """A mean over trials with its interval over families. n: how many it is of."""

    value: float | None
    n: int
    interval: Interval | None


class AgentTable(Record, frozen=True, kw_only=True):
    """One agent's means. curves: by axis, mean Q at each share of the budget in `shares`."""

    agent: str
    n_trials: int
    n_evaluable: int
    means: dict[str, Mean]
    curves: dict[str, list[Mean]]


class TrajectoryFile(Record, frozen=True, kw_only=True):
    """The document.

    shares: of the budget, for the curves; common: over the images that every agent left an
    evaluable trajectory of, null with one agent.
    """

    schema_version: int
    legoworld: str
    evaluator: dict[str, str]
    draws: int
    seed: int
    shares: tuple[float, ...]
    trials: tuple[TrajectoryScore, ...]
    agents: tuple[AgentTable, ...]
    common: tuple[AgentTable, ...] | None
    common_images: tuple[int, ...]


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
    """One trial. photo, final: pictures as data URLs, null where there is none.

    glb: the place of the submission among the page's scenes, null with the reason in glb_said.
    """

    scene: str
    agent: str
    status: str
    ended: str
    seconds: float
    photo: str | None
    final: str | None
    glb: int | None
    glb_said: str
    final_q: float | None
    regret: float | None
    steps: tuple[PageStep, ...]
