"""The construction plan: what the photo shows of each object, without sizes or distances."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from legoworld.escaping import markdown_cell
from legoworld.plugin.evidence import Evidence
from legoworld.plugin.residuals import SMALLEST_PX, measure_shape
from legoworld.records.plugin_evidence import ConstructionPlan, PlannedObject, Region, Structure

Mask = NDArray[np.bool_]
CutBy = Literal["left", "top", "right", "bottom"]


def construction_plan(evidence: Evidence, structures: Mapping[str, Structure]) -> ConstructionPlan:
    """Every region that shows no face of the room; nearest first, then by name.

    Relative depth is linear in the median disparity of a region: 0 is the nearest planned object, 1
    the farthest; the scale is unknown.
    """
    regions = [r for r in evidence.file.regions if r.name not in structures]
    masks = {r.name: evidence.mask(r) for r in regions}
    disparity = {name: _disparity(evidence, mask) for name, mask in masks.items()}
    known = sorted((d for d in disparity.values() if d is not None), reverse=True)
    objects = [
        _object(region, masks, evidence.size_wh, disparity[region.name], known)
        for region in regions
    ]
    far = len(objects) + 1
    return ConstructionPlan(
        photo_sha256=evidence.file.photo.sha256,
        width=evidence.size_wh[0],
        height=evidence.size_wh[1],
        depth_source=evidence.file.depth.source if evidence.file.depth else None,
        objects=tuple(sorted(objects, key=lambda o: (o.depth_rank or far, o.region))),
    )


def _disparity(evidence: Evidence, mask: Mask) -> float | None:
    """Median over a region's pixels that have one; None below 16 of them."""
    if evidence.disparity is None:
        return None
    values = evidence.disparity[mask]
    values = values[np.isfinite(values)]
    return float(np.median(values)) if len(values) >= SMALLEST_PX else None


def _object(
    region: Region,
    masks: Mapping[str, Mask],
    size_wh: tuple[int, int],
    disparity: float | None,
    known: list[float],
) -> PlannedObject:
    """known: the disparities of all planned objects that have one, nearest first."""
    width, height = size_wh
    mask = masks[region.name]
    shape = measure_shape(mask)
    assert shape is not None  # a region without a pixel is refused as evidence
    u, v = shape.centroid_uv
    _, _, w, h = shape.extent_xywh
    spread = known[0] - known[-1] if known else 0.0
    relative = None
    if disparity is not None:
        relative = (known[0] - disparity) / spread if spread else 0.0
    return PlannedObject(
        region=region.name,
        category=region.category,
        centroid_uv=(u / width, v / height),
        extent_wh=(w / width, h / height),
        relative_depth=relative,
        depth_rank=None if disparity is None else known.index(disparity) + 1,
        cut_by=_cut_by(mask),
        small=shape.area_px < SMALLEST_PX,
        touches=tuple(
            sorted(name for name, other in masks.items() if name != region.name
                   and (_grow_mask(mask) & other).any())
        ),
    )  # fmt: skip


def _cut_by(mask: Mask) -> tuple[CutBy, ...]:
    sides: tuple[tuple[CutBy, Mask], ...] = (
        ("left", mask[:, 0]), ("top", mask[0]), ("right", mask[:, -1]), ("bottom", mask[-1]),
    )  # fmt: skip
    return tuple(side for side, pixels in sides if pixels.any())


def _grow_mask(mask: Mask) -> Mask:
    """A mask with its 4-neighbours."""
    padded = np.pad(mask, 1)
    near = padded[:-2, 1:-1] | padded[2:, 1:-1] | padded[1:-1, :-2] | padded[1:-1, 2:]
    return np.asarray(mask | near)


def plan_markdown(plan: ConstructionPlan) -> str:
    """plan.md: the same plan as a table."""
    rows = [
        f"| {_rank(o)} | {markdown_cell(o.region)} | {markdown_cell(o.category or '')} "
        f"| {o.centroid_uv[0]:.3f}, {o.centroid_uv[1]:.3f} "
        f"| {o.extent_wh[0]:.3f} x {o.extent_wh[1]:.3f} "
        f"| {'unknown' if o.relative_depth is None else f'{o.relative_depth:.3f}'} "
        f"| {markdown_cell(_flags(o))} |"
        for o in plan.objects
    ]
    head = [
        "# Construction plan",
        "",
        f"Photo {plan.width}x{plan.height}, sha256 {plan.photo_sha256[:12]}. Centroids and",
        "extents are shares of the photo's width and height, from its upper left corner. Depth is",
        "relative: 0 is the nearest object, 1 the farthest. There is no metric depth and no size.",
        "",
        "| order | region | category | centroid u, v | extent w x h | relative depth | flags |",
        "|---:|---|---|---|---|---|---|",
    ]
    return "\n".join([*head, *rows, ""])


def _rank(planned_object: PlannedObject) -> str:
    return "unknown" if planned_object.depth_rank is None else str(planned_object.depth_rank)


def _flags(planned_object: PlannedObject) -> str:
    flags = [f"cut by the photo's {side} edge" for side in planned_object.cut_by]
    if planned_object.small:
        flags.append("small")
    if planned_object.touches:
        flags.append("touches " + ", ".join(planned_object.touches))
    return "; ".join(flags)
