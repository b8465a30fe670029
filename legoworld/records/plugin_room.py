"""room.json and plan.json: what a scene is begun with, recovered from evidence of the photo."""

from __future__ import annotations

from typing import Annotated, Literal

from msgspec import Meta

from legoworld.records.base import Record
from legoworld.records.plugin_evidence import Rows, Sha256, Side

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
