"""Rebuild COCO val2017 photo 000000403385: a small tiled bathroom, white on white.

Metres; z is up, y leads away from the camera, the origin is on the floor under the camera. Outlines
are pixels of the photo, placed on the plane on which the thing stands. Of COCO's categories only
the toilet and the sink are here.
"""

import math

import bpy
from mathutils import Vector
from mathutils.geometry import delaunay_2d_cdt

IMAGE_WH = (640, 511)
FOCAL_PX = 420.0
HORIZON_V = 220.0
CAMERA_HEIGHT_M = 1.5
LOOKS = {
    "blue": (0.25, 0.45, 0.65),
    "brass": (0.5, 0.33, 0.08),
    "broken wall": (0.25, 0.19, 0.13),
    "ceramic": (0.8, 0.8, 0.78),
    "chrome": (0.35, 0.36, 0.38),
    "curtain": (0.65, 0.66, 0.66),
    "door": (0.12, 0.1, 0.08),
    "fan": (0.6, 0.58, 0.52),
    "floor": (0.07, 0.075, 0.08),
    "tile": (0.6, 0.62, 0.66),
    "tissue": (0.55, 0.62, 0.72),
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


def add_toilet():
    """The toilet: cistern on the wall, raised lid, seat ring with its hollow, bowl and foot."""
    toilet = instance("Toilet", "toilet")
    back, front = standing(455, 430), standing(455, 479)
    cistern = [(413, 243), (416, 239), (500, 239), (502, 243), (499, 303), (414, 303)]
    slab(toilet, "cistern", "ceramic", cistern, back, 0.15)
    body(toilet, "lid", "ceramic", oval(453.5, 315, 37.5, 41), standing(455, 445), 0.05)
    bowl = [
        (416, 378), (420, 395), (428, 412), (432, 430), (429, 452), (431, 470), (442, 478),
        (456, 480), (470, 477), (480, 468), (480, 450), (478, 430), (484, 410), (492, 393),
        (493, 375), (455, 360),
    ]  # fmt: skip
    body(toilet, "bowl", "ceramic", bowl, front, 0.3)
    body(toilet, "seat", "ceramic", oval(454, 376, 40, 24.5), standing(455, 479, 0.16), 0.06)
    body(toilet, "hollow", "chrome", oval(453, 378, 24, 13), standing(455, 479, 0.2), 0.02)


def add_sink():
    """The basin on its pedestal; the tap stands on it and is not part of it."""
    sink = instance("Sink", "sink")
    place = upright(1.5)
    basin = [
        (8, 330), (25, 314), (60, 312), (100, 315), (120, 321), (138, 333), (145, 350), (134, 362),
        (106, 387), (78, 398), (30, 398), (12, 390),
    ]  # fmt: skip
    body(sink, "basin", "ceramic", basin, place, 0.35)
    pedestal = [(28, 385), (95, 385), (95, 530), (30, 530)]
    slab(sink, "pedestal", "ceramic", pedestal, place, 0.1)
    limb(
        None,
        "Tap",
        "chrome",
        [(26, 330, 4), (26, 300, 3), (34, 282, 3), (40, 294, 3)],
        upright(1.3),
    )
    limb(None, "Tap handles", "chrome", [(12, 326, 4), (42, 320, 4)], upright(1.3))


def add_shower():
    """The tray, the damaged wall over it, the rail and the curtain."""
    tray = [(160, 405), (240, 355), (400, 365), (400, 475), (290, 455)]
    slab(None, "Shower tray", "ceramic", tray, level(0.15), 0.03)
    wall = [(250, 200), (308, 200), (308, 360), (250, 350)]
    slab(None, "Broken tiles", "broken wall", wall, upright(3.4), 0.02)
    wall = [(205, 255), (246, 240), (250, 350), (185, 385)]
    slab(None, "Broken tiles left", "broken wall", wall, upright(3.2), 0.02)
    curtain = [
        (325, 35), (345, 35), (372, 65), (376, 250), (390, 465), (355, 475), (340, 455), (335, 478),
        (300, 488), (290, 478), (300, 370), (310, 200),
    ]  # fmt: skip
    slab(None, "Curtain", "curtain", curtain, standing(330, 488), 0.05)
    limb(None, "Rail", "ceramic", [(135, 57, 4), (325, 22, 5), (340, 30, 5)], upright(2.2))
    limb(None, "Shower pipe", "chrome", [(202, 20, 2), (207, 120, 2), (218, 220, 2)], upright(2.8))


def add_fittings():
    """Extractor fan, paper rolls, squeegee, mirror, air conditioner, door."""
    slab(None, "Fan", "fan", [(465, 100), (546, 103), (543, 182), (465, 180)], upright(3.5), 0.1)
    body(None, "Fan blades", "chrome", oval(504, 139, 32, 32), upright(3.4), 0.02)
    for number, u in enumerate((424, 447)):
        slab(
            None,
            f"Roll {number}",
            "tissue",
            [(u - 12, 213), (u + 12, 213), (u + 11, 238), (u - 11, 238)],
            upright(2.9),
            0.1,
        )
    limb(
        None, "Squeegee handle", "blue", [(103, 195, 3), (140, 340, 3), (178, 465, 3)], upright(2.3)
    )
    limb(None, "Squeegee blade", "chrome", [(152, 508, 3), (212, 458, 3)], upright(2.25))
    slab(None, "Mirror", "chrome", [(-10, 64), (67, 68), (70, 172), (-10, 175)], upright(1.7), 0.01)
    slab(
        None,
        "Air conditioner",
        "fan",
        [(565, -10), (650, -10), (650, 20), (590, 50), (560, 42)],
        upright(2.0),
        0.2,
    )
    slab(
        None,
        "Paper roll",
        "tissue",
        [(588, 295), (614, 295), (614, 325), (588, 325)],
        upright(2.0),
        0.1,
    )
    slab(
        None,
        "Plunger",
        "broken wall",
        [(391, 345), (395, 345), (396, 405), (388, 405)],
        upright(3.2),
        0.02,
    )
    slab(None, "Door", "door", [(630, 220), (660, 200), (660, 530), (605, 530)], upright(1.3), 0.05)
    body(None, "Door knob", "brass", oval(617, 357, 14, 11), upright(1.2), 0.05)
    slab(
        None, "Door frame", "fan", [(-20, 320), (4, 325), (12, 530), (-20, 530)], upright(0.9), 0.05
    )


def add_room():
    """Floor, back wall, side walls and ceiling."""
    slab(
        None,
        "Floor",
        "floor",
        [(-700, 1200), (1340, 1200), (1340, 330), (-700, 330)],
        level(0.0),
        0.05,
    )
    slab(
        None,
        "Back wall",
        "tile",
        [(-300, -300), (940, -300), (940, 500), (-300, 500)],
        upright(3.6),
        0.05,
    )
    slab(
        None,
        "Left wall",
        "tile",
        [(-20, -20), (240, -20), (240, 360), (95, 520), (-20, 520)],
        upright(3.5),
        0.05,
    )


def main():
    """Everything in the picture."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    for add in (add_toilet, add_sink, add_shower, add_fittings, add_room):
        add()
    add_camera_and_light((1.0, 1.0, 1.0), 1.5, (50, 20))


main()
