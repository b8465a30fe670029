"""Requirements measured on one state of a scene: pass, fail or unknown, never a guess."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cached_property
from typing import Final

import msgspec
import numpy as np
from numpy.typing import NDArray

from legoworld.errors import LegoWorldError
from legoworld.plugin import residuals
from legoworld.plugin.acceptance import blocks
from legoworld.plugin.corrections import ViewedEntity, is_cut
from legoworld.plugin.evidence import Evidence
from legoworld.plugin.measure_world import Measured, UnknownError, UnmetError, WorldMeasurement
from legoworld.plugin.small_render import mean_lab, rec709_luma, upscale_nearest
from legoworld.plugin.state import LiveScene
from legoworld.pluralize import first_few
from legoworld.readouts.filled_view import with_surfaces
from legoworld.records import plugin_requirements as kinds
from legoworld.records.plugin_requirements import Correction, Report, Requirement, Result
from legoworld.visibility.camera import projection
from legoworld.visibility.kernel import Buffers
from legoworld.visibility.view import surfaces_through

Mask = NDArray[np.bool_]
RGB = NDArray[np.uint8]


#: All masks that are kept for the next requirement, at most.
_MASKS_BYTES: Final = 256 << 20
#: The fields that can be a tolerance; a kind has at most one of them, and 0 without any.
_TOLERANCES: Final = (
    "tolerance", "tolerance_m", "tolerance_deg", "tolerance_px", "slack_m", "ratio",
)  # fmt: skip


def measure(
    scene: LiveScene,
    requirements: Sequence[Requirement],
    evidence: Evidence | None,
    *,
    size_wh: tuple[int, int] | None = None,
) -> Report:
    """Every requirement in its order; of a scene that shows nothing, nothing exists.

    size_wh: of the view; the photo's size with evidence, else the scene's own when None.
    """
    if isinstance(scene.reading, LegoWorldError):
        size = evidence.size_wh if evidence else size_wh or (0, 0)
        results = tuple(
            _unmeasured_result(r, scene.reading.what, fails=isinstance(r, kinds.Existence))
            for r in requirements
        )
    else:
        size = evidence.size_wh if evidence else size_wh or scene.snapshot.render.size_wh
        measured = _Measurement(scene, evidence, size)
        results = tuple(measured.result(requirement) for requirement in requirements)
    return Report(
        scene_signature=scene.state.scene_signature,
        geometry_signature=scene.state.geometry_signature,
        photo_sha256=evidence.file.photo.sha256 if evidence else None,
        size_wh=size,
        results=results,
        blocked=any(map(blocks, results)),
    )


def only(report: Report, count: int) -> Report:
    """A report of the first requirements alone."""
    results = report.results[:count]
    return msgspec.structs.replace(report, results=results, blocked=any(map(blocks, results)))


def _unmeasured_result(requirement: Requirement, reason: str, *, fails: bool) -> Result:
    return Result(
        requirement=requirement,
        verdict="fail" if fails else "unknown",
        measurement=None,
        residual=None,
        tolerance=_tolerance(requirement),
        reason=reason,
    )


def surface_view(scene: LiveScene, size_wh: tuple[int, int]) -> Buffers:
    """Which surface of the snapshot its camera shows at each pixel, -1 for none, and how far.

    The kernel's answer as in a readout, so a mask is the union of its surfaces' pixels there.
    """
    camera = projection(scene.snapshot.camera, scene.snapshot.render, size_wh)
    return surfaces_through(camera, scene.snapshot, size_wh)


def surface_pixels(surfaces: Mask, buffers: Buffers) -> Mask:
    """(H, W) bool: the pixels that show some surfaces. surfaces: (S,) bool."""
    # The last entry is for -1: nothing is hit.
    return np.asarray(np.append(surfaces, False)[buffers.instance])


class _Measurement(WorldMeasurement):
    """One scene under one photo; everything is computed when first asked for."""

    def __init__(
        self,
        scene: LiveScene,
        evidence: Evidence | None,
        size_wh: tuple[int, int],
    ) -> None:
        super().__init__(scene)
        self.evidence, self.size_wh = evidence, size_wh
        self._masks: dict[tuple[str, str], Mask] = {}
        self._measured: dict[tuple[str, str], tuple[residuals.Shape, residuals.Shape]] = {}
        self._views: dict[str, ViewedEntity] = {}
        self._pairs: dict[tuple[str, str], tuple[float, float] | None] = {}

    def result(self, requirement: Requirement) -> Result:
        tolerance = _tolerance(requirement)
        try:
            value, residual, reason = self._values(requirement)
        except (UnknownError, UnmetError) as error:
            return _unmeasured_result(requirement, str(error), fails=isinstance(error, UnmetError))
        return Result(
            requirement=requirement,
            verdict="pass" if residual <= tolerance else "fail",
            measurement=value,
            residual=residual,
            tolerance=tolerance,
            reason=reason,
            correction=self._correction(requirement, value) if residual > 0 else None,
        )

    def _correction(self, requirement: Requirement, measurement: float) -> Correction | None:
        """What would take a residual to zero; None where no one move, scale or turn does."""
        match requirement:
            case kinds.Centroid() | kinds.Extent() | kinds.Overlap() | kinds.Boundary():
                viewed = self._view_entity(requirement.entity)
                both = self._shapes(requirement.entity, requirement.region)
                if any(is_cut(shape, self.size_wh) for shape in both):
                    return None
                if isinstance(requirement, kinds.Extent):
                    return viewed.fit(*both)
                return viewed.towards(*both, scaled=not isinstance(requirement, kinds.Centroid))
            case kinds.Depth():
                return self._view_entity(requirement.entity).along_ray(measurement)
            case kinds.Support():
                return Correction(move_m=(0.0, 0.0, -measurement))
            case kinds.Facing():
                return Correction(yaw_deg=self.turn_to_face(requirement))
            case _:
                return None

    def _view_entity(self, entity: str) -> ViewedEntity:
        if entity not in self._views:
            depth_z_m = self.buffers.depth_z_m[self.mask(entity)]
            self._views[entity] = ViewedEntity(
                snapshot=self.scene.snapshot,
                size_wh=self.size_wh,
                depth_m=float(np.median(depth_z_m)),
                middle_m=self.middle(entity),
            )
        return self._views[entity]

    def _values(self, requirement: Requirement) -> Measured:
        """By the method of the kind's name. UnknownError where there is nothing to measure."""
        kind = str(requirement.__struct_config__.tag)
        return Measured(*getattr(self, kind)(requirement))

    # In the picture.

    @cached_property
    def buffers(self) -> Buffers:
        return surface_view(self.scene, self.size_wh)

    def mask(self, name: str) -> Mask:
        surfaces = self.surfaces(name)
        return self._cached_mask((name, "mask"), lambda: surface_pixels(surfaces, self.buffers))

    def region(self, name: str) -> Mask:
        if self.evidence is None:
            raise UnknownError("there is no evidence")
        evidence, region = self.evidence, self.evidence.region(name)
        if region is None:
            raise UnknownError(f"the evidence has no region {name!r}")
        return self._cached_mask((name, "region"), lambda: evidence.mask(region))

    def _cached_mask(self, what: tuple[str, str], make: Callable[[], Mask]) -> Mask:
        """A mask that several requirements ask for, kept while all of them are small."""
        if what not in self._masks:
            if len(self._masks) * self.size_wh[0] * self.size_wh[1] > _MASKS_BYTES:
                self._masks.clear()
            self._masks[what] = make()
        return self._masks[what]

    def _shapes(self, entity: str, region: str) -> tuple[residuals.Shape, residuals.Shape]:
        """Of the visible mask and of the region; both have to be large enough."""
        if (entity, region) not in self._measured:
            self._measured[entity, region] = (
                _large_shape(self.mask(entity), "visible mask"),
                _large_shape(self.region(region), "region"),
            )
        return self._measured[entity, region]

    def visibility(self, requirement: kinds.Visibility) -> tuple[float, float]:
        area = int(np.count_nonzero(self.mask(requirement.entity)))
        return float(area), float(max(0, requirement.area_px - area))

    def hidden(self, requirement: kinds.Hidden) -> Measured:
        own = np.flatnonzero(self.surfaces(requirement.entity))
        alone = replace(self.scene, reading=with_surfaces(self.scene.snapshot, own))
        whole = surface_view(alone, self.size_wh).instance >= 0
        if (area := int(np.count_nonzero(whole))) < residuals.SMALLEST_PX:
            raise UnknownError(f"it has {area} pixels in the picture, fewer than 16")
        unseen = whole & ~self.mask(requirement.entity)
        if requirement.other is not None:
            unseen &= self.mask(requirement.other)
        share = int(np.count_nonzero(unseen)) / area
        shot, hiding = self.scene.snapshot, self.buffers.instance[unseen]
        owners = shot.occurrence_object[shot.surface_occurrence[hiding[hiding >= 0]]]
        found, pixels = np.unique(owners, return_counts=True)
        named = [
            f"{shot.objects[found[k]].name} {pixels[k]} px"
            for k in np.argsort(-pixels, kind="stable")
        ]
        return Measured(share, share, first_few(named, 5) or None)

    def centroid(self, requirement: kinds.Centroid) -> tuple[float, float]:
        shapes = self._shapes(requirement.entity, requirement.region)
        offset = math.hypot(*residuals.centroid_offset(*shapes, self.size_wh))
        return offset, offset

    def extent(self, requirement: kinds.Extent) -> tuple[float, float]:
        shapes = self._shapes(requirement.entity, requirement.region)
        worst = max(map(abs, residuals.extent_ratio(*shapes)))
        return worst, worst

    def overlap(self, requirement: kinds.Overlap) -> tuple[float, float]:
        iou = residuals.overlap(*self._large_masks(requirement.entity, requirement.region))
        return iou, 1.0 - iou

    def boundary(self, requirement: kinds.Boundary) -> tuple[float, float]:
        masks = self._large_masks(requirement.entity, requirement.region)
        distance = residuals.boundary_distance_px(*masks)
        return distance, distance

    def _large_masks(self, entity: str, region: str) -> tuple[Mask, Mask]:
        self._shapes(entity, region)
        return self.mask(entity), self.region(region)

    # Depth and light.

    def _pair(self, entity: str, region: str) -> tuple[float, float] | None:
        if (entity, region) not in self._pairs:
            both = self.mask(entity) & self.region(region)
            pair = residuals.median_pair(self.buffers.depth_z_m, self._disparity, both)
            self._pairs[entity, region] = pair
        return self._pairs[entity, region]

    @property
    def _disparity(self) -> NDArray[np.float64]:
        if self.evidence is None or self.evidence.disparity is None:
            raise UnknownError("the evidence has no depth")
        return self.evidence.disparity

    def depth(self, requirement: kinds.Depth) -> tuple[float, float]:
        own = [region for entity, region in requirement.matched if entity == requirement.entity]
        if not own:
            raise UnknownError(f"{requirement.entity!r} is not among the matched entities")
        pairs = [self._pair(*match) for match in requirement.matched]
        fit = residuals.fit_depth([pair for pair in pairs if pair is not None])
        if fit is None:
            known = sum(pair is not None for pair in pairs)
            raise UnknownError(f"no fit of depth over {known} matched regions with 16 pixels each")
        both = self.mask(requirement.entity) & self.region(own[0])
        log = residuals.depth_residual(fit, self.buffers.depth_z_m, self._disparity, both)
        if log is None:
            raise UnknownError("fewer than 16 pixels have both depths")
        return log, abs(log)

    def depth_order(self, requirement: kinds.DepthOrder) -> tuple[float, float]:
        pairs = [self._pair(*match) for match in requirement.matched]
        known = [pair for pair in pairs if pair is not None]
        if len(known) < len(pairs):
            raise UnknownError(
                f"{len(pairs) - len(known)} of {len(pairs)} have no 16 pixels of both"
            )
        share, tau = residuals.inversions([p[0] for p in known], [p[1] for p in known])
        return tau, share

    def luminance(self, requirement: kinds.Luminance) -> tuple[float, float]:
        region = self.region(requirement.region)
        ours, theirs = (
            float(rec709_luma(rgb).mean()) for rgb in self._both_rgb(region, region, "region")
        )
        return ours - theirs, abs(ours - theirs)

    def colour(self, requirement: kinds.Colour) -> tuple[float, float]:
        mask, region = self.mask(requirement.entity), self.region(requirement.region)
        ours, theirs = map(mean_lab, self._both_rgb(mask, region, "entity"))
        difference = float(np.linalg.norm(ours - theirs))
        return difference, difference

    def _both_rgb(self, mask: Mask, region: Mask, whose: str) -> tuple[RGB, RGB]:
        """(n, 3) pixels of the small render under a mask, and (m, 3) of the photo in a region."""
        if self.evidence is None or self.evidence.photo is None:
            raise UnknownError("the photo itself is not there: serve with --photo")
        if self.scene.render is None:
            raise UnknownError("nothing was rendered")
        for pixels, name in ((mask, whose), (region, "region")):
            if np.count_nonzero(pixels) < residuals.SMALLEST_PX:
                raise UnknownError(f"the {name} has fewer than 16 pixels")
        return upscale_nearest(self.scene.render, self.size_wh)[mask], self.evidence.photo[region]


def _large_shape(pixels: Mask, whose: str) -> residuals.Shape:
    shape = residuals.measure_shape(pixels)
    if shape is None or shape.area_px < residuals.SMALLEST_PX:
        raise UnknownError(f"the {whose} has {shape.area_px if shape else 0} pixels, fewer than 16")
    return shape


def _tolerance(requirement: Requirement) -> float:
    return float(next((getattr(requirement, n) for n in _TOLERANCES if hasattr(requirement, n)), 0))
