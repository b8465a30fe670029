"""Rebuild COCO val2017 photo 000000106235: a dim living room with three seats round a low table.

Metres; z is up, y leads away from the camera, the origin is on the floor under the camera. Outlines
are pixels of the photo. The low tables are not dining tables and stay unlabelled, as do the lamps.
"""

import math

import bpy
from mathutils import Vector
from mathutils.geometry import delaunay_2d_cdt

IMAGE_WH = (640, 480)
FOCAL_PX = 600.0
HORIZON_V = 60.0
CAMERA_HEIGHT_M = 1.5
LOOKS = {
    "beige": (0.42, 0.34, 0.24),
    "black": (0.015, 0.013, 0.012),
    "blind": (0.55, 0.48, 0.38),
    "blue blanket": (0.12, 0.13, 0.16),
    "brown": (0.08, 0.05, 0.035),
    "cat bed": (0.16, 0.15, 0.1),
    "cream leather": (0.5, 0.4, 0.28),
    "glow": (0.95, 0.9, 0.75),
    "leaf": (0.05, 0.07, 0.03),
    "night": (0.02, 0.02, 0.02),
    "orange": (0.45, 0.13, 0.05),
    "pattern": (0.14, 0.06, 0.04),
    "red pot": (0.7, 0.05, 0.02),
    "rug": (0.1, 0.05, 0.03),
    "wall": (0.5, 0.3, 0.2),
    "wood": (0.3, 0.13, 0.06),
}

COUCH_FEET = ((246, 347), (377, 309))  # where the couch's front meets the floor, left and middle

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


def along_couch(nearer_m=0.0):
    """The upright plane through the couch's front edge, which runs away to the right."""
    left, middle = (level(0.0)(u, v) for u, v in COUCH_FEET)
    normal = (middle - left).cross(Vector((0.0, 0.0, 1.0))).normalized()
    reach = (left - CAMERA_AT).dot(normal) + nearer_m
    return lambda u, v: CAMERA_AT + ray(u, v) * (reach / ray(u, v).dot(normal))


def add_couch():
    """The beige couch: arms, two back cushions, two seats, pillows; the front hides in the dark."""
    couch = instance("Couch", "couch")
    place = along_couch(-0.15)
    hull = [
        (137, 206), (144, 194), (160, 187), (173, 186), (173, 172), (180, 152), (192, 142),
        (215, 142), (262, 149), (310, 143), (333, 143), (450, 147), (490, 164), (510, 171),
        (523, 185), (526, 205), (516, 240), (480, 290), (400, 310), (320, 333), (246, 347),
        (222, 340), (205, 300), (190, 268), (170, 240), (146, 222),
    ]  # fmt: skip
    body(couch, "hull", "beige", hull, place, 0.5)
    cushion = [
        (331, 137),
        (345, 133),
        (370, 137),
        (400, 130),
        (425, 121),
        (443, 118),
        (451, 130),
        (450, 190),
        (340, 208),
    ]
    body(couch, "right back cushion", "beige", cushion, along_couch(0.05), 0.25)
    pillow = [(440, 145), (465, 146), (493, 144), (491, 160), (484, 204), (430, 200), (432, 170)]
    body(couch, "dark pillow", "brown", pillow, along_couch(0.15), 0.15)
    pillow = [(196, 182), (230, 155), (245, 170), (268, 215), (248, 250), (225, 225)]
    body(couch, "light pillow", "cream leather", pillow, along_couch(0.15), 0.15)
    seat = [(250, 255), (270, 235), (340, 217), (388, 245), (385, 270), (290, 295), (255, 290)]
    body(couch, "left seat", "beige", seat, along_couch(0.15), 0.2)
    seat = [(345, 212), (420, 200), (495, 207), (497, 225), (400, 250)]
    body(couch, "right seat", "beige", seat, along_couch(0.15), 0.2)


def add_right_seat():
    """The leather seat that the right edge cuts, a black throw over it."""
    seat = instance("Leather seat", "couch")
    place = standing(640, 318)
    hull = [
        (536, 222), (545, 202), (562, 180), (566, 160), (574, 145), (590, 143), (640, 148),
        (690, 150), (690, 325), (640, 318), (600, 300), (580, 280), (545, 245),
    ]  # fmt: skip
    body(seat, "hull", "cream leather", hull, place, 0.5)
    throw = [(580, 195), (605, 190), (690, 195), (690, 250), (596, 246)]
    body(seat, "throw", "black", throw, standing(640, 318, 0.35), 0.2)


def add_armchair():
    """The patterned armchair nearest to the camera, blankets over its back and arm."""
    chair = instance("Armchair", "chair")
    back = [
        (-30, 283),
        (10, 287),
        (45, 305),
        (75, 345),
        (95, 390),
        (105, 440),
        (150, 510),
        (-30, 510),
    ]
    body(chair, "back", "brown", back, upright(1.5), 0.3)
    arm = [
        (50, 312),
        (100, 300),
        (150, 288),
        (200, 280),
        (216, 290),
        (226, 330),
        (228, 345),
        (120, 390),
        (60, 380),
    ]
    body(chair, "far arm", "pattern", arm, upright(1.9), 0.3)
    blanket = [
        (70, 335),
        (120, 375),
        (220, 342),
        (245, 352),
        (265, 378),
        (230, 400),
        (130, 440),
        (60, 440),
    ]
    body(chair, "blanket", "blue blanket", blanket, upright(1.6), 0.15)
    seat = [
        (140, 440),
        (200, 400),
        (270, 383),
        (325, 386),
        (345, 405),
        (348, 450),
        (340, 510),
        (60, 510),
    ]
    body(chair, "seat", "pattern", seat, upright(1.55), 0.2)


