"""A cat's face, rebuilt in metres.

The photo is scikit-image's `chelsea` (451 x 300): a tabby turned a little to the right of the
picture, cut off by every border but the right one.  Run it with

    legoworld execute examples/chelsea/scene.py -o examples/chelsea

World frame: metres, z up, y away from the camera.  The camera stands at x = y = 0 and looks
level along y.  The photo carries no calibration: an 85 mm lens on a 36 mm wide sensor is
assumed, and the distance, 0.42 m to the middle of the head, follows from a cat's eyes being
about 50 mm apart.  Head and body are stacks of horizontal ellipses whose left and right tangents
from the camera meet the outline in the photo; everything on the face lies on the head's surface.

Labels: every part hangs from one Empty whose `category` is "cat", the name in COCO and in LVIS.
Cushions and wall are unlabelled background.
"""

import math

import bpy
from mathutils import Vector

IMAGE_SIZE_WH_PX = (451, 300)
LENS_MM = 85.0
SENSOR_WIDTH_MM = 36.0
CAMERA_HEIGHT_M = 0.25

# fmt: off
# Horizontal sections: (z, middle x, half width, middle y, half depth), top first.
HEAD = [
    (0.3426, -0.0092, 0.0129, 0.425, 0.02), (0.3378, -0.0097, 0.0242, 0.425, 0.035),
    (0.3258, -0.0081, 0.0368, 0.425, 0.05), (0.3138, -0.0076, 0.0435, 0.425, 0.057),
    (0.3016, -0.0072, 0.0483, 0.423, 0.06), (0.2896, -0.0074, 0.0535, 0.422, 0.062),
    (0.2808, -0.0077, 0.0575, 0.42, 0.064), (0.2768, -0.008, 0.0591, 0.42, 0.065),
    (0.2697, -0.0089, 0.0612, 0.42, 0.066), (0.2638, -0.0094, 0.0627, 0.42, 0.067),
    (0.2599, -0.0094, 0.0631, 0.42, 0.067), (0.2539, -0.009, 0.0622, 0.42, 0.068),
    (0.2492, -0.0087, 0.0607, 0.418, 0.068), (0.243, -0.0079, 0.0579, 0.415, 0.068),
    (0.2376, -0.0069, 0.0546, 0.412, 0.068), (0.2331, -0.0059, 0.0508, 0.41, 0.068),
    (0.2289, -0.0049, 0.0462, 0.408, 0.068), (0.2263, -0.0046, 0.0426, 0.407, 0.067),
    (0.2233, -0.004, 0.0394, 0.406, 0.066), (0.2177, -0.0007, 0.0351, 0.405, 0.064),
    (0.2121, 0.0025, 0.0316, 0.404, 0.06), (0.2076, 0.0047, 0.0286, 0.403, 0.055),
    (0.2039, 0.0069, 0.0247, 0.402, 0.05), (0.2007, 0.0091, 0.0194, 0.401, 0.042),
    (0.1982, 0.0106, 0.0127, 0.4, 0.03),
]
BODY = [
    (0.2793, -0.0645, 0.0275, 0.52, 0.03), (0.2754, -0.0629, 0.0309, 0.52, 0.035),
    (0.2725, -0.0586, 0.0364, 0.52, 0.045), (0.27, -0.0549, 0.0424, 0.52, 0.05),
    (0.2661, -0.0503, 0.0525, 0.52, 0.06), (0.2617, -0.0493, 0.0612, 0.52, 0.065),
    (0.2549, -0.0506, 0.0722, 0.52, 0.07), (0.2402, -0.054, 0.083, 0.52, 0.075),
    (0.2158, -0.0589, 0.0922, 0.52, 0.08), (0.1987, -0.0593, 0.0956, 0.52, 0.08),
    (0.1871, -0.0582, 0.0962, 0.515, 0.08), (0.1823, -0.057, 0.0974, 0.515, 0.08),
    (0.1775, -0.0559, 0.0985, 0.515, 0.08), (0.1581, -0.0545, 0.0999, 0.515, 0.08),
]
CHEST = [
    (0.25, -0.0477, 0.0158, 0.45, 0.015), (0.2437, -0.0482, 0.0247, 0.45, 0.025),
    (0.2373, -0.0479, 0.0308, 0.45, 0.032), (0.2289, -0.0432, 0.0387, 0.45, 0.04),
    (0.2162, -0.037, 0.0431, 0.45, 0.045), (0.2035, -0.0315, 0.0461, 0.45, 0.05),
    (0.1866, -0.0255, 0.0505, 0.45, 0.05), (0.1697, -0.024, 0.0512, 0.45, 0.05),
]

