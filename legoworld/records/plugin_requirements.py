"""Requirements on a scene, and what measuring them gave."""

from __future__ import annotations

from typing import Annotated, Literal

from msgspec import Meta

from legoworld.records.base import Record

#: An object, with what is parented to it, or a collection, with what is below it.
Entity = Annotated[str, Meta(min_length=1, max_length=300)]
Positive = Annotated[float, Meta(gt=0)]
Share = Annotated[float, Meta(ge=0, le=1)]


class AnyRequirement(Record, frozen=True, kw_only=True, tag_field="kind"):
    """hard: what is not accepted blocks; otherwise it warns.

    accept: when a transaction may be committed. passes: within the tolerance. improves, not_worse:
    against the residual when it began. null: of the picture (centroid, extent, overlap, boundary,
    depth, depth_order, luminance, colour) what an entity has is judged together: its closeness, IoU
    times exp(-depth residual in tolerances), must not fall; of the world, it passes.
    """

    hard: bool = True
    accept: Literal["passes", "improves", "not_worse"] | None = None


class _OfEntity(AnyRequirement, frozen=True, kw_only=True):
    entity: Entity


class _OnAnother(_OfEntity, frozen=True, kw_only=True):
    on: Entity | None = None


class _InRegion(_OfEntity, frozen=True, kw_only=True):
    region: str


class Existence(_OfEntity, frozen=True, kw_only=True, tag="existence"):
    """The entity is in the scene and has a surface that renders."""


class ValidTransform(_OfEntity, frozen=True, kw_only=True, tag="valid_transform"):
    """Placements are finite and neither flat nor mirrored; ratio: largest over smallest scale."""

    ratio: Positive = 100.0


class Dimensions(_OfEntity, frozen=True, kw_only=True, tag="dimensions"):
    """The sides of the entity's axis-aligned world box, metres, lie between low and high."""

    low_m: tuple[float, float, float]
    high_m: tuple[float, float, float]


class Support(_OnAnother, frozen=True, kw_only=True, tag="support"):
    """Straight below the entity's lowest points, another surface is within tolerance_m.

    on: the entity that must carry it, null for any.
    """

    tolerance_m: Positive = 0.01


class Stability(_OnAnother, frozen=True, kw_only=True, tag="stability"):
    """It rests on a surface, with its centre of mass margin_m inside the edge of its support.

    The support is the convex hull, seen from above, of where it is in contact. on: as of support.
    """

    margin_m: Annotated[float, Meta(ge=0)] = 0.0


class Touching(_OnAnother, frozen=True, kw_only=True, tag="touching"):
    """The entity's surface is within tolerance_m of another: it hangs on a wall, say.

    on: what it must touch (the wall, the ceiling), null for anything; what touches nothing floats.
    """

    tolerance_m: Positive = 0.01


class Containment(_OfEntity, frozen=True, kw_only=True, tag="containment"):
    """At least `share` of the entity's vertices lie in the convex hull of `inside`."""

    inside: Entity
    share: Share = 1.0


class Collision(_OfEntity, frozen=True, kw_only=True, tag="collision"):
    """Two entities do not reach into each other by more than slack_m."""

    other: Entity
    slack_m: Positive = 0.005


class Facing(_OfEntity, frozen=True, kw_only=True, tag="facing"):
    """Seen from above, the entity's front (its own -Y axis, as in Blender) points at another."""

    towards: Entity
    tolerance_deg: Positive = 15.0


class Layout(AnyRequirement, frozen=True, kw_only=True, tag="layout"):
    """Entities in a row: their centres step evenly, within `tolerance` of the mean step."""

    entities: Annotated[tuple[Entity, ...], Meta(min_length=3, max_length=1000)]
    tolerance: Positive = 0.1


class Visibility(_OfEntity, frozen=True, kw_only=True, tag="visibility"):
    """The camera sees at least area_px pixels of the entity, at the photo's size."""

    area_px: Annotated[int, Meta(ge=1)] = 16


class Hidden(_OfEntity, frozen=True, kw_only=True, tag="hidden"):
    """At most `tolerance` of the entity's pixels in the picture are hidden by something else.

    other: by this entity, null for anything. The reason names what hides it, with the pixels.
    """

    other: Entity | None = None
    tolerance: Share = 0.5


