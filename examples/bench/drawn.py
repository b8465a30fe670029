"""Families drawn by a seed: the eight programs with other assets, layouts, cameras and lights.

    python examples/bench/drawn.py --kaykit FOLDER --seed 7 --number 12 -o references

The same seed and number draw the same scene. A thing keeps its place on what carries it; its place
is drawn again while it would enter another thing or stand on less than its middle, and a layout
whose tiers or views lack something is drawn again as a whole.
"""

from __future__ import annotations

import argparse
import colorsys
import math
import random
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import bpy
from build import FAMILIES
from kaykit import Stage, assets_folder, extent
from mathutils import Matrix, Vector
from mathutils.bvhtree import BVHTree

#: Assets that stand for each other.
ALIKE = (
    "furniture/couch furniture/couch_pillows",
    "furniture/armchair furniture/armchair_pillows",
    "furniture/bed_double_A furniture/bed_double_B",
    "furniture/chair_A furniture/chair_A_wood furniture/chair_B furniture/chair_B_wood "
    "furniture/chair_C",
    "furniture/chair_stool furniture/chair_stool_wood",
    "furniture/pictureframe_large_A furniture/pictureframe_large_B furniture/pictureframe_medium",
    "furniture/pictureframe_small_A furniture/pictureframe_small_B furniture/pictureframe_small_C",
    "furniture/pictureframe_standing_A furniture/pictureframe_standing_B",
    "furniture/pillow_A furniture/pillow_B",
    "furniture/cactus_small_A furniture/cactus_small_B",
    "furniture/cactus_medium_A furniture/cactus_medium_B",
    "furniture/rug_oval_A furniture/rug_oval_B",
    "furniture/rug_rectangle_A furniture/rug_rectangle_B furniture/rug_rectangle_stripes_A "
    "furniture/rug_rectangle_stripes_B",
    "restaurant/table_round_A restaurant/table_round_B",
    "restaurant/chair_A restaurant/chair_B",
    "restaurant/plate restaurant/plate_dirty restaurant/plate_small",
    "restaurant/bowl restaurant/bowl_dirty restaurant/bowl_small",
    "restaurant/pot_A restaurant/pot_A_stew restaurant/pot_B restaurant/pot_B_stew",
    "restaurant/fridge_A restaurant/fridge_B",
    "restaurant/jar_A_medium restaurant/jar_B_medium restaurant/jar_C_medium "
    "restaurant/jar_D_medium",
    "restaurant/crate_carrots restaurant/crate_lettuce restaurant/crate_onions "
    "restaurant/crate_potatoes restaurant/crate_tomatoes restaurant/crate_buns",
    "restaurant/food_burger restaurant/food_vegetableburger restaurant/food_stew",
    "restaurant/food_ingredient_tomato restaurant/food_ingredient_onion "
    "restaurant/food_ingredient_potato",
    "restaurant/ketchup restaurant/mustard",
    " ".join(f"city_builder/building_{letter}" for letter in "ABCDEFGH"),
    " ".join(
        f"city_builder/car_{kind}" for kind in ("hatchback", "police", "sedan", "stationwagon",
                                               "taxi")
    ),
    "city_builder/box_A city_builder/box_B",
    "city_builder/trash_A city_builder/trash_B",
    " ".join(f"city_builder/trafficlight_{letter}" for letter in "ABC"),
)  # fmt: skip
VARIANTS = {name: group.split() for group in ALIKE for name in group.split()}
#: Parts of a row, which stay where their program has them.
FITTED = ("restaurant/kitchencounter", "restaurant/oven", "restaurant/fridge")
TIERS = (None, "medium", "hard")
#: Share of the things of later tiers that a draw leaves out, tries for a place, and for a layout.
LEFT_OUT, PLACES, LAYOUTS = 0.2, 24, 40
#: How far a thing may reach into another, metres; rugs are thinner than what stands across them.
TOUCH_M, RUG_M = 0.005, 0.06
#: How far a foot may be from what carries it.
NEAR = Vector((0.0, 0.0, 0.015))
#: Rays of a view in which a thing has to be seen at least so often, in one of the views.
GRID, SEEN = (128, 72), 6


class NotThisLayoutError(Exception):
    """A layout that is drawn again, and why."""


@dataclass(frozen=True)
class Placed:
    """A thing that was put: where its program wants it, the box and the faces it got.

    wanted: x, y and turn; half: of its footprint along its own axes, metres; on: what carries it.
    """

    root: Any
    wanted: tuple[float, float, float]
    half: tuple[float, float]
    on: Placed | None
    tree: BVHTree
    low: Vector
    high: Vector

    @property
    def is_thing(self) -> bool:
        return "category" in self.root