# Edges of the ears from base to tip: (x, y, z)
FAR_EAR_OUTER = [
    (0.0505, 0.425, 0.2787), (0.0531, 0.425, 0.2815), (0.0559, 0.425, 0.2851),
    (0.0585, 0.427, 0.2889), (0.0606, 0.43, 0.2936), (0.0625, 0.432, 0.2987),
    (0.0658, 0.435, 0.3039), (0.0689, 0.437, 0.3083), (0.0719, 0.44, 0.312), (0.0758, 0.44, 0.319),
    (0.0782, 0.442, 0.3264),
]
FAR_EAR_INNER = [
    (0.0433, 0.41, 0.2769), (0.0382, 0.405, 0.2835), (0.0345, 0.402, 0.2896),
    (0.0319, 0.402, 0.2953), (0.0305, 0.403, 0.3011), (0.0306, 0.405, 0.3059),
    (0.0333, 0.41, 0.3108), (0.0388, 0.415, 0.3155), (0.0491, 0.42, 0.3194), (0.0644, 0.43, 0.3235),
    (0.0776, 0.441, 0.3266),
]
NEAR_EAR_OUTER = [
    (-0.0731, 0.415, 0.2609), (-0.0766, 0.425, 0.2668), (-0.0781, 0.43, 0.2722),
    (-0.0781, 0.43, 0.2803), (-0.0777, 0.43, 0.2884), (-0.0775, 0.432, 0.2966),
    (-0.0768, 0.434, 0.305), (-0.0759, 0.436, 0.3114), (-0.0749, 0.437, 0.3173),
    (-0.072, 0.437, 0.3255), (-0.0671, 0.437, 0.3329),
]
NEAR_EAR_INNER = [
    (-0.0569, 0.39, 0.269), (-0.0516, 0.388, 0.2755), (-0.0484, 0.386, 0.2826),
    (-0.0469, 0.386, 0.2891), (-0.0468, 0.388, 0.2955), (-0.0477, 0.392, 0.3015),
    (-0.0495, 0.398, 0.3079), (-0.0523, 0.405, 0.3146), (-0.0559, 0.415, 0.3209),
    (-0.0605, 0.425, 0.3274), (-0.0665, 0.436, 0.3331),
]

