"""Rebuild COCO val2017 photo 000000214753: two riders on a beach, seen from behind and above.

Metres; z is up, y leads away from the camera, the origin is on the sand under the camera. Outlines
are pixels of the photo, placed on the plane on which the horse stands; the rider's near leg is in
front of it.
"""

import math

import bpy
from mathutils import Vector
from mathutils.geometry import delaunay_2d_cdt

IMAGE_WH = (640, 424)
FOCAL_PX = 1500.0
HORIZON_V = -25.0
CAMERA_HEIGHT_M = 4.0
LOOKS = {
    "black coat": (0.015, 0.014, 0.015),
    "blue jacket": (0.02, 0.06, 0.22),
    "brown coat": (0.045, 0.028, 0.025),
    "grey jacket": (0.06, 0.06, 0.06),
    "mane": (0.4, 0.34, 0.25),
    "maroon": (0.12, 0.02, 0.03),
    "rock": (0.06, 0.06, 0.06),
    "sand": (0.5, 0.4, 0.3),
    "sea": (0.25, 0.33, 0.38),
    "skin": (0.5, 0.3, 0.23),
    "surf": (0.75, 0.77, 0.75),
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


def add_black_horse():
    """The left horse, walking away: its rump, the dock of its mane, four legs."""
    horse = instance("Black horse", "horse")
    trunk, far = standing(290, 304), standing(290, 304, -0.6)
    rump = [
        (254, 204), (266, 195), (280, 193), (296, 194), (308, 204), (313, 222), (312, 241),
        (298, 249), (272, 249), (256, 243), (251, 222),
    ]  # fmt: skip
    body(horse, "rump", "black coat", rump, trunk, 0.7)
    limb(horse, "mane", "black coat", [(257, 200, 5), (252, 186, 4), (254, 178, 3)], far)
    legs = (
        ("left fore leg", [(259, 243, 6), (262, 262, 4), (267, 280, 4), (271, 293, 5)]),
        ("right fore leg", [(277, 247, 5), (277, 265, 3), (277, 285, 3)]),
        ("left hind leg", [(284, 247, 8), (286, 268, 5), (281, 285, 4), (280, 295, 4)]),
        ("right hind leg", [(306, 243, 7), (305, 265, 4), (307, 285, 4), (308, 301, 4)]),
    )
    for name, stations in legs:
        limb(horse, name, "black coat", stations, trunk)


def add_black_horse_rider():
    """Blue jacket, white helmet, one leg seen."""
    rider = instance("Left rider", "person")
    seat, near = standing(290, 304, -0.3), standing(290, 304, 0.5)
    body(rider, "helmet", "white", oval(272, 132, 9.7, 7.6), near, 0.25)
    limb(rider, "head", "skin", [(273, 135, 7), (274, 141, 6)], seat)
    jacket = [
        (262, 147), (272, 141), (284, 147), (292, 160), (293, 173), (288, 180), (288, 190),
        (275, 191), (262, 189), (260, 177), (253, 175), (254, 158),
    ]  # fmt: skip
    body(rider, "jacket", "blue jacket", jacket, near, 0.35)
    leg = [(268, 187), (250, 197), (244, 210), (242, 233), (250, 234), (254, 212), (268, 198)]
    body(rider, "leg", "black coat", leg, near, 0.2)
    boot = [(229, 244), (240, 235), (248, 232), (248, 247), (238, 245)]
    body(rider, "boot", "black coat", boot, near, 0.15)


def add_brown_horse():
    """The right horse: its near side, the head with a pale mane to the left, the tail."""
    horse = instance("Brown horse", "horse")
    trunk, near, far = standing(420, 314), standing(420, 314, 0.25), standing(420, 314, -0.25)
    side = [
        (358, 205), (378, 190), (400, 189), (430, 191), (448, 197), (460, 212), (464, 235),
        (452, 248), (440, 248), (425, 254), (400, 255), (378, 251), (367, 238), (360, 222),
    ]  # fmt: skip
    body(horse, "trunk", "brown coat", side, trunk, 0.7)
    head = [
        (331, 170), (334, 166), (339, 178), (348, 190), (346, 208), (339, 224), (331, 226),
        (325, 220), (326, 203), (328, 186),
    ]  # fmt: skip
    body(horse, "head", "brown coat", head, far, 0.25)
    neck = [
        (337, 178), (345, 171), (354, 169), (364, 175), (378, 190), (382, 208), (366, 224),
        (358, 214), (350, 204), (343, 197),
    ]  # fmt: skip
    body(horse, "neck and mane", "mane", neck, far, 0.3)
    tail = [
        (439, 206), (450, 202), (460, 212), (467, 228), (470, 236), (464, 246), (455, 251),
        (447, 246), (443, 226),
    ]  # fmt: skip
    body(horse, "tail", "mane", tail, standing(420, 314, 0.5), 0.1)
    legs = (
        (
            "left fore leg",
            near,
            [(374, 245, 9), (370, 266, 5), (378, 284, 4), (388, 300, 5), (390, 305, 4)],
        ),
        ("right fore leg", far, [(396, 250, 7), (394, 272, 4), (398, 292, 4), (399, 306, 5)]),
        (
            "left hind leg",
            near,
            [(425, 248, 11), (426, 272, 7), (426, 290, 4), (422, 306, 4), (424, 311, 5)],
        ),
        (
            "right hind leg",
            trunk,
            [(452, 242, 11), (462, 262, 7), (465, 285, 4), (468, 300, 5), (467, 313, 5)],
        ),
    )
    for name, place, stations in legs:
        limb(horse, name, "brown coat", stations, place)


def add_brown_horse_rider():
    """Grey jacket, dark helmet, maroon breeches, a grey boot."""
    rider = instance("Right rider", "person")
    place = standing(420, 314, 0.55)
    body(rider, "helmet", "black coat", oval(399, 126, 9.3, 11), place, 0.25)
    jacket = [
        (387, 142), (393, 137), (404, 136), (412, 143), (414, 158), (414, 180), (402, 187),
        (386, 186), (374, 182), (371, 177), (384, 167), (385, 152),
    ]  # fmt: skip
    body(rider, "jacket", "grey jacket", jacket, place, 0.35)
    breeches = [(366, 207), (375, 191), (388, 184), (402, 187), (393, 199), (382, 210), (372, 214)]
    body(rider, "breeches", "maroon", breeches, place, 0.2)
    boot = [(367, 213), (377, 211), (377, 234), (375, 248), (360, 246), (359, 242), (368, 234)]
    body(rider, "boot", "grey jacket", boot, place, 0.15)


def add_beach():
    """Sand, the sea with its surf, boulders along the water."""
    sand = [(-400, 700), (1040, 700), (1040, 60), (-400, 60)]
    slab(None, "Sand", "sand", sand, level(0.0), 0.05)
    surf = [(-20, 105), (300, 150), (450, 190), (660, 260), (660, -20), (-20, -20)]
    slab(None, "Surf", "surf", surf, level(0.02), 0.01)
    sea = [(-20, 18), (250, 45), (400, 75), (660, 125), (660, -24), (-20, -24)]
    slab(None, "Sea", "sea", sea, level(0.05), 0.01)
    boulders = (
        (15, 98, 7), (105, 98, 12), (132, 113, 16), (97, 111, 9), (66, 106, 10), (150, 132, 20),
        (190, 125, 12), (220, 122, 22), (233, 95, 11), (297, 99, 10), (30, 125, 11), (96, 172, 14),
        (136, 165, 9), (192, 170, 18), (312, 134, 9), (361, 136, 11), (434, 123, 10),
        (464, 136, 10), (300, 172, 10), (430, 176, 13), (616, 189, 9),
        (628, 222, 12), (634, 238, 11),
    )  # fmt: skip
    for number, (u, v, radius) in enumerate(boulders):
        outline = oval(u, v, radius, 0.55 * radius, count=12)
        body(None, f"Boulder {number}", "rock", outline, standing(u, v + 0.5 * radius), 0.4)


def main():
    """Everything in the picture."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    add_black_horse()
    add_black_horse_rider()
    add_brown_horse()
    add_brown_horse_rider()
    add_beach()
    add_camera_and_light((0.9, 0.95, 1.0), 2.0, (35, 25))


main()
