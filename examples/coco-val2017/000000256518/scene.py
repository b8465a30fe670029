"""Rebuild COCO val2017 photo 000000256518: a breakfast on a tray, coffee in two cups.

Metres; z is up, y leads away from the camera, z = 0 is the table top. The slant of the big plate's
rim (an ellipse of 429 by 270 pixels) gives the camera's elevation, the plate's 28 cm the distance.
Plates, toast, egg, corn and hash have no COCO category: they hide what is behind them.
"""

import math

import bpy
from mathutils import Vector
from mathutils.geometry import delaunay_2d_cdt

IMAGE_WH = (640, 426)
FOCAL_PX = 800.0
HORIZON_V = -410.0
CAMERA_HEIGHT_M = 0.34
LOOKS = {
    "cardboard": (0.42, 0.27, 0.17),
    "coffee": (0.35, 0.23, 0.15),
    "corn": (0.8, 0.55, 0.05),
    "dark tray": (0.025, 0.018, 0.018),
    "egg": (0.85, 0.72, 0.2),
    "floor": (0.07, 0.06, 0.06),
    "hash": (0.3, 0.13, 0.1),
    "red": (0.6, 0.04, 0.03),
    "steel": (0.4, 0.42, 0.45),
    "table top": (0.6, 0.58, 0.54),
    "toast": (0.6, 0.38, 0.16),
    "white": (0.78, 0.78, 0.8),
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


def add_mug():
    """The white mug with its handle on the left; the coffee is one of its parts."""
    mug = instance("Mug", "cup")
    place = standing(487, 212)
    outline = [
        (441, 62), (446, 55), (470, 49), (505, 48), (538, 57), (556, 72), (557, 88), (550, 120),
        (540, 150), (522, 186), (506, 207), (486, 213), (474, 206), (462, 180), (445, 125),
        (437, 92),
    ]  # fmt: skip
    body(mug, "side", "white", outline, place, 0.06)
    body(mug, "coffee", "coffee", oval(498, 73, 48, 16, 8), standing(487, 212, 0.05), 0.01)
    handle = [
        (466, 118, 6),
        (452, 114, 6),
        (441, 125, 5.5),
        (437, 148, 5),
        (446, 171, 5),
        (466, 184, 4),
    ]
    limb(mug, "handle", "white", handle, standing(487, 212, 0.01))


def add_paper_cup():
    """The paper cup behind the plate: sleeve, body, and a white lid cut by the picture's edge."""
    cup = instance("Paper cup", "cup")
    place = standing(238, 114)
    sleeve = [
        (189, 18),
        (272, 18),
        (270, 60),
        (267, 100),
        (255, 112),
        (235, 115),
        (215, 111),
        (208, 100),
        (198, 60),
    ]
    body(cup, "sleeve", "cardboard", sleeve, place, 0.07)
    lid = [(184, 9), (188, -10), (276, -10), (279, 7), (270, 20), (232, 28), (194, 21)]
    body(cup, "lid", "white", lid, standing(238, 114, 0.01), 0.07)


def add_cutlery():
    """A spoon on the napkin; the handle of a knife that reaches under the plate."""
    spoon = instance("Spoon", "spoon")
    bowl = [
        (503, 234),
        (516, 230),
        (531, 233),
        (546, 241),
        (557, 252),
        (550, 257),
        (532, 251),
        (514, 243),
    ]
    body(spoon, "bowl", "steel", bowl, level(0.02), 0.006)
    stem = [(552, 252, 2.5), (580, 286, 3), (605, 320, 4), (622, 347, 6), (634, 361, 6)]
    limb(spoon, "stem", "steel", stem, level(0.02))
    knife = instance("Knife", "knife")
    slab(
        knife,
        "handle",
        "steel",
        [(86, 153), (88, 151), (150, 152), (150, 164), (88, 162)],
        level(0.004),
        0.003,
    )


def add_plates():
    """Both plates with their food."""
    body(None, "Plate", "white", oval(271.5, 259, 214.5, 135, 4), level(0.02), 0.02)
    body(None, "Far plate", "white", oval(391, 40, 119, 55, 3), level(0.02), 0.02)
    toast = [(97, 250), (100, 235), (172, 146), (182, 143), (310, 197), (300, 215), (215, 238)]
    slab(None, "Toast", "toast", toast, level(0.055), 0.015)
    toast = [(115, 290), (125, 250), (215, 238), (200, 255), (125, 295)]
    slab(None, "Lower toast", "toast", toast, level(0.04), 0.015)
    corn = [(136, 288), (175, 262), (225, 243), (270, 260), (300, 320), (290, 348), (215, 345)]
    body(None, "Corn", "corn", corn, level(0.04), 0.02)
    egg = [
        (258, 245),
        (285, 236),
        (315, 258),
        (365, 255),
        (412, 290),
        (400, 310),
        (362, 328),
        (300, 322),
        (265, 300),
    ]
    body(None, "Egg", "egg", egg, level(0.045), 0.03)
    heap = [
        (290, 225),
        (315, 190),
        (350, 172),
        (390, 180),
        (415, 210),
        (420, 250),
        (398, 268),
        (330, 258),
    ]
    body(None, "Hash", "hash", heap, level(0.05), 0.04)
    body(
        None,
        "Far egg",
        "egg",
        [(306, 40), (325, 18), (380, 35), (385, 48), (310, 66)],
        level(0.04),
        0.03,
    )
    body(
        None,
        "Far hash",
        "hash",
        [(376, 40), (390, 18), (415, 13), (438, 30), (430, 45)],
        level(0.045),
        0.03,
    )
    slab(
        None, "Far toast", "toast", [(325, 48), (445, 45), (448, 75), (322, 78)], level(0.05), 0.02
    )


def add_table():
    """The round white table, the trays and the sachets on it, the floor far below."""
    table = instance("Table", "dining table")
    top = [
        (-40, 175), (0, 146), (60, 97), (100, 78), (150, 59), (210, 45), (300, 38), (400, 42),
        (480, 62), (556, 95), (600, 120), (640, 158), (680, 200), (680, 470), (300, 470),
        (120, 430), (41, 377), (0, 336), (-40, 290),
    ]  # fmt: skip
    slab(table, "top", "table top", top, level(0.0), 0.02)
    tray = [
        (62, 298), (46, 345), (44, 378), (70, 402), (95, 424), (120, 450), (680, 440), (680, 350),
        (600, 225), (570, 175), (545, 155), (500, 150), (300, 140), (150, 200),
    ]  # fmt: skip
    slab(None, "Tray", "dark tray", tray, level(0.006), 0.004)
    tray = [
        (125, 112),
        (130, 125),
        (150, 136),
        (440, 152),
        (440, 100),
        (280, 80),
        (180, 80),
        (140, 85),
    ]
    slab(None, "Far tray", "dark tray", tray, level(0.006), 0.004)
    rim = [
        (125, 112),
        (145, 65),
        (158, 40),
        (175, 25),
        (192, 21),
        (190, 45),
        (180, 80),
        (160, 128),
        (138, 130),
    ]
    body(None, "Far tray rim", "dark tray", rim, level(0.02), 0.01)
    napkin = [(480, 222), (560, 245), (575, 300), (573, 365), (440, 342)]
    slab(None, "Napkin", "white", napkin, level(0.009), 0.001)
    ketchup = [(513, 195), (552, 178), (590, 232), (556, 245)]
    slab(None, "Ketchup", "red", ketchup, level(0.012), 0.003)
    body(None, "Jam", "red", [(484, 298), (515, 276), (555, 310), (530, 340)], level(0.02), 0.01)
    slab(
        None,
        "Sachet",
        "dark tray",
        [(528, 258), (585, 263), (612, 318), (565, 322)],
        level(0.011),
        0.002,
    )
    slab(
        None,
        "Stirrer",
        "red",
        [(222, 117), (420, 122), (420, 126), (222, 121)],
        level(0.014),
        0.003,
    )
    folded = [(611, 104), (620, 93), (680, 93), (680, 190), (640, 152), (622, 130)]
    slab(None, "Folded napkin", "white", folded, level(0.03), 0.01)
    slab(
        None,
        "Floor",
        "floor",
        [(-900, 1200), (1540, 1200), (1540, -380), (-900, -380)],
        level(-0.72),
        0.1,
    )


def main():
    """Everything in the picture."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    for add in (add_mug, add_paper_cup, add_cutlery, add_plates, add_table):
        add()
    add_camera_and_light((0.9, 0.95, 1.0), 1.0, (50, -60))


main()
