"""Rebuild scikit-image's photo `astronaut` (512 x 512) as a Blender scene.

A portrait of an astronaut in an orange suit, her helmet in front of her; behind her hang a flag
(left) and, on a black-draped stand, a model of the space shuttle (right). Lengths are metres; the
world origin is on the floor below the camera, x to the right, y away from the camera, z up.

Labels, as custom properties on an empty that groups the parts:

    object       category         what it owns
    Astronaut    person           head, hair, suit, gloves, neck ring, patches
    Helmet       helmet           in LVIS only: COCO has no helmet
    Flag         flag             in LVIS only
    Shuttle      space shuttle    in LVIS only: tank, boosters, orbiter and the model's own foot

The draped stand and the backdrop are in neither vocabulary as seen here and stay unlabelled; the
suit is left to the person, so that the person's mask is not cut in two.

How the camera was matched: a portrait taken with a long lens. The head is 164 px from chin to
crown; at 25 cm and from 2.8 m that asks for a focal length near 1850 px. The foot of the model
shows a flat ellipse that puts the horizon at the height of her eyes, 5.4 degrees above the middle
of the photo. Shapes are measured as outlines in the photo (u right, v down, in pixels) with a
depth y in metres for their front and back; `seen_at` turns such a measure into a world point.
"""

import math

import bpy
from mathutils import Matrix, Vector

IMAGE_WH = (512, 512)
FOCAL_PX = 1850.0
SENSOR_WIDTH_MM = 36.0
CAMERA_AT = Vector((0.0, 0.0, 1.35))
CAMERA_DOWN_DEG = 5.4
SEGMENTS = 32

# A row of a body: (v, left u, right u, y of the front, y of the back).
Row = tuple[float, float, float, float, float]
Pixel = tuple[float, float]


def seen_at(u: float, v: float, y: float) -> Vector:
    """The world point at distance y in front of the camera that the photo shows at (u, v)."""
    tilt = Matrix.Rotation(-math.radians(CAMERA_DOWN_DEG), 3, "X")
    ray = tilt @ Vector((u - IMAGE_WH[0] / 2, FOCAL_PX, IMAGE_WH[1] / 2 - v))
    return CAMERA_AT + ray * (y / ray.y)


# --- materials, groups, meshes --------------------------------------------------------------


def material(name: str, rgb, roughness: float = 0.7, metallic: float = 0.0):
    """A plain Principled material; rgb is linear."""
    made = bpy.data.materials.new(name)
    shader = made.node_tree.nodes["Principled BSDF"]
    shader.inputs["Base Color"].default_value = (*rgb, 1.0)
    shader.inputs["Roughness"].default_value = roughness
    shader.inputs["Metallic"].default_value = metallic
    shader.inputs["Specular IOR Level"].default_value = 0.5 * (1.0 - roughness)  # cloth is dull
    made.diffuse_color = (*rgb, 1.0)
    return made


def mottle(made, dark, light, scale: float, stretch=(1.0, 1.0, 1.0)) -> None:
    """Vary a material's colour between two by noise, stretched along the object's axes."""
    nodes, links = made.node_tree.nodes, made.node_tree.links
    mapping, noise = nodes.new("ShaderNodeMapping"), nodes.new("ShaderNodeTexNoise")
    mapping.inputs["Scale"].default_value = stretch
    noise.inputs["Scale"].default_value = scale
    ramp = nodes.new("ShaderNodeValToRGB")
    for element, position, rgb in zip(
        ramp.color_ramp.elements, (0.35, 0.65), (dark, light), strict=True
    ):
        element.position, element.color = position, (*rgb, 1.0)
    links.new(nodes.new("ShaderNodeTexCoord").outputs["Object"], mapping.inputs["Vector"])
    links.new(mapping.outputs["Vector"], noise.inputs["Vector"])
    links.new(noise.outputs["Fac"], ramp.inputs["Fac"])
    links.new(ramp.outputs["Color"], nodes["Principled BSDF"].inputs["Base Color"])


def palette() -> dict:
    """Every material of the scene, by name."""
    table = {
        "orange": ((0.86, 0.115, 0.025), 0.75, 0.0),
        "dark orange": ((0.62, 0.07, 0.02), 0.8, 0.0),
        "skin": ((0.84, 0.50, 0.37), 0.5, 0.0),
        "lips": ((0.60, 0.17, 0.14), 0.4, 0.0),
        "hair": ((0.19, 0.105, 0.035), 0.55, 0.0),
        "brown": ((0.05, 0.022, 0.010), 0.5, 0.0),
        "white": ((0.78, 0.77, 0.74), 0.35, 0.0),
        "grey": ((0.33, 0.35, 0.37), 0.5, 0.0),
        "black cloth": ((0.004, 0.004, 0.005), 0.9, 0.0),
        "black gloss": ((0.003, 0.003, 0.003), 0.06, 0.0),
        "anodised": ((0.16, 0.13, 0.19), 0.25, 0.6),
        "navy": ((0.035, 0.025, 0.16), 0.7, 0.0),
        "purple": ((0.075, 0.035, 0.27), 0.7, 0.0),
        "red": ((0.36, 0.008, 0.018), 0.7, 0.0),
        "tank": ((0.22, 0.095, 0.012), 0.3, 0.0),
        "steel": ((0.5, 0.5, 0.5), 0.25, 1.0),
        "backdrop": ((0.56, 0.50, 0.46), 0.9, 0.0),
    }
    made = {name: material(name, *values) for name, values in table.items()}
    mottle(made["backdrop"], (0.38, 0.32, 0.28), (0.60, 0.55, 0.53), 2.5)
    mottle(made["hair"], (0.085, 0.042, 0.013), (0.36, 0.22, 0.085), 14.0, (0.6, 1.0, 6.0))
    mottle(made["orange"], (0.62, 0.070, 0.016), (0.88, 0.120, 0.028), 5.0, (1.0, 1.0, 1.6))
    return made


