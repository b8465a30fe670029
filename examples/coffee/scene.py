"""Rebuild scikit-image's photo `coffee` (600 x 400) as a Blender scene.

An espresso in a red cup stands on a red saucer with a small spoon beside it, at the corner of a
worn wooden table. All lengths are metres; the world origin is on the table top, under the middle
of the saucer; z is up and y points away from the camera.

Labels, as custom properties on the owner of each instance:

    object         category         what it owns
    Cup            cup              an empty: the porcelain, the handle and the coffee are its parts
    Saucer         saucer           in LVIS only: COCO has no saucer
    Spoon          spoon            one mesh: bowl and handle
    Table          dining table     the board; the dark floor behind it stays unlabelled

How the camera was matched: the rim of the cup (outside and inside), its foot and the edge of the
saucer are circles, so their outlines in the photo are ellipses. Distance, elevation, roll and
aim were solved by least squares from points on these four ellipses with the saucer set to 15 cm;
each fits to 1.5 px rms or better. A focal length of 1500 px fits as well as 2500 px does; 1000 px
and 700 px fit worse.
"""

import math
import random

import bpy
from mathutils import Matrix, Vector

IMAGE_WH = (600, 400)
FOCAL_PX = 1500.0
SENSOR_WIDTH_MM = 36.0
CAMERA_AT = Vector((0.0, -0.30465, 0.48990))
CAMERA_AIM = Vector((0.00753, 0.01472, 0.0))
CAMERA_ROLL_DEG = 8.945

TABLE_THICKNESS = 0.04
TABLE_HEIGHT = 0.75
# Two points on the edge of the board.
TABLE_EDGE = (Vector((-0.1155, 0.0391)), Vector((-0.0660, 0.1042)))

CUP_AXIS = Vector((-0.0006, 0.0019, 0.0))
COFFEE_LEVEL = 0.0425
HANDLE_AZIMUTH_DEG = -107.2
HANDLE_WIDTH = 0.0122
HANDLE_THICKNESS = 0.0055

Vertices = list[Vector]
Faces = list[tuple[int, ...]]


# --- materials ------------------------------------------------------------------------------


def material(name: str, rgb: tuple[float, float, float], roughness: float, metallic: float = 0.0):
    """A plain Principled material; rgb is linear."""
    made = bpy.data.materials.new(name)
    shader = made.node_tree.nodes["Principled BSDF"]
    shader.inputs["Base Color"].default_value = (*rgb, 1.0)
    shader.inputs["Roughness"].default_value = roughness
    shader.inputs["Metallic"].default_value = metallic
    made.diffuse_color = (*rgb, 1.0)
    return made


def wood(name: str, dark: tuple[float, float, float], light: tuple[float, float, float]):
    """Wood whose grain is noise stretched along the object's x axis."""
    made = material(name, light, 0.45)
    nodes, links = made.node_tree.nodes, made.node_tree.links
    coordinates = nodes.new("ShaderNodeTexCoord")
    stretch = nodes.new("ShaderNodeMapping")
    stretch.inputs["Scale"].default_value = (6.0, 160.0, 20.0)
    noise = nodes.new("ShaderNodeTexNoise")
    noise.inputs["Scale"].default_value = 1.0
    noise.inputs["Detail"].default_value = 6.0
    ramp = nodes.new("ShaderNodeValToRGB")
    ramp.color_ramp.elements[0].position, ramp.color_ramp.elements[0].color = 0.3, (*dark, 1.0)
    ramp.color_ramp.elements[1].position, ramp.color_ramp.elements[1].color = 0.7, (*light, 1.0)
    links.new(coordinates.outputs["Object"], stretch.inputs["Vector"])
    links.new(stretch.outputs["Vector"], noise.inputs["Vector"])
    links.new(noise.outputs["Fac"], ramp.inputs["Fac"])
    links.new(ramp.outputs["Color"], nodes["Principled BSDF"].inputs["Base Color"])
    return made


# --- shapes ---------------------------------------------------------------------------------


def add_mesh(name: str, vertices: Vertices, faces: Faces, *materials, parent=None):
    """Link a smooth-shaded mesh object, and set its parent if it is part of something."""
    mesh = bpy.data.meshes.new(name)
    mesh.from_pydata(vertices, [], faces)
    mesh.validate()
    mesh.shade_smooth()
    for each in materials:
        mesh.materials.append(each)
    made = bpy.data.objects.new(name, mesh)
    made.parent = parent
    bpy.context.scene.collection.objects.link(made)
    return made


