"""evidence.json: what a photo says about the scene, from providers that never saw the scene.

room.json and plan.json: what a scene is begun with, recovered from it.
"""

from __future__ import annotations

from typing import Annotated, Any, Literal

from msgspec import Meta

from legoworld.records.base import UNSET, Record, UnsetType
from legoworld.records.cards import OptionValue

Rows = tuple[tuple[float, float, float], tuple[float, float, float], tuple[float, float, float]]
Sha256 = Annotated[str, Meta(pattern="^[0-9a-f]{64}$")]
DepthSpace = Literal["depth", "disparity"]
Side = Annotated[int, Meta(ge=1, le=1 << 15)]


class PhotoEvidence(Record, frozen=True, kw_only=True):
    """The photo that everything else is about; sizes in pixels."""

    file_name: str
    sha256: Sha256
    width: Side
    height: Side


class Region(Record, frozen=True, kw_only=True):
    """One image region. counts: COCO's compressed RLE at the photo's size, column by column.

    name: unique in its file. category and score: the provider's, null where it gives none.
    source: what drew it, as a person would look it up ("polygons of outline.json", "sam3").
    """

    name: Annotated[str, Meta(min_length=1, max_length=200)]
    counts: str
    area_px: Annotated[int, Meta(ge=0)]
    bbox_xywh_px: tuple[int, int, int, int]
    category: str | None
    score: float | None
    source: str


class DepthEvidence(Record, frozen=True, kw_only=True):
    """Relative depth at the photo's size, in depth.npz beside evidence.json (`values`, float32).

    space: "depth" grows with distance, "disparity" falls with it; neither has a scale.
    """

    sha256: Sha256
    space: DepthSpace
    source: str


class CameraEvidence(Record, frozen=True, kw_only=True):
    """What the photo tells about its camera.

    hfov_deg: horizontal field of view of the full width, degrees. world_from_cam_rotation: rows of
    the rotation from OpenCV camera axes (x right, y down, z forward) to a z-up Manhattan frame;
    null where vanishing points cannot tell, and `unknown` says why.
    """

    hfov_deg: float | None
    hfov_source: str | None
    world_from_cam_rotation: Rows | None
    rotation_source: str | None
    unknown: str | None


class ProviderCamera(Record, frozen=True, kw_only=True):
    """A camera that a provider recovered from the photo, as `plugin evidence --camera` reads it.

    source: the provider and its version, such as "vggt 1b". width, height: of the picture that the
    intrinsics are in, which shows all of the photo in its shape; fx, fy, cx, cy: pixels of it,
    origin in its upper left corner. world_from_cam_rotation: as in `CameraEvidence`; null where the
    provider does not tell up, as of one photo alone: it is estimated then.
    """

    schema_version: Literal[1]
    source: Annotated[str, Meta(min_length=1, max_length=200)]
    photo_sha256: Sha256
    width: Side
    height: Side
    fx: Annotated[float, Meta(gt=0)]
    fy: Annotated[float, Meta(gt=0)]
    cx: float
    cy: float
    world_from_cam_rotation: Rows | None = None


class ProviderRecord(Record, frozen=True, kw_only=True):
    """The baseline that camera and depth came from, as run.json records one.

    weights: the hub id, or the name of a file or folder; provenance: what the model's process says
    of itself: hashes of its weights, its package and libraries, its preprocessing; counts: of the
    photo, such as pixels that it was not sure of.
    """

    name: str
    version: str
    card_sha256: Sha256
    code_sha256: Sha256
    weights: str
    device: str
    dtype: str
    options: dict[str, OptionValue | None]
    provenance: dict[str, Any]
    environment: dict[str, Any]
    counts: dict[str, int]


class EvidenceFile(Record, frozen=True, kw_only=True):
    """evidence.json; regions sorted by name. provider: absent where none was asked."""

    schema_version: Literal[1] = 1
    photo: PhotoEvidence
    regions: tuple[Region, ...]
    depth: DepthEvidence | None
    camera: CameraEvidence
    provider: ProviderRecord | UnsetType = UNSET


class Outline(Record, frozen=True, kw_only=True):
    """A region as an agent draws it: polygons of [x, y] in pixels of the photo."""

    name: str
    polygons: tuple[tuple[tuple[float, float], ...], ...]
    category: str | None = None


class Outlines(Record, frozen=True, kw_only=True):
    """A file of outlines; see `Outline`."""

    regions: tuple[Outline, ...]


#: The faces of a room, seen by its camera: the far wall is the one it looks at.
FaceName = Literal["floor", "ceiling", "left", "right", "far", "near"]
#: What an agent says a region shows: one face, or walls that it does not tell apart.
Structure = Literal["floor", "ceiling", "left", "right", "far", "near", "wall"]


class RoomFace(Record, frozen=True, kw_only=True):
    """One face of the room: its distance from the camera along its normal.

    distance: in camera heights, so that the floor's is 1; null where the photo does not tell, and
    `unknown` says why. at_least: nearer than this it would hide what the photo shows; at_most: of
    the distances that explain the photo as well, null without an upper end. agreement: share of
    the pixels of its regions that the room explains, null for a face without any of its own.
    """

    name: FaceName
    distance: float | None
    at_least: float
    at_most: float | None
    agreement: float | None
    unknown: str | None


class Room(Record, frozen=True, kw_only=True):
    """room.json: a box around the camera in a z-up Manhattan frame, and the camera in it.

    world_from_cam_rotation: from OpenCV camera axes (x right, y down, z forward); the camera stands
    above the origin, the floor is z = 0, and x is the horizontal direction nearest to the camera's
    right. camera_height_m: a convention that sets the unit; the photo does not tell it. structures:
    pairs of region and what it shows. agreement: share of labelled pixels that the room explains.
    """

    schema_version: Literal[1] = 1
    photo_sha256: Sha256
    width: Side
    height: Side
    hfov_deg: Annotated[float, Meta(gt=0, lt=180)]
    world_from_cam_rotation: Rows
    camera_height_m: Annotated[float, Meta(gt=0)]
    faces: tuple[RoomFace, ...]
    structures: tuple[tuple[str, Structure], ...]
    labelled_px: int
    agreement: Annotated[float, Meta(ge=0, le=1)]


class PlannedObject(Record, frozen=True, kw_only=True):
    """One visible object of the photo; no metric depth and no absolute size.

    region, category: as in evidence.json. centroid_uv: of its pixels over the photo's width and
    height, from the upper left corner; extent_wh: of its box, likewise. relative_depth: from 0, the
    nearest planned object, to 1, the farthest, linear in disparity; depth_rank: from 1, nearest
    first; both null without depth. Flags: cut_by: sides of the photo that its pixels touch; small:
    fewer than 16 pixels; touches: regions whose pixels meet its own, one of them may hide a part.
    """

    region: str
    category: str | None
    centroid_uv: tuple[float, float]
    extent_wh: tuple[float, float]
    relative_depth: float | None
    depth_rank: int | None
    cut_by: tuple[Literal["left", "top", "right", "bottom"], ...]
    small: bool
    touches: tuple[str, ...]


class ConstructionPlan(Record, frozen=True, kw_only=True):
    """plan.json: every region that is no face of the room, nearest first, then by name.

    depth_source: of the evidence's depth; null without, and the objects' depths are unknown.
    """

    schema_version: Literal[1] = 1
    photo_sha256: Sha256
    width: Side
    height: Side
    depth_source: str | None
    objects: tuple[PlannedObject, ...]
