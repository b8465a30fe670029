"""Rebuild COCO val2017 photo 000000010764: a baseball catcher squats and holds out his mitt.

Metres; z is up, y leads away from the camera, the origin is on the ground under the camera. The
view is a long lens from the stands: the horizon lies far above the picture. Outlines are pixels of
the photo, placed on the plane on which the thing stands.
"""

import math

import bpy
from mathutils import Vector
from mathutils.geometry import delaunay_2d_cdt

IMAGE_WH = (640, 424)
FOCAL_PX = 3000.0
HORIZON_V = -300.0
CAMERA_HEIGHT_M = 2.6
LOOKS = {
    "black": (0.02, 0.02, 0.025),
    "dirt": (0.16, 0.08, 0.05),
    "grass": (0.06, 0.16, 0.05),
    "leather": (0.05, 0.04, 0.035),
    "pale dirt": (0.35, 0.22, 0.16),
    "skin": (0.3, 0.15, 0.09),
    "white": (0.75, 0.75, 0.82),
}

# --- from the picture to the world: metres, z up, y away from the camera ---------------------

CAMERA_AT = Vector((0.0, 0.0, CAMERA_HEIGHT_M))
PITCH = math.atan((HORIZON_V - IMAGE_WH[1] / 2) / FOCAL_PX)


def ray(u, v):
    """Direction from the camera through pixel (u, v), of unit length along the optical axis."""
    right, up = (u - IMAGE_WH[0] / 2) / FOCAL_PX, (IMAGE_WH[1] / 2 - v) / FOCAL_PX
    cos, sin = math.cos(PITCH), math.sin(PITCH)
    return Vector((right, cos - up * sin, sin + up * cos))


def upright(depth_m):
    """The vertical plane that faces the camera at y = depth_m: (u, v) to a point on it."""
    return lambda u, v: CAMERA_AT + ray(u, v) * (depth_m / ray(u, v).y)


def level(height_m):
    """The horizontal plane z = height_m: (u, v) to a point on it."""
    return lambda u, v: CAMERA_AT + ray(u, v) * ((height_m - CAMERA_HEIGHT_M) / ray(u, v).z)


def standing(u, v, nearer_m=0.0):
    """The upright plane of a thing that meets the ground at pixel (u, v)."""
    return upright(level(0.0)(u, v).y - nearer_m)


# --- things ----------------------------------------------------------------------------------


def instance(name, category, lvis_category=None):
    """An empty that owns the parts of one labelled thing."""
    owner = bpy.data.objects.new(name, None)
    owner["category"] = category
    if lvis_category:
        owner["lvis_category"] = lvis_category
    bpy.context.scene.collection.objects.link(owner)
    return owner


def paint(name):
    """The material of that name, made at its first use."""
    if name in bpy.data.materials:
        return bpy.data.materials[name]
    made = bpy.data.materials.new(name)
    shader = made.node_tree.nodes["Principled BSDF"]
    shader.inputs["Base Color"].default_value = (*LOOKS[name], 1.0)
    shader.inputs["Roughness"].default_value = 0.6
    return made


def add_mesh(owner, part, look, points, faces):
    """Link a mesh; as a part of its owner, or as background when owner is None."""
    name = f"{owner.name} {part}" if owner else part
    mesh = bpy.data.meshes.new(name)
    mesh.from_pydata(points, [], faces)
    mesh.materials.append(paint(look))
    made = bpy.data.objects.new(name, mesh)
    made.parent = owner
    bpy.context.scene.collection.objects.link(made)
    return made


def pushed(point, metres):
    """The point moved away from the camera; it keeps its pixel."""
    return point + (point - CAMERA_AT).normalized() * metres


def rounded(points, closed=True, steps=4):
    """Catmull-Rom through points of any dimension."""
    points = [Vector(point) for point in points]
    count = len(points)
    before, after = (points[-1], points[0]) if closed else (points[0], points[-1])
    padded = [before, *points, after, points[1] if closed else after]
    curve = []
    for i in range(count if closed else count - 1):
        a, b, c, d = padded[i : i + 4]
        for t in (step / steps for step in range(steps)):
            bend = (2 * a - 5 * b + 4 * c - d) * t * t + (3 * b - a - 3 * c + d) * t**3
            curve.append(b + 0.5 * ((c - a) * t + bend))
    return curve if closed else [*curve, points[-1]]


def edge_distance(point, outline):
    """Distance in pixels from a point to a closed outline."""
    nearest = math.inf
    for start, stop in zip(outline, outline[1:] + outline[:1], strict=True):
        along = stop - start
        share = (point - start).dot(along) / max(along.length_squared, 1e-12)
        nearest = min(nearest, (point - start - along * min(max(share, 0.0), 1.0)).length)
    return nearest


