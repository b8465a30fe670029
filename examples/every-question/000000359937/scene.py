"""Rebuild COCO val2017 photo 000000359937: a double-decker bus in a car park.

Metres; z is up, y leads away from the camera, z = 0 is the ground. The edges of the bus meet at two
points of the horizon, which gives the horizon and the focal length; its 4.3 m give the height of
the camera. Its two visible sides stand on the lines that its tyres touch.
"""

import math

import bpy
from mathutils import Vector
from mathutils.geometry import delaunay_2d_cdt

IMAGE_WH = (640, 480)
FOCAL_PX = 650.0
HORIZON_V = 300.0
CAMERA_HEIGHT_M = 1.75
LOOKS = {
    "black": (0.02, 0.02, 0.022),
    "brown": (0.09, 0.03, 0.02),
    "chrome": (0.7, 0.72, 0.75),
    "glass": (0.07, 0.08, 0.1),
    "grey": (0.3, 0.33, 0.33),
    "lamp": (0.9, 0.35, 0.03),
    "leaves": (0.1, 0.12, 0.05),
    "orange": (0.85, 0.32, 0.03),
    "sky": (0.6, 0.65, 0.85),
    "tarmac": (0.25, 0.23, 0.2),
    "tyre": (0.06, 0.06, 0.06),
    "white": (0.85, 0.85, 0.83),
    "yellow": (0.85, 0.75, 0.1),
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

SIDE = facing((95, 404), (415, 504))
FRONT = facing((415, 504), (570, 459))
FAR_SIDE = facing((566, 385), (640, 393))


def add_bus():
    """The double-decker: its side, its front, their colours and windows."""
    bus = instance("Bus", "bus", "bus_(vehicle)")
    side = [
        (60, 174), (62, 169), (68, 165), (100, 151), (140, 134), (200, 108), (285, 71), (345, 42),
        (385, 22), (405, 9), (415, 6), (415, 466), (405, 465), (370, 457), (340, 452), (315, 445),
        (299, 441), (292, 442), (247, 442), (238, 441), (233, 429), (172, 414), (126, 401),
        (100, 395), (90, 396), (76, 392), (73, 383), (58, 379), (46, 375), (46, 350), (46, 320),
        (48, 313), (54, 311), (56, 306), (55, 295), (54, 272), (49, 271), (49, 262), (52, 240),
        (53, 217), (57, 190),
    ]  # fmt: skip
    slab(bus, "side", "orange", side, SIDE, 0.3)
    front = [
        (415, 6), (428, 5), (450, 11), (475, 20), (500, 32), (520, 43), (535, 55), (544, 68),
        (549, 80), (553, 105), (558, 135), (563, 154), (566, 185), (569, 215), (570, 228),
        (564, 233), (563, 250), (566, 275), (568, 310), (570, 335), (571, 370), (572, 400),
        (572, 420), (570, 428), (566, 431), (540, 438), (500, 447), (450, 460), (425, 467),
        (415, 466),
    ]  # fmt: skip
    slab(bus, "front", "orange", front, FRONT, 0.3)
    side, front = before(SIDE, 0.01), before(FRONT, 0.01)
    deck = [
        (60, 174), (62, 169), (68, 165), (140, 134), (285, 71), (385, 22), (405, 9), (415, 6),
        (415, 110), (285, 148), (54, 217), (57, 190),
    ]  # fmt: skip
    slab(bus, "upper deck", "white", deck, side, 0.02)
    deck = [
        (415, 6), (428, 5), (475, 20), (520, 43), (544, 68), (549, 80), (558, 135), (563, 154),
        (502, 130), (450, 116), (415, 110),
    ]  # fmt: skip
    slab(bus, "upper front", "white", deck, front, 0.02)
    skirt = [
        (100, 356), (233, 380), (235, 429), (172, 414), (126, 401), (100, 395),
    ]  # fmt: skip
    slab(bus, "skirt", "brown", skirt, side, 0.02)
    skirt = [(294, 377), (415, 391), (415, 466), (340, 452), (299, 441)]
    slab(bus, "front skirt", "brown", skirt, side, 0.02)
    skirt = [(46, 320), (56, 313), (59, 345), (75, 346), (75, 384), (58, 379), (46, 375)]
    slab(bus, "rear skirt", "brown", skirt, side, 0.02)
    skirt = [
        (415, 390), (460, 388), (530, 376), (571, 371), (572, 420), (566, 431), (500, 447),
        (425, 467), (415, 466),
    ]  # fmt: skip
    slab(bus, "bumper", "brown", skirt, front, 0.02)
    panes = [
        [(56, 215), (60, 178), (71, 173),
         (67, 212)], [(70, 210), (75, 172), (106, 158), (101, 202)],
        [(105, 198), (109, 157), (150, 139), (146, 187)],
        [(150, 184), (154, 137), (208, 112), (205, 170)],
        [(211, 164), (215, 108), (290, 77), (287, 145)],
        [(293, 138), (297, 72), (407, 30), (410, 104)],
        [(64, 312), (66, 270), (74, 268), (72, 313)], [(76, 314), (79, 269), (97, 267), (96, 314)],
        [(100, 316), (101, 267), (140, 263), (139, 316)],
        [(144, 317), (146, 262), (199, 256), (199, 319)],
        [(317, 316), (319, 226), (401, 218), (403, 318)],
    ]  # fmt: skip
    for i, pane in enumerate(panes):
        slab(bus, f"side window {i}", "glass", pane, before(SIDE, 0.03), 0.02)
    panes = [
        [(424, 29), (494, 54), (503, 124),
         (430, 106)], [(502, 59), (547, 82), (559, 146), (508, 129)],
        [(418, 215), (560, 233), (568, 334), (424, 339)],
    ]  # fmt: skip
    for i, pane in enumerate(panes):
        slab(bus, f"front window {i}", "glass", pane, before(FRONT, 0.03), 0.02)
    arch = [
        (233, 430), (234, 405), (239, 375), (250, 356), (262, 350), (275, 352), (287, 365),
        (295, 385), (299, 415), (298, 441), (247, 440),
    ]  # fmt: skip
    slab(bus, "front arch", "grey", rounded(arch), before(SIDE, 0.02), 0.02)
    arch = [(75, 383), (76, 358), (84, 339), (92, 336), (98, 348), (100, 392)]
    slab(bus, "rear arch", "grey", rounded(arch), before(SIDE, 0.02), 0.02)
    slab(bus, "stripe", "white", [(99, 351), (235, 371), (233, 379),
                                   (99, 358)], before(SIDE, 0.02),
          0.02)  # fmt: skip


def add_bus_parts():
    """What LVIS names on the bus; for COCO all of it is bus."""
    bus = bpy.data.objects["Bus"]

    def part(name, category):
        made = instance(name, category)
        made.parent = bus
        return made

    tyre = [
        (245, 405), (247, 385), (253, 370), (262, 362), (273, 360), (283, 361), (291, 373),
        (297, 392), (299, 415), (299, 440), (310, 441), (305, 452), (292, 458), (277, 460),
        (265, 456), (255, 445), (248, 428),
    ]  # fmt: skip
    wheel = part("Front wheel", "wheel")
    slab(wheel, "tyre", "tyre", rounded(tyre), before(SIDE, 0.05), 0.25)
    slab(wheel, "hub", "brown", rounded(oval(270, 411, 15, 28)), before(SIDE, 0.06), 0.02)
    tyre = [
        (78, 376), (80, 357), (87, 343), (93, 342), (98, 352), (100, 375), (100, 397), (112, 400),
        (102, 404), (94, 405), (85, 399), (80, 388),
    ]  # fmt: skip
    wheel = part("Rear wheel", "wheel")
    slab(wheel, "tyre", "tyre", rounded(tyre), before(SIDE, 0.05), 0.25)
    slab(wheel, "hub", "brown", rounded(oval(90, 373, 7, 17)), before(SIDE, 0.06), 0.02)
    near = before(FRONT, 0.06)
    lamps = [(455, 401, 9, 16), (455.5, 436, 9.5, 16.5), (566, 383, 5.5, 12), (566.5, 411, 5.5, 12)]
    for i, (u, v, half_u, half_v) in enumerate(lamps):
        lamp = part(f"Headlight {i}", "headlight")
        body(lamp, "lens", "chrome", oval(u, v, half_u, half_v), near, 0.05)
    lamps = [
        [(446, 358), (462, 359), (463, 367), (461, 374), (446, 376), (445, 367)],
        [(560, 348), (569, 347), (569, 360), (561, 360)],
    ]  # fmt: skip
    for i, lamp in enumerate(lamps):
        slab(part(f"Blinker {i}", "blinker"), "lens", "lamp", rounded(lamp), near, 0.03)
    lamp = [(299, 329), (305, 329), (308, 334), (307, 341), (302, 343), (299, 342)]
    slab(part("Side blinker", "blinker"), "lens", "lamp", rounded(lamp), before(SIDE, 0.04), 0.03)
    number = [(503, 426), (534, 419), (535, 431), (503, 438)]
    slab(part("Licence plate", "license plate"), "plate", "white", number, near, 0.02)
    blinds = [
        [(461, 124), (502, 137), (506, 175), (464, 166)],
        [(514, 140), (545, 152), (549, 187), (519, 177)],
        [(490, 185), (532, 195), (535, 210), (491, 204)],
    ]  # fmt: skip
    for i, blind in enumerate(blinds):
        slab(part(f"Blind {i}", "signboard"), "glass", "black", blind, before(FRONT, 0.03), 0.02)
    bill = [(425, 281), (483, 283), (483, 292), (478, 293), (482, 336), (441, 338), (436, 292),
            (426, 290)]  # fmt: skip
    slab(part("Poster", "poster"), "sheet", "white", bill, before(FRONT, 0.04), 0.01)
    for i, wiper in enumerate(
        (
            [(480, 351, 3), (485, 344, 3.5), (490, 325, 2), (497, 308, 1.2)],
            [(556, 344, 3), (551, 334, 2.5), (540, 311, 1.5), (525, 285, 1.2)],
        )
    ):
        limb(part(f"Wiper {i}", "windshield wiper"), "arm", "black", wiper, near)
    mirror = [(378, 219), (395, 218), (394, 244), (379, 245)]
    slab(part("Mirror", "rearview mirror"), "shell", "black", mirror, before(SIDE, 0.12), 0.05)


def add_far_bus():
    """The single-decker behind; it goes on behind the first one, as its windows show."""
    bus = instance("Far bus", "bus", "bus_(vehicle)")
    shell = [
        (430, 263), (566, 258), (600, 254), (640, 251), (760, 243), (760, 392), (640, 381),
        (568, 375), (430, 364),
    ]  # fmt: skip
    slab(bus, "shell", "white", shell, FAR_SIDE, 2.4)
    near = before(FAR_SIDE, 0.02)
    slab(bus, "roof line", "orange", [(430, 263), (566, 258), (640, 251), (760, 243), (760, 250),
                                       (640, 257), (566, 264),
                                       (430, 269)], near, 0.02)  # fmt: skip
    windows = [(430, 270), (566, 265), (640, 258), (760, 250), (760, 307), (640, 309), (430, 311)]
    slab(bus, "windows", "glass", windows, near, 0.02)
    skirt = [(430, 351), (568, 359), (640, 363), (760, 370), (760, 392), (640, 381), (430, 364)]
    slab(bus, "skirt", "brown", skirt, near, 0.02)
    sign = [(598, 315), (660, 314), (660, 332), (599, 333)]
    slab(bus, "sign", "yellow", sign, before(FAR_SIDE, 0.03), 0.02)
    flap = [(618, 352), (625, 342), (640, 339), (640, 372), (622, 386), (618, 384)]
    slab(bus, "flap", "grey", flap, before(FAR_SIDE, 0.03), 0.02)
    wheel = instance("Far wheel", "wheel")
    wheel.parent = bus
    slab(wheel, "tyre", "tyre", rounded(oval(643, 368, 23, 24)), before(FAR_SIDE, 0.05), 0.3)


def add_surroundings():
    """Car park, hedge and trees, sky."""
    ground = instance("Car park", "pavement-merged")
    slab(ground, "tarmac", "tarmac", [(-300, 900), (940, 900), (940, 303), (-300, 303)], level(0.0),
         0.05)  # fmt: skip
    lines = [
        [(78, 440), (86, 440), (176, 480), (160, 480)],
        [(440, 468), (470, 470), (530, 480), (500, 480)],
        [(578, 480), (640, 457), (640, 464), (600, 480)],
    ]  # fmt: skip
    for i, line in enumerate(lines):
        slab(ground, f"line {i}", "white", line, level(0.01), 0.005)
    trees = instance("Trees", "tree-merged")
    left = [
        (-30, 318), (-30, 226), (0, 228), (15, 229), (24, 234), (28, 250), (34, 247), (42, 240),
        (50, 241), (120, 235), (120, 314), (58, 314), (20, 313),
    ]  # fmt: skip
    body(trees, "left", "leaves", left, upright(60), 4)
    right = [
        (480, 240), (540, 236), (566, 232), (574, 225), (590, 223), (605, 218), (622, 216),
        (640, 211), (680, 212), (680, 310), (560, 312), (480, 312),
    ]  # fmt: skip
    body(trees, "right", "leaves", right, upright(50), 4)
    sky = instance("Sky", "sky-other-merged")
    slab(sky, "dome", "sky", [(-200, -200), (840, -200), (840, 310), (-200, 310)], upright(3000), 1)


def main():
    """Everything in the picture."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    for add in (add_bus, add_bus_parts, add_far_bus, add_surroundings):
        add()
    add_camera_and_light((1.0, 1.0, 1.0), 2.0, (50, 30))


main()
