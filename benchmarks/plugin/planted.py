"""Do `stability` and `hidden` name what is wrong, and only that? Random scenes of boxes.

    python benchmarks/plugin/planted.py [--rooms 200]

stability: a box over the edge of a table, or a lamp whose arm carries a weight beyond its foot.
What is planted has its centre of mass 1 to 20 cm outside of its support, the innocent as far
inside. The true margin is that of the polygon where foot and table overlap, clipped here, and of
volumes.
hidden: each object of a room, with a screen put before one. Planted is what is hidden by 60 % or
more, innocent what is by 40 % or less; the true share is that of rays against boxes, cast here.
"""

from __future__ import annotations

import argparse
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[2] / "tests"))

from plugin.synthetic import camera  # pyright: ignore[reportMissingImports]
from scene.by_hand import CAMERA, RENDER  # pyright: ignore[reportMissingImports]
from touching import _FACES, F64, box

from legoworld.plugin.measure import measure
from legoworld.plugin.state import LiveScene, scene_state
from legoworld.records import plugin_requirements as kinds
from legoworld.records.plugin_requirements import Requirement, Result
from legoworld.scene.snapshot import SceneObject, Snapshot

WH = (160, 120)
LEAST_PX = 40
Pose = tuple[F64, F64]
_HASHES: dict[str, str] = dict.fromkeys(("camera", "render", "world", "collections"), "")


def scene_of(parts: dict[str, list[F64]], pose: Pose) -> LiveScene:
    """A live scene of labelled objects, each of boxes of (8, 3) corners."""
    boxes = [b for some in parts.values() for b in some]
    owner = [n for n, some in enumerate(parts.values()) for _ in some]
    n_boxes = len(boxes)
    rotation, place = pose
    shot = Snapshot(
        objects=tuple(
            SceneObject(
                name=name, library=None, type="MESH", parent=-1, collections=(),
                instance_type="NONE", properties={"category": name.split()[0]},
            )
            for name in parts
        ),
        collections=(),
        camera=replace(CAMERA, world_from_camera=tuple(
            (*row, at) for row, at in zip(rotation.tolist(), place.tolist(), strict=True)
        )),
        render=replace(RENDER, resolution_x=WH[0], resolution_y=WH[1]),
        warnings=(),
        vertices=np.concatenate(boxes).astype(np.float32),
        triangles=np.tile(np.array(_FACES, np.int32), (n_boxes, 1)),
        vertex_start=np.arange(n_boxes + 1, dtype=np.int64) * 8,
        triangle_start=np.arange(n_boxes + 1, dtype=np.int64) * 12,
        occurrence_object=np.arange(len(parts), dtype=np.int32),
        occurrence_instancer=np.full(len(parts), -1, np.int32),
        occurrence_frame=np.zeros(len(parts), np.int32),
        surface_occurrence=np.array(owner, np.int32),
        surface_mesh=np.arange(n_boxes, dtype=np.int32),
        surface_holdout=np.zeros(n_boxes, np.uint8),
        world_from_mesh=np.tile(np.eye(3, 4), (n_boxes, 1, 1)),
    )  # fmt: skip
    state = scene_state(shot, "0" * 64, (), None, _HASHES)
    return LiveScene(reading=shot, state=state)


def measure_in_picture(scene: LiveScene, requirements: list[Requirement]) -> tuple[Result, ...]:
    """The results in a picture of WH."""
    return measure(scene, requirements, None, size_wh=WH).results


# Stability.


def clip_polygon(polygon: F64, window: F64) -> F64:
    """The part of a convex polygon in another, both counter-clockwise (Sutherland, Hodgman)."""
    for a, b in zip(window, np.roll(window, -1, axis=0), strict=True):
        way = b - a
        side = way[0] * (polygon[:, 1] - a[1]) - way[1] * (polygon[:, 0] - a[0])
        kept = []
        for k in range(len(polygon)):
            here, there = side[k - 1], side[k]
            if (here < 0) != (there < 0):
                kept.append(polygon[k - 1] + (polygon[k] - polygon[k - 1]) * here / (here - there))
            if there >= 0:
                kept.append(polygon[k])
        polygon = np.array(kept).reshape(-1, 2)
    return polygon


