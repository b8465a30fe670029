"""Rebuild COCO val2017 photo 000000047112: a pizza close up, two glasses, a restaurant behind.

Metres; z is up, y leads away from the camera, z = 0 is the near table top, 15 cm below the lens.
Outlines are pixels of the photo. The room behind is out of focus: bottles lie in a rack on the
left and stand on a shelf on the right, slatted chair backs show above the far table.
"""

import math

import bpy
from mathutils import Vector
from mathutils.geometry import delaunay_2d_cdt

IMAGE_WH = (640, 480)
FOCAL_PX = 600.0
HORIZON_V = 60.0
CAMERA_HEIGHT_M = 0.15
LOOKS = {
    "beer": (0.7, 0.4, 0.02),
    "blue cloth": (0.28, 0.36, 0.55),
    "cabinet": (0.3, 0.15, 0.05),
    "crust": (0.6, 0.4, 0.22),
    "dark glass": (0.03, 0.04, 0.03),
    "dark wood": (0.05, 0.03, 0.025),
    "green": (0.2, 0.3, 0.08),
    "label": (0.7, 0.68, 0.6),
    "olive": (0.09, 0.1, 0.04),
    "porcelain": (0.75, 0.77, 0.8),
    "red floor": (0.35, 0.03, 0.03),
    "skin": (0.6, 0.4, 0.33),
    "steel": (0.5, 0.5, 0.52),
    "topping": (0.65, 0.28, 0.08),
    "wall": (0.5, 0.38, 0.25),
    "water glass": (0.55, 0.57, 0.58),
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


def turned(owner, part, look, axis_u, profile, place, corners=40):
    """A lathed thing that stands upright: profile of (v, half width), in pixels on its axis."""
    points, faces = [], []
    for i, (v, half_width) in enumerate(profile):
        centre = place(axis_u, v)
        radius_m = half_width * (centre - CAMERA_AT).dot(ray(*(n / 2 for n in IMAGE_WH))) / FOCAL_PX
        for turn in (math.tau * k / corners for k in range(corners)):
            points.append(centre + radius_m * Vector((math.cos(turn), math.sin(turn), 0.0)))
        if i:
            for k in range(corners):
                a, b = (i - 1) * corners + k, (i - 1) * corners + (k + 1) % corners
                faces.append((a, b, b + corners, a + corners))
    made = add_mesh(owner, part, look, points, faces)
    made.data.shade_smooth()
    return made


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


def add_pizza():
    """The pizza, cut by the right edge of the picture, on its plate."""
    plate = [
        (50, 318), (62, 288), (100, 250), (170, 222), (250, 209), (330, 204), (480, 210),
        (620, 240), (720, 290), (760, 400), (680, 482), (400, 492), (280, 462), (180, 422),
        (100, 380), (60, 345),
    ]  # fmt: skip
    body(None, "Plate", "porcelain", plate, level(0.008), 0.006)
    pizza = instance("Pizza", "pizza")
    crust = [
        (113, 325), (116, 295), (136, 262), (180, 234), (250, 215), (320, 206), (400, 206),
        (480, 213), (560, 228), (620, 243), (700, 285), (730, 360), (690, 440), (628, 458),
        (500, 458), (400, 452), (300, 438), (230, 415), (170, 385), (130, 355),
    ]  # fmt: skip
    body(pizza, "crust", "crust", crust, level(0.022), 0.015)
    topping = [
        (140, 290), (190, 248), (270, 224), (350, 213), (480, 222), (600, 248), (690, 300),
        (690, 380), (600, 398), (420, 395), (300, 378), (200, 345),
    ]  # fmt: skip
    body(pizza, "topping", "topping", topping, level(0.032), 0.01)


def add_glasses():
    """The beer goblet and the water glass: lathed bowls on stems."""
    beer = instance("Beer goblet", "wine glass")
    place = standing(340, 207)
    bowl = [(14, 37), (40, 41), (73, 44), (100, 43), (130, 35), (150, 24), (160, 15)]
    turned(beer, "bowl", "beer", 340, bowl, place)
    stem = [(158, 15), (168, 13), (183, 9), (203, 10), (207, 13)]
    turned(beer, "stem", "water glass", 340, stem, place)
    water = instance("Water glass", "wine glass")
    profile = [(36, 31), (70, 38), (100, 42), (125, 42.5), (142, 38), (155, 26), (163, 14)]
    turned(water, "bowl", "water glass", 439.5, profile, standing(440, 208))
    stem = [(161, 15), (168, 11), (175, 6.5), (204, 6.5), (208, 11)]
    turned(water, "stem", "water glass", 432, stem, standing(440, 208))


def add_guest():
    """A guest at the right: a hand over the salad bowl, a sleeve and a jacket at the edge."""
    guest = instance("Guest", "person")
    place = upright(1.25)
    hand = [
        (504, 155), (506, 142), (525, 132), (546, 128), (560, 139), (575, 154), (580, 166),
        (540, 170), (506, 168),
    ]  # fmt: skip
    body(guest, "hand", "skin", hand, place, 0.05)
    jacket = [(580, 165), (590, 140), (606, 117), (625, 108), (670, 100), (670, 185), (600, 180)]
    body(guest, "jacket", "olive", jacket, upright(1.3), 0.1)
    sleeve = [(603, 166), (615, 150), (635, 137), (670, 130), (670, 185), (610, 180)]
    body(guest, "sleeve", "blue cloth", sleeve, place, 0.08)
    bowl = instance("Salad bowl", "bowl")
    outline = [
        (502, 165), (515, 162), (560, 162), (640, 165), (690, 175), (690, 225), (640, 233),
        (600, 226), (572, 213), (552, 197), (527, 182),
    ]  # fmt: skip
    body(bowl, "side", "porcelain", outline, upright(0.52), 0.06)
    body(
        bowl,
        "salad",
        "green",
        [(535, 168), (560, 164), (640, 166), (690, 172), (690, 186), (560, 178)],
        upright(0.48),
        0.02,
    )


def add_near_table():
    """The near table, and the knife whose end shows left of the plate."""
    table = instance("Near table", "dining table")
    top = [
        (-60, 262), (0, 236), (25, 217), (150, 208), (300, 201), (400, 198), (500, 190), (560, 194),
        (700, 196), (900, 560), (-300, 560),
    ]  # fmt: skip
    slab(table, "cloth", "blue cloth", top, level(0.0), 0.02)
    knife = instance("Knife", "knife")
    blade = [(96, 232), (102, 231), (160, 230), (160, 237), (104, 237), (97, 235)]
    slab(knife, "blade", "steel", blade, level(0.004), 0.002)


def add_far_table():
    """The far table under its hanging cloth."""
    table = instance("Far table", "dining table")
    cloth = [
        (52, 106), (95, 104), (150, 112), (230, 123), (290, 136), (320, 138), (338, 178),
        (355, 198), (340, 215), (100, 215), (102, 195), (90, 183), (75, 195), (66, 212),
        (62, 205), (66, 160), (58, 125),
    ]  # fmt: skip
    slab(table, "cloth", "blue cloth", cloth, upright(2.2), 0.6)


def add_chair_back(name, left, top, right, bottom, depth_m):
    """A slatted chair back: a top rail and upright slats, given by its rectangle in the picture."""
    chair = instance(name, "chair")
    place = upright(depth_m)
    limb(chair, "rail", "dark wood", [(left + 2, top + 2, 2.5), (right - 2, top + 2, 2.5)], place)
    count = max(2, round((right - left) / 13))
    for slat in range(count + 1):
        u = left + 2 + (right - left - 4) * slat / count
        limb(chair, f"slat {slat}", "dark wood", [(u, top + 2, 2.2), (u, bottom, 2.2)], place)


def add_chairs():
    """The high-backed chair at the far table's left end, and four backs behind the table."""
    chair = instance("Left chair", "chair")
    posts = [
        (13, 84), (24, 79), (38, 76), (46, 80), (53, 120), (60, 160), (64, 188), (63, 214),
        (43, 214),        (36, 180), (24, 125),
    ]  # fmt: skip
    body(chair, "back", "dark wood", posts, upright(1.9), 0.1)
    add_chair_back("Chair behind 1", 62, 93, 119, 118, 3.0)
    add_chair_back("Chair behind 2", 165, 100, 216, 126, 3.0)
    add_chair_back("Chair behind 3", 232, 100, 271, 136, 3.0)
    add_chair_back("Chair behind 4", 274, 101, 312, 142, 3.0)


LYING_BOTTLES = (
    (43, 3), (43, 14), (78, 4), (78, 15), (78, 26), (80, 36), (48, 46), (80, 45), (46, 54),
    (80, 54),    (48, 66), (79, 64), (52, 75), (78, 74), (397, 8), (395, 22), (450, 7),
)  # fmt: skip
STANDING_BOTTLES = (
    (512, 16, 43), (525, 20, 40), (538, 14, 40), (547, 12, 39), (561, 13, 38), (574, 15, 36),
    (587, 17, 36), (381, 66, 105), (393, 62, 104),
)  # fmt: skip


def add_bottles():
    """Bottles lying in the racks, neck to the side, and bottles standing on the shelf."""
    place = upright(4.5)
    for number, (u, v) in enumerate(LYING_BOTTLES):
        bottle = instance(f"Lying bottle {number}", "bottle")
        limb(
            bottle,
            "glass",
            "dark glass",
            [(u - 11, v, 4.6), (u + 6, v, 4.6), (u + 12, v, 2.5)],
            place,
        )
    for number, (u, top, foot) in enumerate(STANDING_BOTTLES):
        bottle = instance(f"Standing bottle {number}", "bottle")
        neck = top + 0.35 * (foot - top)
        profile = [(top, 1.6), (neck - 3, 1.8), (neck + 2, 4.6), (foot, 4.6)]
        turned(bottle, "glass", "dark glass", u, profile, place, corners=16)


def add_room():
    """The wall, the wooden cabinet, the glass counter, the red floor."""
    slab(
        None,
        "Wall",
        "wall",
        [(-400, -400), (1040, -400), (1040, 300), (-400, 300)],
        upright(5.0),
        0.1,
    )
    slab(
        None,
        "Floor",
        "red floor",
        [(-400, 300), (200, 300), (140, 110), (-400, 110)],
        level(-0.75),
        0.05,
    )
    slab(
        None,
        "Cabinet",
        "cabinet",
        [(345, 115), (495, 118), (490, 230), (345, 230)],
        upright(3.0),
        0.3,
    )
    slab(
        None,
        "Counter",
        "dark wood",
        [(480, 45), (605, 38), (605, 230), (480, 230)],
        upright(3.5),
        0.3,
    )
    slab(
        None,
        "Counter window",
        "olive",
        [(490, 60), (584, 48), (575, 125), (500, 120)],
        upright(3.4),
        0.05,
    )


def main():
    """Everything in the picture."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    for add in (add_pizza, add_glasses, add_guest, add_near_table, add_far_table, add_chairs):
        add()
    add_bottles()
    add_room()
    add_camera_and_light((1.0, 0.95, 0.85), 1.5, (45, 30))


main()