def lathe(profile: list[tuple[float, float]], segments: int = 72) -> tuple[Vertices, Faces]:
    """Turn a profile of (radius, z) about the z axis; faces come ring by ring along the profile."""
    vertices = [
        Vector((radius * math.cos(turn), radius * math.sin(turn), z))
        for radius, z in profile
        for turn in (math.tau * step / segments for step in range(segments))
    ]
    faces = []
    for ring in range(len(profile) - 1):
        for step in range(segments):
            after = (step + 1) % segments
            low, high = ring * segments, (ring + 1) * segments
            faces.append((low + step, low + after, high + after, high + step))
    return vertices, faces


def smooth(points: list[Vector], steps: int) -> list[Vector]:
    """A Catmull-Rom curve through the points, `steps` pieces between neighbours."""
    ends = [2 * points[0] - points[1], *points, 2 * points[-1] - points[-2]]
    curve = []
    for before, start, stop, after in zip(ends, ends[1:], ends[2:], ends[3:], strict=False):
        for step in range(steps):
            t = step / steps
            curve.append(
                0.5
                * (
                    2 * start
                    + (stop - before) * t
                    + (2 * before - 5 * start + 4 * stop - after) * t**2
                    + (3 * start - before - 3 * stop + after) * t**3
                )
            )
    return [*curve, points[-1]]


def sweep(path, sides, half_widths, half_thicknesses, corners: int = 16) -> tuple[Vertices, Faces]:
    """Sweep a rounded strap along a path; one side direction and two half sizes per point."""
    vertices: Vertices = []
    faces: Faces = []
    for index, centre in enumerate(path):
        along = (path[min(index + 1, len(path) - 1)] - path[max(index - 1, 0)]).normalized()
        normal = along.cross(sides[index]).normalized()
        for corner in range(corners):
            cos, sin = (trig(math.tau * corner / corners) for trig in (math.cos, math.sin))
            across = math.copysign(abs(cos) ** 0.6, cos) * half_widths[index]
            upward = math.copysign(abs(sin) ** 0.6, sin) * half_thicknesses[index]
            vertices.append(centre + across * sides[index] + upward * normal)
        if index:
            low, high = (index - 1) * corners, index * corners
            for corner in range(corners):
                after = (corner + 1) % corners
                faces.append((low + corner, low + after, high + after, high + corner))
    faces.append(tuple(range(corners)))
    faces.append(tuple(range(len(vertices) - corners, len(vertices))))
    return vertices, faces


# --- the things on the table ----------------------------------------------------------------

# Outside from the foot up, over the lip, and down the inside. White starts at CUP_WHITE_FROM.
CUP_PROFILE = [
    (0.0, 0.0080), (0.0265, 0.0080), (0.0275, 0.0062), (0.0292, 0.0060), (0.0300, 0.0070),
    (0.0305, 0.0110), (0.0317, 0.0190), (0.0338, 0.0280), (0.0370, 0.0390), (0.0393, 0.0500),
    (0.0402, 0.0600), (0.0405, 0.0700), (0.0403, 0.0742), (0.0399, 0.0760), (0.0385, 0.0770),
    (0.0366, 0.0773), (0.0349, 0.0769), (0.0336, 0.0757), (0.0328, 0.0735), (0.0324, 0.0600),
    (0.0318, 0.0500), (0.0306, 0.0400), (0.0285, 0.0280), (0.0230, 0.0170), (0.0, 0.0130),
]  # fmt: skip
CUP_WHITE_FROM = 12

# Top from the well to the edge, then back underneath to the foot ring.
SAUCER_PROFILE = [
    (0.0, 0.0058), (0.0270, 0.0058), (0.0330, 0.0062), (0.0400, 0.0078), (0.0520, 0.0112),
    (0.0640, 0.0146), (0.0720, 0.0168), (0.0742, 0.0172), (0.0750, 0.0166), (0.0749, 0.0152),
    (0.0735, 0.0140), (0.0640, 0.0108), (0.0480, 0.0060), (0.0400, 0.0036), (0.0385, 0.0000),
    (0.0360, 0.0000), (0.0340, 0.0030), (0.0, 0.0030),
]  # fmt: skip


def inside_radius(z: float) -> float:
    """Radius of the cup's inside wall at height z."""
    wall = CUP_PROFILE[CUP_WHITE_FROM + 5 :]
    for (r_high, z_high), (r_low, z_low) in zip(wall, wall[1:], strict=False):
        if z_low <= z <= z_high:
            return r_low + (r_high - r_low) * (z - z_low) / (z_high - z_low)
    raise ValueError(f"z = {z} m is outside the cup")


