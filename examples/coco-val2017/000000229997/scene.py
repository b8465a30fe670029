"""Rebuild COCO val2017 photo 000000229997: a black bear sits among five vultures.

Metres; z is up, y leads away from the camera, the origin is on the grass under the camera. Outlines
are pixels of the photo, placed on the plane on which the animal stands.
"""

import math

import bpy
from mathutils import Vector
from mathutils.geometry import delaunay_2d_cdt

IMAGE_WH = (640, 427)
FOCAL_PX = 1000.0
HORIZON_V = -50.0
CAMERA_HEIGHT_M = 2.0
LOOKS = {
    "bark": (0.35, 0.28, 0.24),
    "black feathers": (0.012, 0.012, 0.018),
    "black fur": (0.015, 0.012, 0.012),
    "brown fur": (0.06, 0.025, 0.02),
    "grass": (0.18, 0.35, 0.04),
    "grey skin": (0.08, 0.08, 0.1),
    "muzzle": (0.4, 0.28, 0.18),
    "pale leg": (0.5, 0.48, 0.5),
    "stone": (0.5, 0.5, 0.52),
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


def add_bear():
    """The bear: a broad back, the hanging head before it, legs in the grass."""
    bear = instance("Bear", "bear")
    trunk, near = standing(300, 300), standing(300, 300, 0.35)
    outline = [
        (203, 226), (214, 206), (216, 180), (224, 158), (235, 145), (249, 134), (269, 122),
        (292, 117), (315, 122), (335, 134), (350, 150), (358, 173), (371, 203), (379, 234),
        (394, 254), (407, 277), (426, 286), (428, 293), (402, 297), (384, 286), (378, 301),
        (351, 301), (310, 297), (290, 296), (275, 285), (254, 292), (224, 288), (206, 268),
        (200, 252),
    ]  # fmt: skip
    body(bear, "trunk", "black fur", outline, trunk, 0.6)
    head = [
        (283, 140), (300, 130), (330, 135), (345, 145), (352, 165), (350, 190), (340, 215),
        (328, 224), (315, 216), (298, 195), (285, 165),
    ]  # fmt: skip
    body(bear, "head", "brown fur", head, near, 0.3)
    muzzle = [(318, 200), (325, 192), (335, 192), (337, 208), (335, 220), (326, 223), (319, 212)]
    body(bear, "muzzle", "muzzle", muzzle, standing(300, 300, 0.55), 0.15)
    body(bear, "left ear", "brown fur", oval(289, 146, 6, 12, 10), standing(300, 300, 0.5), 0.06)
    body(bear, "right ear", "brown fur", oval(346, 143, 7, 9, 10), near, 0.06)


VULTURES = {
    "Vulture on the log": (
        (165, 163),
        [
            (172, 75), (175, 65), (182, 62), (190, 67), (195, 81), (187, 86), (190, 97),
            (188, 112), (183, 130), (178, 143), (165, 144), (157, 145), (148, 158), (133, 160),
            (135, 145), (140, 120), (150, 100), (165, 88),
        ],
        (
            [(161, 143, 2), (161, 152, 2), (163, 162, 3)],
            [(173, 142, 2), (174, 152, 2), (175, 162, 3)],
        ),
    ),
    "Vulture behind the bear": (
        (255, 127),
        [
            (222, 49), (228, 43), (235, 44), (238, 55), (250, 63), (270, 70), (290, 80), (305, 90),
            (316, 98), (311, 111), (295, 110), (280, 112), (262, 120), (250, 117), (242, 105),
            (235, 90), (229, 75), (227, 58),
        ],
        ([(251, 115, 2), (252, 126, 2)], [(257, 115, 2), (258, 122, 2)]),
    ),
    "Left vulture": (
        (50, 348),
        [
            (78, 268), (84, 262), (92, 266), (95, 280), (93, 293), (88, 305), (80, 320), (70, 337),
            (60, 348), (45, 343), (20, 345), (2, 346), (-8, 330), (8, 312), (30, 297), (50, 288),
            (70, 282),
        ],
        (),
    ),
    "Middle vulture": (
        (340, 398),
        [
            (277, 300), (285, 292), (297, 296), (301, 308), (318, 315), (335, 325), (350, 343),
            (360, 360), (370, 375), (380, 387), (368, 399), (355, 392), (340, 383), (320, 378),
            (305, 374), (290, 358), (280, 345), (278, 332), (283, 322), (277, 312),
        ],
        (),
    ),
    "Right vulture": (
        (490, 394),
        [
            (530, 325), (532, 315), (541, 311), (549, 317), (557, 331), (548, 329), (541, 334),
            (530, 342), (525, 355), (515, 368), (500, 376), (470, 379), (445, 380), (422, 386),
            (416, 374), (430, 360), (440, 350), (450, 335), (460, 325), (485, 319), (510, 321),
        ],
        ([(492, 374, 3), (490, 385, 2), (491, 392, 3)], [(463, 375, 2), (462, 383, 2)]),
    ),
}  # fmt: skip


def add_vultures():
    """Each vulture: its outline with head and tail, and the legs that the grass leaves free."""
    for name, (foot, outline, legs) in VULTURES.items():
        vulture = instance(name, "bird")
        place = standing(*foot)
        body(vulture, "plumage", "black feathers", outline, place, 0.25)
        for number, stations in enumerate(legs):
            limb(vulture, f"leg {number}", "pale leg", stations, place)


def add_glade():
    """Grass, the fallen log, the leaning stump, a stone."""
    grass = [(-400, 800), (1040, 800), (1040, -20), (-400, -20)]
    slab(None, "Grass", "grass", grass, level(0.0), 0.05)
    log = [
        (-20, 147),
        (100, 155),
        (220, 166),
        (420, 178),
        (520, 185),
        (520, 215),
        (370, 198),
        (215, 222),
        (-20, 195),
    ]
    slab(None, "Log", "bark", log, standing(190, 222), 0.3)
    stump = [
        (390, -10), (490, -10), (560, 90), (600, 150), (660, 220), (660, 350), (620, 335),
        (575, 320), (560, 290), (520, 235), (490, 190), (465, 150), (455, 125), (430, 105),
        (425, 82), (405, 40),
    ]  # fmt: skip
    slab(None, "Stump", "bark", stump, upright(5.4), 0.4)
    body(
        None,
        "Stone",
        "stone",
        [(-20, 190), (10, 195), (22, 250), (0, 280), (-20, 280)],
        standing(0, 280),
        0.2,
    )


def main():
    """Everything in the picture."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    add_bear()
    add_vultures()
    add_glade()
    add_camera_and_light((0.8, 0.9, 1.0), 3.0, (25, 60))


main()