# Drawn on the face: (x, z) seen from the camera at the face's depth, 0.36 m
NEAR_LID = [
    (-0.0292, 0.2703), (-0.0255, 0.2715), (-0.0205, 0.2716), (-0.0154, 0.271), (-0.011, 0.2689),
    (-0.0083, 0.2659), (-0.0073, 0.2615), (-0.0076, 0.2574), (-0.0093, 0.2541), (-0.0127, 0.252),
    (-0.0171, 0.2514), (-0.0215, 0.2524), (-0.0259, 0.2551), (-0.0289, 0.2591),
    (-0.0303, 0.2642), (-0.0303, 0.2679),
]
FAR_LID = [
    (0.0262, 0.2595), (0.0292, 0.2622), (0.0333, 0.2635), (0.0367, 0.2635), (0.0384, 0.2615),
    (0.039, 0.2578), (0.038, 0.2534), (0.0357, 0.2497), (0.0326, 0.2466), (0.0292, 0.2456),
    (0.0255, 0.2466), (0.0238, 0.2493), (0.0235, 0.253), (0.0242, 0.2564),
]
NOSE = [
    (0.0052, 0.2216), (0.0083, 0.2233), (0.0123, 0.2226), (0.0167, 0.2219), (0.0208, 0.2226),
    (0.0221, 0.2216), (0.0211, 0.2196), (0.0188, 0.2175), (0.0161, 0.2148), (0.013, 0.2125),
    (0.0103, 0.2121), (0.009, 0.2142), (0.0079, 0.2172), (0.0059, 0.2196),
]
MOUTH = [
    (0.0103, 0.2121), (0.01, 0.2101), (0.009, 0.2081),
]
STRIPES = [
    [
        (-0.0441, 0.2716), (-0.0492, 0.2703), (-0.0519, 0.2669), (-0.0566, 0.2635),
        (-0.0614, 0.2598),
    ],
    [
        (-0.0363, 0.2703), (-0.0407, 0.2716), (-0.0451, 0.2723),
    ],
    [
        (-0.0357, 0.2439), (-0.0424, 0.2405), (-0.0485, 0.2415), (-0.0559, 0.2466),
        (-0.0607, 0.2507),
    ],
    [
        (-0.0069, 0.3024), (-0.0066, 0.2939), (-0.0046, 0.2872), (-0.0039, 0.2804),
        (-0.0029, 0.272),
    ],
    [
        (-0.0002, 0.3007), (0.0008, 0.2923), (0.0049, 0.2855), (0.0069, 0.277),
    ],
    [
        (0.0123, 0.3024), (0.015, 0.2939), (0.0171, 0.2855),
    ],
    [
        (0.0201, 0.3007), (0.0218, 0.2923), (0.0211, 0.2838), (0.0198, 0.2737),
    ],
    [
        (0.0286, 0.2754), (0.0279, 0.2703), (0.0289, 0.2652),
    ],
    [
        (-0.0255, 0.2939), (-0.0228, 0.2872), (-0.0188, 0.2811),
    ],
    [
        (-0.034, 0.2906), (-0.0306, 0.2838), (-0.0255, 0.2784),
    ],
    [
        (-0.0289, 0.2449), (-0.0374, 0.25), (-0.0407, 0.2574),
    ],
    [
        (0.0353, 0.2415), (0.0404, 0.2439), (0.0431, 0.2473),
    ],
    [
        (-0.0066, 0.25), (-0.0046, 0.2449), (-0.0019, 0.2405),
    ],
]
WHISKERS = [
    [
        (-0.0199, 0.35, 0.2263), (-0.0337, 0.34, 0.2289), (-0.0528, 0.34, 0.2296),
        (-0.073, 0.345, 0.2267),
    ],
    [
        (-0.0215, 0.35, 0.2234), (-0.0401, 0.34, 0.2232), (-0.056, 0.34, 0.2203),
        (-0.073, 0.345, 0.2157),
    ],
    [
        (-0.0215, 0.35, 0.2204), (-0.0369, 0.34, 0.2168), (-0.0528, 0.34, 0.2111),
        (-0.0714, 0.345, 0.2027),
    ],
    [
        (-0.0199, 0.35, 0.2188), (-0.0337, 0.34, 0.2136), (-0.0465, 0.34, 0.2072),
        (-0.0569, 0.345, 0.2014),
    ],
    [
        (-0.0182, 0.35, 0.2171), (-0.0273, 0.34, 0.2117), (-0.0369, 0.34, 0.204),
        (-0.0423, 0.345, 0.1998),
    ],
    [
        (0.028, 0.37, 0.2757), (0.0326, 0.36, 0.2838), (0.0394, 0.36, 0.2933),
        (0.0509, 0.37, 0.3014),
    ],
]
# fmt: on

FACE_DISTANCE_M = 0.36


def material(name, rgb, roughness=0.7):
    """Return a plain principled material; rgb is linear, in 0..1."""
    made = bpy.data.materials.new(name)
    shader = made.node_tree.nodes["Principled BSDF"]
    shader.inputs["Base Color"].default_value = (*rgb, 1.0)
    shader.inputs["Roughness"].default_value = roughness
    made.diffuse_color = (*rgb, 1.0)
    return made


def add(name, data, parent=None):
    """Link an object made of `data` into the scene, below `parent`."""
    made = bpy.data.objects.new(name, data)
    bpy.context.scene.collection.objects.link(made)
    made.parent = parent
    return made