def add_group(name: str, category: str, key: str = "category") -> bpy.types.Object:
    """An empty that owns the parts of one labelled thing; COCO reads only `category`."""
    group = bpy.data.objects.new(name, None)
    group[key] = category
    group.empty_display_size = 0.1
    bpy.context.scene.collection.objects.link(group)
    return group


def add_mesh(name: str, vertices, faces, surface, parent=None, thickness: float = 0.0):
    """Link a smooth-shaded mesh; a thickness makes a sheet solid."""
    mesh = bpy.data.meshes.new(name)
    mesh.from_pydata(vertices, [], faces)
    mesh.validate()
    mesh.shade_smooth()
    mesh.materials.append(surface)
    made = bpy.data.objects.new(name, mesh)
    made.parent = parent
    bpy.context.scene.collection.objects.link(made)
    if thickness:
        made.modifiers.new("Thickness", "SOLIDIFY").thickness = thickness
    return made


def skin_rings(rings: list[list[Vector]], closed: bool = True):
    """Faces between successive rings of equally many points, with caps when closed."""
    count = len(rings[0])
    faces = []
    for low in range(0, (len(rings) - 1) * count, count):
        for step in range(count):
            after = (step + 1) % count
            faces.append((low + step, low + after, low + count + after, low + count + step))
    if closed:
        last = (len(rings) - 1) * count
        faces += [tuple(range(count)), tuple(range(last, last + count))]
    return [point for ring in rings for point in ring], faces


# --- bodies: lofted, swept and turned -------------------------------------------------------


def refine(rows: list[Row], steps: int) -> list[Row]:
    """Rows on a Catmull-Rom curve through the given ones, `steps` pieces between neighbours."""
    fine: list[Row] = []
    for index in range(len(rows) - 1):
        before, after = rows[max(index - 1, 0)], rows[min(index + 2, len(rows) - 1)]
        for step in range(steps):
            t = step / steps
            fine.append(
                tuple(
                    0.5 * (2 * b + (c - a) * t + (2 * a - 5 * b + 4 * c - d) * t**2
                           + (3 * b - a - 3 * c + d) * t**3)
                    for a, b, c, d in zip(before, rows[index], rows[index + 1], after, strict=True)
                )
            )  # fmt: skip
    return [*fine, rows[-1]]


def loft_ring(row: Row, roundness: float) -> list[Vector]:
    """One level cross-section: a superellipse (2 = ellipse) that spans the row's outline."""
    v, left, right, front, back = row
    middle = (front + back) / 2
    start, stop = seen_at(left, v, middle), seen_at(right, v, middle)
    centre, half = (start + stop) / 2, (stop - start) / 2
    ring = []
    for step in range(SEGMENTS):
        turn = math.tau * step / SEGMENTS
        across = math.copysign(abs(math.cos(turn)) ** (2 / roundness), math.cos(turn))
        inward = math.copysign(abs(math.sin(turn)) ** (2 / roundness), math.sin(turn))
        ring.append(centre + half * across + Vector((0, inward * (back - front) / 2, 0)))
    return ring


def loft(rows: list[Row], steps: int = 2, roundness: float = 2.0):
    """A solid whose silhouette follows the rows."""
    return skin_rings([loft_ring(row, roundness) for row in refine(rows, steps)])


def add_loft(name, rows, surface, parent, steps: int = 2, roundness: float = 2.0):
    """Link a loft as an object of its own."""
    return add_mesh(name, *loft(rows, steps, roundness), surface, parent)


def add_blend(name, solids, surface, parent, voxel: float, rounds: int):
    """Several overlapping solids as one body, without seams: remeshed on a grid and smoothed."""
    vertices, faces = [], []
    for points, corners in solids:
        faces += [tuple(len(vertices) + corner for corner in face) for face in corners]
        vertices += points
    made = add_mesh(name, vertices, faces, surface, parent)
    remesh = made.modifiers.new("One skin", "REMESH")
    remesh.mode, remesh.voxel_size, remesh.use_smooth_shade = "VOXEL", voxel, True
    smoothing = made.modifiers.new("Smooth", "SMOOTH")
    smoothing.factor, smoothing.iterations = 0.5, rounds
    return made


def front_y(rows: list[Row], u: float, v: float, roundness: float = 2.0) -> float:
    """Depth of the front of a lofted body where the photo shows it at (u, v)."""
    for low, high in zip(rows, rows[1:], strict=False):
        if low[0] <= v <= high[0]:
            t = (v - low[0]) / (high[0] - low[0])
            _, left, right, front, back = (a + (b - a) * t for a, b in zip(low, high, strict=True))
            side = min(1.0, abs(2 * u - left - right) / (right - left))
            bulge = (1 - side**roundness) ** (1 / roundness)
            return (front + back) / 2 - bulge * (back - front) / 2
    raise ValueError(f"v = {v} is outside the body")


