"""Boxes as triangles, for tests of solids."""

from __future__ import annotations

import itertools
import math

import numpy as np

#: The 12 triangles of a box, by its corners in the order of `itertools.product`, seen from outside.
FACES = np.array(
    [(0, 1, 3), (0, 3, 2), (4, 6, 7), (4, 7, 5), (0, 4, 5), (0, 5, 1),
     (2, 3, 7), (2, 7, 6), (0, 2, 6), (0, 6, 4), (1, 5, 7), (1, 7, 3)]
)  # fmt: skip
UPRIGHT = np.eye(3)


def box(middle, size, turn=UPRIGHT):
    corners = np.array(list(itertools.product((-0.5, 0.5), repeat=3))) * size
    return (corners @ np.asarray(turn).T + middle)[FACES]


def about(axis, degrees):
    x, y, z = np.asarray(axis) / np.linalg.norm(axis)
    cross = np.array([(0, -z, y), (z, 0, -x), (-y, x, 0)])
    angle = math.radians(degrees)
    return UPRIGHT + math.sin(angle) * cross + (1 - math.cos(angle)) * cross @ cross