def add_cup(red, white, coffee) -> None:
    """The cup: a lathed body with a white lip and inside, a strap handle, and the coffee."""
    cup = bpy.data.objects.new("Cup", None)
    cup["category"] = "cup"
    cup.empty_display_size = 0.05
    cup.location = CUP_AXIS
    bpy.context.scene.collection.objects.link(cup)

    vertices, faces = lathe(CUP_PROFILE)
    body = add_mesh("Cup body", vertices, faces, red, white, parent=cup)
    per_ring = len(faces) // (len(CUP_PROFILE) - 1)
    for index, face in enumerate(body.data.polygons):
        face.material_index = int(index // per_ring >= CUP_WHITE_FROM)

    radius = inside_radius(COFFEE_LEVEL)
    surface = [(0.0, 0.0), (0.8 * radius, 0.0), (0.96 * radius, 0.0002), (radius, 0.0010)]
    surface = [(r, COFFEE_LEVEL + z) for r, z in surface]
    add_mesh("Coffee", *lathe(surface), coffee, parent=cup)
    add_mesh("Cup handle", *handle(), red, parent=cup)


def handle() -> tuple[Vertices, Faces]:
    """The strap handle: a loop in the vertical plane through the cup's axis."""
    turn = Matrix.Rotation(math.radians(HANDLE_AZIMUTH_DEG), 3, "Z")
    loop = [
        (0.0380, 0.0570), (0.0450, 0.0578), (0.0525, 0.0555), (0.0580, 0.0490),
        (0.0590, 0.0400), (0.0555, 0.0310), (0.0470, 0.0245), (0.0320, 0.0210),
    ]  # fmt: skip
    path = smooth([turn @ Vector((r, 0.0, z)) for r, z in loop], 4)
    side = turn @ Vector((0.0, 1.0, 0.0))
    count = len(path)
    return sweep(path, [side] * count, [HANDLE_WIDTH / 2] * count, [HANDLE_THICKNESS / 2] * count)


# Points of the spoon from the tip of its bowl to the end of its handle: x, y, z of the middle
# line at the height of the edge, half the width there, and how deep the metal hollows.
SPOON_STATIONS = [
    (0.0345, -0.0450, 0.0175, 0.0010, 0.0000),
    (0.0345, -0.0444, 0.0175, 0.0056, 0.0008),
    (0.0346, -0.0423, 0.0175, 0.0098, 0.0026),
    (0.0348, -0.0380, 0.0175, 0.0134, 0.0044),
    (0.0351, -0.0310, 0.0175, 0.0151, 0.0054),
    (0.0355, -0.0240, 0.0176, 0.0147, 0.0050),
    (0.0360, -0.0180, 0.0178, 0.0123, 0.0038),
    (0.0365, -0.0135, 0.0181, 0.0086, 0.0020),
    (0.0368, -0.0100, 0.0184, 0.0050, 0.0008),
    (0.0372, -0.0050, 0.0188, 0.0026, 0.0003),
    (0.0385, 0.0056, 0.0198, 0.0020, 0.0000),
    (0.0420, 0.0245, 0.0208, 0.0024, 0.0000),
    (0.0440, 0.0488, 0.0212, 0.0036, 0.0000),
    (0.0447, 0.0630, 0.0215, 0.0052, 0.0000),
    (0.0448, 0.0680, 0.0216, 0.0046, 0.0000),
    (0.0448, 0.0705, 0.0216, 0.0020, 0.0000),
]


def add_spoon(steel) -> None:
    """The spoon: rows of points across its length, bowed down in the bowl, given a thickness."""
    vertices: Vertices = []
    faces: Faces = []
    across = 13
    for row, (x, y, z, half_width, depth) in enumerate(SPOON_STATIONS):
        for column in range(across):
            side = 2.0 * column / (across - 1) - 1.0
            vertices.append(Vector((x + side * half_width, y, z - depth * (1.0 - side * side))))
        if row:
            for column in range(across - 1):
                low, high = (row - 1) * across + column, row * across + column
                faces.append((low, low + 1, high + 1, high))
    spoon = add_mesh("Spoon", vertices, faces, steel)
    spoon["category"] = "spoon"
    thickness = spoon.modifiers.new("Thickness", "SOLIDIFY")
    thickness.thickness = 0.0012
    rounding = spoon.modifiers.new("Rounding", "SUBSURF")
    rounding.levels = rounding.render_levels = 1


def add_saucer(red) -> None:
    """The saucer, lathed about the world's z axis."""
    saucer = add_mesh("Saucer", *lathe(SAUCER_PROFILE, segments=96), red)
    saucer["lvis_category"] = "saucer"


def add_table(board, floor) -> None:
    """A long board whose one edge runs behind the saucer, and the floor far below it."""
    start, stop = TABLE_EDGE
    along = (stop - start).normalized()
    inward = Vector((along.y, -along.x))
    length, depth = 1.6, 0.7
    corners = [
        start - along * length / 2, start + along * length / 2,
        start + along * length / 2 + inward * depth, start - along * length / 2 + inward * depth,
    ]  # fmt: skip
    vertices = [Vector((*corner, z)) for z in (0.0, -TABLE_THICKNESS) for corner in corners]
    faces = [(0, 3, 2, 1), (4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7)]
    # The mesh is given in a frame turned with the board, so that the grain follows its length.
    turn = Matrix.Rotation(math.atan2(along.y, along.x), 4, "Z")
    table = add_mesh("Table", [turn.inverted() @ vertex for vertex in vertices], faces, board)
    table.matrix_world = turn
    table["category"] = "dining table"
    table.data.shade_flat()
    edge = table.modifiers.new("Worn edge", "BEVEL")
    edge.width, edge.segments = 0.002, 2

    half, z = 3.0, -TABLE_HEIGHT
    square = [
        Vector((x, y, z)) for x, y in ((-half, -half), (half, -half), (half, half), (-half, half))
    ]
    add_mesh("Floor", square, [(0, 1, 2, 3)], floor)


def add_bubbles(foam, seed: int = 7, count: int = 9) -> None:
    """A few bubbles in the crema, toward the right, as in the photo."""
    draw = random.Random(seed)
    ball = [(0.00035 * math.sin(turn), 0.00035 * math.cos(turn)) for turn in (0.0, 0.5, 1.0, 1.57)]
    for number in range(count):
        bubble = add_mesh(f"Bubble {number}", *lathe(ball, 8), foam, parent=bpy.data.objects["Cup"])
        bubble.location = (draw.uniform(0.0, 0.02), draw.uniform(-0.02, 0.0), COFFEE_LEVEL)


# --- camera and light -----------------------------------------------------------------------


def add_camera() -> None:
    """A camera that looks at CAMERA_AIM and is then rolled about its own axis."""
    data = bpy.data.cameras.new("Camera")
    data.sensor_fit = "HORIZONTAL"
    data.sensor_width = SENSOR_WIDTH_MM
    data.lens = FOCAL_PX * SENSOR_WIDTH_MM / IMAGE_WH[0]
    data.clip_start, data.clip_end = 0.01, 100.0
    camera = bpy.data.objects.new("Camera", data)
    look = (CAMERA_AIM - CAMERA_AT).to_track_quat("-Z", "Y").to_matrix().to_4x4()
    roll = Matrix.Rotation(math.radians(CAMERA_ROLL_DEG), 4, "Z")
    camera.matrix_world = Matrix.Translation(CAMERA_AT) @ look @ roll
    bpy.context.scene.collection.objects.link(camera)
    bpy.context.scene.camera = camera


def add_light(name: str, at: Vector, watts: float, size: float, rgb) -> None:
    """A square area light that shines at the cup."""
    data = bpy.data.lights.new(name, "AREA")
    data.energy, data.size, data.color = watts, size, rgb
    light = bpy.data.objects.new(name, data)
    aim = (Vector((0.0, 0.0, 0.04)) - at).to_track_quat("-Z", "Y").to_matrix().to_4x4()
    light.matrix_world = Matrix.Translation(at) @ aim
    bpy.context.scene.collection.objects.link(light)


def set_up_render() -> None:
    """The photo's size, Cycles, and a dim warm room."""
    scene = bpy.context.scene
    scene.unit_settings.system = "METRIC"
    scene.render.engine = "CYCLES"
    scene.cycles.samples = 64
    scene.render.resolution_x, scene.render.resolution_y = IMAGE_WH
    scene.render.resolution_percentage = 100
    scene.view_settings.view_transform = "Standard"
    scene.world = bpy.data.worlds.new("Room")
    background = scene.world.node_tree.nodes["Background"]
    background.inputs["Color"].default_value = (1.0, 0.75, 0.55, 1.0)
    background.inputs["Strength"].default_value = 0.12


def main() -> None:
    """Build the scene, from the table up."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    set_up_render()
    red = material("Red glaze", (0.33, 0.022, 0.005), 0.12)
    white = material("White glaze", (0.84, 0.79, 0.73), 0.15)
    coffee = material("Crema", (0.58, 0.24, 0.045), 0.35)
    steel = material("Steel", (0.55, 0.50, 0.45), 0.12, metallic=1.0)
    board = wood("Wood", (0.15, 0.032, 0.008), (0.42, 0.14, 0.036))
    floor = material("Floor", (0.012, 0.009, 0.008), 0.9)
    add_table(board, floor)
    add_saucer(red)
    add_cup(red, white, coffee)
    add_bubbles(coffee)
    add_spoon(steel)
    add_light("Lamp", Vector((0.50, 0.40, 0.60)), 15.0, 0.18, (1.0, 0.86, 0.70))
    add_light("Window", Vector((-0.5, -0.5, 0.7)), 3.5, 0.3, (1.0, 0.88, 0.74))
    add_camera()


main()