class DrawnStage(Stage):
    """A stage whose calls are a draw around what a family's program asks for."""

    def __init__(self, assets: Path, environment: str, theme: str, draw: random.Random) -> None:
        super().__init__(assets, environment, theme)
        self.scene["split"] = "procedural"
        self._draw, self._indoor = draw, environment == "indoor"
        self._chosen: dict[str, str] = {}
        self._placed: list[Placed] = []
        self._gone: list[tuple[float, float]] = []
        self._mirror = draw.choice((1, -1))

    def put(self, asset: str, x: float, y: float, *, z: float | None = None, turn: float = 0.0,
            scale: float = 1.0, category: str | None = None, tier: str | None = None,
            reach: float = 0.5) -> Any:  # fmt: skip
        """Near the place, or nowhere: a thing of a later tier may be left out."""
        wanted = (self._mirror * x, y, self._mirror * turn)
        if category is None:
            made = super().put(asset, *wanted[:2], z=z, turn=wanted[2], scale=scale)
            return self._note(made, wanted, None)
        carrier = self._carrier(*wanted[:2]) if z is None else None
        if tier and (self._draw.random() < LEFT_OUT or self._lost_carrier(carrier, wanted)):
            self._gone.append(wanted[:2])
            return None
        asset = self._variant(asset)
        fitted = z == 0.0 or asset.startswith(FITTED)
        scale *= 1.0 if fitted or z is not None else self._draw.uniform(0.94, 1.06)
        for number in range(PLACES):
            share = 0.0 if fitted else 1.0 - number / (PLACES - 1)
            place = self._drawn_place(wanted, z, carrier, share)
            made = super().put(asset, *place[:2], z=z, turn=place[2], scale=scale,
                               category=category, tier=tier, reach=reach)  # fmt: skip
            if (z is not None or self._stands(made)) and self._is_free(made):
                return self._note(made, wanted, carrier)
            remove(made)
        if tier is None:
            raise NotThisLayoutError(f"no place for {asset}")
        self._gone.append(wanted[:2])
        return None

    def box(self, name: str, low: tuple, high: tuple, color: tuple) -> Any:
        """A part of the architecture, of a colour near the program's."""
        hue, saturation, value = colorsys.rgb_to_hsv(*color)
        drawn = colorsys.hsv_to_rgb(
            (hue + self._draw.gauss(0.0, 0.08)) % 1.0,
            min(max(saturation * self._draw.uniform(0.6, 1.3), 0.0), 1.0),
            min(max(value * self._draw.uniform(0.75, 1.15), 0.05), 0.95),
        )
        made = super().box(name, low, high, drawn)
        self._note(made, (0.0, 0.0, 0.0), None)
        return made

    def light(self, sky: tuple, strength: float, sun: float, tilt: tuple[float, float]) -> None:
        """Another hour: the sun stands elsewhere, both are brighter or darker."""
        uniform = self._draw.uniform
        warm = uniform(-0.08, 0.08)
        sky = tuple(min(c + d, 1.0) for c, d in zip(sky, (warm, 0.0, -warm), strict=True))
        tilt = (tilt[0] + uniform(-12.0, 12.0), self._mirror * tilt[1] + uniform(-40.0, 40.0))
        super().light(sky, strength * uniform(0.7, 1.2), sun * uniform(0.6, 1.3), tilt)

    def view(self, number: int, place: tuple, target: tuple, lens: float) -> None:
        """From another place near the program's, at another point, through another lens."""
        far = 0.08 * math.dist(place, target)
        moved = [c + self._draw.uniform(-far, far) for c in place]
        seen = [c + self._draw.uniform(-0.2, 0.2) * far for c in target]
        moved[0], seen[0] = (c[0] + (self._mirror - 1) * p[0] for c, p in
                             ((moved, place), (seen, target)))  # fmt: skip
        super().view(number, tuple(moved), tuple(seen), lens * self._draw.uniform(0.92, 1.1))

    def finish(self) -> None:
        """Take away what no view sees and nothing stands on; raises NotThisLayoutError."""
        views = sorted((o for o in self.scene.objects if "view" in o), key=lambda o: o["view"])
        while True:
            counts = [self._seen_from(view) for view in views]
            bearers = {id(one.on) for one in self._placed}
            unseen = [
                one for one in self._placed
                if one.is_thing and id(one) not in bearers
                and max(count.get(one.root.name, 0) for count in counts) < SEEN
            ]  # fmt: skip
            if not unseen:
                break
            for one in unseen:
                self._placed.remove(one)
                remove(one.root)
            bpy.context.view_layer.update()
        things = [one.root for one in self._placed if one.is_thing]
        for tier, least in zip(TIERS, (3, 1, 1), strict=True):
            of_tier = [thing.name for thing in things if thing.get("tier") == tier]
            for count in counts:
                if sum(count.get(name, 0) >= SEEN for name in of_tier) < least:
                    raise NotThisLayoutError(f"a view sees too little of {tier or 'easy'}")

    def _variant(self, asset: str) -> str:
        """One that stands for an asset; things of one asset are mostly alike in a scene."""
        group = VARIANTS.get(asset, [asset])
        first = self._chosen.setdefault(asset, self._draw.choice(group))
        return first if self._draw.random() < 0.7 else self._draw.choice(group)

    def _carrier(self, x: float, y: float) -> Placed | None:
        """The last thing whose footprint, as the program wants it, has the point."""
        for one in reversed(self._placed):
            if one.is_thing:
                along, across = turned(x - one.wanted[0], y - one.wanted[1], -one.wanted[2])
                if abs(along) <= one.half[0] and abs(across) <= one.half[1]:
                    return one
        return None

    def _lost_carrier(self, carrier: Placed | None, wanted: tuple[float, float, float]) -> bool:
        near = (math.dist(wanted[:2], place) < 0.5 for place in self._gone)
        return carrier is None and any(near)

    def _drawn_place(
        self, wanted: tuple[float, float, float], z: float | None, carrier: Placed | None,
        share: float,
    ) -> tuple[float, float, float]:  # fmt: skip
        """x, y and turn: with what carries it, and moved by at most `share` of what is allowed."""
        x, y, turn = wanted
        reach, most = (0.30, 15.0) if self._indoor else (0.10, 8.0)
        if z is not None:  # on a wall or a tile: along it
            dx, _ = turned(self._draw.uniform(-reach, reach) * share, 0.0, turn)
            dy = math.sin(math.radians(turn)) * self._draw.uniform(-reach, reach) * share
            return x + dx, y + dy, turn
        if carrier is not None:
            reach *= 0.5
            place, angle = carrier.root.matrix_world.translation, carrier.root["turn"]
            dx, dy = turned(x - carrier.wanted[0], y - carrier.wanted[1],
                            angle - carrier.wanted[2])  # fmt: skip
            x, y, turn = place.x + dx, place.y + dy, turn + angle - carrier.wanted[2]
        return (
            x + self._draw.uniform(-reach, reach) * share,
            y + self._draw.uniform(-reach, reach) * share,
            turn + self._draw.uniform(-most, most) * share,
        )

    def _stands(self, made: Any) -> bool:
        """Whether the middle of what it stands on lies between points that carry it."""
        low, high = extent(made)
        lowest = low.z + 0.02 * (high.z - low.z) + 1e-4
        parts = [part for part in (made, *made.children_recursive) if part.type == "MESH"]
        foot = [
            place
            for part in parts
            for place in (part.matrix_world @ vertex.co for vertex in part.data.vertices)
            if place.z <= lowest
        ]
        foot = foot[:: max(1, len(foot) // 50)]
        for part in parts:
            part.hide_set(True)
        bpy.context.view_layer.update()
        graph = bpy.context.evaluated_depsgraph_get()
        carried = [
            place for place in foot
            if self.scene.ray_cast(graph, place + NEAR, -NEAR, distance=2 * NEAR.length)[0]
        ]  # fmt: skip
        for part in parts:
            part.hide_set(False)
        bpy.context.view_layer.update()
        middle = [(min(p[k] for p in foot) + max(p[k] for p in foot)) / 2 for k in (0, 1)]
        return bool(carried) and all(
            min(p[k] for p in carried) <= middle[k] <= max(p[k] for p in carried) for k in (0, 1)
        )

    def _is_free(self, made: Any) -> bool:
        """Whether it enters nothing that was put before."""
        low, high, tree = surface(made, TOUCH_M)
        for other in self._placed:
            apart = any(low[k] > other.high[k] or high[k] < other.low[k] for k in range(3))
            thin = "rug" in (made["category"], other.root.get("category"))
            if not apart and not (thin and min(high.z, other.high.z) - max(low.z, other.low.z)
                                  <= RUG_M) and tree.overlap(other.tree):  # fmt: skip
                return False
        return True

    def _note(self, made: Any, wanted: tuple[float, float, float], carrier: Placed | None) -> Any:
        made["turn"] = math.degrees(made.matrix_world.to_euler().z)
        low, high, tree = surface(made, 0.0)
        own_from_world = made.matrix_world.inverted()
        corners = [
            own_from_world @ part.matrix_world @ Vector(corner)
            for part in (made, *made.children_recursive)
            if part.type == "MESH"
            for corner in part.bound_box
        ]
        size = made.matrix_world.to_scale().x
        half = tuple(max(abs(c[k]) for c in corners) * size for k in (0, 1))
        self._placed.append(Placed(made, wanted, half, carrier, tree, low, high))
        return made

    def _seen_from(self, view: Any) -> dict[str, int]:
        """How many rays of a view meet each thing; raises where the camera is too close."""
        wide, tall = GRID
        bpy.context.view_layer.update()
        graph, place = bpy.context.evaluated_depsgraph_get(), view.matrix_world.translation
        half = math.tan(view.data.angle_x / 2)
        owners = {part.name: one.root.name for one in self._placed
                  for part in (one.root, *one.root.children_recursive)}  # fmt: skip
        counts: dict[str, int] = {}
        close = 0
        for row in range(tall):
            for column in range(wide):
                ray = Vector(((2 * (column + 0.5) / wide - 1) * half,
                              (1 - 2 * (row + 0.5) / tall) * half * tall / wide, -1.0))  # fmt: skip
                ray = view.matrix_world.to_3x3() @ ray
                hit, point, _, _, thing, _ = self.scene.ray_cast(graph, place, ray)
                if hit:
                    name = owners[thing.name]
                    counts[name] = counts.get(name, 0) + 1
                    close += (point - place).length < (1.0 if self._indoor else 0.6)
        if close > 0.02 * wide * tall:
            raise NotThisLayoutError("something is close to a camera")
        return counts


def turned(x: float, y: float, degrees: float) -> tuple[float, float]:
    """A vector turned about z."""
    moved = Matrix.Rotation(math.radians(degrees), 3, "Z") @ Vector((x, y, 0.0))
    return moved.x, moved.y


def remove(root: Any) -> None:
    """A thing and what belongs to it leave the scene."""
    for part in (*root.children_recursive, root):
        bpy.data.objects.remove(part)


def surface(root: Any, inwards_m: float) -> tuple[Vector, Vector, BVHTree]:
    """The box and the faces of a thing, each side of its box moved inwards."""
    low, high = extent(root)
    middle, size = (low + high) / 2, high - low
    share = [max(1.0 - 2 * inwards_m / max(s, 1e-6), 0.1) for s in size]
    places, faces = [], []
    for part in (root, *root.children_recursive):
        if part.type == "MESH":
            first = len(places)
            for vertex in part.data.vertices:
                away = part.matrix_world @ vertex.co - middle
                places.append(middle + Vector(a * s for a, s in zip(away, share, strict=True)))
            faces += [[first + i for i in face.vertices] for face in part.data.polygons]
    return low, high, BVHTree.FromPolygons(places, faces)


def draw_scene(assets: Path, seed: int, number: int) -> tuple[DrawnStage, str]:
    """Scene `number` of a seed, and the program it comes from; programs take turns."""
    name = sorted(FAMILIES)[number % len(FAMILIES)]
    environment, theme, program = FAMILIES[name]
    reasons = []
    for attempt in range(LAYOUTS):
        draw = random.Random(f"{seed} {number} {attempt}")
        stage = DrawnStage(assets, environment, theme, draw)
        try:
            program(stage)
            stage.finish()
        except NotThisLayoutError as reason:
            reasons.append(str(reason))
            continue
        return stage, name
    sys.exit(f"no layout of {name} in {LAYOUTS} draws; the last: {reasons[-1]}")


def main() -> None:
    """Write the folder of one scene, called after its program, the seed and the number."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--kaykit", help="folder of KayKit's packs [default: $LEGOWORLD_KAYKIT]")
    parser.add_argument("--seed", type=int, required=True)
    parser.add_argument("--number", type=int, required=True)
    parser.add_argument("-o", "--output", type=Path, required=True)
    chosen = parser.parse_args()
    stage, name = draw_scene(assets_folder(chosen.kaykit), chosen.seed, chosen.number)
    stage.save(chosen.output / f"{name}-{chosen.seed}-{chosen.number:04d}")


if __name__ == "__main__":
    main()
