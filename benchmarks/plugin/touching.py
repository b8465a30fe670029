"""Does `touching` name what floats, and only that? Random rooms with one planted fault each.

    python benchmarks/plugin/touching.py [--rooms 200]

A room of boxes has chairs and tables on its floor, cups on the tables, pictures and shelves on its
walls and lamps under its ceiling, each within 5 mm of what holds it, most turned about the upright.
In every second room a cup, picture or lamp is moved off by 2 cm to 1 m, until its box is apart from
all other boxes by at least that: a bound that does not come from FCL. Every object is asked, of its
holder and of anything; a fault that passes is missed, another object that fails is accused.
"""

from __future__ import annotations

import argparse

import numpy as np
from numpy.typing import NDArray

from legoworld.solids.solid import Solid

F64 = NDArray[np.float64]
TOLERANCE_M = 0.01
_FACES = [(0, 2, 1), (0, 3, 2), (4, 5, 6), (4, 6, 7), (0, 1, 5), (0, 5, 4), (1, 2, 6), (1, 6, 5),
          (2, 3, 7), (2, 7, 6), (3, 0, 4), (3, 4, 7)]  # fmt: skip


def box(low: F64, high: F64, turn: float = 0.0) -> F64:
    """(8, 3) corners of a box, turned about the upright through its middle."""
    square = [(0, 0), (1, 0), (1, 1), (0, 1)]
    unit = np.array([(x, y, z) for z in (0, 1) for x, y in square], np.float64)
    corners, middle = low + unit * (high - low), (low + high) / 2
    c, s = np.cos(turn), np.sin(turn)
    return np.asarray((corners - middle) @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]]) + middle)


def room(random: np.random.Generator) -> dict[str, tuple[F64, str]]:
    """Objects by name: corners, and what holds each; "" for what is built in."""
    wide, high = random.uniform(3, 6), random.uniform(2.4, 3)
    made = {
        "floor": (box(np.array([-wide, -wide, -0.1]), np.array([wide, wide, 0.0])), ""),
        "ceiling": (box(np.array([-wide, -wide, high]), np.array([wide, wide, high + 0.1])), ""),
        "wall": (box(np.array([-wide, wide, 0.0]), np.array([wide, wide + 0.1, high])), ""),
    }

    def gap() -> float:
        return float(random.uniform(0, 0.005))

    for n in range(4):
        at = np.array([-wide + (n + 0.5) * wide / 2, random.uniform(-wide + 1, wide - 2), 0.0])
        size = random.uniform([0.4, 0.4, 0.4], [0.9, 0.9, 0.9])
        low: F64 = np.add(at, [0, 0, gap()])
        made[f"table {n}"] = (box(low, low + size, random.uniform(0, 3)), "floor")
        top = low + size * [0.5, 0.5, 1] - [0.05, 0.05, 0] + [0, 0, gap()]
        made[f"cup {n}"] = (box(top, top + 0.1, random.uniform(0, 3)), f"table {n}")
        frame = random.uniform([0.2, 0.01, 0.2], [0.6, 0.04, 0.5])
        low = np.array([at[0], wide - gap() - frame[1], random.uniform(1, 1.8)])
        made[f"picture {n}"] = (box(low, low + frame), "wall")
        lamp = np.array([at[0], at[1], high - gap() - 0.3])
        made[f"lamp {n}"] = (box(lamp, lamp + 0.3, random.uniform(0, 3)), "ceiling")
    return made


def boxes_apart(own: F64, others: list[F64]) -> float:
    """The least distance of the axis-aligned boxes around corners."""
    gaps = [np.maximum(0, np.maximum(o.min(0) - own.max(0), own.min(0) - o.max(0))) for o in others]
    return float(min(np.linalg.norm(gap) for gap in gaps))


def distance(own: F64, others: list[F64]) -> float:
    """What the kind measures."""
    faces = np.array(_FACES)
    many = np.concatenate([faces + 8 * n for n in range(len(others))])
    other = Solid(points=np.concatenate(others), triangles=many)
    return Solid(points=own, triangles=faces).distance_m(other)


def main() -> None:
    """Make the rooms, ask every object, print the counts."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--rooms", type=int, default=200)
    random = np.random.default_rng(1)
    planted = missed = missed_any = asked = accused = accused_any = 0
    for n in range(parser.parse_args().rooms):
        made = room(random)
        fault = ""
        if n % 2:
            fault = str(
                random.choice([name for name, (_, by) in made.items() if by not in ("", "floor")])
            )
            off, corners = np.exp(random.uniform(np.log(0.02), 0)), made[fault][0]
            others = [c for name, (c, _) in made.items() if name != fault]
            while True:
                way = random.normal(size=3)
                there = corners + way / np.linalg.norm(way) * off * random.uniform(1, 3)
                if boxes_apart(there, others) >= off:
                    break
                off = max(0.02, off * 0.9)
            made[fault] = (there, made[fault][1])
            planted += 1
        for name, (corners, holder) in made.items():
            if not holder:
                continue
            own = distance(corners, [made[holder][0]]) > TOLERANCE_M
            anything = [c for other, (c, _) in made.items() if other != name]
            floats = distance(corners, anything) > TOLERANCE_M
            if name == fault:
                missed, missed_any = missed + (not own), missed_any + (not floats)
            else:
                asked, accused, accused_any = asked + 1, accused + own, accused_any + floats
    named, named_any = planted - missed, planted - missed_any
    print(f"planted {planted}: named {named} by the holder, {named_any} by anything")
    print(f"innocent {asked}: accused {accused} by the holder, {accused_any} by anything")


if __name__ == "__main__":
    main()