def body(owner, part, look, outline, place, thickness_m):
    """A pillow: its silhouette is the rounded outline, it swells by half its thickness a side."""
    edge = rounded(outline)
    low = Vector((min(p.x for p in edge), min(p.y for p in edge)))
    span = Vector((max(p.x for p in edge), max(p.y for p in edge))) - low
    step = max(span) / 26
    grid = [
        low + Vector((i * step, j * step))
        for i in range(1, int(span.x / step) + 1)
        for j in range(1, int(span.y / step) + 1)
    ]
    seeds = edge + [p for p in grid if edge_distance(p, edge) > 0.3 * step]
    ring = [(i, (i + 1) % len(edge)) for i in range(len(edge))]
    flat, _, faces, *_ = delaunay_2d_cdt(seeds, ring, [], 1, 1e-4)
    depths = [edge_distance(p, edge) for p in flat]
    deepest = max(depths)
    points, back = [], []
    for (u, v), depth in zip(flat, depths, strict=True):
        swell = 0.5 * thickness_m * math.sqrt(1.0 - (1.0 - depth / deepest) ** 2)
        points.append(pushed(place(u, v), -swell))
        back.append(pushed(place(u, v), swell))
    count = len(points)
    faces = faces + [tuple(count + i for i in reversed(face)) for face in faces]
    made = add_mesh(owner, part, look, points + back, faces)
    made.data.shade_smooth()
    return made


def limb(owner, part, look, stations, place, corners=12):
    """A round tube with round ends through stations (u, v, radius), all in pixels."""
    path = rounded(stations, closed=False)
    start, stop = path[0], path[-1]
    first = (start - path[1]).to_2d().normalized()
    last = (stop - path[-2]).to_2d().normalized()
    ends = [(math.sin(turn), max(math.cos(turn), 0.02)) for turn in (0.5, 1.0, 1.57)]
    head = [(start.to_2d() + first * start.z * out, start.z * wide) for out, wide in ends]
    tail = [(stop.to_2d() + last * stop.z * out, stop.z * wide) for out, wide in ends]
    rings = [*reversed(head), *((p.to_2d(), p.z) for p in path), *tail]
    points, faces = [], []
    for i, (centre, radius) in enumerate(rings):
        tangent = rings[min(i + 1, len(rings) - 1)][0] - rings[max(i - 1, 0)][0]
        normal = Vector((-tangent.y, tangent.x)).normalized()
        radius_m = radius * (place(*centre) - CAMERA_AT).length / FOCAL_PX
        for turn in (math.tau * k / corners for k in range(corners)):
            pixel = centre + normal * radius * math.cos(turn)
            points.append(pushed(place(*pixel), radius_m * math.sin(turn)))
        if i:
            for k in range(corners):
                a, b = (i - 1) * corners + k, (i - 1) * corners + (k + 1) % corners
                faces.append((a, b, b + corners, a + corners))
    made = add_mesh(owner, part, look, points, faces)
    made.data.shade_smooth()
    return made


def slab(owner, part, look, outline, place, thickness_m):
    """A straight-edged plate; its outline is what the picture shows, its depth lies behind it."""
    front = [place(u, v) for u, v in outline]
    count = len(front)
    points = front + [pushed(point, thickness_m) for point in front]
    sides = [(i, (i + 1) % count, (i + 1) % count + count, i + count) for i in range(count)]
    faces = [tuple(range(count)), tuple(range(2 * count - 1, count - 1, -1)), *sides]
    return add_mesh(owner, part, look, points, faces)


def add_camera_and_light(sky_rgb, sun_watts, sun_deg):
    """The camera of the picture, a plain sky, one sun; sun_deg: rotation about x and z."""
    scene = bpy.context.scene
    data = bpy.data.cameras.new("Camera")
    data.sensor_fit, data.sensor_width = "HORIZONTAL", 36.0
    data.lens = FOCAL_PX * data.sensor_width / IMAGE_WH[0]
    data.clip_start, data.clip_end = 0.01, 5000.0
    camera = bpy.data.objects.new("Camera", data)
    camera.location = CAMERA_AT
    camera.rotation_euler = (math.pi / 2 + PITCH, 0.0, 0.0)
    light = bpy.data.lights.new("Sun", "SUN")
    light.energy, light.angle = sun_watts, 0.1
    sun = bpy.data.objects.new("Sun", light)
    sun.rotation_euler = (math.radians(sun_deg[0]), 0.0, math.radians(sun_deg[1]))
    for each in (camera, sun):
        scene.collection.objects.link(each)
    scene.camera = camera
    scene.world = bpy.data.worlds.new("World")
    background = scene.world.node_tree.nodes["Background"]
    background.inputs["Color"].default_value = (*sky_rgb, 1.0)
    scene.render.engine = "CYCLES"
    scene.cycles.samples = 8
    scene.render.resolution_x, scene.render.resolution_y = IMAGE_WH
    scene.render.resolution_percentage = 100


