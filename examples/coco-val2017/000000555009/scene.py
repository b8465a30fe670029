"""Rebuild COCO val2017 photo 000000555009: a desk with two monitors, a laptop and headphones.

Metres; z is up, y leads away from the camera, z = 0 is the desk top, 32 cm below the lens. Outlines
are pixels of the photo. Monitors are COCO's "tv"; headphones and the small computer have no
category: they hide what is behind them.
"""

import math

import bpy
from mathutils import Vector
from mathutils.geometry import delaunay_2d_cdt

IMAGE_WH = (500, 375)
FOCAL_PX = 500.0
HORIZON_V = 80.0
CAMERA_HEIGHT_M = 0.32
LOOKS = {
    "black": (0.012, 0.012, 0.015),
    "blue": (0.03, 0.08, 0.5),
    "bottle": (0.35, 0.37, 0.33),
    "cloth": (0.7, 0.68, 0.4),
    "dark screen": (0.02, 0.05, 0.15),
    "desk": (0.65, 0.64, 0.58),
    "green label": (0.15, 0.4, 0.05),
    "grey": (0.3, 0.32, 0.35),
    "leaf": (0.02, 0.08, 0.02),
    "mug print": (0.6, 0.5, 0.5),
    "red label": (0.6, 0.05, 0.08),
    "screen": (0.5, 0.75, 0.9),
    "wall": (0.3, 0.28, 0.26),
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


def add_screens():
    """Two monitors at the back and the laptop at the left edge."""
    left = instance("Left monitor", "tv")
    place, near = upright(1.3), upright(1.28)
    slab(left, "housing", "black", [(71, 13), (262, 2), (268, 155), (104, 176)], place, 0.05)
    slab(left, "screen", "dark screen", [(84, 22), (246, 18), (248, 142), (106, 153)], near, 0.01)
    right = instance("Right monitor", "tv")
    slab(
        right,
        "housing",
        "black",
        [(268, -20), (499, -20), (461, 168), (400, 166), (274, 157)],
        place,
        0.05,
    )
    slab(right, "screen", "screen", [(278, -20), (488, -20), (458, 153), (278, 140)], near, 0.01)
    slab(
        None,
        "Right monitor stand",
        "black",
        [(340, 165), (400, 168), (410, 205), (330, 200)],
        place,
        0.05,
    )
    slab(
        None,
        "Left monitor stand",
        "black",
        [(145, 170), (215, 165), (225, 205), (135, 212)],
        place,
        0.05,
    )
    laptop = instance("Laptop", "laptop")
    slab(
        laptop, "lid", "black", [(-20, 114), (82, 105), (106, 209), (-20, 246)], upright(0.95), 0.02
    )
    slab(
        laptop,
        "screen",
        "screen",
        [(-20, 122), (79, 111), (101, 205), (-20, 236)],
        upright(0.94),
        0.005,
    )
    base = [(-40, 240), (104, 208), (164, 254), (165, 260), (0, 326), (-40, 340)]
    slab(laptop, "base", "black", base, level(0.02), 0.01)


def add_input_devices():
    """Keyboard and mouse; the headphones lie over the keyboard's corner."""
    keyboard = instance("Keyboard", "keyboard")
    frame = [(186, 212), (347, 217), (354, 256), (351, 264), (250, 274), (172, 271), (170, 263)]
    slab(keyboard, "frame", "black", frame, level(0.02), 0.015)
    slab(
        keyboard,
        "keys",
        "grey",
        [(190, 216), (344, 220), (349, 250), (180, 258)],
        level(0.024),
        0.003,
    )
    mouse = instance("Mouse", "mouse")
    shell = [
        (393, 277), (400, 271), (413, 270), (428, 273), (440, 285), (448, 300), (452, 316),
        (447, 324), (435, 325), (420, 322), (407, 310), (398, 293),
    ]  # fmt: skip
    body(mouse, "shell", "dark screen", shell, level(0.02), 0.03)
    limb(None, "Mouse cable", "black", [(350, 225, 1), (385, 238, 1), (404, 271, 1)], level(0.01))


def add_drinks():
    """The printed tumbler and two bottles at the right edge."""
    tumbler = instance("Tumbler", "cup")
    place = standing(402, 232)
    side = [
        (386, 165),
        (421, 165),
        (418, 215),
        (414, 230),
        (400, 233),
        (386, 229),
        (381, 215),
        (384, 185),
    ]
    body(tumbler, "side", "mug print", side, place, 0.07)
    lid = [(385, 158), (392, 154), (415, 154), (422, 160), (423, 172), (405, 175), (386, 172)]
    body(tumbler, "lid", "black", lid, standing(402, 232, 0.01), 0.07)
    first = instance("Left bottle", "bottle")
    side = [
        (474, 130), (491, 130), (489, 142), (492, 160), (488, 185), (484, 215), (477, 225),
        (462, 223), (452, 213), (455, 190), (457, 170), (464, 150), (472, 139),
    ]  # fmt: skip
    body(first, "side", "bottle", side, standing(468, 224), 0.06)
    slab(
        first,
        "cap",
        "white",
        [(474, 117), (491, 117), (492, 131), (473, 131)],
        standing(468, 224),
        0.02,
    )
    slab(
        first,
        "label",
        "green label",
        [(459, 172), (486, 172), (480, 202), (456, 200)],
        standing(468, 224, 0.04),
        0.005,
    )
    second = instance("Right bottle", "bottle")
    side = [
        (498, 119), (520, 119), (520, 246), (495, 246), (479, 241), (476, 220), (480, 190),
        (485, 165), (492, 142),
    ]  # fmt: skip
    body(second, "side", "bottle", side, standing(495, 245), 0.06)
    slab(
        second,
        "label",
        "red label",
        [(489, 158), (520, 156), (520, 178), (487, 176)],
        standing(495, 245, 0.04),
        0.005,
    )


def add_plant():
    """Dark leaves behind the left monitor; the pot is out of sight."""
    plant = instance("Plant", "potted plant")
    place = upright(1.5)
    leaves = (
        [(60, 30, 5), (55, 60, 8), (50, 92, 4)], [(72, 40, 4), (66, 55, 7), (58, 75, 4)],
        [(45, 5, 5), (56, 18, 6), (66, 12, 4)], [(68, 62, 4), (72, 75, 5), (66, 85, 4)],
    )  # fmt: skip
    for number, stations in enumerate(leaves):
        limb(plant, f"leaf {number}", "leaf", stations, place)


def add_desk_things():
    """Headphones, the small computer, a pouch, a box; nothing here has a COCO category."""
    ring = [
        (250, 300, 12),
        (258, 275, 8),
        (290, 258, 8),
        (335, 257, 7),
        (365, 275, 6),
        (374, 298, 5),
        (364, 318, 5),
    ]
    limb(None, "Headphones band", "black", ring, level(0.05))
    body(None, "Left ear pad", "black", oval(272, 308, 34, 30), level(0.05), 0.04)
    body(None, "Right ear pad", "black", oval(303, 318, 28, 27, 20), level(0.06), 0.04)
    slab(
        None,
        "Small computer",
        "grey",
        [(216, 170), (295, 165), (300, 200), (222, 208)],
        standing(260, 207),
        0.12,
    )
    body(
        None,
        "Pouch",
        "cloth",
        [(102, 320), (145, 270), (180, 282), (148, 335), (110, 330)],
        level(0.01),
        0.02,
    )
    slab(
        None,
        "Box",
        "white",
        [(420, 199), (450, 202), (448, 238), (417, 235)],
        standing(435, 238),
        0.05,
    )
    slab(
        None,
        "Blue clip",
        "blue",
        [(452, 228), (470, 229), (472, 249), (448, 246)],
        standing(460, 249),
        0.02,
    )
    slab(
        None, "Papers", "white", [(485, 262), (520, 235), (520, 275), (490, 268)], level(0.03), 0.01
    )


def add_room():
    """The desk, the dark wall behind it, the gap under it."""
    top = [
        (-200, 215),
        (150, 212),
        (300, 195),
        (520, 190),
        (700, 190),
        (700, 352),
        (250, 358),
        (-200, 352),
    ]
    slab(None, "Desk", "desk", top, level(0.0), 0.03)
    slab(
        None,
        "Wall",
        "black",
        [(-300, -300), (480, -300), (480, 300), (-300, 300)],
        upright(1.7),
        0.1,
    )
    slab(
        None,
        "Right wall",
        "wall",
        [(455, -300), (800, -300), (800, 300), (455, 300)],
        upright(1.65),
        0.1,
    )
    slab(
        None,
        "Floor",
        "black",
        [(-900, 900), (1400, 900), (1400, 150), (-900, 150)],
        level(-0.7),
        0.1,
    )


def main():
    """Everything in the picture."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    for add in (add_screens, add_input_devices, add_drinks, add_plant, add_desk_things, add_room):
        add()
    add_camera_and_light((0.9, 0.95, 1.0), 1.0, (40, 30))


main()
