"""Rebuild COCO val2017 photo 000000439180: a parade of riders on a meadow, lorries behind them.

Metres; z is up, y leads away from the camera. The heights of the riders near by, of the man at the
right edge and of the man in yellow give the horizon and the height of the camera, and show that the
meadow rises to the right. The focal length is a guess. Cars, trees and bystanders far behind
stand on a bank. Meadow, track, trees and sky carry the names of COCO's panoptic vocabulary.
"""

import math

import bpy
from mathutils import Vector
from mathutils.geometry import delaunay_2d_cdt

IMAGE_WH = (640, 360)
FOCAL_PX = 550.0
HORIZON_V = 193.0
CAMERA_HEIGHT_M = 1.85
LOOKS = {
    "black": (0.015, 0.014, 0.015),
    "blond": (0.45, 0.33, 0.18),
    "blue": (0.02, 0.05, 0.5),
    "brown": (0.1, 0.05, 0.03),
    "chestnut": (0.2, 0.08, 0.04),
    "grass": (0.2, 0.3, 0.04),
    "grey": (0.4, 0.42, 0.43),
    "hair": (0.06, 0.04, 0.03),
    "leaves": (0.04, 0.06, 0.03),
    "leather": (0.35, 0.2, 0.08),
    "maroon": (0.18, 0.01, 0.03),
    "navy": (0.02, 0.03, 0.08),
    "palomino": (0.4, 0.28, 0.13),
    "pink": (0.75, 0.35, 0.38),
    "red": (0.6, 0.02, 0.03),
    "skin": (0.5, 0.3, 0.22),
    "sky": (0.85, 0.82, 0.87),
    "straw": (0.45, 0.35, 0.2),
    "track": (0.35, 0.3, 0.24),
    "white": (0.75, 0.75, 0.75),
    "yellow": (0.75, 0.65, 0.03),
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

RISE = 0.06  # of the meadow, for each metre to the right


def meadow(u, v):
    """The point of the meadow seen at a pixel."""
    along = ray(u, v)
    return CAMERA_AT + along * (CAMERA_HEIGHT_M / (RISE * along.x - along.z))


def add_figure(name, category, foot, parts):
    """A person or horse whose foot is seen at a pixel.

    Parts: (name, look, points, metres nearer). Points of two numbers are an outline,
    of three the stations of a limb.
    """
    figure = instance(name, category)
    thick_m = 0.5 if category == "horse" else 0.2
    for part, look, points, nearer_m in parts:
        place = upright(meadow(*foot).y - nearer_m)
        if len(points[0]) == 3:
            limb(figure, part, look, points, place)
        else:
            body(figure, part, look, points, place, 0.12 if part == "hat" else thick_m)


def add_left_riders():
    """The three in front on the left, and the woman with the straw hat on her back behind them."""
    foot = (120, 348)
    add_figure("Horse 1", "horse", foot, [
        ("body", "brown", [(96, 234), (112, 222), (132, 224), (146, 236), (153, 250), (155, 268),
                           (152, 284), (148, 297), (147, 315), (146, 334), (139, 335), (139.5, 318),
                           (138, 302), (133, 306), (131, 320), (128, 335), (126, 348), (117, 348),
                           (118.5, 338), (118, 325), (114, 312), (109, 298), (104, 282), (101, 265),
                           (98, 250)], 0.0),
        ("head", "brown", [(98, 218), (100, 210), (106, 206), (112, 204), (119, 207), (122, 214),
                           (122, 226), (118, 236), (113, 243), (110, 250), (104, 251), (100, 246),
                           (100, 236), (99, 226)], 0.7),
    ])  # fmt: skip
    add_figure("Rider 1", "person", foot, [
        ("hat", "hair", [(113, 174.5), (118, 171), (119, 166), (125, 164), (131, 165), (134, 171),
                         (139, 172), (136, 175.5), (128, 176), (118, 177)], -0.2),
        ("head", "skin", [(115, 177), (121, 174), (133, 174), (133, 182), (128, 187), (120, 191),
                          (113, 195), (110, 194)],
         -0.3),
        ("shirt", "maroon", [(110, 191), (118, 187), (130, 186), (140, 184), (144, 190), (139, 199),
                             (139, 213), (122, 214), (116, 209), (110, 207), (109, 199)], -0.3),
        ("right arm", "skin", [(142, 193, 3.4), (153, 196, 2.8), (147, 190, 2.5), (139, 185, 2.4),
                               (132, 183, 2)], -0.1),
        ("left hand", "skin", [(108, 203, 2.4), (103, 205, 2.2)], -0.2),
        ("right leg", "black", [(120, 213), (139, 213), (143, 219), (148, 230), (153, 240),
                                (155, 250), (156, 262), (154, 275), (148, 276), (147, 262),
                                (148, 250), (144, 240), (136, 227), (125, 221)], 0.4),
        ("left leg", "black", [(87, 257), (91, 240), (98, 231), (101, 242), (100, 262), (100, 278),
                               (94, 277), (87, 273), (94, 268)], 0.3),
    ])  # fmt: skip
    foot = (178, 331)
    add_figure("Horse 2", "horse", foot, [
        ("body", "palomino", [(157, 232), (160, 225), (175, 236), (190, 240), (193, 270),
                              (188, 285), (184, 300), (181, 318), (180, 332), (172, 332),
                              (174, 316), (176, 300), (176, 285), (171, 276), (166, 288),
                              (163, 300), (164, 312), (171, 324), (169, 328.5), (163, 327),
                              (159, 312), (156, 300), (158, 285), (158, 268), (156, 250)], 0.0),
        ("head", "palomino", [(160, 193), (166, 198.5), (172, 198), (178, 192), (181, 193),
                              (181, 200), (182, 212), (181, 228), (178, 236), (170, 241),
                              (164, 237), (161, 224), (160, 210)], 0.6),
        ("neck", "palomino", [(160, 225), (155, 236), (157, 250), (176, 252), (180, 235),
                              (170, 226)], 0.3),
    ])  # fmt: skip
    add_figure("Rider 2", "person", foot, [
        ("hat", "navy", [(169.5, 171), (175, 170), (176, 163), (183, 161), (188, 164), (190, 170),
                         (194, 170), (191, 173), (181, 174), (172, 173.5)], -0.2),
        ("head", "skin", [(173, 173), (180, 172), (189, 173), (190, 182), (184, 188), (176, 188),
                          (170, 191), (167, 195)],
         -0.3),
        ("shirt", "maroon", [(164, 199), (167, 191), (173, 184), (188, 182), (195, 185),
                             (199.5, 192), (200, 204), (190, 207), (182, 206), (166, 206)], -0.3),
        ("hands", "skin", [(180, 203, 2.2), (190, 203, 2.2)], 0.0),
        ("legs", "black", [(166, 206), (198, 206), (200, 225), (190, 240), (168, 235)], -0.2),
        ("boot", "leather", [(178, 262), (180, 256), (189, 256), (190, 275), (187, 292), (178, 293),
                             (169.5, 292), (176, 286), (178, 275)], 0.4),
    ])  # fmt: skip
    foot = (215, 353)
    add_figure("Horse 3", "horse", foot, [
        ("body", "chestnut", [(196, 212), (204, 210), (212, 222), (222, 232), (230, 248),
                              (231, 262), (238, 275), (241, 290), (237, 300), (235, 320),
                              (237, 348), (228, 349.5), (229, 330), (226, 312), (223, 300),
                              (224, 318), (222, 335), (225, 347), (214, 353), (213, 340),
                              (210, 353), (206, 353), (207, 335), (205, 320), (201, 306),
                              (196, 296), (191, 282), (188, 268), (191, 256), (196, 240)], 0.0),
        ("head", "chestnut", [(181, 203), (186, 205), (192, 204), (197, 205), (201, 199),
                              (203, 206), (203, 218), (200, 232), (196, 244), (194, 254),
                              (188, 257.5), (182, 253), (180, 244), (180, 232), (179, 220),
                              (178, 213)], 0.7),
    ])  # fmt: skip
    add_figure("Rider 3", "person", foot, [
        ("hat", "black", [(204.5, 172), (211, 170), (213, 163), (218, 161), (225, 163), (227, 170),
                          (233.5, 172.5), (228, 175), (218, 175), (209, 174)], -0.1),
        ("head", "skin", [(211, 174), (227, 174), (230, 183), (225, 189), (216, 190),
                          (211, 183)], -0.2),
        ("shirt", "maroon", [(201, 197), (203, 188), (212, 184), (218, 188), (227, 184), (239, 189),
                             (244, 200), (247, 210), (243, 218), (232, 221), (222, 222), (211, 221),
                             (202, 211)], -0.2),
        ("left arm", "skin", [(203, 208, 3), (212, 208, 2.8), (219, 206, 2.4)], 0.0),
        ("right arm", "skin", [(244, 211, 3.2), (234, 213, 2.8), (224, 209, 2.5)], 0.0),
        ("leg", "black", [(216, 222), (240, 220), (246, 232), (251, 246), (252.5, 264), (246, 266),
                          (234, 265), (230, 250), (226, 236), (220, 229)], 0.4),
        ("boot", "leather", [(239, 264), (251.5, 264), (252, 275), (249, 285), (250.5, 293),
                             (244, 295), (239, 296), (243, 284), (240, 275)], 0.4),
    ])  # fmt: skip
    foot = (243, 337)
    add_figure("Horse 4", "horse", foot, [
        ("body", "brown", [(236, 226), (262, 228), (268, 245), (266, 262), (263, 275), (256, 284),
                           (247, 297), (247, 310), (245, 325), (246, 336), (240, 337), (240, 320),
                           (238, 300), (230, 290)], -0.3),
        ("tail", "palomino", [(256, 268), (262, 270), (265, 285), (265, 300), (258, 306.5),
                              (253, 300), (253, 285)], -0.2),
        ("hind leg", "brown", [(251, 283, 3), (251.5, 300, 2.4), (253, 318, 2.6),
                               (252.5, 324, 2.6)], -0.2),
    ])  # fmt: skip
    add_figure("Rider 4", "person", foot, [
        ("head", "blond", [(233, 179), (237, 174.5), (243, 173), (248, 178), (249, 188), (246, 191),
                           (238, 188)], -0.3),
        ("shirt", "yellow", [(240, 191), (248, 188), (256, 192), (258, 202), (258, 215), (252, 222),
                             (244, 222), (238, 216), (242, 205)], -0.3),
        ("arm", "skin", [(256, 203, 2.6), (260.5, 212, 2.6), (257, 218, 2.2)], -0.2),
        ("leg", "white", [(243, 224), (252, 221), (259, 231), (264, 243), (265, 256), (270.5, 261),
                          (266, 264), (261, 263), (257, 256), (250, 244)], 0.1),
    ])  # fmt: skip


def add_middle_riders():
    """The grey horse and the two dark ones to its right, the child behind them."""
    foot = (297, 341)
    add_figure("Horse 5", "horse", foot, [
        ("body", "grey", [(287, 230), (298, 212), (306, 207), (311, 222), (318, 226), (324, 238),
                          (326, 252), (325, 266), (319, 279), (316, 292), (315, 305), (318, 318),
                          (317, 325), (311, 326), (310, 315), (310, 300), (308, 318), (309.5, 338),
                          (303, 338), (303, 320), (302, 300), (300, 290), (299, 310), (297, 330),
                          (297, 342), (289.5, 342), (292, 325), (291, 308), (288, 292), (287, 275),
                          (284, 255), (284, 240)], 0.0),
        ("head", "grey", [(281, 195), (285, 188), (292, 186), (298, 188), (302, 183), (305, 180.5),
                          (305, 190), (302, 200), (299, 210), (296, 222), (292, 230), (285, 232),
                          (281, 228), (281, 215), (280, 203)], 0.7),
    ])  # fmt: skip
    add_figure("Rider 5", "person", foot, [
        ("hat", "black", [(289, 162), (292, 158.5), (300, 157), (303, 153), (312, 153), (315, 157),
                          (320.5, 161), (320, 165), (313, 167), (300, 168), (291, 166.5)], -0.1),
        ("head", "skin", [(296, 168), (313, 166), (317, 174), (316, 183), (309, 187), (299, 185),
                          (294, 178)], -0.2),
        ("shirt", "navy", [(279, 189), (288, 184), (297, 182), (315, 178), (322, 186), (326, 198),
                           (328, 210), (333, 218), (325, 222), (313, 218), (303, 212), (288, 206),
                           (280, 200)], -0.2),
        ("arm", "skin", [(325, 198, 3.2), (317, 201, 2.8), (307, 198, 2.5)], 0.0),
        ("right leg", "navy", [(308, 212), (326, 219), (333, 228), (339, 240), (339.5, 256),
                               (332, 258), (326, 252), (322, 236), (314, 224)], 0.3),
        ("right boot", "chestnut", [(327, 256), (339, 255), (337, 264), (341.5, 276), (339, 281),
                                    (330, 284), (325, 281), (328, 268)], 0.3),
        ("left leg", "navy", [(271, 233), (277, 226), (284, 222), (286, 240), (284, 258),
                              (276, 258), (271, 248)], 0.3),
        ("left boot", "chestnut", [(268, 272), (274, 260), (284, 257), (283, 278),
                                   (270, 278)], 0.3),
    ])  # fmt: skip
    foot = (363, 332)
    add_figure("Horse 6", "horse", foot, [
        ("body", "black", [(338, 240), (346, 224), (356, 215), (376, 215), (384, 230), (388, 248),
                           (385, 265), (379, 278), (376, 295), (374, 312), (376, 331), (368, 332),
                           (369, 314), (367, 320), (363, 318), (363, 305), (360, 298), (358, 302),
                           (357, 318), (357, 333), (350.5, 333), (351, 312), (349, 300), (347, 285),
                           (343, 270), (340, 256)], 0.0),
        ("head", "brown", [(357, 212), (362, 208), (370, 208), (376, 214), (377, 226), (376, 240),
                           (375, 252), (372, 260), (366, 262.5), (362, 257), (360, 244), (358, 230),
                           (356, 220)], 0.7),
        ("saddle", "leather", [(336, 230), (341, 218), (352, 210), (360, 206), (376, 206),
                               (388, 214), (391, 226), (386, 232), (374, 218), (356, 216),
                               (345, 228), (338, 235)], 0.1),
    ])  # fmt: skip
    add_figure("Rider 6", "person", foot, [
        ("hat", "straw", [(345, 161.5), (352, 159), (353, 153), (358, 151.5), (367, 151),
                          (369, 157), (374, 158), (368, 161), (356, 161.5)], -0.1),
        ("head", "blond", [(353, 161), (366, 160), (368.5, 168), (364, 174), (357, 178), (349, 182),
                           (345, 180), (349, 172)],
         -0.2),
        ("shirt", "maroon", [(341, 188), (346, 179), (357, 176), (368, 172), (376, 176), (380, 188),
                             (379, 196), (377, 206), (358, 207), (348, 206), (340, 202),
                             (339, 196)], -0.2),
        ("left arm", "skin", [(342, 203, 3), (350, 203, 2.8), (359, 206, 2.8)], 0.2),
        ("right arm", "skin", [(383, 191, 2.8), (379, 195, 2.8), (374, 187, 2.6)], 0.0),
        ("hip", "black", [(374, 204), (383, 201), (388, 212), (389, 219), (382, 221)], 0.2),
    ])  # fmt: skip
    foot = (435, 334)
    add_figure("Horse 7", "horse", foot, [
        ("body", "brown", [(402, 226), (412, 212), (424, 204), (434, 196), (446, 187), (456, 200),
                           (455, 225), (452, 240), (452, 258), (449, 275), (445, 288), (441, 300),
                           (441, 318), (444, 335), (434.5, 335), (435, 315), (434, 298), (432, 280),
                           (427, 278), (424, 292), (424, 306), (425, 320), (418, 322), (417, 312),
                           (420, 300), (419, 292), (416, 305), (415, 318), (417, 330), (409.5, 330),
                           (411, 316), (406, 317), (406, 300), (408, 290), (404, 278), (400, 262),
                           (399, 245)], 0.0),
        ("head", "brown", [(434, 204), (438, 190), (444, 184), (452, 184), (458, 194), (460, 204),
                           (457, 214), (453, 224), (453, 234), (447, 240), (440, 237), (437, 226),
                           (436, 214)], 0.8),
        ("blanket", "leather", [(398, 250), (400, 232), (407, 216), (416, 206), (427, 202),
                                (424, 212), (412, 228), (405, 244), (400, 252)], 0.2),
    ])  # fmt: skip
    add_figure("Rider 7", "person", foot, [
        ("hat", "black", [(404, 161), (411, 156.5), (413, 149), (420, 146), (427, 149), (429, 155),
                          (434, 157), (429, 161), (420, 162), (410, 163.5)], -0.1),
        ("head", "hair", [(410, 162), (427, 159), (428, 166), (433, 172), (436, 182), (431, 187),
                          (423, 183), (415, 178), (404, 181), (403, 177)], -0.2),
        ("shirt", "maroon", [(390, 187), (395, 178), (402, 170), (408, 167), (413, 172), (424, 176),
                             (434, 171), (438, 180), (440, 190), (434, 197), (424, 200), (420, 207),
                             (412, 209), (402, 209), (405, 196), (402, 192), (395, 195)], -0.2),
        ("left arm", "skin", [(394, 190, 3.4), (402, 186, 3), (410, 181, 2.8)], 0.0),
        ("right arm", "skin", [(438, 192, 3.2), (430, 194, 2.8), (423, 193, 2.5)], 0.0),
        ("left leg", "navy", [(403, 208), (412, 210), (403, 222), (398, 235), (397, 244),
                              (388.5, 244), (390, 232), (396, 218)], 0.3),
        ("left boot", "black", [(389, 243), (397, 243), (397, 256), (400, 264), (397, 271),
                                (393, 275), (394, 285), (386, 283), (385, 268), (388, 258)], 0.3),
        ("right leg", "navy", [(452, 222), (457, 222), (462, 235), (463, 248), (471.5, 258),
                               (470, 261), (459, 264.5), (456, 255), (452, 240)], 0.3),
    ])  # fmt: skip
    foot = (450, 291)
    add_figure("Rider 8", "person", foot, [
        ("hat", "straw", [(438, 164), (444, 162), (446, 158), (452, 158), (455, 163), (459.5, 166),
                          (452, 168), (443, 167)],
         -0.2),
        ("head", "skin", [(444, 166), (453, 167), (456, 175), (452, 179), (446, 177)], -0.3),
        ("shirt", "blue", [(441, 177), (448, 175), (456, 177), (460, 184), (461, 192), (452, 196),
                           (444, 190)], -0.3),
        ("leg", "blue", [(458, 208, 5), (457, 222, 4)], 0.0),
    ])  # fmt: skip
    add_figure("Horse 8", "horse", foot, [
        ("body", "palomino", [(440, 200), (460, 200), (460, 225), (456, 245), (452, 262),
                              (450, 278), (451, 291), (445, 291), (446, 270), (440, 245)], -0.2),
    ])  # fmt: skip


def add_right_riders():
    """The blue cape, the child in white, the man in a white shirt, and the riders behind them."""
    foot = (490, 288)
    add_figure("Horse 9", "horse", foot, [
        ("body", "chestnut", [(476, 196), (482, 190), (490, 193), (499, 199), (506, 207),
                              (508, 225), (506, 240), (500, 250), (498, 262), (498, 278),
                              (499, 288), (491, 288), (492, 275), (491, 262), (488, 257),
                              (488, 272), (489, 288), (484.5, 288), (484, 270), (482, 258),
                              (479, 246), (475, 235), (475, 215)], 0.0),
        ("head", "chestnut", [(464, 196), (468, 190), (474, 188), (481, 189), (482, 198),
                              (479, 210), (476, 220), (473, 228), (472, 240), (464, 244),
                              (461, 236), (459, 226), (461, 214)], 0.6),
    ])  # fmt: skip
    add_figure("Rider 9", "person", foot, [
        ("hat", "black", [(476, 157), (481, 155), (482, 150), (490, 149.5), (493, 155),
                          (496.5, 158), (490, 160), (481, 160)], -0.1),
        ("head", "hair", [(480, 159), (491, 159), (493, 166), (487, 171), (481, 168)], -0.2),
        ("cape", "blue", [(468, 188), (470, 177), (476, 169), (484, 166), (492, 165), (498, 168),
                          (503, 178), (508, 190), (510.5, 200), (500, 202), (493, 197), (484, 190),
                          (478, 188), (470, 190)], -0.2),
        ("trousers", "white", [(498, 201), (510, 201), (516, 209), (516, 220), (508, 222),
                               (503, 213)], 0.3),
        ("boot", "black", [(507, 220), (516, 219), (516, 232), (518, 240), (512, 243.5),
                           (508, 237)], 0.3),
    ])  # fmt: skip
    foot = (533, 278)
    add_figure("Horse 10", "horse", foot, [
        ("body", "black", [(515, 200), (522, 194), (534, 190), (546, 191), (551, 200), (551, 214),
                           (548, 226), (543, 238), (540, 252), (539, 264), (540, 278), (532.5, 278),
                           (534, 262), (534, 250), (531, 245), (531, 258), (533, 276), (525.5, 278),
                           (527, 262), (525, 250), (524, 238), (521, 228), (519, 215)], 0.0),
        ("head", "black", [(533, 205), (538, 201), (546, 202), (548, 210), (547, 222), (543, 232),
                           (539, 236), (536, 228), (534, 216)], 0.6),
        ("hind leg", "black", [(522, 240, 4), (515, 250, 3), (508, 256, 2.4)], -0.2),
    ])  # fmt: skip
    add_figure("Rider 10", "person", foot, [
        ("hat", "straw", [(524, 166), (529, 164), (531, 160), (538, 159), (541, 163.5),
                          (545.5, 166), (540, 168.5), (529, 168)], -0.2),
        ("head", "skin", oval(534.5, 171, 4.2, 5), -0.3),
        ("shirt", "white", [(521, 184), (524, 176), (531, 174), (540, 174), (546, 180),
                            (549.5, 191), (542, 193), (536, 189), (528, 190), (523, 194),
                            (520.5, 190)], -0.3),
        ("leg", "hair", [(547, 196, 4), (551, 210, 4), (555, 221, 3.5), (556, 231, 3)], 0.2),
        ("shoe", "hair", [(553, 229), (558, 228), (564, 231), (562, 234), (554, 235)], 0.2),
    ])  # fmt: skip
    foot = (510, 259)
    add_figure("Rider 11", "person", foot, [
        ("hat", "straw", [(502, 167.5), (506, 165), (510, 163.5), (514, 166), (518, 169.5),
                          (510, 170)], -0.2),
        ("head", "skin", oval(510, 172, 3.4, 4), -0.3),
        ("shirt", "white", [(503, 179), (509, 175), (516, 177), (520, 186), (518, 195),
                            (508, 195)], -0.3),
    ])  # fmt: skip
    add_figure("Horse 11", "horse", foot, [
        ("body", "brown", [(506, 195), (520, 195), (523, 215), (520, 235), (517, 245), (518, 257),
                           (511, 259), (511, 243), (506, 250), (505, 258), (500, 258), (503, 240),
                           (506, 225)], 0.0),
    ])  # fmt: skip
    foot = (566, 237)
    add_figure("Horse 12", "horse", foot, [
        ("body", "white", [(549, 197), (555, 188), (565, 185), (571, 192), (572, 205), (569, 215),
                           (569, 228), (568.5, 237), (563, 237), (564, 225), (562, 213), (557, 216),
                           (553, 208)], 0.0),
        ("head", "white", [(563, 189), (565, 184), (571, 184), (574, 194), (572, 204), (567, 204),
                           (564, 197)], 0.6),
    ])  # fmt: skip
    add_figure("Rider 12", "person", foot, [
        ("hat", "straw", [(558, 170), (561, 166.5), (566, 166), (569, 170), (563, 171)], -0.2),
        ("head", "skin", oval(563.5, 172, 2.8, 3.2), -0.3),
        ("shirt", "navy", [(556, 181), (559, 175), (567, 175), (570, 182), (568, 189),
                           (558, 190)], -0.3),
        ("leg", "straw", [(557, 190, 3.5), (555, 202, 3)], 0.2),
    ])  # fmt: skip
    foot = (598, 272)
    add_figure("Horse 13", "horse", foot, [
        ("body", "chestnut", [(588, 192), (596, 184), (604, 186), (614, 212), (615, 228),
                              (614, 242), (614, 258), (613.5, 269), (608, 271), (606, 263),
                              (609, 248), (605, 236), (602, 250), (602, 262), (602, 273),
                              (595.5, 273), (596, 258), (595, 245), (592, 232), (587, 240),
                              (584, 252), (583.5, 268), (578.5, 269), (579, 252), (578, 238),
                              (578, 222), (582, 205)], 0.0),
        ("head", "chestnut", [(601, 190), (604, 180.5), (609, 183), (614, 182), (616.5, 190),
                              (615.5, 203), (613, 214), (608, 218), (604, 212), (602, 200)], 0.6),
        ("tail", "black", [(569, 242), (577, 237), (581, 238), (579, 244), (573, 246)], -0.3),
    ])  # fmt: skip
    add_figure("Rider 13", "person", foot, [
        ("hat", "black", [(588, 152), (594, 148), (597, 143.5), (604, 143), (607, 148), (611, 152),
                          (607, 156.5), (596, 156.5)], -0.1),
        ("head", "skin", oval(599, 157, 4.4, 5), -0.2),
        ("shirt", "white", [(583.5, 168), (589, 158), (598, 160), (607, 157), (613, 164),
                            (614.5, 179), (608, 181), (597, 183), (590, 183), (584.5, 179)], -0.2),
        ("left leg", "black", [(582, 186), (590, 182), (595, 190), (586, 200), (580, 212),
                               (578, 226), (568.5, 228), (571, 216), (577, 200)], 0.3),
        ("right boot", "black", [(609, 224), (616, 220), (620, 224), (613, 229)], 0.4),
    ])  # fmt: skip
    foot = (640, 262)
    add_figure("Rider 14", "person", foot, [
        ("hat", "straw", [(610, 156.5), (615, 153.5), (619, 154), (622.5, 158), (616, 159)], -1.0),
        ("head", "skin", oval(616, 160.5, 3, 3.8), -1.0),
        ("shirt", "maroon", [(611, 167), (617, 164), (624, 168), (624, 178), (616, 181),
                             (612, 177)], -1.0),
    ])  # fmt: skip
    add_figure("Rider 15", "person", foot, [
        ("hat", "black", [(630, 151), (635, 146), (642, 144), (652, 152), (640, 158),
                          (632, 157)], -0.1),
        ("head", "skin", oval(640, 160, 5, 6), -0.2),
        ("shirt", "maroon", [(632, 180), (632, 170), (638, 165), (648, 165), (658, 172), (658, 195),
                             (636, 192)], -0.2),
    ])  # fmt: skip
    add_figure("Horse 14", "horse", foot, [
        ("body", "brown", [(614, 207), (618, 198), (627, 190), (640, 184), (658, 184), (664, 255),
                           (645, 262), (632, 232), (619, 218)], 0.0),
    ])  # fmt: skip


def add_people_on_foot():
    """The man at the right edge, the three at the left edge, and those on the bank."""
    add_figure("Man in pink", "person", (637, 313), [
        ("head", "skin", [(633, 192), (637, 183), (645, 180), (652, 190), (646, 201),
                          (637, 201)], 0.0),
        ("shirt", "pink", [(620, 222), (624, 209), (632, 203), (640, 201), (658, 203), (658, 237),
                           (630, 236), (631, 226), (626, 224)], 0.0),
        ("arm", "skin", [(625, 223, 3.4), (619, 233, 2.8), (613, 242, 2.5), (609, 248, 2.8)], 0.1),
        ("trousers", "black", [(630, 236), (658, 236), (660, 308), (634, 308), (631, 290),
                               (628, 265)], 0.0),
        ("shoe", "black", [(630.5, 309), (640, 306), (652, 308), (652, 313.5), (632, 313.5)], 0.0),
    ])  # fmt: skip
    add_figure("Man in yellow", "person", (28, 267), [
        ("head", "white", [(23, 210), (26, 205), (31, 205), (33.5, 209), (31, 213),
                           (26, 213)], 0.0),
        ("jacket", "yellow", [(17, 230), (19, 219), (24, 213), (31, 214), (32.5, 226), (31, 237),
                              (22, 237), (17, 234)], 0.0),
        ("trousers", "black", [(22, 236), (31, 236), (30, 248), (29, 261), (23, 262),
                               (22, 250)], 0.0),
        ("shoes", "white", [(21, 263), (26, 260), (35, 265), (34, 267), (22, 267)], 0.0),
    ])  # fmt: skip
    add_figure("Man in red", "person", (2, 268), [
        ("head", "skin", oval(0, 205, 4, 5), 0.0),
        ("shirt", "red", [(-8, 212), (2, 209), (9, 215), (10.5, 225), (7, 234), (8, 240),
                          (-8, 240)], 0.0),
        ("trousers", "black", [(-8, 238), (8, 238), (8, 252), (5, 267), (-8, 268)], 0.0),
    ])  # fmt: skip
    add_figure("Child in stripes", "person", (8, 267), [
        ("head", "hair", oval(11, 213, 3.4, 4), -0.2),
        ("shirt", "pink", [(8, 222), (14, 221), (17, 232), (16, 241), (8, 241)], -0.2),
        ("legs", "navy", [(7, 240), (13, 240), (11, 255), (11, 267), (3, 267.5)], -0.2),
    ])  # fmt: skip
    watchers = [
        ("white", 511.5, 148, 160, 4), ("red", 520, 150, 164, 4), ("grey", 535, 147, 164, 4),
        ("navy", 553, 144, 170, 4.5), ("white", 570.5, 144, 171, 3.8), ("navy", 500, 145, 160, 4),
        ("red", 528, 154, 162, 3), ("white", 332, 178, 200, 5), ("maroon", 264, 172, 196, 7),
        ("navy", 277, 173, 200, 6),
    ]  # fmt: skip
    for i, (look, u, top, foot, half) in enumerate(watchers):
        watcher = instance(f"Watcher {i}", "person")
        place = upright(40 if u > 400 else 24)
        body(watcher, "head", "skin", oval(u, top + 3, 0.5 * half, 3), place, 0.2)
        trunk = [(u - half, top + 8), (u - 0.5 * half, top + 5), (u + 0.5 * half, top + 5),
                 (u + half, top + 8), (u + 0.8 * half, foot), (u - 0.8 * half, foot)]  # fmt: skip
        body(watcher, "trunk", look, trunk, place, 0.3)


def add_vehicles():
    """The lorry with the red cab, the one behind it, cars on the left and on the bank."""
    place = upright(meadow(58, 238).y)
    lorry = instance("Lorry", "truck")
    load = [(60, 176), (62, 161), (110, 159.5), (232, 160), (232, 222), (150, 226), (110, 230),
            (70, 226), (60, 212)]  # fmt: skip
    slab(lorry, "load", "black", load, place, 2.2)
    cab = [(38, 206), (41, 195), (45, 185), (50, 177), (61, 175), (62, 208), (50, 212), (42, 213)]
    slab(lorry, "cab", "red", cab, before(place, 0.02), 2.0)
    base = [(40, 212), (62, 206), (64, 232), (50, 236), (44, 230)]
    slab(lorry, "base", "black", base, before(place, 0.01), 2.0)
    body(lorry, "wheel", "grey", oval(58, 229, 8, 8.5), before(place, 0.03), 0.2)
    far = upright(meadow(58, 238).y + 5)
    lorry = instance("Lorry behind", "truck")
    slab(lorry, "load", "grey", [(150, 162), (152, 148), (186, 155), (254, 155), (256, 190),
                                 (150, 190)], far, 2.2)  # fmt: skip
    slab(lorry, "sheet", "blue", [(184, 155), (188, 147), (220, 146), (254, 147),
                                  (255, 156)], before(far, 0.05), 2.2)  # fmt: skip
    slab(lorry, "roof", "straw", [(152, 150), (156, 146), (188, 147), (184, 155),
                                  (152, 156)], before(far, 0.03), 1)  # fmt: skip
    slab(lorry, "cab", "white", [(254, 163), (265, 162), (268, 171), (269, 188),
                                 (254, 188)], before(far, 0.05), 2)  # fmt: skip
    cars = [
        ("Car 1", "black", [(-10, 184), (20, 183), (39, 184), (42, 195), (38, 207), (40, 232),
                            (-10, 236)], 23),
        ("Car 2", "white", [(319, 173), (329, 172), (337, 167), (350, 166), (356, 171), (356, 182),
                            (344, 188), (336, 187), (320, 182)], 30),
        ("Car 3", "red", [(372, 168), (382, 166), (391, 167), (397, 175), (396, 184), (388, 188),
                          (376, 186)], 30),
        ("Car 4", "white", [(533, 172), (543, 166), (553, 167), (560, 174), (566, 180), (560, 192),
                            (540, 190)], 35),
        ("Car 5", "white", [(566, 173), (576, 171), (588, 180), (584, 188), (568, 188)], 34),
        ("Car 6", "grey", [(578, 164), (584, 153), (596, 152), (600, 165), (594, 179),
                           (579, 178)], 36),
        ("Car 7", "white", [(497, 168), (500, 161), (511, 161), (517, 168), (514, 174),
                            (498, 174)], 38),
    ]  # fmt: skip
    for name, look, outline, depth_m in cars:
        body(instance(name, "car"), "shell", look, outline, upright(depth_m), 1.6)


def add_ground():
    """Meadow, track, the bank behind, trees and sky; the flag on its pole."""
    grass = instance("Meadow", "grass-merged")
    slab(grass, "turf", "grass", [(-300, 900), (940, 900), (940, 162), (-300, 236)], meadow, 0.05)
    bank = [(-200, 182), (260, 184), (330, 183), (480, 172), (640, 165), (840, 160), (840, 215),
            (-200, 215)]  # fmt: skip
    slab(grass, "bank", "grass", bank, upright(42), 3)
    track = instance("Track", "dirt-merged")
    way = [(60, 372), (110, 348), (160, 322), (190, 305), (240, 296), (275, 278), (300, 262),
           (345, 250), (350, 262), (346, 280), (335, 300), (312, 325), (285, 345),
           (262, 372)]  # fmt: skip
    slab(track, "gravel", "track", way, lambda u, v: pushed(meadow(u, v), -0.02), 0.01)
    trees = instance("Trees", "tree-merged")
    wood = [
        (-200, -100), (320, -100), (326, 5), (334, 28), (350, 35), (360, 48), (370, 62), (384, 66),
        (392, 58), (404, 60), (412, 74), (420, 72), (432, 70), (438, 55), (445, 40), (440, 30),
        (450, 10), (462, 4), (490, -30), (520, -30), (530, 4), (544, 20), (546, 40), (556, 50),
        (553, 66), (567, 74), (578, 68), (585, 56), (600, 42), (616, 42), (628, 52), (640, 60),
        (840, 60), (840, 190), (-200, 200),
    ]  # fmt: skip
    slab(trees, "wood", "leaves", wood, upright(70), 5)
    sky = instance("Sky", "sky-other-merged")
    slab(sky, "dome", "sky", [(-200, -200), (840, -200), (840, 190), (-200, 190)], upright(3000), 1)
    flag = [(343, 86), (350, 88), (358, 94), (357, 103), (350, 101), (343, 97)]
    slab(None, "Flag", "red", flag, upright(40), 0.02)
    limb(None, "Flag pole", "white", [(342, 86, 0.7), (336, 165, 0.7)], upright(40))


def main():
    """Everything in the picture."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    for add in (
        add_left_riders,
        add_middle_riders,
        add_right_riders,
        add_people_on_foot,
        add_vehicles,
        add_ground,
    ):
        add()
    add_camera_and_light((1.0, 1.0, 1.0), 2.0, (45, 30))


main()
