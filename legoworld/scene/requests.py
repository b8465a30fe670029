"""What the Blender process is asked: one JSON object a line."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Literal, NotRequired, Required, TypedDict

if TYPE_CHECKING:
    from legoworld.records.bench_dataset import Tier


class CardRequest(TypedDict):
    """How a picture is rendered, apart from the scene. threads: 0 for all.

    stand: where the camera is put before, left out where it stays.
    """

    size_wh: Sequence[int]
    samples: int
    seed: int
    denoise: bool
    threads: int
    stand: NotRequired[StandRequest]


class StandRequest(TypedDict):
    """Another pose of the active camera: (3, 4) rows in scene units, OpenCV axes.

    zoom: what its focal length is multiplied by. camera: the name of another one whose optics are
    taken; clip: its near and far planes; both left out where the active camera's own are.
    """

    world_from_camera: Sequence[Sequence[float]]
    zoom: float
    camera: NotRequired[str]
    clip: NotRequired[tuple[float, float]]


class CaseRequest(TypedDict):
    """One case of a reference scene. view: a camera's name; glb: whether scene.glb is wanted."""

    tier: Tier | None
    view: str
    size_wh: Sequence[int]
    glb: bool


class JointFact(TypedDict):
    """A `joint` property. world_from_object: 12 numbers, null for an object at no finite place."""

    object: str
    text: str
    world_from_object: Sequence[float] | None


class DeclaredCases(TypedDict):
    """What a reference scene declares; see `scene.blender.reference_cases`."""

    environment: str | None
    theme: str | None
    split: str | None
    views: Sequence[str]
    tiers: Sequence[Tier | None]
    unscored: Sequence[str]
    joints: Sequence[JointFact]


class Request(TypedDict, total=False):
    """A request; each kind has the keys that its function in `worker` reads."""

    kind: Required[
        Literal[
            "version", "snapshot", "state", "check", "picture", "card_render", "card_depth",
            "facts", "cases", "case", "usd", "import", "import_glb",
        ]
    ]  # fmt: skip
    blend: str
    output: str
    usd: str
    glb: str
    metres_per_unit: float
    layer: str
    passing: bool
    any_camera: bool
    corner_normals: bool
    card: CardRequest
    thumbnail_wh: tuple[int, int]
    case: CaseRequest
