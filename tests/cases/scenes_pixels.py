"""Scenes of rows 1 to 14 and 26: which pixels, at which depth."""

from __future__ import annotations

import bpy
from cases.stage import box, camera, outline, pixel_camera, polygons, square


def facing_plane() -> None:
    camera((0, 0, 5))
    square("Plane", 100)


def inside_a_sphere() -> None:
    camera((0, 0, 0), lens=20.0)
    bpy.ops.mesh.primitive_uv_sphere_add(segments=128, ring_count=64, radius=10)


def a_small_quad() -> None:
    pixel_camera()
    box("Quad", 10, 10, 50, 50, category="quad")


def left_edges() -> None:
    pixel_camera()
    box("In", 10.49, 5, 20, 15)
    box("Out", 10.51, 20, 20, 30)
    box("On", 10.5, 35, 20, 45)


def at_the_top() -> None:
    pixel_camera()
    box("Top", 30, 2, 50, 6)
    box("Left", 1, 20, 4, 40)


def ring() -> None:
    pixel_camera()
    x0, x1, x2, x3 = 10, 20, 40, 50
    corners = [(x0, x0), (x3, x0), (x3, x3), (x0, x3), (x1, x1), (x2, x1), (x2, x2), (x1, x2)]
    polygons(
        "Ring",
        [(x - 40.0, 30.0 - y, 0.0) for x, y in corners],
        [(4, 5, 1, 0), (5, 6, 2, 1), (6, 7, 3, 2), (7, 4, 0, 3)],
        category="ring",
    )


def split_by_an_occluder() -> None:
    pixel_camera()
    box("Bar", 10, 20, 70, 30, category="bar")
    box("Post", 35, 5, 45, 55, z=1)


def one_pixel_wide() -> None:
    pixel_camera()
    box("Dot", 12, 7, 13, 8, category="dot")
    box("Row", 20, 10, 60, 11, category="line")
    box("Column", 15, 20, 16, 50, category="line")


def unseen() -> None:
    camera((0, 0, 10), lens=36.0, clip_end=50.0)
    square("Wall", 3)
    square("Hidden", 1, category="thing").location.z = -1
    square("Behind", 1, category="thing").location.z = 20
    square("Outside", 1, category="thing").location.x = 100
    square("Beyond", 100, category="thing").location.z = -90
    # One picture point is 10 / 80 wide at that distance: between four pixel centres.
    tiny = square("Sub-pixel", 0.01, category="thing")
    tiny.location = (2.5, 0, 0)
    polygons("Line", [(3, 0, 0), (3, 2, 0), (3, 1, 0)], [(0, 1, 2)], category="thing")


def cut_by_the_border() -> None:
    pixel_camera()
    box("Corner", -20, -30, 8, 5, category="thing")
    box("Right", 70, 20, 200, 40, category="thing")
    box("Bottom", 30, 55, 40, 90, category="thing")


def clip_planes() -> None:
    pixel_camera(clip_start=90.0, clip_end=110.0)
    box("Before clip start", 0, 0, 40, 60, z=50, category="thing")
    box("Seen", 10, 10, 70, 50, z=0, category="thing")
    box("At clip start", 0, 55, 5, 60, z=10, category="thing")
    box("At clip end", 75, 55, 80, 60, z=-10, category="thing")
    box("Past clip end", 0, 0, 80, 60, z=-20, category="thing")


def crowd() -> None:
    pixel_camera()
    for i in range(12):
        labels = {"category": "thing"} if i % 3 else {}
        x, y = 5 * i, (7 * i) % 40
        box(f"Card {i}", x, y, x + 17, y + 14, z=(i * 5) % 7, **labels)


def coplanar() -> None:
    pixel_camera()
    box("Z last", 20, 10, 60, 50)
    box("A first", 10, 20, 50, 40)


def concave() -> None:
    pixel_camera()
    outline("L", [(10, 10), (20, 10), (20, 40), (50, 40), (50, 50), (10, 50)], category="l")