class Centroid(_InRegion, frozen=True, kw_only=True, tag="centroid"):
    """Centroids of visible mask and region: (du / W, dv / H), its length within tolerance."""

    tolerance: Positive = 0.02


class Extent(_InRegion, frozen=True, kw_only=True, tag="extent"):
    """Extents of visible mask and region: the larger |log| of the width and height ratios."""

    tolerance: Positive = 0.10


class Overlap(_InRegion, frozen=True, kw_only=True, tag="overlap"):
    """IoU of visible mask and region; the residual is 1 - IoU."""

    tolerance: Positive = 0.5


class Boundary(_InRegion, frozen=True, kw_only=True, tag="boundary"):
    """Mean distance of both outlines to each other, pixels."""

    tolerance_px: Positive = 8.0


class Depth(_OfEntity, frozen=True, kw_only=True, tag="depth"):
    """Depth of the entity under the photo's relative depth, after one fit over `matched`.

    matched: pairs of entity and region, this one among them; at least three are needed.
    """

    matched: tuple[tuple[Entity, str], ...]
    tolerance: Positive = 0.10


class DepthOrder(AnyRequirement, frozen=True, kw_only=True, tag="depth_order"):
    """Entities stand in the regions' order of depth; the residual is the share of inversions."""

    matched: Annotated[tuple[tuple[Entity, str], ...], Meta(min_length=2)]
    tolerance: Annotated[float, Meta(ge=0)] = 0.0


class Luminance(AnyRequirement, frozen=True, kw_only=True, tag="luminance"):
    """Mean Rec. 709 luma over the region: of the photo and of a small fixed render."""

    region: str
    tolerance: Positive = 0.10


class Colour(_InRegion, frozen=True, kw_only=True, tag="colour"):
    """CIE 1976 colour difference of the entity in a small fixed render and the photo's region.

    Of the means of L*a*b* over the entity's visible pixels and over the region. Light counts, too.
    """

    tolerance: Positive = 9.0


Requirement = (
    Existence
    | ValidTransform
    | Dimensions
    | Support
    | Stability
    | Touching
    | Containment
    | Collision
    | Facing
    | Layout
    | Visibility
    | Hidden
    | Centroid
    | Extent
    | Overlap
    | Boundary
    | Depth
    | DepthOrder
    | Luminance
    | Colour
)


class Correction(Record, frozen=True, kw_only=True):
    """What would take a residual to zero, all else left as it is; null where none does.

    move_m: of the entity, world axes, in the plane of the picture or along the view; on_ground_m:
    the same in the picture by a move along x and y; scale: a factor about the middle of its world
    box; yaw_deg: about the upright through it, counter-clockwise from above.
    """

    move_m: tuple[float, float, float] | None = None
    on_ground_m: tuple[float, float, float] | None = None
    scale: float | None = None
    yaw_deg: float | None = None


class Result(Record, frozen=True, kw_only=True):
    """One requirement measured.

    measurement: the value itself (a distance, an IoU, an angle); residual: how far it is from what
    is required, in the unit of the tolerance. The verdict is pass exactly when the residual is at
    most the tolerance. Both are null where there is nothing to measure; `reason` then says why, and
    the verdict is unknown, or fail where that itself breaks the requirement (nothing below it).
    Beside a measurement, `reason` names what it counts (what hides an entity).
    correction: where one is known and the residual is above 0.
    """

    requirement: Requirement
    verdict: Literal["pass", "fail", "unknown"]
    measurement: float | None
    residual: float | None
    tolerance: float
    reason: str | None = None
    correction: Correction | None = None


class Report(Record, frozen=True, kw_only=True):
    """All results about one state of the scene; stale as soon as its signature is another.

    blocked: a hard requirement that has to pass does not, or one is unknown.
    """

    schema_version: Literal[1] = 1
    scene_signature: str
    geometry_signature: str
    photo_sha256: str | None
    size_wh: tuple[int, int]
    results: tuple[Result, ...]
    blocked: bool