def tube(spine: list[tuple[float, float, float, float]]):
    """A round limb; the spine holds (u, v, radius in px, y)."""
    centres = [seen_at(u, v, y) for u, v, _, y in spine]
    rings = []
    for index, (_, _, radius_px, y) in enumerate(spine):
        along = centres[min(index + 1, len(spine) - 1)] - centres[max(index - 1, 0)]
        across = along.cross(Vector((0, 1, 0))).normalized()
        beyond = along.cross(across).normalized()
        radius = radius_px * y / FOCAL_PX
        rings.append([
            centres[index] + radius * (across * math.cos(turn) + beyond * math.sin(turn))
            for turn in (math.tau * step / SEGMENTS for step in range(SEGMENTS))
        ])  # fmt: skip
    return skin_rings(rings)


def add_turned(name, profile, frame: Matrix, surface, parent, closed: bool = True):
    """A profile of (radius, height), in metres, turned about the z axis of a frame."""
    rings = [
        [Vector((r * math.cos(turn), r * math.sin(turn), h))
         for turn in (math.tau * step / SEGMENTS for step in range(SEGMENTS))]
        for r, h in profile
    ]  # fmt: skip
    made = add_mesh(name, *skin_rings(rings, closed), surface, parent)
    made.matrix_world = frame
    return made


def upright(u: float, v: float, y: float) -> Matrix:
    """A frame with a vertical axis through the point seen at (u, v)."""
    return Matrix.Translation(seen_at(u, v, y))


# --- things that lie on a body --------------------------------------------------------------


def add_patch(name, outline: list[Pixel], on, surface, parent, lift=0.004, thickness=0.003):
    """A convex patch laid on a body: `on` gives the body's front depth at (u, v)."""
    mid_u = sum(u for u, _ in outline) / len(outline)
    mid_v = sum(v for _, v in outline) / len(outline)
    rings = []
    for scale in (0.02, 0.35, 0.7, 1.0):
        ring = [(mid_u + (u - mid_u) * scale, mid_v + (v - mid_v) * scale) for u, v in outline]
        rings.append([seen_at(u, v, on(u, v) - lift) for u, v in ring])
    vertices, faces = skin_rings(rings, closed=False)
    faces.append(tuple(range(len(outline))))  # the innermost ring, filled
    return add_mesh(name, vertices, faces, surface, parent, thickness)


def oval(u: float, v: float, half_u: float, half_v: float, points: int = 16) -> list[Pixel]:
    """The outline of an upright oval."""
    turns = [math.tau * step / points for step in range(points)]
    return [(u + half_u * math.cos(turn), v + half_v * math.sin(turn)) for turn in turns]


def add_strip(name, path: list[Pixel], width_px: float, on, surface, parent, lift=0.004):
    """A strap of constant width laid on a body along a path."""
    vertices, faces = [], []
    for index, (u, v) in enumerate(path):
        (u0, v0), (u1, v1) = path[max(index - 1, 0)], path[min(index + 1, len(path) - 1)]
        length = math.hypot(u1 - u0, v1 - v0)
        side = ((v1 - v0) / length * width_px / 2, -(u1 - u0) / length * width_px / 2)
        y = on(u, v) - lift
        vertices += [seen_at(u + side[0], v + side[1], y), seen_at(u - side[0], v - side[1], y)]
        if index:
            faces.append((2 * index - 2, 2 * index - 1, 2 * index + 1, 2 * index))
    return add_mesh(name, vertices, faces, surface, parent, 0.003)


# --- the astronaut --------------------------------------------------------------------------

