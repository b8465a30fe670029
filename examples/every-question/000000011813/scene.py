"""Rebuild COCO val2017 photo 000000011813: a camera on a tripod, a laptop on a folding chair.

Metres; z is up, y leads away from the camera, z = 0 is the floor. The edges of the vending machines
give the horizon; their 1.83 m, the table's 0.74 m and the chair's 0.8 m agree on the height of the
camera and the focal length. What has no name in COCO carries the name that LVIS has for it.
"""

import math

import bpy
from mathutils import Vector
from mathutils.geometry import delaunay_2d_cdt

IMAGE_WH = (333, 500)
FOCAL_PX = 1100.0
HORIZON_V = 126.0
CAMERA_HEIGHT_M = 1.42
LOOKS = {
    "alloy": (0.45, 0.36, 0.27),
    "black": (0.015, 0.015, 0.017),
    "blue": (0.1, 0.15, 0.45),
    "brown": (0.12, 0.09, 0.08),
    "chair": (0.25, 0.22, 0.2),
    "dark": (0.08, 0.08, 0.09),
    "floor": (0.3, 0.28, 0.24),
    "glow": (0.6, 0.85, 0.9),
    "machine": (0.4, 0.4, 0.34),
    "wall": (0.85, 0.8, 0.74),
    "white": (0.8, 0.8, 0.8),
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


def before(place, metres):
    """The place moved towards the camera: what stands or sticks out in front of it."""
    return lambda u, v: pushed(place(u, v), -metres)


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

TRIPOD_M = 2.75
CHAIR_M = 3.15
TABLE_M = 3.5


def add_tripod():
    """Head, column, three legs that go on below the picture, and the struts between them."""
    tripod = instance("Tripod", "tripod")
    place = upright(TRIPOD_M)
    limb(tripod, "column", "alloy", [(227, 147, 3.9), (226.3, 200, 3.9), (225.8, 250, 3.6),
                                     (225.5, 272, 3.6)], place)  # fmt: skip
    head = [
        (212, 126), (217, 119), (222, 120), (226, 127), (230, 131), (238, 132), (242, 136),
        (243, 140), (240, 144), (232, 145), (222, 147), (213, 146),
    ]  # fmt: skip
    body(tripod, "head", "black", head, place, 0.05)
    limb(tripod, "rod", "alloy", [(222, 123, 1.2), (226, 115, 1.4), (229, 109, 1.6)], place)
    grip = [(228.5, 110, 2), (232, 101, 2.6), (238, 88, 3.2), (243.5, 75, 4)]
    limb(tripod, "grip", "black", grip, place)
    hub = [
        (205, 277), (209, 272), (220, 269), (232, 272), (240, 274), (243, 279), (241, 284),
        (238, 292), (234, 292), (231, 285), (230, 293), (220, 293), (218, 285), (213, 286),
        (211, 292), (206, 290), (207, 284),
    ]  # fmt: skip
    body(tripod, "hub", "black", hub, before(place, 0.02), 0.05)
    limb(tripod, "crank", "black", [(241, 284, 2.2), (246, 292, 2),
                                    (251, 296, 3)], before(place, 0.03))  # fmt: skip
    left = [(208, 290, 3.2), (192, 330, 3.2), (180, 360, 3.2), (172, 380, 3.2), (164, 400, 3.2),
            (151, 430, 3), (139, 460, 2.9), (126.5, 490, 2.9), (114, 520, 2.9),
            (45, 690, 2.9)]  # fmt: skip
    limb(tripod, "left leg", "alloy", left, place)
    right = [(236, 290, 3.1), (239, 300, 3.1), (248.3, 330, 3.1), (258, 360, 3.2), (264, 380, 3.2),
             (276, 420, 3), (285.5, 450, 2.8), (294.8, 480, 2.8), (304, 510, 2.8),
             (356, 680, 2.8)]  # fmt: skip
    limb(tripod, "right leg", "alloy", right, place)
    front = [(226.3, 290, 3.6), (227.5, 350, 3.6), (228.3, 414, 3.6), (229, 430, 3.2),
             (230, 490, 3.2), (230.4, 520, 3.2), (233, 720, 3)]  # fmt: skip
    limb(tripod, "front leg", "alloy", front, before(place, 0.1))
    limb(tripod, "back leg", "alloy", [(221, 290, 3), (220.5, 345, 3.2), (220, 398, 3.4),
                                       (218, 422, 3.3)],
         before(place, -0.1))  # fmt: skip
    limb(tripod, "left strut", "white", [(165, 404, 1.4), (190, 407, 1.4), (216, 410, 1.4)], place)
    limb(tripod, "right strut", "white", [(230, 410, 1.4), (250, 408, 1.4), (270, 405, 1.4)], place)
    clamps = [
        ([(157, 400), (166, 403), (164, 410), (160, 413), (154, 409)], 0.03),
        ([(268, 402), (276, 401), (279, 409), (276, 414), (269, 412)], 0.03),
        ([(220, 415), (232, 415), (233, 426), (221, 427)], 0.13),
        ([(214, 396), (224, 396), (224, 424), (218, 424), (216, 412), (213, 411)], -0.07),
    ]  # fmt: skip
    for i, (clamp, nearer_m) in enumerate(clamps):
        slab(tripod, f"clamp {i}", "black", clamp, before(place, nearer_m), 0.03)


def add_camera_on_tripod():
    """The camera, its lens to the right; cords hang from its plugs, one leads to the laptop."""
    camera = instance("Photo camera", "camera")
    shell = [
        (187, 122), (190, 117), (196, 115), (206, 115), (213, 117), (217, 120), (218, 130),
        (217, 142), (213, 147), (213, 152), (210, 155), (200, 156), (200, 162), (193, 162),
        (193, 155), (188, 153), (188, 140), (188, 128),
    ]  # fmt: skip
    body(camera, "shell", "black", shell, upright(TRIPOD_M - 0.03), 0.08)
    body(camera, "lens", "dark", oval(209, 131.5, 9, 9.5), upright(TRIPOD_M - 0.08), 0.05)
    place = upright(TRIPOD_M - 0.02)
    cords = [
        ("black", [(188, 148, 1.5), (187, 157, 1.5), (184, 164, 2.5), (181, 172, 1.5)]),
        ("black", [(191, 164, 2.5), (192, 178, 2.5), (190, 190, 2), (187, 203, 2.2),
                   (186, 213, 1.5)]),
        ("white", [(187, 214, 0.8), (188, 230, 0.8), (187, 246, 0.8), (182, 265, 0.8),
                   (175, 279, 0.8), (170, 290, 0.8), (164.5, 310, 0.8), (162.3, 340, 0.8),
                   (162, 365, 0.8), (159, 387, 0.8)]),
    ]  # fmt: skip
    for i, (look, stations) in enumerate(cords):
        limb(None, f"Cord {i}", look, stations, place)


def add_laptop():
    """The laptop; its lid faces us, its keys the back of the chair."""
    laptop = instance("Laptop", "laptop")
    lid = [
        (43, 453), (60, 424), (78, 391), (84, 389), (120, 387), (160, 385), (172, 387), (173, 390),
        (158, 418), (141, 448), (136, 450), (90, 454), (44, 459),
    ]  # fmt: skip
    slab(laptop, "lid", "black", lid, upright(CHAIR_M - 0.2), 0.012)
    base = [
        (-90, 464), (0, 460), (37, 453), (60, 452), (138, 449), (137, 453), (130, 457), (105, 461),
        (80, 467), (56, 470), (48, 466), (40, 465), (0, 467), (-90, 470),
    ]  # fmt: skip
    slab(laptop, "base", "black", base, upright(CHAIR_M - 0.19), 0.24)


def add_chairs():
    """The chair below the laptop, and the corner of a seat at the edge of the picture."""
    chair = instance("Chair", "chair", "folding_chair")
    back = [
        (-60, 352), (-30, 339), (0, 336), (25, 334), (48, 333), (58, 335), (67, 341), (75, 351),
        (80, 361), (83, 370), (80, 377), (60, 378), (45, 382), (25, 386), (0, 388), (-30, 387),
        (-60, 378),
    ]  # fmt: skip
    body(chair, "back", "chair", back, upright(CHAIR_M + 0.1), 0.03)
    limb(chair, "tube", "alloy", [(81, 370, 2.5), (87, 387, 2.5), (100, 425, 2.5), (113, 462, 2.5)],
         upright(CHAIR_M + 0.08))  # fmt: skip
    seat = [
        (-70, 464), (0, 463), (60, 462), (100, 460), (133, 460), (144, 459), (148, 463), (147, 467),
        (140, 470), (105, 474), (85, 478), (60, 479), (25, 476), (-10, 472), (-70, 472),
    ]  # fmt: skip
    slab(chair, "seat", "chair", seat, upright(CHAIR_M - 0.18), 0.3)
    legs = [
        [(68, 479, 4), (55, 485, 4), (37, 499, 4), (-20, 550, 4)],
        [(117, 474, 3.2), (121, 487, 3), (126, 502, 3), (140, 545, 3)],
        [(130, 472, 2), (133, 480, 2), (137, 500, 2), (150, 545, 2)],
    ]  # fmt: skip
    for i, leg in enumerate(legs):
        limb(chair, f"leg {i}", "alloy", leg, upright(CHAIR_M))
    near = instance("Near chair", "chair", "folding_chair")
    seat = [(-80, 485), (0, 482), (18, 480), (24, 480), (25, 485), (20, 488), (8, 490), (0, 492),
            (-80, 494)]  # fmt: skip
    slab(near, "seat", "chair", seat, upright(2.75), 0.3)
    limb(near, "leg", "black", [(2, 490, 3), (6, 501, 3), (20, 560, 3)], upright(2.8))
    paper = [(-60, 474), (0, 473), (20, 473), (26, 474), (18, 481), (0, 482), (-60, 485)]
    slab(None, "Papers", "white", paper, upright(2.73), 0.01)


def add_table():
    """The folding table under its cloth, with a box and trays on it; it goes on to the right."""
    table = instance("Table", "dining table", "table")
    place = upright(TABLE_M)
    cloth = [
        (254, 322), (261, 322), (266, 332), (274, 341), (300, 340), (333, 339), (480, 339),
        (480, 362), (333, 361), (300, 362), (285, 367), (273, 371), (268, 363), (265, 355),
        (263, 346), (259, 334),
    ]  # fmt: skip
    slab(table, "cloth", "white", cloth, place, 0.5)
    legs = [
        [(297, 360, 2.7), (297, 400, 2.7), (296, 425, 4), (295, 438, 8)],
        [(324, 360, 3.5), (323, 430, 3.7), (323, 475, 4), (323, 500, 8)],
        [(480, 440, 2.3), (333, 440, 2.3), (285, 439, 2.3), (272, 442, 2.5), (265, 452, 2.6),
         (263, 478, 2.6)],
        [(300, 373, 1.3), (308, 367, 1.3), (325, 363, 1.3)],
    ]  # fmt: skip
    for i, leg in enumerate(legs):
        limb(table, f"leg {i}", "black", leg, before(place, -0.15 if i != 1 else 0.0))
    box = instance("Box", "box")
    side = [(241, 252), (243, 243), (300, 241), (480, 238), (480, 288), (333, 289), (262, 287),
            (244, 286)]  # fmt: skip
    slab(box, "side", "white", side, upright(TABLE_M + 0.1), 0.25)
    flap = [(238, 243), (290, 241), (480, 239), (480, 252), (333, 252), (262, 250), (242, 247)]
    slab(box, "flap", "brown", flap, upright(TABLE_M + 0.09), 0.01)
    trays = [(272, 291), (290, 290), (480, 289), (480, 341), (333, 340), (300, 339), (288, 330),
             (280, 322), (284, 312)]  # fmt: skip
    slab(None, "Trays", "white", trays, upright(TABLE_M + 0.05), 0.2)
    under = [(244, 286), (300, 286), (300, 342), (274, 342), (264, 322), (250, 322)]
    slab(None, "Carton", "wall", under, upright(TABLE_M + 0.2), 0.1)
    sheet = [(217, 254), (228, 247), (243, 242), (247, 246), (244, 252), (230, 257), (219, 257)]
    slab(None, "Sheet", "white", sheet, upright(TABLE_M + 0.08), 0.005)


def add_hall():
    """Out of focus: two vending machines, a cabinet, a bin, the wall and the floor."""
    depth = 6.6
    machine = instance("Glass machine", "vending machine")
    side = [(30, 51), (40, 54), (72, 57), (74, 70), (72, 200), (70, 340), (68, 350), (30, 345)]
    slab(machine, "side", "machine", side, upright(depth + 0.05), 0.05)
    front = [(72, 57), (80, 57), (91, 66), (92, 200), (90, 345), (70, 348), (71, 200)]
    slab(machine, "front", "glow", front, upright(depth + 0.1), 0.6)
    drinks = instance("Drinks machine", "vending machine")
    shell = [
        (72, 55), (110, 57), (145, 59), (148, 64), (150, 90), (152, 125), (152, 160), (150, 195),
        (147, 230), (144, 262), (144, 290), (147, 320), (150, 337), (141, 343), (139, 358),
        (130, 360), (128, 346), (106, 346), (96, 350), (80, 352), (88, 330), (90, 200), (89, 66),
    ]  # fmt: skip
    slab(drinks, "shell", "black", shell, upright(depth), 0.7)
    face = [(105, 66), (146, 68), (151, 125), (149, 195), (144, 262), (144, 290), (149, 335),
            (106, 341), (101, 280)]  # fmt: skip
    slab(drinks, "face", "blue", face, upright(depth - 0.01), 0.005)
    slab(None, "Pallet", "brown", [(75, 356), (125, 348), (128, 360), (110, 366),
                                   (75, 362)], upright(depth),
         0.6)  # fmt: skip
    cabinet = [(-60, 54), (26, 51), (32, 56), (30, 345), (-60, 350)]
    slab(None, "Cabinet", "brown", cabinet, upright(depth - 0.1), 0.6)
    bin_ = instance("Bin", "trash can")
    shell = [(140, 226), (175, 225), (223, 227), (222, 260), (218, 300), (214, 345), (185, 351),
             (145, 348)]  # fmt: skip
    slab(bin_, "shell", "dark", shell, upright(7.0), 0.4)
    things = [(219, 226), (240, 220), (280, 220), (400, 220), (400, 350), (240, 348), (215, 345)]
    slab(None, "Things at the wall", "white", things, upright(7.2), 0.2)
    wall = instance("Wall", "wall-other-merged")
    slab(wall, "face", "wall", [(-300, -300), (640, -300), (640, 345),
                                (-300, 345)], upright(7.6), 0.1)  # fmt: skip
    floor = instance("Floor", "floor-other-merged")
    slab(floor, "face", "floor", [(-400, 900), (740, 900), (740, 325),
                                  (-400, 325)], level(0.0), 0.1)  # fmt: skip


def main():
    """Everything in the picture."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    for add in (add_tripod, add_camera_on_tripod, add_laptop, add_chairs, add_table, add_hall):
        add()
    add_camera_and_light((0.9, 0.88, 0.85), 1.0, (40, 30))


main()