def mesh(name, vertices, faces, look, parent=None):
    """Add a smooth mesh object with one material."""
    data = bpy.data.meshes.new(name)
    data.from_pydata(vertices, [], faces)
    data.materials.append(look)
    data.validate()
    data.shade_smooth()
    return add(name, data, parent)


def stack(name, sections, look, parent=None, sides=36):
    """Skin a stack of horizontal ellipses (z, middle x, half width, middle y, half depth)."""
    vertices, faces = [], []
    for z, x, half_width, y, half_depth in sections:
        for k in range(sides):
            angle = 2 * math.pi * k / sides
            vertices.append((x + half_width * math.cos(angle), y + half_depth * math.sin(angle), z))
    for i in range(len(sections) - 1):
        for j in range(sides):
            a, b = i * sides + j, i * sides + (j + 1) % sides
            faces.append((a, a + sides, b + sides, b))
    faces.append(tuple(range(sides)))
    faces.append(tuple(reversed(range(len(vertices) - sides, len(vertices)))))
    return mesh(name, vertices, faces, look, parent)


def tube(name, paths, radius, look, parent):
    """Sweep a circle along smooth paths that thin out at both ends."""
    data = bpy.data.curves.new(name, "CURVE")
    data.dimensions, data.bevel_depth, data.bevel_resolution = "3D", radius, 1
    data.resolution_u, data.use_fill_caps = 6, True
    for points in paths:
        path = data.splines.new("BEZIER")
        path.bezier_points.add(len(points) - 1)
        for k, (knot, point) in enumerate(zip(path.bezier_points, points, strict=True)):
            knot.co = point
            knot.handle_left_type = knot.handle_right_type = "AUTO"
            knot.radius = 0.5 if k in (0, len(points) - 1) else 1.0
    data.materials.append(look)
    return add(name, data, parent)


def ball(name, centre, radii, look, parent, turn=(0, 0, 0)):
    """Add an ellipsoid with radii along its own x, y, z, turned by XYZ degrees."""
    sides, layers = 32, 16
    vertices = [(0, 0, radii[2]), (0, 0, -radii[2])]
    for i in range(1, layers):
        polar = math.pi * i / layers
        for j in range(sides):
            around = 2 * math.pi * j / sides
            x, y = math.sin(polar) * math.cos(around), math.sin(polar) * math.sin(around)
            vertices.append((radii[0] * x, radii[1] * y, radii[2] * math.cos(polar)))
    faces = []
    for j in range(sides):
        k = (j + 1) % sides
        last = 2 + (layers - 2) * sides
        faces += [(0, 2 + j, 2 + k), (1, last + k, last + j)]
        for i in range(layers - 2):
            a = 2 + i * sides
            faces.append((a + j, a + sides + j, a + sides + k, a + k))
    made = mesh(name, vertices, faces, look, parent)
    made.location = centre
    made.rotation_euler = [math.radians(angle) for angle in turn]
    return made


def face_depth(x_over_y, z_over_y):
    """Return y where the ray through (x / y, z / y) above the camera first meets the head."""
    y = FACE_DISTANCE_M
    for _ in range(8):
        _, middle_x, half_width, middle_y, half_depth = section_at(CAMERA_HEIGHT_M + z_over_y * y)
        a = (x_over_y / half_width) ** 2 + 1 / half_depth**2
        b = -2 * (x_over_y * middle_x / half_width**2 + middle_y / half_depth**2)
        c = (middle_x / half_width) ** 2 + (middle_y / half_depth) ** 2 - 1
        y = (-b - math.sqrt(max(b * b - 4 * a * c, 0.0))) / (2 * a)
    return y


def section_at(z):
    """Interpolate the head's section at height z."""
    for i in range(len(HEAD) - 1):
        high, low = HEAD[i], HEAD[i + 1]
        if low[0] <= z <= high[0]:
            share = (high[0] - z) / (high[0] - low[0])
            return [a + share * (b - a) for a, b in zip(high, low, strict=True)]
    return HEAD[0] if z > HEAD[0][0] else HEAD[-1]