FACE = [
    (50, 192, 258, 2.755, 2.93), (70, 186, 264, 2.742, 2.94), (90, 182, 268, 2.735, 2.94),
    (110, 181, 269, 2.735, 2.94), (130, 182, 268, 2.735, 2.93), (140, 182.5, 266, 2.735, 2.92),
    (150, 185, 262.5, 2.735, 2.91), (160, 190, 257, 2.735, 2.89), (167, 197, 252, 2.74, 2.88),
    (173, 206, 245, 2.745, 2.86), (177, 213, 238, 2.75, 2.83), (179.5, 220, 231, 2.755, 2.80),
]  # fmt: skip
NOSE = [
    (94, 220, 228, 2.735, 2.76), (104, 219, 229, 2.730, 2.76), (113, 217, 231, 2.723, 2.76),
    (120, 213.5, 234.5, 2.716, 2.76), (126, 211, 237, 2.712, 2.76), (129.5, 213, 235, 2.716, 2.76),
    (132, 219, 229, 2.724, 2.76),
]  # fmt: skip
EAR_LEFT = [
    (112, 172, 186, 2.80, 2.86), (120, 170.5, 187, 2.79, 2.86), (126, 173, 187, 2.79, 2.86),
    (131.5, 178, 186, 2.80, 2.85),
]  # fmt: skip
EAR_RIGHT = [
    (118, 262, 280, 2.80, 2.86), (128, 262, 279, 2.79, 2.86), (133, 263, 275, 2.79, 2.86),
    (137, 266, 271, 2.80, 2.85),
]  # fmt: skip
NECK = [
    (140, 186, 258, 2.80, 2.92), (160, 186, 257, 2.79, 2.91), (175, 186.5, 254, 2.785, 2.91),
    (187, 188, 253, 2.782, 2.91), (200, 186, 258, 2.775, 2.92),
]  # fmt: skip
TURTLENECK = [
    (182, 187, 254, 2.778, 2.92), (190, 184, 257, 2.772, 2.92), (205, 172, 264, 2.75, 2.92),
    (225, 168, 270, 2.73, 2.92), (250, 182, 268, 2.72, 2.92),
]  # fmt: skip
HAIR_TOP = [
    (15.5, 226, 238, 2.83, 2.87), (18, 215, 248, 2.80, 2.91), (23, 203, 258, 2.77, 2.94),
    (31, 192, 274, 2.745, 2.96), (38, 182, 284, 2.735, 2.975), (46, 171, 290, 2.73, 2.98),
    (56, 160, 295, 2.725, 2.985), (66, 154, 298.5, 2.722, 2.985), (74, 153, 300.5, 2.725, 2.98),
]  # fmt: skip
FRINGE = [
    (40, 190, 268, 2.735, 2.80), (52, 186, 274, 2.722, 2.80), (64, 185, 274, 2.716, 2.79),
    (73, 186, 273, 2.716, 2.785), (79, 196, 272, 2.72, 2.78), (84, 228, 271, 2.722, 2.78),
    (88, 256, 270, 2.735, 2.78),
]  # fmt: skip
HAIR_LEFT = [
    (42, 170, 200, 2.76, 2.95), (50, 163, 196, 2.745, 2.96), (62, 155, 192, 2.735, 2.97),
    (74, 153, 190, 2.735, 2.97), (88, 153.5, 188, 2.745, 2.965),
    (100, 156, 186, 2.76, 2.955), (109, 161, 185, 2.775, 2.95), (115, 166, 184, 2.79, 2.94),
    (120, 170, 183, 2.80, 2.92), (124, 174, 182, 2.82, 2.90),
]  # fmt: skip
HAIR_RIGHT = [
    (36, 245, 272, 2.76, 2.95), (46, 252, 287, 2.745, 2.96), (60, 258, 296.5, 2.73, 2.97),
    (76, 260, 301, 2.73, 2.975), (88, 261, 302, 2.74, 2.975),
    (100, 262, 300, 2.755, 2.97), (110, 263, 296, 2.77, 2.96), (119, 264, 288.5, 2.785, 2.95),
    (126, 266, 281, 2.80, 2.93), (132, 269, 275, 2.83, 2.90),
]  # fmt: skip
TORSO = [
    (206, 117, 240, 2.87, 2.93), (214, 103, 278, 2.86, 2.95), (224, 91, 296, 2.87, 2.97),
    (236, 77, 309, 2.865, 2.98), (246, 67, 321, 2.85, 3.00), (258, 58.5, 333, 2.82, 3.01),
    (270, 55, 340, 2.77, 3.01), (282, 61, 342, 2.705, 3.01), (296, 63, 343, 2.665, 3.01),
    (320, 70, 340, 2.655, 3.01), (360, 85, 335, 2.65, 3.01), (420, 95, 335, 2.645, 3.01),
    (540, 100, 335, 2.63, 3.01),
]  # fmt: skip
TORSO_ROUNDNESS = 2.4
SLEEVE = [  # the right arm, on the left of the photo: (u, v, radius in px, y)
    (94, 262, 28, 2.86), (91, 274, 38, 2.84), (88, 288, 44, 2.81), (83, 310, 48, 2.79),
    (77, 340, 50, 2.78), (73, 375, 52, 2.77), (71, 410, 53, 2.76), (72, 440, 52, 2.75),
    (76, 465, 52, 2.74), (82, 490, 52, 2.73), (90, 520, 51, 2.72), (94, 545, 50, 2.72),
]  # fmt: skip
FOREARM = [
    (76, 500, 42, 2.69), (90, 496, 46, 2.66), (110, 496, 46, 2.63), (130, 501, 42, 2.60),
    (143, 507, 38, 2.58),
]  # fmt: skip
OTHER_SLEEVE = [
    (313, 263, 22, 2.90), (314, 277, 33, 2.88), (316, 295, 38, 2.86), (320, 318, 39, 2.84),
    (323, 340, 40, 2.82), (326, 370, 42, 2.80), (330, 410, 42, 2.78), (330, 470, 42, 2.76),
]  # fmt: skip

RING_CENTRE = (216.3, 207.8, 2.80)
RING_RADIUS_PX = 96.5  # half the long axis of its ellipse in the photo
RING_FLATNESS = 0.544  # short axis / long axis
RING_TURN_DEG = 25.8  # of the long axis, clockwise from the photo's u axis


def ring_frame() -> Matrix:
    """The neck ring's frame: z is its axis, out of the suit; a unit is the ring's radius.

    An ellipse of flatness f is a circle whose axis leans acos(f) away from the line of sight,
    toward the short axis; the ring's near side is the lower one.
    """
    turn, lean = math.radians(RING_TURN_DEG), math.acos(RING_FLATNESS)
    long = Vector((math.cos(turn), 0, -math.sin(turn)))
    short = Vector((math.sin(turn), 0, math.cos(turn)))
    axis = short * math.sin(lean) + Vector((0, -1, 0)) * math.cos(lean)
    axes = Matrix((long, axis.cross(long), axis)).transposed().to_4x4()
    tilt = Matrix.Rotation(-math.radians(CAMERA_DOWN_DEG), 4, "X")
    radius = RING_RADIUS_PX * RING_CENTRE[2] / FOCAL_PX
    return Matrix.Translation(seen_at(*RING_CENTRE)) @ tilt @ axes @ Matrix.Scale(radius, 4)