def add_tables():
    """The oval low table with a candle on it, the side table, and their remote controls."""
    top = [
        (373, 285),
        (385, 262),
        (430, 243),
        (485, 237),
        (545, 241),
        (585, 258),
        (593, 275),
        (570, 305),
        (510, 326),
        (440, 327),
        (395, 312),
    ]
    body(None, "Low table", "wood", top, level(0.45), 0.05)
    for number, stations in enumerate(
        (
            [(400, 320, 6), (405, 370, 5), (390, 412, 5)],
            [(525, 325, 6), (525, 370, 5), (540, 402, 5)],
        )
    ):
        limb(None, f"Table leg {number}", "black", stations, upright(2.7))
    slab(
        None,
        "Candle",
        "black",
        [(475, 248), (498, 248), (496, 281), (474, 281)],
        upright(2.0),
        0.05,
    )
    top = [
        (10, 265),
        (40, 240),
        (100, 230),
        (150, 231),
        (185, 248),
        (187, 265),
        (165, 285),
        (100, 300),
        (60, 304),
        (20, 285),
    ]
    body(None, "Side table", "wood", top, level(0.65), 0.05)
    rows = (
        (
            "Remote 1",
            0.68,
            [(111, 246), (116, 243), (160, 252), (166, 257), (160, 260), (113, 251)],
        ),
        (
            "Remote 2",
            0.69,
            [(116, 259), (122, 256), (175, 258), (177, 263), (168, 266), (120, 262)],
        ),
        (
            "Remote 3",
            0.48,
            [(447, 313), (451, 308), (470, 305), (474, 308), (470, 314), (452, 317)],
        ),
    )
    for name, height_m, outline in rows:
        remote = instance(name, "remote")
        slab(remote, "shell", "black", outline, level(height_m), 0.01)
    slab(
        None,
        "Tin",
        "cream leather",
        [(123, 217), (142, 217), (147, 238), (122, 238)],
        upright(1.9),
        0.05,
    )


def add_plants():
    """Two potted plants on the window sill, dark against the night."""
    left = instance("Left plant", "potted plant")
    place = upright(5.3)
    slab(left, "pot", "orange", [(225, 132), (252, 132), (249, 152), (228, 152)], place, 0.1)
    leaves = (
        [(238, 133, 2), (238, 100, 3), (228, 62, 4)], [(238, 130, 2), (220, 90, 5), (206, 85, 4)],
        [(238, 125, 2), (250, 85, 5), (260, 72, 4)], [(238, 128, 2), (212, 110, 4), (208, 125, 3)],
        [(238, 120, 2), (240, 80, 5), (245, 58, 4)],
    )  # fmt: skip
    for number, stations in enumerate(leaves):
        limb(left, f"leaf {number}", "leaf", stations, place)
    right = instance("Right plant", "potted plant")
    slab(right, "pot", "red pot", [(308, 117), (335, 117), (332, 143), (311, 143)], place, 0.1)
    leaves = (
        [(320, 118, 2), (318, 80, 4), (310, 40, 3)], [(322, 118, 2), (330, 75, 5), (340, 45, 3)],
        [(320, 118, 2), (305, 90, 4), (302, 75, 3)], [(324, 118, 2), (338, 95, 4), (342, 85, 3)],
    )  # fmt: skip
    for number, stations in enumerate(leaves):
        limb(right, f"leaf {number}", "leaf", stations, place)


def add_room():
    """Floor, rug, walls, the window with its blinds, lamps, the cat bed on its stand."""
    slab(
        None,
        "Floor",
        "wood",
        [(-600, 1200), (1240, 1200), (1240, 150), (-600, 150)],
        level(0.0),
        0.05,
    )
    slab(None, "Rug", "rug", [(350, 310), (660, 310), (660, 500), (330, 500)], level(0.01), 0.005)
    slab(
        None,
        "Wall",
        "wall",
        [(-400, -400), (1040, -400), (1040, 320), (-400, 320)],
        upright(5.6),
        0.05,
    )
    slab(
        None,
        "Window",
        "night",
        [(175, -20), (350, -20), (350, 150), (178, 150)],
        upright(5.5),
        0.02,
    )
    slab(
        None,
        "Left blind",
        "blind",
        [(75, -20), (173, -20), (178, 155), (93, 171)],
        upright(5.4),
        0.02,
    )
    slab(
        None,
        "Right blind",
        "blind",
        [(347, -20), (430, -20), (423, 135), (347, 140)],
        upright(5.4),
        0.02,
    )
    slab(
        None,
        "Left lamp",
        "glow",
        [(-20, 37), (55, 40), (78, 180), (80, 260), (-20, 260)],
        upright(3.4),
        0.2,
    )
    body(None, "Right lamp", "glow", oval(540, -10, 65, 50), upright(5.0), 0.4)
    limb(None, "Lamp pole", "black", [(538, 25, 1.5), (533, 120, 1.5)], upright(5.2))
    body(
        None,
        "Cat bed",
        "cat bed",
        [(478, 98), (500, 92), (555, 91), (556, 118), (480, 120)],
        upright(4.9),
        0.3,
    )
    slab(
        None,
        "Cat tree",
        "brown",
        [(460, 121), (562, 121), (555, 127), (525, 127), (525, 200), (500, 200), (500, 127)],
        upright(5.0),
        0.3,
    )


def main():
    """Everything in the picture."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    for add in (add_couch, add_right_seat, add_armchair, add_tables, add_plants, add_room):
        add()
    add_camera_and_light((1.0, 0.8, 0.6), 0.6, (40, 30))


main()