def on_face(points_xz, lift=0.0):
    """Carry points drawn at FACE_DISTANCE_M along their rays onto the head, `lift` above it."""
    carried = []
    for x, z in points_xz:
        slope_x, slope_z = x / FACE_DISTANCE_M, (z - CAMERA_HEIGHT_M) / FACE_DISTANCE_M
        y = face_depth(slope_x, slope_z) - lift
        carried.append(Vector((slope_x * y, y, CAMERA_HEIGHT_M + slope_z * y)))
    return carried


def cap(name, outline_xz, bulge, look, cat, lift=0.0005):
    """Add a domed patch on the face inside an outline: an eyeball behind its lids, the nose."""
    rim = on_face(outline_xz, lift)
    middle = sum(rim, Vector()) / len(rim)
    towards_camera = (Vector((0, 0, CAMERA_HEIGHT_M)) - middle).normalized()
    vertices, faces = [middle + towards_camera * bulge], []
    count, layers = len(rim), 4
    for i in range(1, layers + 1):
        share = i / layers
        dome = towards_camera * bulge * math.sqrt(1 - share * share)
        vertices += [middle.lerp(point, share) + dome for point in rim]
    for j in range(count):
        k = (j + 1) % count
        faces.append((0, 1 + j, 1 + k))
        for i in range(layers - 1):
            a = 1 + i * count
            faces.append((a + j, a + count + j, a + count + k, a + k))
    return mesh(name, [tuple(vertex) for vertex in vertices], faces, look, cat)


def build_ear(name, outer, inner, look, cat):
    """Add a cupped ear between its outer and inner edge, a few millimetres thick."""
    columns, vertices, faces = 7, [], []
    for k, (a, b) in enumerate(zip(outer, inner, strict=True)):
        width = (Vector(a) - Vector(b)).length
        for j in range(columns):
            share = j / (columns - 1)
            point = Vector(a).lerp(Vector(b), share)
            point.y += 0.3 * width * math.sin(math.pi * share)
            vertices.append(tuple(point))
        if k:
            for j in range(columns - 1):
                first = (k - 1) * columns + j
                faces.append((first, first + 1, first + columns + 1, first + columns))
    ear = mesh(name, vertices, faces, look, cat)
    thickness = ear.modifiers.new("Thickness", "SOLIDIFY")
    thickness.thickness, thickness.offset = 0.002, 0.0
    return ear


def build_eye(name, lid_xz, pupil_xz, pupil_size, looks, cat):
    """Add an eye: domed iris, upright slit pupil, dark lid around it."""
    cap(f"{name} iris", lid_xz, 0.005, looks["iris"], cat, 0.001)
    x, y, z = on_face([pupil_xz], 0.0062)[0]
    ball(f"{name} pupil", (x, y, z), (pupil_size[0], 0.0012, pupil_size[1]), looks["dark"], cat)
    lid = on_face(lid_xz, 0.0015)
    tube(f"{name} lid", [[*lid, lid[0]]], 0.0013, looks["dark"], cat)


def build_face(looks, cat):
    """Add muzzle, nose, eyes, stripes and whiskers."""
    ball("Near whisker pad", (-0.0068, 0.352, 0.2193), (0.02, 0.018, 0.0125), looks["cream"], cat)
    ball("Far whisker pad", (0.0191, 0.353, 0.2162), (0.0105, 0.016, 0.0095), looks["cream"], cat)
    ball("Chin", (0.0066, 0.362, 0.2072), (0.02, 0.016, 0.007), looks["cream"], cat)
    ball(
        "Nose bridge",
        (0.0098, 0.352, 0.2368),
        (0.0105, 0.013, 0.027),
        looks["ginger"],
        cat,
        (-10, 0, 0),
    )
    cap("Nose", NOSE, 0.004, looks["nose"], cat, 0.015)
    tube("Mouth", [on_face(MOUTH, 0.017)], 0.0008, looks["dark"], cat)
    build_eye("Near eye", NEAR_LID, (-0.0181, 0.2632), (0.0036, 0.0066), looks, cat)
    build_eye("Far eye", FAR_LID, (0.0299, 0.2564), (0.0027, 0.0055), looks, cat)
    tube("Stripes", [on_face(stripe) for stripe in STRIPES], 0.0014, looks["stripe"], cat)
    tube("Whiskers", WHISKERS, 0.0002, looks["white"], cat)