def add_neck_ring(colour: dict, owner) -> None:
    """The metal ring with its band and latch, the pale lining inside, and the black collar."""
    frame = ring_frame()
    band = [(0.90, -0.02), (0.91, 0.0), (0.98, 0.0), (1.0, -0.02), (1.0, -0.06)]
    add_turned("Neck ring", band, frame, colour["anodised"], owner, closed=False)
    outer = [(0.99, -0.05), (1.01, -0.08), (1.01, -0.25), (0.97, -0.27), (0.85, -0.27)]
    add_turned("Neck band", outer, frame, colour["black gloss"], owner, closed=False)
    wall = [(0.90, -0.02), (0.89, -0.10)]
    add_turned("Ring wall", wall, frame, colour["black cloth"], owner, closed=False)
    lining = [(0.89, -0.10), (0.84, -0.12), (0.78, -0.14), (0.72, -0.13)]
    add_turned("Lining", lining, frame, colour["grey"], owner, closed=False)
    collar = [(0.74, -0.13), (0.66, -0.08), (0.50, -0.06), (0.0, -0.06)]
    add_turned("Collar", collar, frame, colour["black cloth"], owner, closed=False)
    latch = [(183, 115, 119, 2.77, 2.79), (187, 112.5, 122, 2.76, 2.80),
             (204, 113, 122, 2.76, 2.80), (213, 117, 124, 2.77, 2.80)]  # fmt: skip
    add_loft("Ring latch", latch, colour["steel"], owner)


def add_head(colour: dict, owner) -> None:
    """Face, ears, nose, neck, collar and hair."""
    face = [loft(rows) for rows in (FACE, NOSE, EAR_LEFT, EAR_RIGHT)]
    add_blend("Face", face, colour["skin"], owner, voxel=0.005, rounds=3)
    add_loft("Neck", NECK, colour["skin"], owner, steps=1)
    add_loft("Turtleneck", TURTLENECK, colour["black cloth"], owner)
    hair = [loft(rows, steps=1) for rows in (HAIR_TOP, FRINGE, HAIR_LEFT, HAIR_RIGHT)]
    add_blend("Hair", hair, colour["hair"], owner, voxel=0.007, rounds=5)


def add_features(colour: dict, owner) -> None:
    """Eyes, brows and mouth, laid on the face."""

    def on(u: float, v: float) -> float:
        return front_y(FACE, u, v)

    for side, u, v in (("left", 202, 101), ("right", 247, 103)):
        add_patch(f"Eye {side}", oval(u, v, 9, 4), on, colour["white"], owner, 0.003)
        add_patch(f"Iris {side}", oval(u, v, 3.6, 3.6), on, colour["brown"], owner, 0.005)
        lid = [(u - 11, v - 0.5), (u - 5, v - 4.5), (u + 4, v - 4.5), (u + 11, v - 0.5)]
        add_strip(f"Lashes {side}", lid, 1.6, on, colour["brown"], owner, 0.006)
    brow_left = [(189, 91), (196, 88.5), (204, 89), (213, 91.5)]
    brow_right = [(236, 93), (245, 91.5), (254, 92), (263, 96)]
    add_strip("Brow left", brow_left, 1.8, on, colour["hair"], owner)
    add_strip("Brow right", brow_right, 1.8, on, colour["hair"], owner)
    mouth = [(203, 140), (213, 141), (224, 142), (235, 141), (244, 140),
             (239, 148), (231, 153.5), (222, 155), (213, 152), (207, 147)]  # fmt: skip
    teeth = [(207, 141.8), (215, 142.8), (224, 143.5), (233, 142.8), (240, 141.8),
             (235, 146), (228, 148.3), (221, 148.6), (214, 147), (210, 144.5)]  # fmt: skip
    add_patch("Lips", mouth, on, colour["lips"], owner, 0.003)
    add_patch("Teeth", teeth, on, colour["white"], owner, 0.006)


def add_suit(colour: dict, owner) -> None:
    """Torso, sleeves, glove, and what is sewn and buckled on."""

    def on(u: float, v: float) -> float:
        return front_y(TORSO, u, v, TORSO_ROUNDNESS)

    orange, white = colour["orange"], colour["white"]
    torso = loft(TORSO, roundness=TORSO_ROUNDNESS)
    limbs = [tube(spine) for spine in (SLEEVE, FOREARM, OTHER_SLEEVE)]
    add_blend("Suit", [torso, *limbs], orange, owner, voxel=0.012, rounds=3)
    cuff = tube([(139, 505, 39, 2.585), (150, 511, 37, 2.57)])
    add_mesh("Cuff", *cuff, colour["black gloss"], owner)
    glove = tube([(146, 510, 33, 2.57), (172, 528, 30, 2.54)])
    add_mesh("Glove", *glove, colour["navy"], owner)

    add_patch("Patch ground", oval(171, 386, 43, 46, 24), on, colour["dark orange"], owner)
    add_patch("Mission patch", oval(171, 385, 37, 36.5, 24), on, colour["purple"], owner, 0.007)
    emblem = [(150, 400), (172, 388), (198, 392), (170, 406)]
    add_patch("Patch emblem", emblem, on, white, owner, 0.010)
    tag = [(278, 340), (328, 346), (327, 377), (283, 375)]
    add_patch("Name tag edge", tag, on, white, owner, 0.008)
    inner = [(280, 342), (326, 348), (325, 375), (285, 373)]
    add_patch("Name tag", inner, on, colour["purple"], owner, 0.010)
    add_patch("Wings", [(286, 352), (303, 348), (322, 356), (304, 366)], on, white, owner, 0.012)
    add_patch("Valve", oval(173, 488, 22, 25, 24), on, white, owner, 0.02, 0.02)
    add_patch("Valve button", oval(170, 490, 8, 8), on, colour["steel"], owner, 0.05, 0.02)

    zipper = [(247, 335), (244, 370), (242, 410), (244, 445), (249, 465)]
    strap = [(256, 330), (262, 360), (266, 400), (267, 450), (265, 525)]
    add_strip("Zipper tape", zipper, 8, on, white, owner, 0.006)
    add_strip("Strap", strap, 13, on, white, owner, 0.008)
    add_strip("Buckle", [(243, 297), (245, 318), (247, 345)], 10, on, colour["steel"], owner, 0.012)
    add_strip("Zipper pull", [(249, 446), (249, 475)], 12, on, white, owner, 0.012)
    add_strip("Lower buckle", [(232, 470), (233, 505)], 14, on, colour["steel"], owner, 0.008)