def margin(point: F64, polygon: F64) -> float:
    """Distance of a point to a counter-clockwise polygon's edge, below 0 outside of it."""
    ways = np.roll(polygon, -1, axis=0) - polygon
    along = ((point - polygon) * ways).sum(1) / (ways**2).sum(1)
    near = np.linalg.norm(point - polygon - np.clip(along, 0, 1)[:, None] * ways, axis=1).min()
    sides = ways[:, 0] * (point - polygon)[:, 1] - ways[:, 1] * (point - polygon)[:, 0]
    return float(near if (sides >= 0).all() else -near)


def standing(random: np.random.Generator) -> tuple[dict[str, list[F64]], float]:
    """One thing on a table, and its true margin, 1 to 20 cm either way."""
    while True:
        top = random.uniform([0.4, 0.4, 0.3], [1.2, 1.2, 1.0])
        table = box(-top * [0.5, 0.5, 1], top * [0.5, 0.5, 0])
        at = np.append(random.uniform(-0.9, 0.9, 2) * top[:2], 0.0)
        turn = random.uniform(0, 3)
        if random.random() < 0.5:
            size = random.uniform([0.2, 0.2, 0.05], [0.8, 0.8, 0.8])
            parts = [box(at - size * [0.5, 0.5, 0], at + size * [0.5, 0.5, 1], turn)]
            mass = at[:2]
        else:
            foot = np.append(random.uniform(0.15, 0.5, 2), random.uniform(0.02, 0.1))
            weight, arm = random.uniform(0.05, 0.3, 3), random.uniform(0, 0.5, 2)
            held = at + np.append(arm, foot[2])
            low = [at - foot * [0.5, 0.5, 0], held - weight * [0.5, 0.5, 0]]
            high = [at + foot * [0.5, 0.5, 1], held + weight * [0.5, 0.5, 1]]
            parts = [box(low[0], high[0], turn), box(low[1], high[1])]
            volumes = np.prod([foot, weight], axis=1)
            mass = (at[:2] * volumes[0] + held[:2] * volumes[1]) / volumes.sum()
        polygon = clip_polygon(parts[0][:4, :2], table[:4, :2])
        if len(polygon) > 2:
            ways = np.roll(polygon, -1, axis=0) - polygon
            polygon = polygon[np.linalg.norm(ways, axis=1) > 1e-9]
        if len(polygon) > 2 and 0.01 <= abs(true := margin(mass, polygon)) <= 0.2:
            return {"table": [table], "thing": parts}, true


def stability(rooms: int, random: np.random.Generator) -> None:
    """Print how many of the unstable and of the stable fail, and how far the margins are off."""
    counts: dict[bool, list[bool]] = {True: [], False: []}
    off, pose = [], (np.eye(3), np.zeros(3))
    while len(counts[True]) < rooms // 2 or len(counts[False]) < 10 * rooms:
        parts, true = standing(random)
        (result,) = measure_in_picture(scene_of(parts, pose), [kinds.Stability(entity="thing")])
        counts[true < 0].append(result.verdict == "fail")
        if result.measurement is not None:
            off.append(abs(result.measurement - true) * 1000)
    middle, most, worst = np.quantile(off, [0.5, 0.99, 1])
    print(f"stability: {count_fails(counts[True], counts[False])}; margin of {len(off)} off by "
          f"{middle:.1f} mm at the median, {most:.1f} at 99 %, {worst:.1f} at most")  # fmt: skip


def count_fails(planted: list[bool], innocent: list[bool]) -> str:
    """Counts: of what fails."""
    return (
        f"planted {len(planted)}, named {sum(planted)}; "
        f"innocent {len(innocent)}, accused {sum(innocent)}"
    )