# --- the picture ----------------------------------------------------------------------------


def add_catcher():
    """The catcher in profile: near limbs in front of the trunk, far ones behind it."""
    man = instance("Catcher", "person")
    trunk, near, far = standing(310, 396), standing(310, 396, 0.25), standing(310, 396, -0.25)
    helmet = [
        (306, 122), (308, 103), (315, 88), (330, 82), (345, 80), (362, 84), (378, 95), (387, 110),
        (389, 124), (377, 128), (383, 142), (376, 165), (367, 184), (353, 177), (350, 155),
        (343, 136), (310, 133),
    ]  # fmt: skip
    body(man, "helmet and mask", "black", helmet, trunk, 0.2)
    limb(man, "neck", "skin", [(325, 132, 12), (332, 148, 15)], trunk)
    jersey = [
        (298, 143), (285, 155), (272, 168), (262, 190), (250, 217), (236, 240), (224, 260),
        (219, 285), (221, 302), (270, 305), (320, 285), (352, 240), (357, 195), (350, 163),
        (325, 146), (310, 142),
    ]  # fmt: skip
    body(man, "jersey", "white", jersey, trunk, 0.4)
    limb(man, "sleeve", "black", [(325, 180, 20), (311, 208, 18), (304, 225, 15)], near)
    forearm = [(304, 240, 11), (330, 256, 11), (365, 262, 9), (395, 262, 8), (408, 268, 10)]
    limb(man, "near forearm", "skin", forearm, standing(310, 396, 0.35))
    limb(man, "near fingers", "skin", [(404, 266, 11), (407, 273, 9)], standing(310, 396, 0.35))
    limb(man, "far forearm", "skin", [(355, 226, 9), (385, 240, 8), (405, 248, 8)], far)
    limb(man, "far wrist band", "black", [(402, 246, 10), (428, 260, 9)], far)
    thigh = [
        (220, 296), (225, 318), (237, 340), (257, 352), (284, 354), (302, 345), (325, 322),
        (345, 310), (370, 297), (374, 277), (352, 271), (310, 278), (270, 287),
    ]  # fmt: skip
    body(man, "trousers", "white", thigh, near, 0.35)
    guard = [
        (408, 287), (404, 302), (394, 322), (368, 345), (342, 372), (320, 378), (300, 376),
        (288, 366), (291, 353), (318, 331), (335, 311), (350, 292), (361, 273), (385, 274),
    ]  # fmt: skip
    body(man, "leg guard", "black", guard, standing(310, 396, 0.32), 0.16)
    near_shoe = [(266, 389), (280, 378), (300, 374), (350, 372), (357, 380), (347, 393), (310, 398)]
    body(man, "near shoe", "white", near_shoe, near, 0.1)
    far_shoe = [(258, 380), (260, 359), (275, 353), (292, 360), (285, 376), (270, 387)]
    body(man, "far shoe", "black", far_shoe, far, 0.1)


def add_mitt():
    """The catcher's mitt on the far hand."""
    mitt = instance("Mitt", "baseball glove")
    outline = [
        (429, 247), (444, 223), (476, 210), (484, 218), (477, 238), (467, 251), (461, 278),
        (444, 277), (433, 267),
    ]  # fmt: skip
    body(mitt, "pocket", "leather", outline, standing(310, 396, -0.2), 0.12)


def add_field():
    """Dirt, the grass beyond it, and the chalk lines of the batter's boxes."""
    dirt = [(-400, 600), (1040, 600), (1040, -250), (-400, -250)]
    slab(None, "Dirt", "dirt", dirt, level(0.0), 0.05)
    grass = [(-20, 275), (150, 264), (320, 253), (480, 247), (660, 243), (660, -240), (-20, -240)]
    slab(None, "Grass", "grass", grass, level(0.01), 0.005)
    for number, outline in enumerate(
        (
            [(0, 374), (30, 374), (95, 418), (70, 424)],
            [(10, 374), (10, 376), (410, 356), (410, 353)],
            [(80, 421), (80, 417), (640, 388), (640, 391)],
            [(384, 332), (398, 330), (480, 362), (460, 364)],
            [(398, 330), (640, 317), (640, 321), (398, 332)],
            [(470, 362), (640, 358), (640, 362), (470, 365)],
            [(545, 390), (570, 390), (640, 420), (620, 424)],
        )
    ):
        slab(None, f"Chalk line {number}", "white", outline, level(0.02), 0.005)


def main():
    """Everything in the picture."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    add_catcher()
    add_mitt()
    add_field()
    add_camera_and_light((0.7, 0.8, 1.0), 2.0, (40, 30))


main()