# --- the helmet -----------------------------------------------------------------------------

HELMET = [
    (345.5, 386, 406, 2.44, 2.47), (348.5, 372, 424, 2.40, 2.51), (353, 361, 437, 2.37, 2.54),
    (359, 343, 450, 2.35, 2.56), (367, 328, 461, 2.33, 2.58), (377, 316, 472, 2.315, 2.595),
    (389, 305, 481, 2.305, 2.605), (403, 296, 487.5, 2.30, 2.61), (420, 287.5, 492, 2.295, 2.615),
    (440, 281, 496, 2.29, 2.62), (462, 278, 498, 2.29, 2.62), (490, 277, 499, 2.29, 2.62),
    (540, 278, 498, 2.29, 2.62),
]  # fmt: skip
VISOR = [
    (353.5, 360, 366, 2.38, 2.42), (355, 352, 378, 2.345, 2.45), (359, 341, 398, 2.325, 2.47),
    (367, 328.5, 421, 2.305, 2.49), (379, 313.5, 441, 2.285, 2.50), (396, 300.5, 461, 2.27, 2.51),
    (416, 289.5, 476, 2.26, 2.52), (436, 282, 484, 2.255, 2.53), (460, 278, 491, 2.25, 2.53),
    (490, 277, 493, 2.25, 2.53), (540, 278, 491, 2.25, 2.53),
]  # fmt: skip


def add_helmet(colour: dict) -> None:
    """White shell, black visor, and the hinge at its side."""
    owner = add_group("Helmet", "helmet", "lvis_category")
    add_loft("Helmet shell", HELMET, colour["white"], owner)
    add_loft("Visor", VISOR, colour["black gloss"], owner)
    hinge = [(456, 492, 500, 2.38, 2.44), (462, 489, 505, 2.36, 2.44), (472, 487, 508, 2.35, 2.44),
             (485, 486, 509.5, 2.35, 2.44), (500, 487, 509, 2.35, 2.44),
             (525, 489, 507, 2.35, 2.44)]  # fmt: skip
    add_loft("Hinge", hinge, colour["steel"], owner)
    lug = [(484, 503, 514, 2.38, 2.42), (498, 503, 515, 2.38, 2.42), (508, 503, 513, 2.38, 2.42)]
    add_loft("Hinge lug", lug, colour["white"], owner)


# --- the flag -------------------------------------------------------------------------------

FLAG_Y = 3.45
STRIPE_SLOPE = 1.36  # the folds carry the stripes down to the right: v = s + slope * u
STRIPES = [(-60, "white"), (63, "red"), (130, "white"), (215, "red"), (300, "white"),
           (392, "red"), (480, "white"), (620, "")]  # fmt: skip
FLAG_EDGE = [(-30, 40), (0, 44.5), (30, 50), (60, 56.5), (88, 63.5), (110, 72), (135, 79.5),
             (160, 87), (185, 92), (215, 96), (260, 100), (560, 110)]  # fmt: skip
STARS = [(36, 19, 13), (38, 66, 13), (4, 9, 11), (2, 60, 12), (0, 112, 12)]


def flag_edge(v: float) -> float:
    """The u of the flag's right edge in row v."""
    for (v0, u0), (v1, u1) in zip(FLAG_EDGE, FLAG_EDGE[1:], strict=False):
        if v0 <= v <= v1:
            return u0 + (u1 - u0) * (v - v0) / (v1 - v0)
    return FLAG_EDGE[0][1] if v < FLAG_EDGE[0][0] else FLAG_EDGE[-1][1]


def flag_y(u: float, v: float) -> float:
    """Depth of the hanging cloth, with its folds."""
    return FLAG_Y + 0.025 * math.sin(0.11 * u - 0.03 * v)


def add_cloth(name, points: list[list[Pixel]], lift, surface, owner) -> None:
    """A sheet of the flag from rows of pixels."""
    across = len(points[0])
    vertices = [seen_at(u, v, flag_y(u, v) - lift) for row in points for u, v in row]
    faces = [
        (low + column, low + column + 1, low + across + column + 1, low + across + column)
        for low in range(0, (len(points) - 1) * across, across)
        for column in range(across - 1)
    ]
    add_mesh(name, vertices, faces, surface, owner, 0.002)


