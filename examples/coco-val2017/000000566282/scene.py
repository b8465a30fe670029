"""Rebuild COCO val2017 photo 000000566282: two men with a football in a street, in black and white.

Metres; z is up, y leads away from the camera, the origin is on the pavement under the camera. The
camera's height follows from the men here and the people down the street: both are 1.7 m tall only
when the horizon is at row 206. Outlines are pixels of the photo.
"""

import math

import bpy
from mathutils import Vector
from mathutils.geometry import delaunay_2d_cdt

IMAGE_WH = (640, 426)
FOCAL_PX = 800.0
HORIZON_V = 206.0
CAMERA_HEIGHT_M = 0.82
LOOKS = {
    "black": (0.015, 0.015, 0.015),
    "facade": (0.3, 0.3, 0.3),
    "glass": (0.05, 0.05, 0.05),
    "grey": (0.25, 0.25, 0.25),
    "pavement": (0.6, 0.6, 0.6),
    "road": (0.3, 0.3, 0.3),
    "silver": (0.5, 0.5, 0.5),
    "skin": (0.12, 0.12, 0.12),
    "white": (0.85, 0.85, 0.85),
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


def add_kicking_man():
    """Black waistcoat over a white shirt; the left leg swings back for the kick."""
    man = instance("Kicking man", "person")
    trunk, near, far = standing(180, 369), standing(180, 369, 0.12), standing(180, 369, -0.1)
    head = [
        (149, 62), (150, 47), (157, 39), (168, 37), (179, 42), (182, 55), (179, 70), (172, 85),
        (163, 88), (155, 78),
    ]  # fmt: skip
    body(man, "head", "skin", head, near, 0.2)
    limb(man, "neck", "skin", [(163, 82, 9), (162, 95, 10)], trunk)
    waistcoat = [
        (133, 88), (150, 80), (165, 95), (180, 88), (186, 105), (183, 150), (184, 185), (165, 193),
        (140, 188), (117, 182), (119, 150), (125, 115),
    ]  # fmt: skip
    body(man, "waistcoat", "black", waistcoat, trunk, 0.25)
    arm = [(130, 97, 13), (114, 120, 13), (102, 150, 11), (94, 180, 9)]
    limb(man, "left sleeve", "white", arm, trunk)
    limb(man, "left hand", "skin", [(91, 193, 7), (88, 203, 6), (90, 207, 5)], trunk)
    arm = [(187, 105, 9), (192, 128, 10), (211, 151, 11), (240, 157, 8)]
    limb(man, "right sleeve", "white", arm, far)
    limb(man, "right hand", "skin", [(246, 157, 7), (253, 158, 5)], far)
    trousers = [
        (117, 183), (150, 190), (184, 184), (192, 195), (193, 215), (198, 250), (198, 290),
        (192, 346), (180, 350), (168, 346), (169, 320), (171, 280), (168, 255), (155, 223),
        (145, 237), (133, 266), (122, 282), (98, 302), (82, 303), (77, 287), (90, 276), (105, 262),
        (110, 235), (113, 205),
    ]  # fmt: skip
    body(man, "trousers", "black", trousers, trunk, 0.22)
    shoe = [(47, 308), (55, 297), (75, 288), (83, 300), (68, 309), (52, 319)]
    body(man, "left shoe", "black", shoe, far, 0.1)
    shoe = [(165, 351), (188, 347), (197, 364), (192, 371), (178, 370), (165, 362)]
    body(man, "right shoe", "black", shoe, trunk, 0.1)


def add_ball():
    """The football on the ground."""
    ball = instance("Ball", "sports ball")
    body(ball, "leather", "white", oval(126.5, 349.3, 24.5, 26), standing(126, 372), 0.24)


def add_watching_man():
    """White shirt and tie, hands low, looking down at the ball; his tie is its own instance."""
    man = instance("Watching man", "person")
    trunk, near = standing(385, 340), standing(385, 340, 0.15)
    head = [
        (386, 18), (391, 6), (402, 2), (415, 6), (420, 20), (418, 40), (424, 50), (405, 58),
        (393, 52), (388, 36),
    ]  # fmt: skip
    body(man, "head", "skin", head, near, 0.2)
    shirt = [
        (396, 49), (380, 54), (370, 75), (365, 110), (360, 148), (358, 173), (374, 177), (379, 150),
        (406, 151), (430, 155), (450, 159), (466, 149), (472, 122), (465, 88), (452, 52), (430, 42),
        (412, 54),
    ]  # fmt: skip
    body(man, "shirt", "white", shirt, trunk, 0.3)
    limb(man, "left hand", "skin", [(368, 176, 7), (371, 190, 6)], trunk)
    limb(man, "right hand", "skin", [(453, 157, 8), (447, 172, 7), (443, 183, 4)], trunk)
    trousers = [
        (378, 144), (430, 150), (450, 157), (446, 180), (437, 205), (428, 230), (425, 250),
        (421, 280), (418, 309), (406, 312), (394, 311), (397, 290), (398, 250), (400, 225),
        (392, 260), (386, 303),        (368, 301), (370, 250), (378, 215), (376, 180),
    ]  # fmt: skip
    body(man, "trousers", "black", trousers, trunk, 0.22)
    shoe = [(360, 334), (368, 312), (376, 301), (388, 310), (381, 330), (372, 339)]
    body(man, "left shoe", "black", shoe, near, 0.1)
    shoe = [(385, 335), (388, 312), (402, 310), (405, 332), (403, 341), (390, 341)]
    body(man, "right shoe", "black", shoe, near, 0.1)
    tie = instance("Tie", "tie")
    blade = [
        (403, 61),
        (418, 63),
        (411, 82),
        (393, 120),
        (383, 134),
        (378, 128),
        (386, 112),
        (400, 84),
    ]
    body(tie, "blade", "grey", blade, standing(385, 340, 0.2), 0.02)
    limb(tie, "tail", "grey", [(402, 84, 2), (392, 94, 2), (383, 102, 2)], standing(385, 340, 0.2))


def add_car():
    """The parked estate car behind the watching man."""
    car = instance("Car", "car")
    place, near = standing(390, 237), standing(390, 237, 0.3)
    outline = [
        (291, 211), (296, 192), (302, 185), (320, 172), (335, 170), (365, 170), (395, 173),
        (420, 182), (440, 196), (455, 200), (480, 205), (491, 211), (495, 220), (493, 230),
        (478, 234), (440, 233), (400, 235), (350, 233), (318, 233), (292, 222),
    ]  # fmt: skip
    body(car, "shell", "silver", outline, place, 1.2)
    body(
        car,
        "rear window",
        "glass",
        [(297, 188), (320, 173), (340, 174), (333, 188), (310, 192)],
        near,
        0.1,
    )
    body(
        car,
        "side window",
        "glass",
        [(343, 190), (352, 176), (380, 174), (400, 180), (408, 192)],
        near,
        0.1,
    )
    body(car, "far rear wheel", "black", oval(325, 229, 11, 9), place, 0.2)
    body(car, "rear wheel", "black", oval(371, 226, 13, 13), near, 0.2)
    body(car, "front wheel", "black", oval(474, 226, 13, 13), near, 0.2)


def add_passer_by(name, look, u, top, foot, half_width):
    """Somebody far down the street: a head, a trunk, two legs close together."""
    passer = instance(name, "person")
    place, height = standing(u, foot), foot - top
    body(
        passer,
        "head",
        "skin",
        oval(u, top + 0.08 * height, 0.3 * half_width, 0.08 * height),
        place,
        0.2,
    )
    trunk = [
        (u - 0.4 * half_width, top + 0.15 * height), (u + 0.4 * half_width, top + 0.15 * height),
        (u + half_width, top + 0.3 * height), (u + 0.8 * half_width, top + 0.55 * height),
        (u - 0.8 * half_width, top + 0.55 * height), (u - half_width, top + 0.3 * height),
    ]  # fmt: skip
    body(passer, "trunk", look, trunk, place, 0.3)
    for side in (-0.45, 0.45):
        stations = [
            (u + side * half_width, top + share * height, 0.36 * half_width)
            for share in (0.5, 0.94)
        ]
        limb(passer, f"leg {side:+}", "black", stations, place)


def add_street():
    """Pavement, road, the facades on both sides and at the end."""
    slab(
        None,
        "Pavement",
        "pavement",
        [(-400, 900), (1040, 900), (1040, 209), (-400, 209)],
        level(0.0),
        0.05,
    )
    road = [(480, 264), (550, 262), (480, 225), (500, 214), (700, 240), (700, 380), (600, 360)]
    slab(None, "Road", "road", road, level(0.01), 0.005)
    slab(
        None,
        "Left facade",
        "facade",
        [(-20, -20), (300, -20), (300, 205), (-20, 230)],
        upright(40),
        0.3,
    )
    slab(
        None,
        "Far houses",
        "grey",
        [(300, -20), (385, 20), (470, 100), (500, 205), (300, 205)],
        upright(110),
        1,
    )
    slab(
        None,
        "Right facade",
        "facade",
        [(500, -20), (660, -20), (660, 225), (500, 208)],
        upright(90),
        1,
    )
    slab(
        None,
        "Litter bin",
        "black",
        [(621, 200), (637, 202), (637, 232), (621, 231)],
        standing(630, 232),
        0.4,
    )
    slab(
        None, "Pub sign", "black", [(103, 172), (117, 172), (115, 208), (103, 208)], upright(8), 0.1
    )
    limb(None, "Plant stem", "black", [(549, 208, 1), (549, 222, 2)], standing(549, 224))
    body(None, "Plant", "black", oval(546, 212, 5, 5), standing(549, 224), 0.3)


def main():
    """Everything in the picture."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    for add in (add_kicking_man, add_ball, add_watching_man, add_car, add_street):
        add()
    add_passer_by("Passer-by 1", "black", 570.5, 184, 226, 7.5)
    add_passer_by("Passer-by 2", "grey", 582, 187, 225, 5)
    add_passer_by("Passer-by 3", "black", 596, 190, 225, 5)
    add_passer_by("Passer-by 4", "black", 511.5, 193, 215, 3.2)
    add_passer_by("Passer-by 5", "white", 517.5, 194, 215, 3)
    add_camera_and_light((1.0, 1.0, 1.0), 2.0, (40, 30))


main()
