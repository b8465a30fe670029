"""LEGO-Bench-X: DATASET/private/x.json, and what a run and an evaluation hold of it.

DATASET/private/x/<stem>.npz holds the reference as the probe looks at it: `offset_depth_z_m` and
`offset_instance` at the scoring raster, its samples moved by the private offset; `view_depth_z_m`
and `view_instance` from the second view; `points_m` (N, 3) float32 in the camera frame, samples of
the surface in and around each object's box, `point_object` (N,) int32 its place in the scored
objects, `point_kind` (N,) int8: CONTEXT for what else is there, OWN for the object itself, NEAR
where both are within the tolerance of each other.
RUN/probe/<stem>.npz holds the same of a submission: `offset_depth_z_m`, `view_depth_z_m`,
`points_m` and `point_object`, of whatever surface lies in the box.
"""

from __future__ import annotations

from typing import Annotated, Final, Literal

from msgspec import Meta

from legoworld.records.base import Record
from legoworld.records.bench_dataset import BenchImage, Sha256
from legoworld.records.track import CategoryInfo, Private, Probe

CONTEXT: Final = 0
OWN: Final = 1
NEAR: Final = 2


class XTruth(Record, frozen=True, kw_only=True):
    """The private half of one image's second card.

    R_empty: R of the reference without its scored objects; picture: of the second view, below the
    dataset, null without one.
    """

    R_empty: float
    arrays_sha256: Sha256
    picture: str | None
    picture_sha256: Sha256 | None


class BenchXImage(BenchImage, frozen=True, kw_only=True):
    """One case: what is public of it, how a submission is probed, and what is expected."""

    # Optional in other tracks, required here.
    probe: Probe  # pyright: ignore[reportGeneralTypeIssues]
    x: XTruth


class BenchXInfo(Record, frozen=True, kw_only=True):
    """The info of x.json. track_sha256: of the public half it belongs to."""

    description: str
    task: Literal["bench-x"]
    card_version: str
    track_sha256: Sha256


class BenchXFile(Private, frozen=True, kw_only=True):
    """DATASET/private/x.json: the track of bench-x, never handed to whoever makes submissions."""

    info: BenchXInfo
    images: Annotated[tuple[BenchXImage, ...], Meta(min_length=1)]
    categories: tuple[CategoryInfo, ...]


class Object3D(Record, frozen=True, kw_only=True):
    """F3D of one scored object. found: F of a half or more.

    eligible: whether enough of it is told apart from what it stands on or at; others are listed and
    not averaged.
    """

    id: int
    eligible: bool
    f1: float
    precision: float
    recall: float
    found: bool


class XNumbers(Record, frozen=True, kw_only=True):
    """The second card's numbers of one case; zeros where the submission is not valid.

    R_x, A_x: null without a second view, A_x also without a render; F3D, found: null where no
    object is eligible; R_above_empty: null where R_empty is 1.
    """

    R_p: float
    R_x: float | None
    A_x: float | None
    F3D: float | None
    found: float | None
    R_empty: float
    R_above_empty: float | None


class XScores(XNumbers, frozen=True, kw_only=True):
    """The numbers, each object's, and three facts of the submission.

    A_x_seen: A_x over the pixels whose surface the first picture shows, null without them;
    surface_differs: share of the raster where Cycles meets another surface than the kernel, null
    where it was not asked; unreadable_alpha: materials whose alpha the kernel took as opaque.
    """

    objects: tuple[Object3D, ...]
    A_x_seen: float | None = None
    surface_differs: float | None
    unreadable_alpha: int