def stripe_row(s: float, left_u: float = -70.0, columns: int = 16) -> list[Pixel]:
    """The line v = s + slope * u from the left of the photo to the flag's right edge."""
    right_u = 60.0
    for _ in range(40):
        right_u += 0.5 * (flag_edge(s + STRIPE_SLOPE * right_u) - right_u)
    us = [left_u + (right_u - left_u) * column / columns for column in range(columns + 1)]
    return [(u, s + STRIPE_SLOPE * u) for u in us]


def add_flag(colour: dict) -> None:
    """Stripes, the blue field in front of their upper end, and its stars."""
    owner = add_group("Flag", "flag", "lvis_category")
    for number, ((start, name), (stop, _)) in enumerate(zip(STRIPES, STRIPES[1:], strict=False)):
        pieces = 4
        rows = [stripe_row(start + (stop - start) * piece / pieces) for piece in range(pieces + 1)]
        add_cloth(f"Stripe {number}", rows, 0.0, colour[name], owner)

    field = []
    for step in range(13):
        t = step / 12
        right_v = -30 + 118.5 * t
        right_u = flag_edge(right_v)
        left_v = -30 + (158 + 70 * 1.1 + 30) * t
        field.append([
            (-70 + (right_u + 70) * k / 10, left_v + (right_v - left_v) * k / 10) for k in range(11)
        ])  # fmt: skip
    add_cloth("Field", field, 0.014, colour["navy"], owner)
    for number, (u, v, radius) in enumerate(STARS):
        outline = []
        for point in range(10):
            turn = math.tau * point / 10 - math.pi / 2
            reach = radius if point % 2 == 0 else 0.42 * radius
            outline.append((u + 0.85 * reach * math.cos(turn), v + reach * math.sin(turn)))
        add_patch(f"Star {number}", outline, flag_y, colour["white"], owner, 0.030, 0.001)


# --- the shuttle and its stand --------------------------------------------------------------

SHUTTLE_Y = 3.60
FUSELAGE = [
    (83, 389, 404, 3.50, 3.53), (89, 386.5, 405, 3.48, 3.54), (98, 383.5, 406, 3.465, 3.55),
    (108, 380, 408, 3.455, 3.555), (118, 378.2, 410, 3.45, 3.555), (150, 377.8, 411, 3.45, 3.555),
    (185, 378, 411, 3.45, 3.555), (225, 381, 411, 3.45, 3.555), (240, 390, 410, 3.46, 3.55),
    (248, 398, 408, 3.48, 3.53),
]  # fmt: skip
NOSE_CAP = [
    (75.5, 393, 399, 3.51, 3.53), (78, 390.5, 402, 3.495, 3.535), (84, 389, 404, 3.49, 3.54),
]  # fmt: skip
TILES = [
    (84, 398, 405, 3.52, 3.55), (100, 401, 408, 3.52, 3.565), (120, 403, 412, 3.52, 3.565),
    (150, 404, 417, 3.52, 3.565), (178, 404, 421, 3.52, 3.565),
]  # fmt: skip
WING_LEFT = [(379, 182), (367, 193), (359, 206), (354.5, 218), (354.5, 222.5), (379, 225)]
WING_RIGHT = [(405, 176), (421, 177), (437, 190), (451.5, 206), (455, 218), (455, 231),
              (432, 236), (405, 234)]  # fmt: skip
ELEVON_LEFT = [(354.5, 220.5), (376, 222.5), (376, 225), (354.5, 223)]
ELEVON_RIGHT = [(416, 224), (455, 223), (455, 226), (416, 227)]
FIN = [(388, 218), (392.5, 231), (386, 247), (373, 269), (368, 272), (367.5, 262), (377, 236)]


def add_plate(name, outline: list[Pixel], front, back, surface, owner) -> None:
    """A flat part, such as a wing, with a thickness in depth."""
    rings = [[seen_at(u, v, y) for u, v in outline] for y in (front, back)]
    made = add_mesh(name, *skin_rings(rings), surface, owner)
    made.data.shade_flat()


def add_booster(name, u, y, colour, owner) -> None:
    """A solid rocket booster, from its tip at v = 41 to its skirt and nozzle."""
    metres = SHUTTLE_Y / FOCAL_PX
    profile = [(r * metres, (155 - v) * metres) for v, r in (
        (41, 0.5), (46, 3), (56, 6.5), (70, 9.5), (82, 10.3), (150, 10.3), (244, 10.3), (250, 11.5),
        (265, 13.5), (266, 7), (275, 6))]  # fmt: skip
    add_turned(name, profile, upright(u, 155, y), colour["white"], owner)


