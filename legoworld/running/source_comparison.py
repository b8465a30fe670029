"""Comparison of scene.blend and scene.glb of one folder, instance by instance."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from legoworld.conventions import NO_INSTANCE
from legoworld.records.scene_folder import InstanceRow
from legoworld.running.inspection import Inspection

#: Minimum mask IoU at which the instances of both sources agree.
SAME_IOU: Final = 0.999

_ROUNDING_PX: Final = 1e-3  # what single precision leaves of a focal length
_SAME_DEPTH: Final = 1e-4  # relative


@dataclass(frozen=True, kw_only=True)
class Pair:
    """An instance in both sources, visible in at least one. iou: of its visible masks."""

    name: str
    blend_category: str | None
    glb_category: str | None
    blend_area_px: int
    glb_area_px: int
    iou: float


@dataclass(frozen=True, kw_only=True)
class SourceComparison:
    """Both sources at one size. lost, gained: instances.json rows of one source alone.

    unseen: instances of both sources that no pixel shows in either. differences: what else differs,
    in words.
    """

    blend: Inspection
    glb: Inspection
    pairs: tuple[Pair, ...]
    unseen: int
    lost: tuple[InstanceRow, ...]
    gained: tuple[InstanceRow, ...]
    differences: tuple[str, ...]

    @property
    def differing_px(self) -> int:
        """Pixels that show instances of different names, or an instance in one source only."""
        names = [np.array([e.name for e in x.entries] + [None]) for x in (self.blend, self.glb)]
        shown = [
            n[x.view.buffers.instance] for n, x in zip(names, (self.blend, self.glb), strict=True)
        ]
        return int((shown[0] != shown[1]).sum())

    @property
    def n_disagreeing(self) -> int:
        """Shared instances whose masks differ."""
        return sum(pair.iou < SAME_IOU for pair in self.pairs)

    @property
    def faithful(self) -> bool:
        """Whether both sources show the same instances, with the same categories and masks."""
        one_sided = any(entry.area_px for entry in (*self.lost, *self.gained))
        relabelled = any(pair.blend_category != pair.glb_category for pair in self.pairs)
        return not (self.n_disagreeing or one_sided or relabelled)


def compare_sources(blend: Inspection, glb: Inspection) -> SourceComparison:
    """Compare two views of one size, from a folder's scene.blend and from its scene.glb.

    Instances are matched by name; instances with the same name by the largest overlap first.
    """
    partner = _partners(blend, glb)
    pairs = [_pair(blend.entries[i], glb.entries[j], overlap) for i, j, overlap in partner]
    seen = [pair for pair in pairs if pair.blend_area_px or pair.glb_area_px]
    taken = {i for i, _, _ in partner}, {j for _, j, _ in partner}
    return SourceComparison(
        blend=blend,
        glb=glb,
        pairs=tuple(sorted(seen, key=lambda pair: (pair.iou >= SAME_IOU, pair.name))),
        unseen=len(pairs) - len(seen),
        lost=tuple(entry for entry in blend.entries if entry.id not in taken[0]),
        gained=tuple(entry for entry in glb.entries if entry.id not in taken[1]),
        differences=(*_snapshot_differences(blend, glb), *_view_differences(blend, glb)),
    )


def _pair(blend: InstanceRow, glb: InstanceRow, overlap: int) -> Pair:
    union = blend.area_px + glb.area_px - overlap
    return Pair(
        name=blend.name,
        blend_category=blend.category,
        glb_category=glb.category,
        blend_area_px=blend.area_px,
        glb_area_px=glb.area_px,
        iou=overlap / union if union else 1.0,
    )


def _partners(blend: Inspection, glb: Inspection) -> list[tuple[int, int, int]]:
    """(id in blend, id in glb, overlap in pixels) of instances with one name, each used once."""
    overlaps = _overlaps(blend.view.buffers.instance, glb.view.buffers.instance)
    names = [entry.name for entry in blend.entries], [entry.name for entry in glb.entries]
    ranked = sorted(((-n, i, j) for (i, j), n in overlaps.items() if names[0][i] == names[1][j]))
    partner: dict[int, tuple[int, int]] = {}
    taken: set[int] = set()
    for n, i, j in ranked:
        if i not in partner and j not in taken:
            partner[i] = (j, -n)
            taken.add(j)
    left: defaultdict[str, list[int]] = defaultdict(list)
    for j in range(len(names[1]) - 1, -1, -1):
        if j not in taken:
            left[names[1][j]].append(j)
    for i, name in enumerate(names[0]):
        if i not in partner and left[name]:
            partner[i] = (left[name].pop(), 0)
    return [(i, j, n) for i, (j, n) in sorted(partner.items())]


def _overlaps(first: NDArray[np.int32], second: NDArray[np.int32]) -> dict[tuple[int, int], int]:
    """The number of pixels that each pair of ids shares."""
    both = (first != NO_INSTANCE) & (second != NO_INSTANCE)
    code = first[both].astype(np.int64) << 32 | second[both]
    codes, counts = np.unique(code, return_counts=True)
    return {
        (int(code >> 32), int(code & 0xFFFFFFFF)): int(n)
        for code, n in zip(codes, counts, strict=True)
    }


def _snapshot_differences(blend: Inspection, glb: Inspection) -> Iterator[str]:
    """Properties that glTF cannot store, or that were not exported."""
    ours, theirs = blend.scene.snapshot, glb.scene.snapshot
    if ours.camera.name != theirs.camera.name:
        yield f"the camera is {theirs.camera.name!r}, not {ours.camera.name!r}"
    if ours.camera.shift_x or ours.camera.shift_y:
        yield f"lens shift {ours.camera.shift_x:g}, {ours.camera.shift_y:g} is lost"
    if ours.render.pixel_aspect_x != ours.render.pixel_aspect_y:
        yield "the pixel aspect is lost"
    if ours.render.unit_scale != 1:
        yield f"the unit scale is lost: 1 unit is {ours.render.unit_scale:g} m, in glTF 1 m"
    kept = {o.name for o in theirs.objects if o.properties}  # a collection comes as a node
    lost = [c.name for c in ours.collections if c.properties and c.name not in kept]
    if lost:
        yield f"labels of collections are lost: {', '.join(lost[:10])}"
    if ours.surface_holdout.any():
        yield f"{int(ours.surface_holdout.sum())} holdout surfaces are ordinary surfaces"
    if len(ours.cutouts) != len(theirs.cutouts):
        yield f"{len(ours.cutouts)} alpha cut-outs became {len(theirs.cutouts)}"
    if ours.n_triangles != theirs.n_triangles:
        yield f"{ours.n_triangles:,} triangles became {theirs.n_triangles:,}"


def _view_differences(blend: Inspection, glb: Inspection) -> Iterator[str]:
    ours, theirs = blend.view, glb.view
    for name in ("fx", "fy", "cx", "cy"):
        a, b = getattr(ours.projection, name), getattr(theirs.projection, name)
        if abs(a - b) > _ROUNDING_PX:
            yield f"the projection's {name} is {b:.3f} px, not {a:.3f}"
    poses = [
        np.asarray(x.scene.snapshot.camera.world_from_camera, np.float64) for x in (blend, glb)
    ]
    apart = float(np.linalg.norm(poses[0][:, 3] - poses[1][:, 3]))
    turned = float(np.abs(poses[0][:, :3] - poses[1][:, :3]).max())
    if turned > _SAME_DEPTH or apart > _SAME_DEPTH * max(1.0, float(np.abs(poses[0]).max())):
        yield f"the camera stands {apart:g} units away, its axes differ by up to {turned:g}"
    depths = ours.buffers.depth_z_m, theirs.buffers.depth_z_m
    both = np.isfinite(depths[0]) & np.isfinite(depths[1]) & (depths[0] > 0)
    if both.any():
        ratio = float(np.median(depths[1][both] / depths[0][both]))
        if abs(ratio - 1) > _SAME_DEPTH:
            yield f"depth is {ratio:.6g} times scene.blend's (median)"
