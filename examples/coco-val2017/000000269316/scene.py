"""Rebuild COCO val2017 photo 000000269316: four men play ultimate, the disc is in the air.

Metres; z is up, y leads away from the camera, the origin is on the ground under the camera.
Outlines are pixels of the photo, placed on the plane on which the man stands.
"""

import math

import bpy
from mathutils import Vector
from mathutils.geometry import delaunay_2d_cdt

IMAGE_WH = (640, 428)
FOCAL_PX = 1500.0
HORIZON_V = 230.0
CAMERA_HEIGHT_M = 1.2
LOOKS = {
    "black": (0.02, 0.02, 0.025),
    "blue": (0.1, 0.25, 0.6),
    "grass": (0.25, 0.3, 0.14),
    "hair": (0.15, 0.1, 0.07),
    "reeds": (0.35, 0.3, 0.2),
    "red": (0.5, 0.03, 0.03),
    "skin": (0.55, 0.33, 0.26),
    "trees": (0.04, 0.06, 0.04),
    "white": (0.8, 0.8, 0.82),
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


def add_left_man():
    """Red shirt, white cap, seen from behind."""
    man = instance("Left man", "person")
    trunk, near, far = standing(160, 405), standing(160, 405, 0.25), standing(160, 405, -0.25)
    cap = [(93, 160), (94, 145), (102, 138), (113, 138), (123, 143), (125, 158), (121, 164)]
    body(man, "cap", "white", cap, near, 0.2)
    head = [(94, 158), (124, 158), (123, 172), (118, 184), (102, 184), (95, 172)]
    body(man, "head", "skin", head, trunk, 0.2)
    shirt = [
        (101, 181), (125, 177), (140, 190), (148, 210), (153, 240), (162, 266), (150, 272),
        (128, 280), (114, 287), (108, 262), (103, 236), (87, 223), (85, 208), (91, 190),
    ]  # fmt: skip
    body(man, "shirt", "red", shirt, trunk, 0.3)
    arm = [(98, 222, 9), (88, 234, 8), (68, 243, 6), (52, 247, 7), (42, 250, 7)]
    limb(man, "near arm", "skin", arm, near)
    arm = [(108, 244, 8), (85, 251, 7), (60, 257, 6), (47, 261, 9)]
    limb(man, "far arm", "skin", arm, far)
    shorts = [
        (112, 286), (162, 270), (164, 290), (157, 325), (151, 347), (127, 347), (122, 326),
        (108, 328), (92, 312), (104, 293),
    ]  # fmt: skip
    body(man, "shorts", "black", shorts, near, 0.3)
    leg = [(100, 315, 13), (89, 330, 11), (93, 358, 10), (96, 382, 7)]
    limb(man, "left leg", "skin", leg, trunk)
    limb(man, "left sock", "black", [(95, 385, 8), (95, 394, 8)], near)
    body(
        man,
        "left shoe",
        "black",
        [(78, 403), (86, 397), (104, 395), (107, 405), (90, 406)],
        trunk,
        0.1,
    )
    leg = [(140, 345, 13), (140, 357, 11), (165, 367, 9), (188, 378, 7)]
    limb(man, "right leg", "skin", leg, trunk)
    shoe = [
        (187, 375),
        (200, 371),
        (215, 378),
        (223, 381),
        (222, 396),
        (215, 409),
        (203, 408),
        (197, 390),
    ]
    body(man, "right shoe", "black", shoe, near, 0.1)


def add_middle_man():
    """White sleeveless shirt, legs wide, looking back at the disc."""
    man = instance("Middle man", "person")
    trunk, near = standing(300, 406), standing(300, 406, 0.25)
    hair = [(205, 156), (212, 145), (222, 141), (238, 146), (245, 160), (242, 172), (225, 165)]
    body(man, "hair", "hair", hair, near, 0.2)
    face = [
        (206, 160),
        (230, 160),
        (242, 170),
        (240, 190),
        (226, 196),
        (214, 192),
        (206, 179),
        (204, 172),
    ]
    body(man, "head", "skin", face, trunk, 0.2)
    shirt = [
        (231, 194), (248, 175), (262, 175), (275, 185), (290, 205), (298, 230), (318, 246),
        (328, 271), (315, 281), (292, 290), (276, 298), (259, 286), (248, 260), (232, 240),
        (226, 222), (227, 203),
    ]  # fmt: skip
    body(man, "shirt", "white", shirt, trunk, 0.3)
    arm = [(266, 185, 11), (290, 198, 10), (304, 215, 8), (309, 234, 8), (314, 240, 6)]
    limb(man, "near arm", "skin", arm, near)
    shorts = [
        (260, 287), (290, 290), (325, 275), (328, 295), (327, 318), (308, 327), (290, 330),
        (270, 325), (243, 318), (250, 300),
    ]  # fmt: skip
    body(man, "shorts", "black", shorts, trunk, 0.28)
    limb(
        man,
        "left leg",
        "skin",
        [(254, 322, 14), (243, 345, 12), (233, 372, 9), (226, 394, 7)],
        trunk,
    )
    body(man, "left shoe", "black", oval(224, 403, 9, 4.5), trunk, 0.1)
    limb(
        man,
        "right leg",
        "skin",
        [(316, 322, 14), (330, 348, 12), (348, 373, 9), (365, 395, 7)],
        trunk,
    )
    body(
        man,
        "right shoe",
        "black",
        [(361, 400), (372, 398), (384, 405), (372, 409), (361, 408)],
        trunk,
        0.1,
    )


def add_running_man():
    """Red shirt and red cap, running to the left."""
    man = instance("Running man", "person")
    trunk, near, far = standing(520, 396), standing(520, 396, 0.25), standing(520, 396, -0.25)
    cap = [(439, 160), (449, 150), (465, 147), (477, 155), (479, 168), (462, 163), (440, 166)]
    body(man, "cap", "red", cap, near, 0.18)
    head = [(450, 163), (475, 163), (473, 180), (466, 191), (455, 190), (450, 178)]
    body(man, "head", "skin", head, trunk, 0.18)
    shirt = [
        (456, 190), (475, 180), (490, 185), (505, 195), (512, 208), (515, 240), (528, 263),
        (508, 270), (482, 268), (475, 252), (466, 238), (445, 234), (436, 228), (447, 205),
    ]  # fmt: skip
    body(man, "shirt", "red", shirt, trunk, 0.3)
    arm = [(445, 232, 9), (430, 240, 9), (415, 234, 8), (406, 226, 6)]
    limb(man, "far arm", "skin", arm, far)
    arm = [(503, 212, 11), (488, 221, 9), (470, 228, 7), (450, 233, 6)]
    limb(man, "near arm", "skin", arm, near)
    shorts = [
        (470, 266), (500, 268), (528, 262), (534, 290), (541, 313), (520, 324), (500, 305),
        (489, 313), (457, 292), (464, 278),
    ]  # fmt: skip
    body(man, "shorts", "black", shorts, trunk, 0.28)
    limb(
        man,
        "left leg",
        "skin",
        [(462, 300, 12), (449, 312, 11), (456, 338, 9), (467, 368, 7)],
        trunk,
    )
    shoe = [(436, 392), (455, 384), (462, 370), (476, 370), (482, 385), (465, 396), (440, 397)]
    body(man, "left shoe", "blue", shoe, trunk, 0.1)
    limb(
        man,
        "right leg",
        "skin",
        [(527, 322, 13), (541, 337, 11), (565, 355, 8), (585, 372, 6)],
        trunk,
    )
    shoe = [(581, 392), (580, 374), (592, 366), (604, 371), (608, 384), (598, 397), (588, 396)]
    body(man, "right shoe", "blue", shoe, trunk, 0.1)


def add_far_man():
    """White shirt and blue cap, behind the running man."""
    man = instance("Far man", "person")
    trunk, near = standing(540, 383), standing(540, 383, 0.2)
    cap = [(536, 193), (540, 183), (550, 180), (559, 186), (561, 194), (548, 190)]
    body(man, "cap", "blue", cap, near, 0.2)
    head = [(537, 190), (560, 190), (560, 203), (555, 212), (546, 214), (538, 205)]
    body(man, "head", "skin", head, trunk, 0.2)
    shirt = [
        (530, 215), (545, 210), (565, 212), (579, 224), (585, 250), (573, 256), (573, 290),
        (555, 295), (533, 291), (532, 260), (512, 243), (514, 225),
    ]  # fmt: skip
    body(man, "shirt", "white", shirt, trunk, 0.3)
    limb(man, "left arm", "skin", [(577, 255, 7), (580, 280, 6), (584, 305, 6)], trunk)
    shorts = [(535, 292), (573, 289), (580, 324), (563, 328), (552, 312), (530, 325), (528, 300)]
    body(man, "shorts", "white", shorts, trunk, 0.25)
    limb(man, "right leg", "skin", [(527, 322, 9), (517, 345, 7), (509, 370, 5)], trunk)
    body(man, "right shoe", "red", [(498, 381), (507, 370), (513, 376), (511, 382)], trunk, 0.1)
    limb(man, "left leg", "skin", [(571, 325, 9), (575, 345, 7), (575, 370, 5)], trunk)
    body(man, "left shoe", "red", [(570, 374), (580, 372), (581, 382), (573, 382)], trunk, 0.1)


def add_disc():
    """The flying disc, tilted a little."""
    disc = instance("Disc", "frisbee")
    body(disc, "plate", "white", oval(193, 98.5, 23.5, 6.0, 10.0), upright(11.0), 0.06)


def add_field():
    """Mown grass with its lines, reeds, rails, and the dark wood behind."""
    grass = [(-400, 700), (1040, 700), (1040, 245), (-400, 245)]
    slab(None, "Grass", "grass", grass, level(0.0), 0.05)
    slab(
        None,
        "Near line",
        "white",
        [(50, 406), (515, 411), (515, 413), (50, 408)],
        level(0.01),
        0.005,
    )
    slab(
        None, "Far line", "white", [(0, 361), (640, 369), (640, 372), (0, 363)], level(0.01), 0.005
    )
    slab(
        None, "Wood", "trees", [(-200, -200), (840, -200), (840, 260), (-200, 260)], upright(60), 1
    )
    slab(
        None,
        "Reeds",
        "reeds",
        [(-50, 215), (250, 205), (690, 215), (690, 275), (-50, 275)],
        upright(40),
        1,
    )
    limb(None, "Top rail", "black", [(-20, 237, 2), (660, 246, 2)], upright(25))
    limb(None, "Low rail", "black", [(-20, 271, 2), (110, 273, 2)], upright(25))
    limb(None, "Rail post", "black", [(332, 245, 2), (332, 322, 2)], upright(25))


def main():
    """Everything in the picture."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    for add in (add_left_man, add_middle_man, add_running_man, add_far_man, add_disc, add_field):
        add()
    add_camera_and_light((0.9, 0.95, 1.0), 2.0, (40, 20))


main()
