"""Requirements on entities in the world: what each measures there, and its residual."""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from legoworld.plugin.entities import Entities
from legoworld.plugin.state import LiveScene
from legoworld.records import plugin_requirements as kinds
from legoworld.solids import hulls
from legoworld.solids.meshes import own_front, surfaces_solid
from legoworld.solids.penetration import penetration_m
from legoworld.solids.support import RestContact, rest_on

#: What is nearer to the ground than this rests on it: the default tolerance of `support`.
_CONTACT_M: Final = 0.01


class UnknownError(Exception):
    """A requirement cannot be measured; the text says why."""


class UnmetError(Exception):
    """A requirement fails without a number: the text names what is missing to measure it."""


class Measured(NamedTuple):
    """What measuring gave. reason: what the measurement counts, if it has names."""

    measurement: float
    residual: float
    reason: str | None = None


class WorldMeasurement:
    """One scene; each method gives (measurement, residual) of a kind of requirement.

    UnknownError where there is nothing to measure, UnmetError where that itself is the failure.
    """

    def __init__(self, scene: LiveScene) -> None:
        self.scene = scene
        self.entities = Entities(scene.snapshot)

    def surfaces(self, name: str) -> NDArray[np.bool_]:
        """(S,) bool: an entity's surfaces. UnknownError where it has none."""
        surfaces = self.entities.surfaces(name)
        if surfaces is None:
            near = ", ".join(self.entities.nearest(name)) or "none"
            raise UnknownError(f"no object or collection {name!r}; similar names: {near}")
        if not surfaces.any():
            raise UnknownError(f"{name!r} has no surface that renders")
        return surfaces

    def points(self, name: str) -> NDArray[np.float64]:
        """(N, 3) an entity's vertices in the world, metres."""
        self.surfaces(name)
        return self.entities.points_m(name)

    def existence(self, requirement: kinds.Existence) -> tuple[float, float]:
        """How many surfaces render; the residual is 1 without any."""
        surfaces = self.entities.surfaces(requirement.entity)
        n_surfaces = 0 if surfaces is None else int(np.count_nonzero(surfaces))
        return float(n_surfaces), 0.0 if n_surfaces else 1.0

    def valid_transform(self, requirement: kinds.ValidTransform) -> tuple[float, float]:
        """Largest over smallest axis scale of any placement. UnmetError for a flat one."""
        worst = 1.0
        for surface in np.flatnonzero(self.surfaces(requirement.entity)).tolist():
            lengths, determinant = hulls.scales(self.scene.snapshot.world_from_mesh[surface])
            if not np.isfinite(lengths).all() or lengths.min() <= 0 or determinant <= 0:
                raise UnmetError("a placement is flat, mirrored or not finite")
            worst = max(worst, float(lengths.max() / lengths.min()))
        return worst, worst

    def dimensions(self, requirement: kinds.Dimensions) -> tuple[float, float]:
        """The side of the world box that is farthest outside of its limits, metres."""
        points = self.points(requirement.entity)
        sides = points.max(axis=0) - points.min(axis=0)
        low, high = np.array(requirement.low_m), np.array(requirement.high_m)
        outside = np.maximum(np.maximum(low - sides, sides - high), 0.0)
        worst = int(np.argmax(outside))
        return float(sides[worst]), float(outside[worst])

    def support(self, requirement: kinds.Support) -> tuple[float, float]:
        """The least gap to what is below, metres, below 0 where sunk in. UnmetError off balance."""
        rest = self._rest_contact(requirement)
        if abs(rest.gap_m) <= requirement.tolerance_m and not rest.balanced:
            raise UnmetError("its centre of mass is not above what it rests on")
        return rest.gap_m, abs(rest.gap_m)

    def stability(self, requirement: kinds.Stability) -> tuple[float, float]:
        """Its centre of mass to the edge of its support, metres. UnmetError: nothing carries it."""
        rest = self._rest_contact(requirement)
        if abs(rest.gap_m) > _CONTACT_M:
            raise UnmetError(f"it rests on nothing: the gap below it is {rest.gap_m:.3g} m")
        return rest.margin_m, max(0.0, requirement.margin_m - rest.margin_m)

    def _rest_contact(self, requirement: kinds.Support | kinds.Stability) -> RestContact:
        own = self.surfaces(requirement.entity)
        below = (
            self._around(own) if requirement.on is None else self.surfaces(requirement.on) & ~own
        )
        rest = rest_on(self.entities.triangles_m(own), self.entities.triangles_m(below))
        if rest is None:
            raise UnmetError("nothing is below it")
        return rest

    def touching(self, requirement: kinds.Touching) -> tuple[float, float]:
        """The least distance of its surface to another's, metres; 0 in contact. UnmetError."""
        own = self.surfaces(requirement.entity)
        other = ~own if requirement.on is None else self.surfaces(requirement.on) & ~own
        if not other.any():
            raise UnmetError("there is nothing else that it could touch")
        shot = self.scene.snapshot
        solids = [surfaces_solid(shot, np.flatnonzero(some).tolist()) for some in (own, other)]
        distance = solids[0].distance_m(solids[1])
        return distance, distance

    def _around(self, own: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """(S,) bool: the other surfaces, without those in the entity's box, which it holds."""
        points = self.entities.triangles_m(own).reshape(-1, 3)
        low, high = points.min(axis=0), points.max(axis=0)
        around = ~own
        for surface in np.flatnonzero(around).tolist():
            other = self.entities.surface_points_m(surface)
            around[surface] = not len(other) or bool(((other < low) | (other > high)).any())
        return around

    def containment(self, requirement: kinds.Containment) -> tuple[float, float]:
        """Share of vertices in the convex hull; the residual is what is missing. UnknownError."""
        points = self.points(requirement.entity)
        planes = hulls.hull_planes(self.points(requirement.inside))
        if planes is None:
            raise UnknownError(f"{requirement.inside!r} has no volume")
        share = hulls.share_inside(points, planes)
        return share, max(0.0, requirement.share - share)

    def collision(self, requirement: kinds.Collision) -> tuple[float, float]:
        """Penetration depth, metres. UnknownError where the two share surfaces."""
        first, second = self.surfaces(requirement.entity), self.surfaces(requirement.other)
        if (first & second).any():
            raise UnknownError("the two entities share surfaces")
        triangles = (self.entities.triangles_m(first), self.entities.triangles_m(second))
        depth = penetration_m(*triangles)
        return depth, depth

    def facing(self, requirement: kinds.Facing) -> tuple[float, float]:
        """Angle on the ground between its front and the way to the other, degrees. UnknownError."""
        way = self.middle(requirement.towards) - self.middle(requirement.entity)
        (angle,) = hulls.facing_angles_deg(self._front(requirement.entity), way[None]).tolist()
        if math.isnan(angle):
            raise UnknownError("one has no direction on the ground")
        return angle, angle

    def turn_to_face(self, requirement: kinds.Facing) -> float:
        """The turn about the upright, degrees, that makes `facing` 0."""
        way = self.middle(requirement.towards) - self.middle(requirement.entity)
        front = self._front(requirement.entity)
        turn = np.arctan2(way[1], way[0]) - np.arctan2(front[1], front[0])
        return float(np.degrees((turn + np.pi) % (2 * np.pi) - np.pi))

    def _front(self, name: str) -> NDArray[np.float64]:
        """(3,) an object's own -Y axis in the world, whatever its children do."""
        shot = self.scene.snapshot
        index = next((i for i, o in enumerate(shot.objects) if o.name == name), None)
        if index is None:
            raise UnknownError(f"{name!r} is a collection, which has no front: name an object")
        front = own_front(shot, index)
        if front is not None:
            return front
        placed = {(o.name, o.library): o for o in self.scene.state.objects}
        world = np.eye(4)
        while index >= 0:
            thing = shot.objects[index]
            basis, inverse = np.reshape(placed[thing.name, thing.library].transform, (2, 4, 4))
            world = inverse @ basis @ world
            index = thing.parent
        return np.asarray(-world[:3, 1])

    def layout(self, requirement: kinds.Layout) -> tuple[float, float]:
        """Largest deviation of a step from the mean step, over its length. UnknownError."""
        deviation = hulls.step_deviation([self.middle(name) for name in requirement.entities])
        if deviation is None:
            raise UnknownError("all of them are in one place")
        return deviation, deviation

    def middle(self, name: str) -> NDArray[np.float64]:
        """(3,) the middle of an entity's world box, metres."""
        points = self.points(name)
        return np.asarray((points.min(axis=0) + points.max(axis=0)) / 2)