def build_cat(looks):
    """Gather head, ears, face, body and chest under one labelled Empty."""
    cat = add("Cat", None)
    cat["category"] = "cat"
    stack("Head", HEAD, looks["fur"], cat)
    stack("Body", BODY, looks["fur"], cat)
    stack("Chest", CHEST, looks["white"], cat)
    build_ear("Far ear", FAR_EAR_OUTER, FAR_EAR_INNER, looks["pink"], cat)
    build_ear("Near ear", NEAR_EAR_OUTER, NEAR_EAR_INNER, looks["fur"], cat)
    build_face(looks, cat)


def build_background(looks):
    """Soft cushions and a wall, well out of focus in the photo."""
    cushions = (  # name, centre, radii
        ("Left cushion", (-0.19, 0.75, 0.3), (0.1, 0.12, 0.13), "cushion"),
        ("Right cushion", (0.24, 0.8, 0.26), (0.14, 0.1, 0.025), "cushion"),
        ("Low cushion", (0.27, 0.75, 0.15), (0.12, 0.1, 0.1), "cushion"),
        ("Blanket", (0.08, 0.85, 0.17), (0.1, 0.1, 0.07), "brown"),
    )
    for name, centre, radii, look in cushions:
        ball(name, centre, radii, looks[look], None)
    vertices = [(-2, 1.6, -1), (2, 1.6, -1), (2, 1.6, 2), (-2, 1.6, 2)]
    mesh("Wall", vertices, [(0, 1, 2, 3)], looks["brown"])


def build_light_and_camera():
    """One soft lamp from the upper left, a dim sky, and the level camera."""
    scene = bpy.context.scene
    world = bpy.data.worlds.new("World")
    world.node_tree.nodes["Background"].inputs["Color"].default_value = (1, 0.95, 0.9, 1)
    world.node_tree.nodes["Background"].inputs["Strength"].default_value = 0.6
    scene.world = world
    light = bpy.data.lights.new("Lamp", "AREA")
    light.energy, light.size = 9, 0.5
    lamp = add("Lamp", light)
    lamp.location, lamp.rotation_euler = (-0.3, -0.1, 0.8), (math.radians(45), 0, math.radians(-30))

    camera = bpy.data.cameras.new("Camera")
    camera.lens, camera.sensor_width, camera.sensor_fit = LENS_MM, SENSOR_WIDTH_MM, "HORIZONTAL"
    camera.clip_start = 0.05
    holder = add("Camera", camera)
    holder.location = (0, 0, CAMERA_HEIGHT_M)
    holder.rotation_euler = (math.radians(90), 0, 0)
    scene.camera = holder
    scene.render.resolution_x, scene.render.resolution_y = IMAGE_SIZE_WH_PX
    scene.render.resolution_percentage = 100
    scene.render.engine = "CYCLES"
    scene.cycles.samples = 16


def make_looks():
    """Return every material by name."""
    return {
        "fur": material("Tabby fur", (0.38, 0.24, 0.13), 0.9),
        "cream": material("Cream fur", (0.46, 0.32, 0.21), 0.9),
        "ginger": material("Ginger fur", (0.42, 0.24, 0.1), 0.9),
        "white": material("White fur", (0.6, 0.45, 0.38), 0.9),
        "stripe": material("Dark stripe", (0.08, 0.045, 0.025), 0.9),
        "pink": material("Inner ear", (0.5, 0.25, 0.22), 0.8),
        "nose": material("Nose", (0.4, 0.08, 0.03), 0.5),
        "iris": material("Iris", (0.3, 0.3, 0.06), 0.15),
        "dark": material("Dark", (0.012, 0.009, 0.008), 0.2),
        "cushion": material("Cushion", (0.6, 0.5, 0.48), 0.9),
        "brown": material("Brown cloth", (0.2, 0.13, 0.1), 0.9),
    }


def main():
    """Build the whole scene from an empty file."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    looks = make_looks()
    build_cat(looks)
    build_background(looks)
    build_light_and_camera()


main()
