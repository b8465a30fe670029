"""evidence.json: what a photo says about the scene, from providers that never saw the scene."""

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
