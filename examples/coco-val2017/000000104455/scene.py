"""Rebuild COCO val2017 photo 000000104455: a zebra eats hay, another lies behind its forelegs.

Metres; z is up, y leads away from the camera, the origin is on the ground under the camera.
Outlines are pixels of the photo, placed on the plane on which the thing stands.
"""

import math

import bpy
from mathutils import Vector
from mathutils.geometry import delaunay_2d_cdt

IMAGE_WH = (640, 480)
FOCAL_PX = 1000.0
HORIZON_V = 10.0
CAMERA_HEIGHT_M = 1.5
LOOKS = {
    "bark": (0.06, 0.05, 0.05),
    "dark coat": (0.16, 0.15, 0.15),
    "hay": (0.14, 0.12, 0.07),
    "hoof": (0.1, 0.08, 0.07),
    "log": (0.4, 0.33, 0.24),
    "sand": (0.55, 0.48, 0.4),
    "striped coat": (0.3, 0.29, 0.28),
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


def oval(u, v, half_u, half_v, tilt_deg=0.0, count=20):
    """Outline of an ellipse in the picture."""
    cos, sin = math.cos(math.radians(tilt_deg)), math.sin(math.radians(tilt_deg))
    outline = []
    for turn in (math.tau * k / count for k in range(count)):
        x, y = half_u * math.cos(turn), half_v * math.sin(turn)
        outline.append((u + x * cos - y * sin, v + x * sin + y * cos))
    return outline


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


def add_grazing_zebra():
    """The standing zebra: trunk with mane, head down at the hay, four legs."""
    zebra = instance("Grazing zebra", "zebra")
    trunk, near = standing(400, 388), standing(400, 388, 0.2)
    outline = [
        (108, 205), (102, 185), (104, 163), (116, 138), (133, 117), (155, 96), (165, 72), (180, 72),
        (200, 57), (225, 42), (250, 33), (268, 27), (285, 34), (310, 38), (350, 42), (400, 42),
        (450, 38), (485, 36), (510, 40), (535, 54), (557, 76), (567, 95), (567, 130), (563, 165),
        (545, 195), (500, 205), (463, 202), (434, 211), (400, 218), (377, 220), (340, 216),
        (308, 209), (290, 222), (262, 222), (235, 209), (205, 204), (190, 214), (170, 225),
        (130, 235),
    ]  # fmt: skip
    body(zebra, "trunk and neck", "striped coat", outline, trunk, 0.5)
    head = [
        (118, 210), (104, 230), (97, 255), (95, 270), (100, 292), (104, 335), (130, 344),
        (155, 346), (168, 326), (178, 305), (178, 275), (172, 250), (178, 232), (165, 215),
        (140, 205),
    ]  # fmt: skip
    body(zebra, "head", "striped coat", head, standing(400, 388, 0.25), 0.2)
    ear = [(77, 232), (80, 222), (95, 214), (112, 212), (108, 235), (88, 243)]
    body(zebra, "far ear", "dark coat", ear, trunk, 0.06)
    ear = [(160, 222), (178, 221), (194, 220), (190, 228), (178, 240), (170, 250), (160, 240)]
    body(zebra, "near ear", "dark coat", ear, standing(400, 388, 0.3), 0.06)
    foreleg = [
        (262, 205), (264, 222), (278, 255), (284, 300), (284, 345), (280, 364), (273, 379),
        (288, 392), (302, 391), (301, 372), (304, 350), (305, 320), (307, 295), (305, 260),
        (308, 205), (285, 190),
    ]  # fmt: skip
    body(zebra, "near foreleg", "striped coat", foreleg, near, 0.15)
    limb(
        zebra,
        "far foreleg",
        "dark coat",
        [(300, 300, 8), (307, 345, 7), (305, 370, 6)],
        standing(305, 387),
    )
    hoof = [(298, 366), (311, 362), (316, 379), (305, 386)]
    body(zebra, "far fore hoof", "hoof", hoof, standing(305, 387), 0.08)
    hind = [
        (567, 120), (564, 160), (559, 190), (563, 218), (578, 244), (585, 262), (584, 300),
        (591, 345), (597, 378), (588, 389), (562, 389), (570, 372), (574, 350), (570, 315),
        (560, 285), (545, 262), (528, 240), (503, 215), (490, 190), (520, 140),
    ]  # fmt: skip
    body(zebra, "near hind leg", "striped coat", hind, near, 0.2)
    hind = [
        (469, 200), (486, 240), (517, 266), (523, 308), (517, 345), (508, 365), (489, 379),
        (508, 385), (526, 381), (536, 358), (531, 345), (538, 315), (544, 260), (520, 220),
        (490, 195),
    ]  # fmt: skip
    body(zebra, "far hind leg", "striped coat", hind, standing(508, 386), 0.15)


def add_lying_zebra():
    """The zebra on the ground: a neck with its mane, the back, one hind foot stretched out."""
    zebra = instance("Lying zebra", "zebra")
    place = standing(240, 335)
    neck = [
        (172, 258), (180, 240), (192, 222), (202, 211), (211, 203), (218, 200), (228, 203),
        (240, 212), (252, 220), (250, 230), (240, 246), (236, 262), (215, 268), (185, 268),
    ]  # fmt: skip
    body(zebra, "neck", "striped coat", neck, place, 0.2)
    back = [
        (172, 256), (200, 255), (225, 256), (250, 265), (272, 275), (280, 292), (286, 312),
        (284, 338), (265, 335), (235, 338), (200, 338), (170, 335), (160, 300),
    ]  # fmt: skip
    body(zebra, "back", "dark coat", back, place, 0.4)
    foot = [(285, 318, 10), (303, 328, 11), (318, 344, 9), (336, 341, 8), (352, 336, 8)]
    limb(zebra, "hind foot", "striped coat", foot, standing(330, 352))


def add_enclosure():
    """Sand, hay, a tree and the log fence."""
    sand = [(-200, 700), (840, 700), (840, 60), (-200, 60)]
    slab(None, "Sand", "sand", sand, level(0.0), 0.05)
    hay = [
        (5, 335), (40, 308), (80, 300), (100, 330), (130, 342), (155, 344), (180, 330), (235, 331),
        (285, 342), (282, 362), (260, 388), (235, 410), (150, 420), (20, 412),
    ]  # fmt: skip
    body(None, "Hay", "hay", hay, standing(100, 420), 0.3)
    body(None, "Hay right", "hay", oval(450, 420, 75, 28), level(0.03), 0.05)
    trunk = [(-20, -20), (60, -20), (30, 100), (15, 230), (35, 310), (50, 335), (-20, 340)]
    slab(None, "Tree", "bark", trunk, standing(10, 335), 0.4)
    for number, (v, u0, u1) in enumerate(
        (
            (15, 220, 660),
            (35, 90, 340),
            (85, 540, 660),
            (100, 20, 200),
            (150, 560, 660),
            (170, 0, 110),
        )
    ):
        limb(None, f"Log {number}", "log", [(u0, v, 13), (u1, v, 13)], upright(7.0))


def main():
    """Everything in the picture."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    add_grazing_zebra()
    add_lying_zebra()
    add_enclosure()
    add_camera_and_light((0.8, 0.9, 0.8), 2.5, (30, -40))


main()
