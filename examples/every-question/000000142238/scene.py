"""Rebuild COCO val2017 photo 000000142238: a line-out, two teams and two men lifted for the ball.

Metres; z is up, y leads away from the camera, z = 0 is the field. The players' height at the touch
line and the spectators' far behind give the horizon and the height of the camera; the focal length
is a guess. Field, trees and sky carry the names of COCO's panoptic vocabulary; the goal has none.
"""

import math

import bpy
from mathutils import Vector
from mathutils.geometry import delaunay_2d_cdt

IMAGE_WH = (640, 427)
FOCAL_PX = 1500.0
HORIZON_V = 231.0
CAMERA_HEIGHT_M = 1.65
LOOKS = {
    "black": (0.015, 0.015, 0.02),
    "blond": (0.5, 0.36, 0.15),
    "blue": (0.03, 0.1, 0.45),
    "brown": (0.12, 0.07, 0.04),
    "denim": (0.1, 0.15, 0.25),
    "field": (0.2, 0.3, 0.03),
    "hair": (0.06, 0.035, 0.02),
    "leaves": (0.05, 0.06, 0.015),
    "navy": (0.02, 0.03, 0.15),
    "purple": (0.12, 0.04, 0.2),
    "skin": (0.55, 0.3, 0.2),
    "sky": (0.9, 0.9, 0.92),
    "white": (0.75, 0.75, 0.72),
    "yellow": (0.7, 0.8, 0.1),
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


def add_person(name, foot, parts):
    """Somebody whose foot is seen at a pixel; parts: (name, look, points, metres nearer).

    Points of two numbers are an outline, of three the stations of a limb.
    """
    person = instance(name, "person")
    for part, look, points, nearer_m in parts:
        place = standing(*foot, nearer_m)
        if len(points[0]) == 3:
            limb(person, part, look, points, place)
        else:
            body(person, part, look, points, place, 0.22 if part in ("shirt", "shorts") else 0.14)


def add_watchers():
    """The four on the left, who look up at the ball."""
    add_person("Watcher 1", (62, 352), [
        ("head", "hair", [(59, 232), (60, 227), (64, 224), (70, 222), (75, 224), (78, 228),
                          (81, 234), (79, 238), (75, 239), (73, 241), (66, 241), (61, 238)], 0.0),
        ("shirt", "blue", [(58, 250), (64, 242), (68, 240), (74, 242), (78, 248), (81, 258),
                           (80, 272), (78, 287), (72, 285), (58, 281), (58, 272), (57, 262)], 0.0),
        ("near arm", "skin", [(63, 260, 4), (67, 274, 3.4), (71, 284, 3), (73, 292, 3)], 0.2),
        ("far arm", "skin", [(78, 284, 2.5), (81, 292, 2.8), (82, 296, 2.5)], -0.1),
        ("shorts", "blue", [(54, 284), (58, 281), (70, 284), (77, 287), (75, 298), (73, 306),
                            (65, 305), (57, 305), (54, 294)], 0.0),
        ("thigh", "skin", [(66, 303, 6.5), (64, 312, 5.6), (62, 320, 4.6)], 0.0),
        ("sock", "white", [(58.5, 324, 5), (58, 333, 4.6), (56.5, 346, 3.8)], 0.02),
        ("far sock", "white", [(62, 322, 3.5), (60, 334, 3), (59, 345, 2.5)], -0.1),
        ("shoe", "blue", [(51, 351), (54, 347), (60, 347), (66, 349), (72, 352), (62, 354),
                          (53, 353)], 0.05),
    ])  # fmt: skip
    add_person("Watcher 2", (97, 348), [
        ("head", "hair", [(89, 226), (91, 221), (97, 218), (103, 219), (106, 225), (107.5, 231),
                          (106, 234), (102, 236), (98, 238), (93, 232), (90, 231)], 0.0),
        ("shirt", "white", [(96, 237), (104, 239), (109, 245), (112, 254), (111, 268), (110, 284),
                            (100, 283), (93, 279), (94, 262), (88, 260), (88, 249),
                            (92, 242)], 0.0),
        ("near arm", "skin", [(91.5, 259, 3.8), (95, 269, 3.3), (102, 279, 3.1),
                              (107, 285, 3.3)], 0.2),
        ("far arm", "skin", [(110, 268, 2), (115, 272, 2.3), (120, 275, 3.2)], -0.2),
        ("shorts", "black", [(91, 281), (96, 277), (104, 283), (112, 286), (113.5, 296), (114, 303),
                             (104, 304), (93, 301), (92, 291)], 0.0),
        ("front thigh", "skin", [(108, 301, 5.8), (107, 312, 5.2), (103, 318, 4)], 0.05),
        ("front sock", "purple", [(98, 322, 5), (97, 333, 3.8), (95, 344, 3)], 0.05),
        ("back thigh", "skin", [(100, 301, 5), (99, 312, 5), (97, 319, 4)], -0.05),
        ("back sock", "purple", [(93, 326, 3.4), (88, 334, 3.2), (85, 338, 3)], -0.05),
        ("front shoe", "black", [(88, 347), (93, 341), (98, 343), (105, 348), (98, 349),
                                 (90, 349)], 0.05),
        ("back shoe", "black", [(79, 331), (82, 329), (86, 332), (88, 338), (86, 347), (82, 346),
                                (81, 338)], -0.05),
    ])  # fmt: skip
    add_person("Watcher 3", (170, 353), [
        ("head", "black", [(164, 229), (166, 222), (172, 219), (179, 220), (183, 225), (186, 231),
                           (182, 235), (176, 236), (170, 236), (166, 232)], 0.0),
        ("neck", "skin", [(177, 233, 4), (177, 239, 4)], 0.0),
        ("shirt", "blue", [(168, 240), (172, 236), (180, 237), (184, 244), (185, 256), (184, 268),
                           (183, 282), (178, 285), (170, 281), (160, 281), (163, 266), (163, 252),
                           (164, 245)], 0.0),
        ("near arm", "skin", [(178, 262, 3.8), (186, 268, 3.3), (198, 268, 2.6),
                              (207, 267, 3)], 0.2),
        ("far arm", "skin", [(183, 281, 2.5), (186, 290, 2.8), (187, 297, 2.4)], -0.1),
        ("shorts", "blue", [(159, 284), (163, 281), (180, 283), (184, 290), (183, 297), (172, 301),
                            (168, 303), (162, 294)], 0.0),
        ("near thigh", "skin", [(178, 299, 7), (182, 309, 6.2), (176, 317, 5)], 0.1),
        ("near sock", "white", [(173, 320, 4.6), (166, 331, 4.6), (162, 341, 3.6)], 0.1),
        ("far thigh", "skin", [(171, 302, 4.5), (173, 312, 4)], -0.1),
        ("far sock", "navy", [(175, 326, 4.6), (171, 338, 3.4), (169, 346, 3)], -0.1),
        ("near shoe", "black", [(155, 342), (158, 338), (165, 341), (174, 350), (175, 354),
                                (164, 352), (157, 347)], 0.1),
        ("far shoe", "black", [(168, 350), (172, 347), (178, 350), (184, 353), (172, 354)], -0.1),
    ])  # fmt: skip
    add_person("Watcher 4", (216, 353), [
        ("head", "hair", [(207, 229), (209, 224), (215, 222), (223, 221), (226, 226), (229.5, 233),
                          (227, 236), (224, 238), (216, 240), (210, 239), (208, 234)], 0.0),
        ("shirt", "blue", [(212, 241), (218, 237), (225, 239), (230, 245), (235, 252), (230, 259),
                           (231, 268), (229, 281), (220, 281), (209, 279), (209, 265), (210, 256),
                           (210, 247)], 0.0),
        ("near arm", "skin", [(216, 257, 4), (222, 261, 3.4), (235, 265, 2.8),
                              (244, 267, 3.3)], 0.25),
        ("far arm", "skin", [(231, 253, 4), (245, 255, 2.8), (257, 253, 2.4), (263, 248, 2)], 0.1),
        ("shorts", "blue", [(206, 283), (212, 279), (228, 281), (229, 292), (228.5, 300),
                            (218, 301), (209, 303), (206, 294)], 0.0),
        ("near thigh", "skin", [(221, 300, 7), (222, 312, 6), (221, 320, 5)], 0.1),
        ("near sock", "white", [(220, 325, 4.8), (217, 336, 4.8), (214.5, 346, 3.5)], 0.1),
        ("far thigh", "skin", [(213, 303, 4.6), (213, 314, 4.2), (210, 323, 3.8)], -0.1),
        ("far sock", "navy", [(208, 328, 4.6), (205, 338, 4.2), (203, 346, 3.4)], -0.1),
        ("near shoe", "black", [(210, 352), (214, 347), (220, 348), (231, 353), (227, 354.5),
                                (214, 354)], 0.1),
        ("far shoe", "black", [(198, 352), (203, 347), (209, 349), (210, 353), (203, 354)], -0.1),
    ])  # fmt: skip


def add_middle_jump():
    """The two who jump for the ball, and the four who hold them up."""
    add_person("Lifter 1", (265, 350), [
        ("head", "hair", [(245, 223), (248, 217), (255, 214.5), (260, 217), (263, 222), (261, 227),
                          (257, 230), (251, 231), (247, 228)], 0.0),
        ("shirt", "white", [(253, 239), (256, 232), (263, 226), (272, 223), (277, 229), (277, 240),
                            (280, 257), (282, 270), (270, 274), (260, 275), (261, 262), (259, 250),
                            (254, 244)], 0.0),
        ("near arm", "skin", [(267, 227, 4), (272, 211, 3.5), (278, 198, 3), (281, 187, 3)], 0.3),
        ("far arm", "skin", [(275, 224, 3.2), (280, 210, 3.2), (283, 200, 2.8),
                             (284, 192, 2.5)], -0.2),
        ("shorts", "black", [(259, 277), (275, 271), (281, 272), (286, 285), (284, 293), (272, 297),
                             (262, 295), (259, 287)], 0.0),
        ("left thigh", "skin", [(268, 296, 6), (266, 307, 6), (263.5, 317, 4.5)], 0.1),
        ("left sock", "black", [(262, 320, 4.8), (261, 332, 4.2), (259.5, 342, 3.2)], 0.1),
        ("right thigh", "skin", [(280, 296, 5.2), (278.5, 307, 5.2), (277, 317, 4.2)], -0.1),
        ("right sock", "black", [(276.5, 320, 4.8), (277, 332, 4.4), (276.5, 341, 3.6)], -0.1),
        ("left shoe", "black", [(253.5, 347), (258, 342), (263, 343), (267.5, 349), (262, 352),
                                (255, 351)], 0.1),
        ("right shoe", "black", [(270, 348), (274, 342), (282, 342), (284, 348), (279, 351),
                                 (272, 350)], -0.1),
    ])  # fmt: skip
    add_person("Jumper 17", (300, 350), [
        ("head", "blond", [(286, 124), (290, 119), (297, 117.5), (302, 120), (304, 126),
                           (305.5, 131), (302, 134), (295, 133), (288, 131)], 0.05),
        ("shirt", "white", [(283, 135), (292, 132), (301, 134), (309, 140), (316, 146), (309, 148),
                            (303, 152), (300, 165), (297, 180), (288, 180), (281, 174), (282, 160),
                            (283, 146), (277, 142)], 0.0),
        ("left arm", "skin", [(288, 127, 3), (279, 131, 3.4), (273, 137, 3.2),
                              (279, 139, 3.2)], -0.1),
        ("right arm", "purple", [(310, 144, 3), (317, 146, 2)], 0.1),
        ("shorts", "black", [(282, 181), (288, 178), (299, 179), (306, 187), (301, 193), (299, 199),
                             (290, 201), (284, 197), (280, 187)], 0.0),
        ("right thigh", "skin", [(303, 192, 5.6), (311, 199, 5.2), (317, 206, 4)], 0.1),
        ("right sock", "black", [(316, 208, 4), (316, 216, 3.6)], 0.1),
        ("left thigh", "skin", [(296, 202, 5.2), (296, 212, 4.8), (295, 219, 4.2)], 0.0),
        ("left sock", "purple", [(292, 222, 4.8), (287, 235, 4.2), (284, 243, 3.4)], 0.0),
        ("left shoe", "black", [(279, 245), (284, 243), (291, 252), (292, 257), (287, 257),
                                (281, 250)], 0.0),
    ])  # fmt: skip
    add_person("Jumper with ball", (330, 351), [
        ("head", "hair", [(310, 131), (312, 125), (318, 122), (326, 124), (329, 130), (332, 135),
                          (328, 138), (322, 140), (314, 138)], 0.0),
        ("shirt", "blue", [(318, 148), (323, 140), (332, 137), (343, 135), (344, 142), (340, 148),
                           (340, 156), (343, 165), (342.5, 185), (334, 182), (322, 181), (320, 165),
                           (319, 155)], 0.0),
        ("left arm", "skin", [(340, 139, 4.4), (351, 134, 3.6), (357, 126, 3),
                              (362, 118, 2.6)], 0.1),
        ("right arm", "skin", [(339, 146, 3.2), (350, 146, 3), (355, 141, 2.8),
                               (358, 133, 2.4)], -0.1),
        ("shorts", "blue", [(321, 183), (330, 180), (342, 185), (344.5, 195), (343, 206),
                            (335, 205), (328, 207), (325, 200), (320, 192)], 0.0),
        ("near thigh", "skin", [(330, 206, 4.5), (331, 215, 4.2), (330, 224, 4.2)], 0.1),
        ("near sock", "white", [(329.5, 227, 5.2), (330, 238, 4.8), (330, 248, 4),
                                (331, 255, 3)], 0.1),
        ("far thigh", "skin", [(342, 208, 3.4), (342, 222, 3)], -0.1),
        ("far sock", "navy", [(339, 226, 4), (337, 240, 4), (335, 252, 3)], -0.1),
        ("shoes", "black", [(320, 258), (325, 253), (333, 252), (337, 258), (341, 263), (336, 268),
                            (337, 274), (331, 271), (325, 264)], 0.1),
    ])  # fmt: skip
    ball = instance("Ball", "sports ball")
    leather = [(361, 117), (366, 115), (372, 118), (376, 125), (376, 131), (372, 134), (366, 132.5),
               (361, 127)]  # fmt: skip
    body(ball, "leather", "white", leather, standing(330, 351), 0.19)
    add_person("Lifter 2", (306, 352), [
        ("head", "hair", [(301, 229), (304, 224), (310, 222), (313, 225), (310, 232), (305, 238),
                          (301, 236)], 0.0),
        ("left arm", "skin", [(304, 224, 3.4), (300, 214, 3.2), (296, 206, 3),
                              (291, 203, 2.6)], 0.25),
        ("right arm", "skin", [(314, 233, 4.8), (318, 221, 4.2), (322, 210, 3.4), (322, 202, 3),
                               (318, 195, 2.4)], 0.2),
        ("shirt", "blue", [(302, 246), (309, 235), (313, 231), (318, 237), (324, 243), (326, 256),
                           (326, 270), (327.5, 285), (318, 283), (308, 281), (299, 279), (302, 267),
                           (303, 256)], 0.0),
        ("shorts", "blue", [(296, 286), (303, 281), (315, 285), (322, 285), (321, 298), (320, 309),
                            (312, 309), (303, 306), (296, 304), (297, 295)], 0.0),
        ("left thigh", "skin", [(300, 305, 5.6), (298, 314, 5.4), (296, 318, 4.8)], 0.1),
        ("left sock", "white", [(295, 319, 5.4), (289, 332, 5), (285, 343, 3.2)], 0.1),
        ("right thigh", "skin", [(311, 308, 6), (309, 318, 5), (307, 323, 4.4)], -0.1),
        ("right sock", "navy", [(306.5, 325, 5), (305, 337, 4.4), (304.5, 347, 3.4)], -0.1),
        ("left shoe", "black", [(283, 351), (285, 345), (289, 345), (293, 353), (287, 353)], 0.1),
        ("right shoe", "black", [(300.5, 352), (304, 348), (311, 348), (320, 353),
                                 (312, 353.5)], -0.1),
    ])  # fmt: skip
    add_person("Lifter 3", (340, 350), [
        ("head", "hair", [(326, 230), (329, 222), (335, 222), (337, 230), (333, 236),
                          (329, 236)], 0.0),
        ("shirt", "white", [(324, 240), (333, 234), (340, 235), (342, 243), (339, 258), (339, 273),
                            (325, 273), (323, 256)], 0.0),
        ("shorts", "black", [(323, 284), (326, 272), (339, 271), (342, 285), (339, 300), (330, 300),
                             (322, 300)], 0.0),
        ("left thigh", "skin", [(327, 299, 5), (332, 311, 4.6), (334, 318, 4.2)], 0.1),
        ("left sock", "purple", [(334, 322, 4.8), (338, 333, 4.4), (340.5, 343, 3.4)], 0.1),
        ("right thigh", "skin", [(337, 299, 4), (341, 311, 3.4), (342, 316, 3.2)], -0.1),
        ("right sock", "purple", [(342.5, 318, 3.8), (345, 331, 3.6), (348, 340, 3)], -0.1),
        ("left shoe", "black", [(328, 352), (336, 346), (344, 345), (345, 350), (336, 353)], 0.1),
        ("right shoe", "black", [(342, 348), (348, 341), (352, 340), (354, 347), (347, 350)], -0.1),
    ])  # fmt: skip
    add_person("Lifter 4", (368, 353), [
        ("head", "hair", [(356, 229), (358, 223.5), (364, 221.5), (371, 224), (373, 231),
                          (370, 236), (364, 239), (359, 236)], 0.0),
        ("near arm", "skin", [(350, 237, 4.6), (343, 227, 3.8), (337, 216, 3.4), (333, 209, 3),
                              (329, 206, 2.8)], 0.25),
        ("far arm", "skin", [(357, 230, 2.8), (351, 224, 3), (346, 216, 2.6),
                             (342, 210, 2.4)], -0.1),
        ("shirt", "blue", [(347, 244), (352, 236), (359, 237), (368, 237), (373, 245), (373, 258),
                           (375, 272), (376, 281), (366, 280), (354, 281), (349, 279), (349, 262),
                           (351, 250)], 0.0),
        ("shorts", "blue", [(351, 283), (355, 280), (376, 283), (377, 292), (375, 303), (365, 302),
                            (353, 304), (351, 293)], 0.0),
        ("left thigh", "skin", [(361, 302, 6.4), (364, 312, 5.6), (366, 317, 4.8)], 0.1),
        ("left sock", "navy", [(367, 320, 4.8), (369, 332, 4.6), (370.5, 346, 3.6)], 0.1),
        ("right thigh", "skin", [(373, 302, 3.8), (375, 313, 3.8), (377, 317, 3.6)], -0.1),
        ("right sock", "white", [(377, 321, 4.4), (380, 334, 4.2), (380.5, 345, 3.2)], -0.1),
        ("left shoe", "black", [(360.5, 354), (364, 349), (373, 347), (375.5, 352),
                                (368, 354)], 0.1),
        ("right shoe", "black", [(374, 352), (378, 347), (383, 345), (385, 351), (380, 354)], -0.1),
    ])  # fmt: skip


def add_right_jump():
    """The man with number 4 in the air, his two lifters, and who stands about them."""
    add_person("Number nine", (398, 367), [
        ("head", "hair", [(397, 226), (399, 219), (404, 215), (410, 217), (413.5, 224), (412, 231),
                          (408, 237), (401, 237), (398, 232)], 0.0),
        ("shirt", "blue", [(397, 238), (404, 235), (412, 238), (420, 244), (424, 254), (426.5, 262),
                           (417, 265), (416, 280), (415, 294), (400, 295), (387, 291), (389, 273),
                           (388, 262), (380, 262), (380, 255), (384, 246), (390, 240)], 0.0),
        ("left arm", "skin", [(384, 262, 3.4), (386, 275, 3.2), (388, 286, 2.4)], 0.0),
        ("right arm", "skin", [(421, 264, 3.6), (423, 278, 3.2), (424, 292, 2.6),
                               (424, 301, 2.6)], 0.0),
        ("shorts", "navy", [(387, 293), (400, 294), (415, 294), (416, 305), (415, 314), (403, 311),
                            (392, 312), (382, 308), (384, 299)], 0.0),
        ("left thigh", "skin", [(392, 311, 5.6), (392, 322, 5), (391, 328, 4.6)], 0.0),
        ("left sock", "blue", [(390.5, 331, 4.8), (389, 342, 4.4), (387, 357, 3.2)], 0.0),
        ("right thigh", "skin", [(408.5, 313, 5.4), (409, 323, 4.8), (408.5, 328, 4.4)], 0.0),
        ("right sock", "white", [(408, 332, 4.8), (408, 345, 4.2), (407, 358, 3.2)], 0.0),
        ("left shoe", "black", [(383, 367), (387, 361), (392, 361), (393, 366), (388, 368)], 0.0),
        ("right shoe", "black", [(404, 366), (406, 361), (412, 362), (422.5, 366.5), (418, 368),
                                 (407, 368)], 0.0),
    ])  # fmt: skip
    add_person("Behind nine", (432, 341), [
        ("head", "hair", oval(411, 229, 4, 7), 0.0),
        ("shirt", "white", [(408, 241), (417, 237), (424, 243), (427, 255), (424, 262), (422, 275),
                            (410, 280), (407, 262)], 0.0),
        ("arm", "skin", [(426, 257, 2.8), (428, 270, 2.4), (427, 284, 2.4)], 0.0),
        ("shorts", "black", [(410, 280), (421, 277), (425, 290), (423, 300), (412, 302)], 0.0),
        ("thigh", "skin", [(420, 300, 3.8), (425, 310, 3.6), (427, 315, 3.4)], 0.0),
        ("sock", "black", [(427.5, 317, 3.8), (430, 328, 3.4), (433, 337, 2.8)], 0.0),
        ("shoe", "black", [(430, 341), (434, 337), (438, 340), (437, 343), (433, 343)], 0.0),
    ])  # fmt: skip
    add_person("Far player", (432, 302), [
        ("head", "blond", oval(430, 243, 4, 5.2), 0.0),
        ("shirt", "white", [(424, 251), (430, 247), (436, 250), (440, 258), (438, 268), (428, 269),
                            (428, 258), (425, 256)], 0.0),
        ("shorts", "black", [(430, 267), (438, 267), (438, 278), (430, 279)], 0.0),
        ("thigh", "skin", [(432, 278, 3), (432.5, 287, 2.8)], 0.0),
        ("sock", "purple", [(432.5, 289, 2.8), (431, 301, 2.4)], 0.0),
        ("far leg", "purple", [(437, 278, 2.6), (438, 300, 2.2)], 0.0),
    ])  # fmt: skip
    add_person("Lifter 5", (444, 355), [
        ("head", "blond", [(430, 225), (432, 217), (438, 213), (444, 216), (447, 223), (446, 230),
                           (437, 232), (432, 231)], 0.0),
        ("left arm", "skin", [(446, 224, 3.6), (445, 210, 3.8), (447, 198, 3.2),
                              (447, 187, 3)], 0.2),
        ("right arm", "skin", [(457, 226, 4.4), (460, 210, 4), (464, 199, 3.4),
                               (464, 191, 3.6)], 0.25),
        ("shirt", "white", [(431, 240), (437, 233), (446, 231), (455, 224), (459, 232), (459, 245),
                            (458, 260), (461, 276), (448, 276), (437, 279), (439, 262),
                            (436, 250)], 0.0),
        ("shorts", "black", [(435, 284), (440, 275), (458, 275), (462, 287), (463, 297), (455, 298),
                             (448, 300), (436, 299), (434, 291)], 0.0),
        ("left thigh", "skin", [(443.5, 299, 7), (439.5, 311, 6), (436, 320, 5)], 0.1),
        ("left sock", "black", [(434, 325, 5.6), (429, 338, 4.8), (425.5, 348, 3.8)], 0.1),
        ("right thigh", "skin", [(457, 297, 6.8), (460, 309, 5.8), (458, 320, 5.2)], -0.1),
        ("right sock", "black", [(456, 326, 5.6), (452.5, 338, 4.4), (450.5, 348, 3.8)], -0.1),
        ("left shoe", "black", [(421, 354), (422, 348), (430, 348), (440, 354), (436, 356),
                                (425, 356)], 0.1),
        ("right shoe", "black", [(446, 354), (447, 348), (454, 349), (467, 355), (461, 356),
                                 (450, 356)], -0.1),
    ])  # fmt: skip
    add_person("Jumper 4", (458, 353), [
        ("head", "black", [(443, 132), (445, 128), (450, 126), (456, 128), (458, 135), (457.5, 143),
                           (450, 145), (444, 142)], 0.0),
        ("shirt", "white", [(437, 159), (438, 152), (442, 147), (447, 144), (459, 145), (468, 149),
                            (475, 158), (479, 164), (472, 168), (474, 180), (475, 191), (468, 190),
                            (464, 181), (446, 181), (444, 175), (442, 165)], 0.0),
        ("arm", "skin", [(474, 166, 4.2), (482, 172.5, 3), (491, 166, 2.7), (498, 159, 2.8),
                         (501, 156, 3.4)], 0.1),
        ("shorts", "black", [(446, 180), (465, 180), (472, 190), (475, 195), (474, 203), (466, 202),
                             (459, 208), (450, 205), (447, 195)], 0.0),
        ("left thigh", "skin", [(454, 205, 5), (453, 218, 4)], -0.1),
        ("left sock", "white", [(453, 220, 4), (453, 250, 4)], -0.1),
        ("right thigh", "skin", [(469, 204, 5.6), (468.5, 218, 4.8), (466, 228, 4.2)], 0.05),
        ("right sock", "purple", [(465, 231, 4.8), (464, 245, 4.6), (464, 258, 4)], 0.05),
        ("back sock", "denim", [(469, 246, 2.8), (470, 260, 3)], -0.05),
        ("shoe", "black", [(459, 266), (462, 260), (469, 262), (476, 270), (475, 273),
                           (467, 271)], 0.05),
    ])  # fmt: skip
    add_person("Lifter 6", (518, 354), [
        ("head", "hair", [(498, 232), (502, 225), (506, 219), (513, 219), (518, 224), (519, 231),
                          (515, 236), (508, 237), (502, 235)], 0.0),
        ("near arm", "skin", [(497, 238, 4), (484, 228.5, 3), (474, 221, 2.8),
                              (468.5, 213, 2.8)], 0.2),
        ("far arm", "skin", [(488, 239, 2.8), (478, 231.5, 2.6), (470, 227, 2.2)], -0.2),
        ("shirt", "white", [(500, 236), (510, 236), (516, 242), (516, 252), (513, 268), (512, 281),
                            (501, 283), (490, 282), (487, 270), (489, 255), (490, 243),
                            (495, 244)], 0.0),
        ("shorts", "black", [(491, 283), (512, 281), (515, 291), (515, 306), (505, 309), (492, 310),
                             (490, 296)], 0.0),
        ("back thigh", "skin", [(501, 308, 4.6), (504, 317, 3.8), (506, 321, 3.4)], -0.1),
        ("back sock", "black", [(506, 323, 3.4), (510, 334, 3.6), (513, 344, 3)], -0.1),
        ("front thigh", "skin", [(510, 307, 5.2), (513.5, 317, 4.6), (515, 320, 4.4)], 0.1),
        ("front sock", "black", [(516, 322, 4.8), (521, 334, 4.4), (524, 345, 3.4)], 0.1),
        ("back shoe", "black", [(505, 352), (510, 347), (518, 346), (517, 352), (509, 354)], -0.1),
        ("front shoe", "black", [(513, 355), (521, 348), (528, 346), (531, 350), (525, 354),
                                 (519, 357)], 0.1),
    ])  # fmt: skip


def add_bystanders():
    """Two spectators far behind, and two people whom the edges of the picture cut."""
    add_person("Spectator 1", (581, 266), [
        ("head", "skin", oval(581, 232, 2.3, 3.8), 0.0),
        ("shirt", "brown", [(575, 237), (579, 234), (584, 234), (586.5, 239), (586, 249),
                            (575, 249.5), (574, 243)], 0.0),
        ("left leg", "denim", [(578.5, 250, 2.2), (577.5, 264.5, 1.7)], 0.0),
        ("right leg", "denim", [(583, 250, 2.2), (584, 264.5, 1.7)], 0.0),
    ])  # fmt: skip
    add_person("Spectator 2", (593, 266), [
        ("head", "skin", oval(591.5, 232, 2.3, 3.6), 0.0),
        ("shirt", "white", [(587, 236.5), (590, 234), (595, 234), (598.5, 238), (599, 245),
                            (597, 249), (588, 249), (586.5, 243)], 0.0),
        ("left leg", "black", [(590.5, 250, 2.2), (590.5, 264.5, 1.7)], 0.0),
        ("right leg", "black", [(595.5, 250, 2.2), (597, 264.5, 1.7)], 0.0),
    ])  # fmt: skip
    add_person("Referee", (645, 360), [
        ("head", "hair", oval(655, 236, 7, 10), 0.0),
        ("shirt", "yellow", [(638, 258), (645, 250), (665, 252), (665, 290), (636.5, 284),
                             (639, 272)], 0.0),
        ("arm", "skin", [(639, 272, 3.4), (631, 283, 2.8), (626, 289, 2.6), (623, 294, 2.6)], 0.1),
        ("shorts", "navy", [(637.5, 286), (665, 286), (665, 313), (641, 312), (637, 302)], 0.0),
        ("leg", "skin", [(650, 312, 6), (649, 335, 5), (647, 354, 3.5)], 0.0),
        ("shoe", "black", [(635, 360), (640, 354), (652, 352), (652, 361)], 0.0),
    ])  # fmt: skip
    add_person("Player at the edge", (-4, 290), [
        ("head", "hair", oval(-8, 235, 4, 6), 0.0),
        ("shirt", "white", [(-16, 245), (-8, 241), (0, 242), (5, 247), (4, 255), (1, 262),
                            (-2, 270), (-15, 270)], 0.0),
        ("arm", "skin", [(6, 256, 1.6), (2, 257.5, 2), (-4, 258, 2)], 0.1),
        ("sleeve", "purple", [(4, 248, 2), (6, 254, 2)], 0.1),
        ("leg", "purple", [(-4, 268, 4), (-3, 287, 3)], 0.0),
    ])  # fmt: skip


def add_ground():
    """The field, the goal, the trees and the sky between them."""
    field = instance("Field", "playingfield")
    slab(field, "turf", "field", [(-200, 900), (840, 900), (840, 233),
                                  (-200, 233)], level(0.0), 0.05)  # fmt: skip
    for name, u, top, foot in (("Left post", 240, 47, 268), ("Right post", 371, 43, 268)):
        limb(
            None, name, "white", [(u + 0.6, top, 1.6), (u - 0.4, foot - 2, 1.6)], standing(u, foot)
        )
        pad = [(u - 4, 225), (u + 4.5, 225), (u + 4, foot), (u - 4, foot)]
        slab(None, f"{name} pad", "purple", pad, standing(u, foot, 0.4), 0.6)
    limb(None, "Crossbar", "white", [(240, 199, 1.5), (371, 197, 1.5)], standing(300, 268))
    trees = instance("Trees", "tree-merged")
    near = standing(320, 255)
    wood = [
        (-200, -100), (452, -100), (456, 0), (470, 20), (486, 42), (472, 58), (456, 70), (452, 82),
        (462, 95), (474, 99), (484, 94), (479, 84), (484, 72), (500, 60), (508, 48), (528, 38),
        (542, 40), (550, 28), (576, 20), (600, 21), (608, 34), (617, 28), (628, 18), (640, 12),
        (840, -20), (840, 252), (640, 252), (560, 249), (500, 256), (400, 257), (200, 255),
        (100, 254), (-200, 254),
    ]  # fmt: skip
    slab(trees, "wood", "leaves", wood, near, 4)
    sky = instance("Sky", "sky-other-merged")
    slab(sky, "dome", "sky", [(-200, -200), (840, -200), (840, 240), (-200, 240)], upright(3000), 1)
    gaps = [
        [(8, 22), (24, 20), (42, 32), (26, 44), (13, 53), (4, 46)],
        [(160, 34), (175, 38), (195, 36), (216, 26), (240, 26), (254, 38), (244, 50), (224, 56),
         (206, 64), (200, 77), (186, 80), (170, 74), (163, 58)],
        [(270, 48), (282, 36), (300, 39), (322, 46), (344, 60), (352, 70), (332, 76), (312, 66),
         (290, 56)],
    ]  # fmt: skip
    for i, gap in enumerate(gaps):
        slab(sky, f"gap {i}", "sky", gap, before(near, 0.2), 0.05)


def main():
    """Everything in the picture."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    for add in (add_watchers, add_middle_jump, add_right_jump, add_bystanders, add_ground):
        add()
    add_camera_and_light((1.0, 1.0, 1.0), 2.0, (45, 30))


main()