def add_shuttle(colour: dict) -> None:
    """Tank, boosters and orbiter on a post and a round foot."""
    owner = add_group("Shuttle", "space shuttle", "lvis_category")
    metres = SHUTTLE_Y / FOCAL_PX
    tank = [(-5, 1), (0, 9), (10, 14.5), (20, 18), (33, 20.4), (50, 21), (200, 21), (228, 18),
            (238, 6)]  # fmt: skip
    profile = [(r * metres, (100 - v) * metres) for v, r in tank]
    add_turned("Tank", profile, upright(417, 100, SHUTTLE_Y + 0.06), colour["tank"], owner)
    add_booster("Booster left", 390.5, SHUTTLE_Y + 0.08, colour, owner)
    add_booster("Booster right", 445.5, SHUTTLE_Y - 0.01, colour, owner)

    white, black = colour["white"], colour["black cloth"]
    add_loft("Fuselage", FUSELAGE, white, owner)
    add_loft("Nose cap", NOSE_CAP, black, owner, steps=1)
    add_loft("Tiles", TILES, black, owner, steps=1)
    add_plate("Wing left", WING_LEFT, 3.50, 3.515, white, owner)
    add_plate("Wing right", WING_RIGHT, 3.50, 3.515, white, owner)
    add_plate("Elevon left", ELEVON_LEFT, 3.495, 3.517, black, owner)
    add_plate("Elevon right", ELEVON_RIGHT, 3.495, 3.517, black, owner)
    add_plate("Fin", FIN, 3.42, 3.43, colour["grey"], owner)
    engine = [(240, 392, 404, 3.47, 3.52), (252, 388, 412, 3.46, 3.54), (268, 388, 413, 3.46, 3.54)]
    add_loft("Engines", engine, black, owner)
    bell = [(248, 390, 398, 3.46, 3.50), (256, 386, 400, 3.45, 3.50), (264, 388, 400, 3.45, 3.50)]
    add_loft("Engine bell", bell, colour["grey"], owner)

    post = [(236, 414, 426, 3.57, 3.60), (283, 414, 426, 3.57, 3.60)]
    add_loft("Post", post, black, owner)
    foot = [(50 * metres, 0.002), (52 * metres, 0.0), (52 * metres, -0.008), (50 * metres, -0.011)]
    add_turned("Foot", foot, upright(420, 277, SHUTTLE_Y), colour["grey"], owner)


def add_stand(colour: dict) -> None:
    """The stand below the model, under a black cloth that reaches the floor."""
    rows = [
        (285, 369, 700, 3.46, 3.73), (288, 367, 700, 3.45, 3.74), (312, 366, 700, 3.45, 3.74),
        (340, 365.5, 700, 3.45, 3.74), (600, 360, 704, 3.45, 3.74), (770, 357, 707, 3.44, 3.75),
    ]  # fmt: skip
    add_loft("Draped stand", rows, colour["black cloth"], None, roundness=8.0)


# --- room -----------------------------------------------------------------------------------


def add_backdrop(surface) -> None:
    """A mottled studio cloth behind everything, and a floor of the same."""
    y, half, top = 4.6, 3.0, 3.2
    low = [Vector((-half, y, 0)), Vector((half, y, 0))]
    high = [Vector((half, y, top)), Vector((-half, y, top))]
    near = [Vector((half, -1, 0)), Vector((-half, -1, 0))]
    add_mesh("Backdrop", low + high, [(0, 1, 2, 3)], surface)
    add_mesh("Floor", low + near, [(3, 2, 1, 0)], surface)


def add_camera() -> None:
    """A camera that looks along y, tilted down by CAMERA_DOWN_DEG."""
    data = bpy.data.cameras.new("Camera")
    data.sensor_fit = "HORIZONTAL"
    data.sensor_width = SENSOR_WIDTH_MM
    data.lens = FOCAL_PX * SENSOR_WIDTH_MM / IMAGE_WH[0]
    data.clip_start, data.clip_end = 0.1, 100.0
    camera = bpy.data.objects.new("Camera", data)
    camera.location = CAMERA_AT
    camera.rotation_euler = (math.radians(90 - CAMERA_DOWN_DEG), 0, 0)
    bpy.context.scene.collection.objects.link(camera)
    bpy.context.scene.camera = camera


def add_light(name: str, at, aim, watts: float, size: float) -> None:
    """A square softbox at one point, aimed at another."""
    data = bpy.data.lights.new(name, "AREA")
    data.energy, data.size = watts, size
    light = bpy.data.objects.new(name, data)
    turn = (Vector(aim) - Vector(at)).to_track_quat("-Z", "Y").to_matrix().to_4x4()
    light.matrix_world = Matrix.Translation(at) @ turn
    bpy.context.scene.collection.objects.link(light)


def set_up_render() -> None:
    """The photo's size, Cycles, and a softly lit studio."""
    scene = bpy.context.scene
    scene.unit_settings.system = "METRIC"
    scene.render.engine = "CYCLES"
    scene.cycles.samples = 64
    scene.render.resolution_x, scene.render.resolution_y = IMAGE_WH
    scene.render.resolution_percentage = 100
    scene.view_settings.view_transform = "Standard"
    scene.world = bpy.data.worlds.new("Studio")
    background = scene.world.node_tree.nodes["Background"]
    background.inputs["Color"].default_value = (1.0, 0.97, 0.94, 1.0)
    background.inputs["Strength"].default_value = 0.16
    add_light("Key", (-0.9, 0.9, 2.3), (0.0, 2.8, 1.2), 42.0, 0.4)
    add_light("Fill", (1.3, 1.0, 1.9), (0.0, 2.8, 1.1), 10.0, 0.7)
    add_light("Background light", (0.0, 3.2, 2.6), (0.0, 4.6, 1.4), 42.0, 0.8)


def main() -> None:
    """Build the scene, from the back to the front."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    set_up_render()
    colour = palette()
    add_backdrop(colour["backdrop"])
    add_flag(colour)
    add_stand(colour)
    add_shuttle(colour)
    astronaut = add_group("Astronaut", "person")
    add_head(colour, astronaut)
    add_features(colour, astronaut)
    add_suit(colour, astronaut)
    add_neck_ring(colour, astronaut)
    add_helmet(colour)
    add_camera()


main()