# In the picture.


Thing = tuple[F64, F64, float]  # middle of its bottom, size, turn


def place_things(random: np.random.Generator, n: int) -> dict[str, Thing]:
    """Blocks on the floor before the camera, turned, and a cup on every second."""
    made: dict[str, Thing] = {}
    for k in range(n):
        size = random.uniform([0.3, 0.3, 0.3], [1.0, 0.8, 1.4])
        at = np.array([random.uniform(-2, 2), random.uniform(-1.5, 3.5), 0.0])
        made[f"block {k}"] = (at, size, float(random.uniform(0, 3)))
        if k % 2:
            made[f"cup {k}"] = (np.add(at, [0, 0, size[2]]), random.uniform(0.12, 0.3, 3), 0.0)
    return made


def corners(thing: Thing) -> F64:
    at, size, turn = thing
    return box(at - size * [0.5, 0.5, 0], at + size * [0.5, 0.5, 1], turn)


def cast(things: list[Thing], pose: Pose) -> F64:
    """(N, H, W) depth of each box along the rays through pixel centres, infinite where missed."""
    rotation, place = pose
    x, y = np.meshgrid(np.arange(WH[0]) + 0.5 - WH[0] / 2, np.arange(WH[1]) + 0.5 - WH[1] / 2)
    ways = np.stack([x / WH[0], y / WH[0], np.ones_like(x)], axis=-1) @ rotation.T
    depths = []
    for at, size, turn in things:
        c, s = np.cos(turn), np.sin(turn)
        spun = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
        origin, rays = (place - at - [0, 0, size[2] / 2]) @ spun, ways @ spun
        with np.errstate(divide="ignore"):
            ends = np.stack([(side * size / 2 - origin) / rays for side in (-1, 1)])
        enter, leave = ends.min(axis=0).max(axis=-1), ends.max(axis=0).min(axis=-1)
        depths.append(np.where((enter <= leave) & (enter > 0.1), enter, np.inf))
    return np.array(depths)


def hidden(rooms: int, random: np.random.Generator) -> None:
    """Print how many of those hidden by 60 % and by 40 % fail, and how far the shares are off."""
    planted: list[bool] = []
    innocent: list[bool] = []
    off = []
    while len(planted) < rooms // 2 or len(innocent) < 10 * rooms:
        rotation, place = camera(random)
        pose, things = (rotation, place - [0, 1.5, 0]), place_things(random, 10)
        behind = things[str(random.choice([*things]))][0]
        at = np.append((pose[1] * 0.3 + behind * 0.7)[:2], 0.0)
        things["screen"] = (at, random.uniform([0.5, 0.1, 1], [1.2, 0.2, 2]), 0.0)
        depths = cast([*things.values()], pose)
        nearest = depths.argmin(axis=0)
        scene = scene_of({name: [corners(thing)] for name, thing in things.items()}, pose)
        for k, result in enumerate(
            measure_in_picture(scene, [kinds.Hidden(entity=name) for name in things])
        ):
            whole = np.isfinite(depths[k])
            if (area := int(whole.sum())) < LEAST_PX:
                continue
            true = float((whole & (nearest != k)).sum() / area)
            assert result.measurement is not None
            off.append(abs(result.measurement - true))
            if abs(true - 0.5) > 0.1:
                (planted if true > 0.5 else innocent).append(result.verdict == "fail")
    print(f"hidden: {count_fails(planted, innocent)}; share of {len(off)} off by "
          f"{np.quantile(off, 0.99):.4f} at 99 %, {np.max(off):.4f} at most")  # fmt: skip


def main() -> None:
    """Print the counts of each kind."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--rooms", type=int, default=200)
    rooms = parser.parse_args().rooms
    stability(rooms, np.random.default_rng(1))
    hidden(rooms, np.random.default_rng(2))


if __name__ == "__main__":
    main()
