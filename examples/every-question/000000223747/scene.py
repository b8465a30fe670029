"""Rebuild COCO val2017 photo 000000223747: a man asleep, a dog, a leg in jeans.

Metres; z is up, y leads away from the camera, z = 0 is what they lie on. The photo is dark: its
edges were traced on a brightened copy. The length of the man's face gives his distance, the width
of the leg its own. The horizon is a guess, and so is the line between the dog and the sleeve.
"""

import math

import bpy
from mathutils import Vector
from mathutils.geometry import delaunay_2d_cdt

IMAGE_WH = (500, 370)
FOCAL_PX = 560.0
HORIZON_V = 150.0
CAMERA_HEIGHT_M = 0.45
LOOKS = {
    "beige": (0.4, 0.38, 0.3),
    "black": (0.02, 0.02, 0.02),
    "cloth": (0.12, 0.13, 0.18),
    "dark": (0.03, 0.03, 0.032),
    "denim": (0.06, 0.06, 0.085),
    "door": (0.6, 0.3, 0.2),
    "fur": (0.12, 0.1, 0.09),
    "hair": (0.03, 0.027, 0.025),
    "hood": (0.1, 0.17, 0.17),
    "skin": (0.5, 0.28, 0.22),
    "wall": (0.85, 0.5, 0.3),
    "white": (0.5, 0.48, 0.45),
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


def add_man():
    """The man asleep on his side in a hooded jersey; his hand lies on the dog."""
    man = instance("Man", "person")
    place = upright(1.05)
    hood = [
        (205, 112), (222, 115), (244, 120), (256, 112), (290, 102), (318, 89), (340, 79), (357, 74),
        (367, 80), (384, 100), (400, 115), (415, 126), (416, 137), (408, 150), (380, 200),
        (340, 245), (330, 255), (300, 240), (262, 226), (240, 205), (205, 170),
    ]  # fmt: skip
    body(man, "hood", "hood", hood, place, 0.16)
    torso = [
        (60, 200), (130, 170), (222, 165), (240, 200), (262, 225), (300, 238), (340, 245),
        (375, 298), (395, 310), (420, 325), (448, 348), (470, 372), (490, 410), (330, 440),
        (120, 420), (80, 330),
    ]  # fmt: skip
    body(man, "jersey", "dark", torso, before(place, 0.03), 0.24)
    head = [
        (251, 128), (258, 112), (256, 105), (263, 110), (290, 106), (312, 112), (322, 108),
        (340, 108), (355, 113), (378, 124), (402, 136), (420, 147), (426, 160), (422, 176),
        (416, 190), (414, 215), (407, 245), (402, 265), (390, 285), (375, 298), (345, 290),
        (325, 255), (290, 236), (268, 212), (253, 190), (250, 160),
    ]  # fmt: skip
    body(man, "hair and beard", "hair", head, before(place, 0.06), 0.18)
    face = [
        (300, 150), (310, 125), (325, 109), (342, 109), (378, 124), (402, 136), (419, 148),
        (425, 160), (421, 176), (415, 188), (400, 184), (385, 172), (355, 162), (330, 168),
        (305, 165),
    ]  # fmt: skip
    body(man, "face", "skin", face, before(place, 0.12), 0.08)
    sleeve = [(372, 292, 22), (320, 265, 18), (270, 260, 13), (235, 256, 12)]
    limb(man, "sleeve", "hood", sleeve, before(place, 0.2))
    hand = [(258, 264), (268, 261), (280, 263), (290, 272), (297, 283), (288, 287), (275, 283),
            (263, 275)]  # fmt: skip
    body(man, "hand", "skin", hand, upright(0.76), 0.03)


def add_dog():
    """The dog looks at the camera: an upright ear, a muzzle out of focus, a paw."""
    dog = instance("Dog", "dog")
    trunk = [
        (80, 300), (190, 288), (215, 283), (245, 280), (275, 284), (300, 285), (325, 292),
        (345, 305), (355, 325), (352, 350), (345, 380), (330, 420), (70, 420),
    ]  # fmt: skip
    body(dog, "trunk", "black", trunk, upright(0.9), 0.2)
    head = [
        (52, 380), (44, 335), (46, 300), (54, 276), (62, 257), (80, 248), (112, 240), (140, 246),
        (163, 259), (180, 270), (190, 290), (187, 310), (180, 338), (165, 360), (150, 380),
        (100, 400),
    ]  # fmt: skip
    body(dog, "head", "black", head, upright(0.75), 0.14)
    ear = [(165, 262), (173, 250), (185, 242), (197, 242), (201, 252), (197, 272), (190, 292),
           (172, 290)]  # fmt: skip
    body(dog, "ear", "skin", ear, upright(0.72), 0.03)
    face = [(97, 310), (110, 294), (140, 300), (160, 294), (176, 305), (178, 335), (158, 360),
            (120, 335)]  # fmt: skip
    body(dog, "face", "fur", face, upright(0.68), 0.05)
    muzzle = [(86, 352), (95, 335), (108, 330), (122, 342), (130, 362), (125, 390), (95, 390)]
    body(dog, "muzzle", "white", muzzle, upright(0.62), 0.06)
    paw = [(232, 345), (245, 330), (262, 328), (280, 338), (292, 355), (296, 380), (260, 390),
           (238, 370)]  # fmt: skip
    body(dog, "paw", "fur", paw, upright(0.68), 0.06)


def add_leg():
    """The leg in jeans that hangs into the picture; nothing else of its owner can be seen."""
    leg = instance("Leg", "person", "jean")
    denim = [
        (40, -60), (235, -60), (229, 0), (225, 50), (222, 110), (221, 160), (221, 174), (214, 185),
        (190, 192), (165, 197), (148, 205), (136, 212), (128, 224), (118, 237), (105, 246),
        (80, 255), (72, 243), (62, 226), (54, 205), (52, 170), (50, 120), (46, 60), (44, 0),
    ]  # fmt: skip
    body(leg, "denim", "denim", denim, upright(0.6), 0.15)


def add_surroundings():
    """Out of focus: cloths at both sides; behind: a dark back rest, the wall and a door."""
    cloth = [
        (-60, 90), (0, 118), (5, 150), (14, 185), (30, 208), (38, 220), (32, 240), (30, 265),
        (20, 285), (-60, 290),
    ]  # fmt: skip
    body(None, "Cloth on the left", "cloth", cloth, upright(0.55), 0.08)
    cover = [(-60, 300), (-5, 292), (18, 285), (35, 265), (56, 254), (54, 275), (44, 300),
             (44, 335), (55, 390), (-60, 420)]  # fmt: skip
    body(None, "Cover on the left", "beige", cover, upright(0.66), 0.08)
    right = [
        (417, 128), (425, 119), (445, 112), (500, 104), (570, 100), (580, 300), (500, 296),
        (467, 298), (456, 255), (448, 215), (443, 190), (437, 160), (428, 140),
    ]  # fmt: skip
    body(None, "Cover on the right", "beige", right, upright(0.9), 0.12)
    rest = [(-100, 150), (215, 150), (240, 150), (416, 130), (600, 130), (600, 500), (-100, 500)]
    slab(None, "Back rest", "black", rest, upright(1.3), 0.1)
    slab(None, "Seat", "black", [(-300, 600), (800, 600), (800, 420), (-300, 420)], level(0.0), 0.1)
    left = [(-100, -60), (60, -60), (60, 300), (-100, 300)]
    slab(None, "Dark corner", "black", left, upright(1.2), 0.1)
    wall = instance("Wall", "wall-other-merged")
    slab(wall, "plaster", "wall", [(-200, -100), (378, -100), (372, 320),
                                   (-200, 320)], upright(2.2), 0.1)  # fmt: skip
    door = instance("Door", "door-stuff", "door")
    slab(door, "leaf", "door", [(376, -100), (640, -100), (640, 320),
                                (370, 320)], upright(2.25), 0.05)  # fmt: skip


def main():
    """Everything in the picture."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    for add in (add_man, add_dog, add_leg, add_surroundings):
        add()
    add_camera_and_light((0.5, 0.5, 0.5), 1.0, (50, 30))


main()
