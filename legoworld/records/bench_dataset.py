"""LEGO-Bench's files: DATASET/public/track.json and DATASET/private/truth.json.

Nothing of the private half is in the public one, not even as a hash; the private half names the
public one by its sha256, so that halves of two datasets are never scored together.
"""

from __future__ import annotations

from typing import Annotated, Literal

from msgspec import Meta

from legoworld.records.base import UNSET, Record, UnsetType
from legoworld.records.joints import JointType, Pose, SceneJoint
from legoworld.records.render_card import RenderCard
from legoworld.records.track import CategoryInfo, ImageInfo, Pixels, Private

Count = Annotated[int, Meta(ge=0)]
#: What became of a reference joint: the counts C, W, P, O, J, and ignored, which no count has.
Outcome = Literal[
    "correct", "wrong", "part_missing", "object_missing", "joint_missing", "ignored"
]  # fmt: skip


class ReferenceJoint(SceneJoint, frozen=True, kw_only=True):
    """A joint of a reference. object_id: the scored object its part belongs to, null for none."""

    object_id: int | None


class JointRow(Record, frozen=True, kw_only=True):
    """What became of one reference joint.

    object: name of the scored object, null where the joint is of none and ignored; matched: the
    submission's part, null where no joint corresponds; box_iou, axis_deg, axis_apart_m: of those
    two, null without a match (axis_apart_m also where either slides).
    """

    part: str
    object: str | None
    type: JointType
    outcome: Outcome
    matched: str | None
    box_iou: float | None
    axis_deg: float | None
    axis_apart_m: float | None


class JointCounts(Record, frozen=True, kw_only=True):
    """C correct, W wrong, P part missing, O object missing, J joint missing, E extra.

    score: 2C / (2C + O + P + J + 2W + E); null where there is nothing to count.
    """

    C: Count
    W: Count
    P: Count
    O: Count  # noqa: E741  the formula's letter
    J: Count
    E: Count
    score: float | None


class Articulation(JointCounts, frozen=True, kw_only=True):
    """The pilot's part of a case. extra: parts of the submission's joints that match none."""

    joints: tuple[JointRow, ...]
    extra: tuple[str, ...]


class ArticulationSummary(JointCounts, frozen=True, kw_only=True):
    """Counts over all attempted cases whose reference has scored joints.

    score: of the summed counts; mean_score: the unweighted mean of the cases' scores; card_*: the
    provisional card, readouts/pilots/articulation.toml.
    """

    cases: Count
    mean_score: float | None
    provisional: Literal[True]
    card_version: str
    card_sha256: str


#: Easy < Medium < Hard: each holds the objects of the one before, and more.
Tier = Literal["easy", "medium", "hard"]
Sha256 = Annotated[str, Meta(pattern="^[0-9a-f]{64}$")]


class BenchImage(ImageInfo, frozen=True, kw_only=True):
    """One public case. file_name: `<family>__<tier>__view_00.png`, no tier where it has none.

    hfov_deg: horizontal field of view of the whole picture; pixels are square and the principal
    point is its middle. view: its number within family and tier.
    """

    # Optional in other tracks, required here.
    hfov_deg: Annotated[float, Meta(gt=0, lt=180)]  # pyright: ignore[reportGeneralTypeIssues]
    family: Annotated[str, Meta(min_length=1)]
    environment: str | None
    theme: str | None
    split: str | None
    tier: Tier | None
    view: Annotated[int, Meta(ge=0)]


class PictureCard(Record, frozen=True, kw_only=True):
    """How the public pictures were rendered. denoised: they are inputs, not what A renders."""

    engine: Literal["CYCLES"]
    device: Literal["CPU"]
    samples: Annotated[int, Meta(ge=1)]
    seed: int
    denoised: bool


class BenchInfo(Record, frozen=True, kw_only=True):
    """The info of a bench track."""

    description: str
    task: Literal["bench"]
    card_version: str
    picture: PictureCard


class BenchTrackFile(Private, frozen=True, kw_only=True):
    """DATASET/public/track.json: COCO image info with what an agent is told."""

    info: BenchInfo
    images: Annotated[tuple[BenchImage, ...], Meta(min_length=1)]
    categories: tuple[CategoryInfo, ...]


class BenchCamera(Record, frozen=True, kw_only=True):
    """The reference's camera: pixels at the image's full size, origin at its top left corner."""

    fx: float
    fy: float
    cx: float
    cy: float
    world_from_cam: Pose


class BenchHashes(Record, frozen=True, kw_only=True):
    """sha256 of a case's files: public/images/<file_name>, and those of private/.

    raster: null for an imported reference that was never sampled at the scoring raster.
    """

    reference: Sha256
    depth: Sha256
    instances: Sha256
    raster: Sha256 | None


class ScoredObject(Record, frozen=True, kw_only=True):
    """An object that R averages over. id: its value in the instance arrays."""

    id: Annotated[int, Meta(ge=0)]
    name: str
    category: str


class NoiseFloor(Record, frozen=True, kw_only=True):
    """A of the reference rendered by the render card with these seeds, against its own picture.

    a_self: one A a seed, in [0, 1]; sd: their standard deviation, ddof = 1.
    """

    seeds: tuple[int, ...]
    a_self: tuple[float, ...]
    sd: float


class BenchTruth(Record, frozen=True, kw_only=True):
    """The private half of one image.

    raster_wh: size of the scoring raster; noise_floor: null where it was not measured; joints: left
    out where the reference has none.
    """

    camera: BenchCamera
    sha256: BenchHashes
    scored: Annotated[tuple[ScoredObject, ...], Meta(min_length=1)]
    raster_wh: tuple[Pixels, Pixels]
    snapshot_sha256: str
    noise_floor: NoiseFloor | None
    joints: tuple[ReferenceJoint, ...] | UnsetType = UNSET


class BenchTruthFile(Record, frozen=True, kw_only=True):
    """DATASET/private/truth.json. track_sha256: of the public half; images: by image id as text.

    private/depth/<stem>.npz holds `depth_z_m` (float32, +inf where nothing is hit),
    private/instances/<stem>.npz `instance` (int32, -1), both at the image's full size;
    private/raster/<stem>.npz holds both at the scoring raster, sampled at its own centres.
    """

    schema_version: Annotated[int, Meta(ge=1)]
    task: Literal["bench"]
    card_version: str
    track_sha256: Sha256
    point_cap: Annotated[int, Meta(ge=1)]
    card: RenderCard
    images: dict[str, BenchTruth]
