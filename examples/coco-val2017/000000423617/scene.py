"""Rebuild COCO val2017 photo 000000423617: buses, a taxi and cars on a wet road, from a bridge.

Metres; z is up, y leads away from the camera, the origin is on the road under the camera. Two buses
of one height at two distances give the horizon and the camera's height: 8.4 m above the road.
Outlines are pixels of the photo, placed on the plane on which the thing stands.
"""

import math

import bpy
from mathutils import Vector
from mathutils.geometry import delaunay_2d_cdt

IMAGE_WH = (640, 480)
FOCAL_PX = 1000.0
HORIZON_V = -65.0
CAMERA_HEIGHT_M = 8.4
LOOKS = {
    "bark": (0.12, 0.11, 0.1),
    "black": (0.015, 0.015, 0.018),
    "brown roof": (0.4, 0.25, 0.2),
    "concrete": (0.35, 0.35, 0.33),
    "grass": (0.07, 0.16, 0.03),
    "orange": (0.6, 0.12, 0.05),
    "purple": (0.12, 0.06, 0.12),
    "red": (0.45, 0.02, 0.03),
    "road": (0.09, 0.09, 0.095),
    "silver": (0.42, 0.4, 0.36),
    "skin": (0.4, 0.27, 0.2),
    "white": (0.75, 0.76, 0.76),
    "window": (0.04, 0.045, 0.05),
    "yellow": (0.6, 0.62, 0.02),
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


def add_front_bus():
    """The articulated bus of line 180: shell, roof, both window bands, bumper, wheels, mirror."""
    bus = instance("Bus 180", "bus")
    place, near = standing(380, 337), standing(380, 337, 0.15)
    shell = [
        (153, 119), (155, 115), (245, 113), (312, 140), (345, 151), (437, 192), (441, 198),
        (443, 333), (380, 337), (310, 338), (294, 332), (278, 316), (240, 286), (216, 268),
        (200, 258), (176, 238), (154, 212),
    ]  # fmt: skip
    slab(bus, "shell", "white", shell, place, 3.0)
    slab(
        bus,
        "windows",
        "window",
        [(155, 132), (215, 155), (305, 215), (312, 285), (215, 220), (155, 170)],
        near,
        0.05,
    )
    slab(bus, "windscreen", "window", [(318, 200), (439, 200), (440, 285), (320, 292)], near, 0.05)
    slab(
        bus,
        "red band",
        "orange",
        [(154, 198), (310, 300), (443, 302), (443, 320), (310, 325), (154, 212)],
        near,
        0.05,
    )
    slab(
        bus,
        "bumper",
        "black",
        [(312, 325), (443, 318), (443, 333), (312, 338)],
        standing(380, 337, 0.2),
        0.05,
    )
    slab(
        bus,
        "joint",
        "black",
        [(204, 145), (216, 150), (218, 270), (205, 262)],
        standing(380, 337, 0.2),
        0.05,
    )
    for number, (u, v) in enumerate(((175, 228), (228, 273), (286, 316))):
        body(bus, f"wheel {number}", "black", oval(u, v, 7, 18), standing(380, 337, 0.25), 0.3)
    arm = [(442, 200, 1.5), (450, 212, 1.5), (453, 225, 1.5)]
    limb(bus, "mirror arm", "black", arm, place)
    slab(bus, "mirror", "black", [(448, 224), (457, 224), (457, 247), (448, 247)], place, 0.1)


def add_rear_bus():
    """The bus of line 160, its right part hidden by the one in front; its driver is seen."""
    bus = instance("Bus 160", "bus")
    place, near = standing(130, 191), standing(130, 191, 0.15)
    shell = [
        (57, 55), (61, 53), (110, 52), (150, 61), (190, 85), (207, 98), (207, 115), (206, 190),
        (113, 191), (104, 184), (78, 163), (66, 150), (57, 138), (55, 130),
    ]  # fmt: skip
    slab(bus, "shell", "purple", shell, place, 3.0)
    slab(
        bus,
        "roof",
        "brown roof",
        [(58, 55), (110, 53), (150, 62), (207, 99), (117, 98)],
        near,
        0.05,
    )
    slab(bus, "windows", "window", [(58, 63), (113, 103), (115, 150), (58, 97)], near, 0.05)
    slab(bus, "windscreen", "window", [(118, 100), (205, 100), (205, 158), (118, 158)], near, 0.05)
    for number, (u, v) in enumerate(((71, 146), (101, 173))):
        body(bus, f"wheel {number}", "black", oval(u, v, 4, 17), standing(130, 191, 0.25), 0.3)
    driver = instance("Driver", "person")
    seat = standing(130, 191, 0.3)
    body(driver, "head", "skin", oval(128, 121, 4, 4.5), seat, 0.2)
    body(
        driver,
        "trunk",
        "white",
        [(121, 139), (122, 129), (128, 125), (136, 128), (140, 139)],
        seat,
        0.2,
    )


def add_taxi():
    """The yellow taxi with the sign on its roof."""
    taxi = instance("Taxi", "car")
    place, near = standing(200, 400), standing(200, 400, 0.15)
    outline = [
        (128, 332), (131, 317), (140, 304), (155, 294), (180, 291), (215, 292), (226, 298),
        (237, 318), (246, 330), (257, 342), (263, 360), (265, 378), (262, 391), (240, 393),
        (195, 394), (165, 396), (152, 382), (142, 368), (130, 352),
    ]  # fmt: skip
    body(taxi, "shell", "yellow", outline, place, 1.2)
    slab(
        taxi,
        "roof sign",
        "black",
        [(173, 268), (178, 266), (197, 275), (197, 292), (174, 290)],
        place,
        0.4,
    )
    slab(
        taxi,
        "windscreen",
        "window",
        [(161, 310), (228, 307), (244, 334), (157, 340)],
        standing(200, 400, 0.75),
        0.05,
    )
    body(taxi, "right mirror", "yellow", oval(250, 325, 5.5, 4), place, 0.1)
    body(taxi, "rear wheel", "black", oval(136, 356, 7, 17, -8), place, 0.2)
    body(taxi, "front wheel", "black", oval(158, 383, 7, 17, -8), near, 0.2)
    body(taxi, "far wheel", "black", oval(257, 389, 8, 7), place, 0.2)


def add_silver_car():
    """The silver saloon at the lower right, its front corner hidden by the van."""
    car = instance("Silver car", "car")
    place, near = standing(470, 467), standing(470, 467, 0.2)
    outline = [
        (408, 386), (411, 368), (418, 358), (430, 355), (442, 347), (465, 344), (490, 343),
        (510, 347), (530, 358), (548, 378), (566, 402), (578, 420), (578, 456), (520, 460),
        (482, 459), (460, 445), (432, 426), (414, 410),
    ]  # fmt: skip
    body(car, "shell", "silver", outline, place, 1.2)
    slab(
        car,
        "windscreen",
        "window",
        [(465, 365), (530, 362), (553, 390), (468, 398)],
        standing(470, 467, 0.8),
        0.05,
    )
    body(car, "right mirror", "silver", oval(557, 385, 5, 4.5), place, 0.1)
    body(car, "left mirror", "silver", oval(450, 390, 7, 4), standing(470, 467, 0.7), 0.1)
    body(car, "rear wheel", "black", oval(421, 414, 8, 20, -8), place, 0.2)
    body(car, "front wheel", "black", oval(467, 447, 8, 20, -8), near, 0.2)


def add_cut_off_cars():
    """Cars that the picture's edges or a tree cut: five of them."""
    rows = (
        ("White car", "white", standing(20, 219), 1.0, [
            (-30, 156), (10, 153), (28, 154), (38, 163), (46, 174), (52, 173), (53, 178), (54, 195),
            (55, 213), (51, 220), (44, 218), (38, 213), (-30, 217),
        ]),
        ("White van", "white", upright(13.0), 1.0, [
            (559, 560), (559, 490), (559, 445), (564, 415), (571, 398), (582, 391), (605, 387),
            (640, 385), (690, 385), (690, 560),
        ]),
        ("Car below", "silver", upright(12.0), 0.5, [
            (336, 482), (348, 474), (370, 469), (400, 467), (430, 468), (448, 474), (460, 490),
            (400, 510), (330, 495),
        ]),
        ("Car at the left edge", "silver", standing(0, 67), 0.5, [
            (-12, 44), (0, 44), (3, 48), (4, 56), (4, 64), (0, 68), (-12, 68),
        ]),
        ("Car behind the tree", "white", standing(590, 71), 1.0, [
            (576, 53), (584, 47), (592, 39), (605, 38), (612, 50), (605, 70), (590, 72), (579, 66),
        ]),
    )  # fmt: skip
    for name, look, place, thickness_m, outline in rows:
        car = instance(name, "car")
        body(car, "shell", look, outline, place, thickness_m)


def add_motorcyclist():
    """A motorcycle with its rider, coming toward the camera."""
    place, near = standing(25, 110), standing(25, 110, 0.3)
    rider = instance("Rider", "person")
    body(rider, "helmet", "black", oval(22.5, 65.5, 3.6, 4.3), place, 0.3)
    jacket = [
        (18, 71),
        (22, 69),
        (27, 70),
        (31, 78),
        (32, 85),
        (26, 84),
        (20, 85),
        (15, 86),
        (15, 78),
    ]
    body(rider, "jacket", "red", jacket, place, 0.4)
    limb(rider, "left leg", "black", [(18, 86, 3), (17, 92, 3), (19, 98, 2.5)], place)
    limb(rider, "right leg", "black", [(30, 86, 2), (30, 94, 2), (31, 98, 1.5)], place)
    motorcycle = instance("Motorcycle", "motorcycle")
    fairing = [(17, 87), (20, 81), (26, 80), (32, 86), (29, 94), (27, 101), (21, 101), (18, 93)]
    body(motorcycle, "fairing", "red", fairing, near, 0.4)
    limb(motorcycle, "bars", "black", [(15.5, 84, 1), (24, 82, 1), (33, 84, 1)], near)
    limb(motorcycle, "front wheel", "black", [(27, 98, 2), (27, 107.5, 2)], near)
    limb(motorcycle, "stand", "black", [(23, 99, 1.2), (23, 106, 1)], near)


def add_pedestrian():
    """Somebody in a yellow shirt who walks away behind the tree."""
    walker = instance("Pedestrian", "person")
    place = standing(578, 94)
    body(walker, "hair", "black", oval(576, 57, 4, 4), place, 0.2)
    body(walker, "shirt", "yellow", [(573, 62), (580, 62), (581, 74), (572, 74)], place, 0.3)
    body(walker, "skirt", "black", [(573, 73), (581, 73), (581, 80), (573, 80)], place, 0.3)
    limb(walker, "legs", "skin", [(578, 79, 2), (578, 86, 1.7), (579, 92.5, 1.5)], place)


def add_surroundings():
    """Road with markings, lawns, the board on its post, trees, the bridge's pillar."""
    slab(
        None, "Road", "road", [(-500, 900), (1140, 900), (1140, -50), (-500, -50)], level(0.0), 0.05
    )
    lawn = [
        (60, -40),
        (1140, -40),
        (1140, 900),
        (700, 470),
        (550, 380),
        (440, 320),
        (300, 200),
        (150, 80),
        (40, 0),
    ]
    slab(None, "Lawn", "grass", lawn, level(0.02), 0.01)
    slab(
        None,
        "Left lawn",
        "grass",
        [(-20, 310), (60, 340), (62, 600), (-20, 600)],
        level(0.02),
        0.01,
    )
    slab(
        None,
        "Pavement",
        "concrete",
        [(440, 250), (640, 360), (640, 385), (440, 275)],
        level(0.04),
        0.01,
    )
    lines = (
        [(0, 228), (110, 222), (172, 300), (60, 305)],
        [(330, 397), (338, 396), (362, 418), (352, 418)],
        [(285, 463), (305, 463), (318, 480), (298, 480)],
        [(255, 338), (264, 337), (282, 355), (272, 355)],
    )
    for number, outline in enumerate(lines):
        slab(None, f"Marking {number}", "concrete", outline, level(0.01), 0.005)
    board = [
        (372, 43),
        (380, 39),
        (525, 28),
        (538, 40),
        (540, 128),
        (533, 133),
        (385, 145),
        (375, 140),
    ]
    slab(None, "Board", "black", board, standing(500, 245), 0.3)
    slab(
        None,
        "Post",
        "black",
        [(494, 133), (502, 133), (503, 246), (494, 246)],
        standing(500, 246),
        0.2,
    )
    tree = [
        (535, -10), (562, -10), (568, 30), (569, 60), (572, 85), (577, 130), (580, 200), (586, 275),
        (548, 275), (555, 230), (553, 170), (556, 130), (551, 85),
    ]  # fmt: skip
    slab(None, "Tree", "bark", tree, standing(567, 275), 0.4)
    limb(None, "Branch", "bark", [(517, -5, 6), (540, 45, 6), (553, 90, 7)], standing(567, 275))
    slab(
        None,
        "Pillar",
        "concrete",
        [(592, -10), (632, -10), (636, 128), (593, 126)],
        standing(615, 128),
        1.0,
    )
    slab(
        None,
        "Lamp post",
        "concrete",
        [(328, -10), (334, -10), (336, 148), (330, 148)],
        upright(38),
        0.2,
    )
    slab(
        None,
        "Left tree",
        "bark",
        [(225, -10), (262, -10), (260, 100), (248, 100)],
        upright(45),
        0.4,
    )
    slab(
        None,
        "Middle tree",
        "bark",
        [(297, -10), (315, -10), (325, 145), (310, 145)],
        upright(42),
        0.4,
    )


def main():
    """Everything in the picture."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    for add in (add_front_bus, add_rear_bus, add_taxi, add_silver_car, add_cut_off_cars):
        add()
    for add in (add_motorcyclist, add_pedestrian, add_surroundings):
        add()
    add_camera_and_light((0.8, 0.85, 0.9), 1.0, (30, 30))


main()
