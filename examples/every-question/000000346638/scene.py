"""Rebuild COCO val2017 photo 000000346638: a beer bottle, a mouse and a keyboard before a screen.

Metres; z is up, y leads away from the camera, z = 0 is the top of the desk. The rings of the bottle
are level with the camera at its shoulder, which is the horizon; its 23 cm give the distances. What
has no name in COCO carries the name that LVIS or COCO's panoptic vocabulary has for it.
"""

import math

import bpy
from mathutils import Vector
from mathutils.geometry import delaunay_2d_cdt

IMAGE_WH = (640, 480)
FOCAL_PX = 680.0
HORIZON_V = 265.0
CAMERA_HEIGHT_M = 0.11
LOOKS = {
    "beige": (0.35, 0.27, 0.14),
    "black": (0.015, 0.013, 0.013),
    "blue": (0.08, 0.15, 0.4),
    "brown": (0.1, 0.03, 0.01),
    "desk": (0.55, 0.22, 0.06),
    "floor": (0.05, 0.03, 0.02),
    "grey": (0.25, 0.25, 0.27),
    "orange": (0.6, 0.25, 0.05),
    "red": (0.5, 0.03, 0.02),
    "screen": (0.95, 0.98, 1.0),
    "wall": (0.4, 0.15, 0.05),
    "white": (0.8, 0.7, 0.6),
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


def facing(left, right):
    """The upright plane through the ground seen at two pixels: (u, v) to a point on it."""
    base, along = level(0.0)(*left), level(0.0)(*right) - level(0.0)(*left)
    normal = Vector((along.y, -along.x, 0.0))
    return lambda u, v: (
        CAMERA_AT + ray(u, v) * ((base - CAMERA_AT).dot(normal) / ray(u, v).dot(normal))
    )


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


def sloped(near_m, near_height_m, far_m, far_height_m):
    """The plane that rises from one height at a depth to another at another depth."""
    normal = Vector((0.0, near_height_m - far_height_m, far_m - near_m))
    base = Vector((0.0, near_m, near_height_m))
    return lambda u, v: (
        CAMERA_AT + ray(u, v) * ((base - CAMERA_AT).dot(normal) / ray(u, v).dot(normal))
    )


def add_mouse():
    """The mouse with its lit side; the cable leads past the bottle."""
    mouse = instance("Mouse", "mouse")
    place = standing(180, 456)
    shell = [
        (86, 440), (87, 428), (93, 416), (103, 405), (118, 396), (135, 391), (155, 388), (175, 387),
        (192, 390), (210, 394), (228, 402), (238, 404), (250, 415), (268, 421), (275, 427),
        (276, 436), (275, 444), (272, 456), (262, 464), (250, 467), (220, 467), (180, 465),
        (140, 463), (110, 458), (92, 450),
    ]  # fmt: skip
    body(mouse, "shell", "grey", shell, place, 0.05)
    light = [(98, 441), (118, 432), (150, 427), (180, 430), (210, 440), (215, 455), (190, 459),
             (140, 459), (105, 452)]  # fmt: skip
    body(mouse, "lit side", "red", light, before(place, 0.021), 0.01)
    button = [(200, 398), (206, 395), (226, 403), (252, 418), (274, 426), (270, 436), (258, 444),
              (235, 432), (210, 414)]  # fmt: skip
    body(mouse, "button", "white", button, before(place, 0.018), 0.015)


def add_keyboard():
    """The keyboard, its wrist rest to the left; its right end is hidden by the bottle."""
    keyboard = instance("Keyboard", "keyboard", "computer_keyboard")
    place = sloped(0.42, 0.005, 0.98, 0.045)
    outline = [
        (127, 358), (130, 349), (140, 340), (158, 334), (163, 330), (180, 328), (205, 322),
        (222, 318), (240, 316), (255, 310), (275, 309), (300, 314), (340, 320), (378, 324),
        (420, 329), (463, 336), (500, 341), (540, 352), (530, 380), (500, 406), (463, 416),
        (400, 426), (340, 434), (305, 437), (292, 434), (275, 428), (240, 416), (200, 401),
        (165, 388), (145, 379), (132, 369),
    ]  # fmt: skip
    slab(keyboard, "base", "black", rounded(outline), place, 0.02)
    keys = [
        (165, 332), (210, 323), (258, 311), (300, 315), (380, 325), (463, 337), (500, 343),
        (505, 352), (463, 368), (400, 384), (345, 400), (300, 384), (240, 366), (200, 348),
    ]  # fmt: skip
    slab(keyboard, "keys", "grey", keys, before(place, 0.008), 0.006)


def add_bottle():
    """The beer bottle; the cable and the tablet hide its foot."""
    bottle = instance("Bottle", "bottle", "beer_bottle")
    place = standing(515, 436)
    glass = [
        (489, 77), (497, 74), (507, 73), (518, 73), (526, 76), (527, 83), (526, 90), (529, 93),
        (527, 97), (529, 115), (532, 145), (534, 165), (537, 190), (540, 210), (547, 223),
        (555, 236), (559, 249), (561, 265), (562, 300), (563, 350), (563, 390), (562, 420),
        (559, 432), (545, 439), (515, 442), (485, 439), (471, 434), (468, 420), (466, 390),
        (465, 350), (464, 300), (463, 270), (464, 252), (469, 238), (477, 222), (481, 205),
        (483, 180), (485, 150), (487, 120), (488, 98), (486, 93), (488, 90), (487, 83),
    ]  # fmt: skip
    body(bottle, "glass", "brown", glass, place, 0.06)
    near = before(place, 0.031)
    label = [(466, 275), (505, 273), (547, 276), (547, 396), (505, 396), (467, 388)]
    slab(bottle, "label", "blue", label, near, 0.002)
    label = [(487, 112), (508, 109), (528, 113), (533, 158), (508, 161), (486, 158)]
    slab(bottle, "neck label", "blue", label, before(place, 0.018), 0.002)


def add_screen():
    """The monitor, turned to the left; it goes on above the picture and behind the bottle."""
    screen = instance("Monitor", "tv", "monitor_(computer_equipment) computer_monitor")
    place = facing((330, 353), (560, 380))
    frame = [
        (330, 271), (338, 210), (350, 130), (366, 30), (369, 24), (400, 6), (425, -10), (600, -110),
        (592, 0), (568, 165), (556, 250), (551, 292), (463, 280), (420, 279), (385, 279),
        (345, 274),
    ]  # fmt: skip
    slab(screen, "frame", "black", frame, place, 0.06)
    face = [(341, 258), (375, 33), (435, -4), (580, -90), (574, 0), (543, 262), (463, 260)]
    slab(screen, "face", "screen", face, before(place, 0.004), 0.002)
    foot = [(475, 270), (540, 275), (540, 345), (475, 340)]
    slab(screen, "foot", "black", foot, before(place, -0.05), 0.03)


def add_cans():
    """Three cans below the screen; the bottle hides most of the third."""
    cans = [("Can 1", "grey", 360, 397, 321), ("Can 2", "red", 397, 434, 325),
            ("Can 3", "blue", 434, 474, 329)]  # fmt: skip
    for name, look, left, right, foot in cans:
        can = instance(name, "can")
        outline = [
            (left, 248),
            (right, 248),
            (right, foot),
            ((left + right) / 2, foot + 2),
            (left, foot),
        ]
        slab(can, "wall", look, outline, standing(left, 338), 0.06)


def add_desk_things():
    """What stands and lies on the desk and is no COCO category, but the speaker and the cans."""
    speaker = instance("Speaker", "speaker_(stero_equipment)")
    box = [
        (162, 293), (165, 268), (168, 250), (174, 236), (181, 231), (200, 230), (217, 233),
        (222, 255), (224, 292), (207, 296), (190, 295),
    ]  # fmt: skip
    slab(speaker, "box", "orange", box, upright(1.25), 0.1)
    body(speaker, "cloth", "brown", oval(186, 260, 21, 27, 12), upright(1.245), 0.01)
    player = instance("Player", "iPod")
    shell = [(30, 346), (38, 342), (60, 341), (100, 341), (126, 342), (122, 345), (107, 350),
             (105, 355), (60, 356), (31, 352)]  # fmt: skip
    slab(player, "shell", "black", shell, level(0.012), 0.012)
    stylus = instance("Stylus", "stylus")
    stations = [(293, 233, 2), (297, 250, 4), (304, 278, 5), (312, 308, 6), (316, 320, 5)]
    limb(stylus, "barrel", "grey", stations, upright(1.0))
    headset = instance("Headset", "headset")
    cup = [(249, 98), (249, 85), (256, 76), (266, 73), (273, 78), (284, 82), (276, 89), (284, 94),
           (266, 96)]  # fmt: skip
    body(headset, "cup", "black", cup, upright(1.4), 0.06)
    band = [(272, 83, 3), (300, 81, 3), (330, 80, 3), (352, 79, 3), (356, 86, 3), (350, 93, 3),
            (340, 92, 3), (328, 86, 2), (310, 82, 2)]  # fmt: skip
    limb(headset, "band", "black", band, upright(1.38))
    buds = instance("Earphones", "earphone")
    on_desk = level(0.006)
    for i, (u, v) in enumerate(((606, 394), (604, 405), (601, 416))):
        body(buds, f"bud {i}", "white", oval(u, v, 10, 5), on_desk, 0.006)
    wires = [
        [(606, 397), (588, 388), (578, 375), (586, 371), (600, 375), (622, 388)],
        [(562, 394), (585, 404), (605, 414), (622, 420)],
        [(640, 371), (629, 382), (627, 400), (632, 415), (640, 420)],
    ]  # fmt: skip
    for i, wire in enumerate(wires):
        limb(buds, f"wire {i}", "white", [(u, v, 1.5) for u, v in wire], on_desk)
    tower = [(234, 106), (303, 90), (306, 318), (236, 318)]
    slab(None, "Tower front", "beige", tower, upright(1.45), 0.01)
    tower = [(303, 90), (345, 92), (420, 100), (420, 256), (305, 256)]
    slab(None, "Tower side", "black", tower, upright(1.47), 0.3)
    slab(None, "Carton", "orange", [(306, 254), (360, 254), (360, 324),
                                    (308, 322)], upright(1.2), 0.2)  # fmt: skip
    cables = [
        [(272, 217), (248, 219), (228, 232), (214, 258), (209, 285), (214, 303), (224, 318)],
        [(270, 219), (248, 226), (240, 248), (230, 278), (231, 295), (254, 313)],
        [(204, 320), (211, 304), (224, 296), (236, 300), (240, 310), (238, 320)],
    ]  # fmt: skip
    for i, cable in enumerate(cables):
        limb(None, f"White cable {i}", "white", [(u, v, 1.5) for u, v in cable], upright(1.1))
    cable = [(274, 446, 2.5), (330, 444, 2.5), (400, 441, 2.5), (470, 438, 2.5), (520, 435, 2.5),
             (560, 429, 2.5), (600, 424, 2.5), (650, 421, 2.5)]  # fmt: skip
    limb(None, "Mouse cable", "black", cable, level(0.02))
    tablet = [(402, 466), (404, 455), (412, 447), (440, 441), (540, 437), (660, 430), (660, 560),
              (450, 560)]  # fmt: skip
    slab(None, "Tablet", "grey", tablet, level(0.012), 0.01)
    paper = [(88, 329), (150, 325), (155, 318), (215, 317), (200, 322), (160, 331), (140, 340),
             (102, 340), (112, 335)]  # fmt: skip
    slab(None, "Papers", "white", paper, level(0.002), 0.001)
    slab(None, "Card", "white", [(20, 356), (40, 350), (117, 354), (105, 359)], level(0.002), 0.001)
    clutter = [(65, 312), (75, 303), (130, 300), (122, 290), (126, 278), (140, 275), (165, 279),
               (212, 296), (235, 300), (236, 320), (120, 318), (70, 314)]  # fmt: skip
    slab(None, "Black things", "black", clutter, upright(1.35), 0.02)
    right = [(545, 290), (556, 250), (594, 216), (700, 214), (700, 336), (575, 336), (555, 346)]
    slab(None, "Things on the right", "black", right, upright(0.75), 0.1)
    panel = [(540, 280), (570, -20), (620, -20), (590, 216), (580, 290)]
    slab(None, "Blue panel", "blue", panel, upright(0.8), 0.02)


def add_room():
    """The desk, the rack on the wall, the wall."""
    desk = instance("Desk", "table-merged", "desk")
    top = [(-10, 388), (28, 314), (700, 314), (700, 900), (-400, 900)]
    slab(desk, "top", "desk", top, level(0.0), 0.01)
    wall = instance("Wall", "wall-other-merged")
    slab(wall, "face", "wall", [(-200, -200), (840, -200), (840, 520),
                                (-200, 520)], upright(2.3), 0.1)  # fmt: skip
    floor = instance("Floor", "floor-other-merged")
    slab(floor, "boards", "floor", [(-300, 1500), (940, 1500), (940, 478),
                                    (-300, 478)], level(-0.72), 0.05)  # fmt: skip
    lamp = [(289, 95), (291, 70), (297, 50), (304, 44), (330, 43), (360, 47), (380, 60), (380, 95)]
    slab(None, "Printer", "beige", lamp, upright(1.9), 0.3)
    bars = [
        [(42, 60, 3), (48, 306, 3)], [(83, 60, 2), (88, 160, 2), (104, 205, 3), (122, 280, 3)],
        [(164, 60, 2.5),
         (168, 280, 2.5)], [(203, 0, 5), (207, 300, 5)], [(233, 0, 3), (233, 290, 3)],
        *([(-10, v, 2), (236, v + slope, 2)] for v, slope in
          ((118, 0), (151, 2), (178, -1), (205, -2), (233, -6), (260, -6), (288, -8))),
    ]  # fmt: skip
    for i, bar in enumerate(bars):
        limb(None, f"Rack bar {i}", "black", bar, upright(2.1))
    for i, (v, foot) in enumerate(((-20, 30), (92, 118))):
        shelf = [(-20, v), (236, v), (236, foot), (-20, foot)]
        slab(None, f"Rack shelf {i}", "brown", shelf, upright(2.0), 0.02)


def main():
    """Everything in the picture."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    for add in (
        add_mouse,
        add_keyboard,
        add_bottle,
        add_screen,
        add_cans,
        add_desk_things,
        add_room,
    ):
        add()
    add_camera_and_light((0.9, 0.7, 0.5), 1.0, (50, -30))


main()
