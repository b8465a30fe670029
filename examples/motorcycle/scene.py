"""A parked motorcycle in a garage, rebuilt in metres.

The photo is scikit-image's `stereo_motorcycle()[0]` (741 x 500), the left view of the Motorcycle
pair of Middlebury 2014 (Scharstein et al., GCPR 2014).  Run it with

    legoworld execute examples/motorcycle/scene.py -o examples/motorcycle

World frame: metres, z up, the floor is z = 0, x runs right along the back wall and y towards it;
the camera stands above the origin.  Depth follows the published calibration at this size,
z = f b / (d + doffs) with f = 994.978 px, b = 0.193001 m, doffs = 31.086 px.  At that scale the
motorcycle is 1.4 m long, shorter than a real one; the published depth is kept.

Camera: focal length and principal point are the published calibration; height, pitch, roll and
heading come from planes fitted to the disparity of the floor and of the door.

Labels: `category` on the Empty (or mesh) that gathers an instance's parts, for both vocabularies;
`lvis_category` where LVIS has a name that COCO lacks (wheel, headlight, box, ...).  COCO sees one
motorcycle, bench and bicycle and two bottles.  Room, shelves and tubs carry no label.
"""

import math

import bpy
from mathutils import Matrix, Vector

IMAGE_SIZE_WH_PX = (741, 500)
FOCAL_PX = 994.978
PRINCIPAL_POINT_PX = (311.318, 255.002)  # pixel edges at integers: published value + 1/8
CAMERA_HEIGHT_M = 1.051
CAMERA_EULER_DEG = (75.850, -1.194, 17.307)  # XYZ; 14 degrees down, one of roll

# The motorcycle's own frame: origin on the floor under the rear axle, x forward, y to its left
# (away from the camera), z up.  It stands on its centre stand, so the rear wheel hangs.
BIKE_ORIGIN = (-0.985, 2.305, 0.0)
BIKE_YAW_DEG = 2.9
BIKE_LEAN_DEG = 1.5
FENDER_CENTRE = (0.969, -0.014, 0.245)  # a little behind the front axle
FENDER_ARC_DEG = (52, 171)  # from straight ahead, over the top
FENDER_EDGE_M, FENDER_RISE_M, FENDER_HALF_WIDTH_M = 0.230, 0.018, 0.050
HEADLAMP_AXIS = (0.75, -0.64, -0.12)
PAIR_SPREAD_DEG = 21  # between the two cast spokes of a pair
CLOCK_AXIS = (-0.62, 0.38, 0.68)
REAR_AXLE = (-0.012, 0.0, 0.244)
FRONT_AXLE = (0.973, -0.014, 0.244)
FRONT_AXLE_DIRECTION = (0.613, 0.724, 0.317)  # steered to the right, so the wheel leans too

BENCH_ORIGIN = (-1.82, 2.9, 0.0)
BENCH_YAW_DEG = 29.22

BICYCLE_FRONT_AXLE = (-2.634, 3.935, 0.153)
BICYCLE_REAR_AXLE = (-2.136, 4.04, 0.138)

# (height, half width, half depth) from the floor of each container up
RED_TUB_X = -0.149
RED_TUB = [(0.156, 0.135, 0.17), (0.38, 0.165, 0.2)]
RED_TUB_LID = [(0.38, 0.172, 0.207), (0.41, 0.172, 0.207)]

# Name, then (x low, x high, z low, z high) of the face towards the camera.
SHELF_BOARDS = (
    ("Top shelf", (-1.026, 0.275, 1.047, 1.117)),
    ("Upper shelf", (-1.033, 0.27, 0.677, 0.735)),
    ("Middle shelf", (-1.034, 0.288, 0.441, 0.509)),
    ("Bottom shelf", (-1.02, 0.316, 0.006, 0.069)),
)
# The same, then y of that face, depth, look and LVIS name.
BOXES = (
    ("Large carton", (-0.336, -0.128, 0.733, 0.965), 3.778, 0.2, "cardboard", "box"),
    ("Small carton", (-0.109, 0.032, 0.742, 0.859), 3.775, 0.15, "cardboard", "box"),
    ("Tall carton", (0.024, 0.25, 0.101, 0.434), 3.785, 0.25, "cardboard", "box"),
    ("Left carton", (-1.022, -0.786, 0.219, 0.436), 3.8, 0.25, "cardboard", "box"),
    ("Low carton", (-0.545, -0.406, 0.034, 0.246), 3.8, 0.25, "cardboard", "box"),
    ("Clementine crate right", (0.047, 0.18, 0.743, 0.815), 3.785, 0.12, "pale wood", "crate"),
    ("Clementine crate middle", (-0.813, -0.683, 0.596, 0.654), 3.83, 0.1, "blue", "crate"),
    ("Clementine crate left", (-0.961, -0.817, 0.546, 0.601), 3.785, 0.1, "blue", "crate"),
    ("White tub upper", (-0.969, -0.836, 0.758, 0.836), 3.9, 0.15, "white", None),
    ("White tub lower", (-0.183, 0.012, 0.491, 0.587), 3.778, 0.2, "white", None),
    ("Lid", (-0.129, 0.262, 0.584, 0.639), 3.82, 0.1, "white", None),
    ("Tray", (0.029, 0.384, 0.487, 0.541), 3.82, 0.15, "dark", None),
    ("Tool tray", (-1.027, -0.801, 0.468, 0.515), 3.8, 0.15, "dark", None),
    ("Wooden crate low", (-0.326, 0.02, 0.083, 0.157), 3.798, 0.2, "pale wood", None),
    ("Clutter", (-0.762, -0.463, 0.74, 0.797), 3.9, 0.05, "dark", None),
    ("Wall cloth", (-1.223, -0.995, 0.896, 1.109), 4.02, 0.06, "dark", None),
    ("Stud left", (-2.642, -2.576, -0.074, 1.115), 4.33, 0.05, "wood", None),
    ("Stud middle", (-2.309, -2.234, -0.038, 1.119), 4.3, 0.05, "wood", None),
    ("Door post", (-2.047, -1.971, -0.008, 1.122), 4.27, 0.1, "wood", None),
    ("Stud right", (-1.346, -1.277, 0.24, 1.131), 4.22, 0.05, "wood", None),
    ("Panel right", (-0.074, 0.104, 0.705, 1.15), 4.22, 0.05, "weathered wood", None),
)

# Shapes read off the photo's outlines, each on the plane of its own measured depth.  Metres, in
# the frame of the thing they belong to: (x, z) outlines for `plate`, (x, z low, z high, half
# width) stations for `body`, (x, y, z[, radius]) paths for `tube`.
# fmt: off
TRACED = {
    "Tail": [
        (-0.229, 0.504), (-0.208, 0.484), (-0.149, 0.528), (-0.1, 0.544), (-0.121, 0.548),
        (-0.208, 0.545),
    ],
    "Tail lamp": [
        (-0.283, 0.515), (-0.274, 0.55), (-0.259, 0.566), (-0.21, 0.572), (-0.213, 0.552),
        (-0.221, 0.507), (-0.273, 0.506),
    ],
    "Plate bracket": [
        (-0.282, 0.445), (-0.261, 0.462), (-0.249, 0.49), (-0.226, 0.494), (-0.23, 0.468),
        (-0.245, 0.445), (-0.265, 0.438),
    ],
    "License plate": [(-0.263, 0.447), (-0.256, 0.447), (-0.254, 0.405), (-0.261, 0.403)],
    "Grab bar": [
        (-0.081, -0.1, 0.567), (-0.107, -0.1, 0.593), (-0.122, -0.1, 0.632),
        (-0.128, -0.095, 0.668), (-0.129, -0.07, 0.691), (-0.126, -0.03, 0.693),
        (-0.127, 0.02, 0.682), (-0.128, 0.055, 0.661), (-0.124, 0.06, 0.639),
    ],
    "Inner fender": [
        (-0.033, 0.488), (0.02, 0.505), (0.08, 0.481), (0.125, 0.443), (0.169, 0.39),
        (0.228, 0.38), (0.324, 0.28), (0.268, 0.29), (0.216, 0.29), (0.169, 0.333),
        (0.124, 0.407), (0.072, 0.455), (0.02, 0.474),
    ],
    "Side cover": [
        (0.217, 0.401), (0.399, 0.492), (0.385, 0.461), (0.355, 0.368), (0.334, 0.31),
        (0.285, 0.352), (0.247, 0.373),
    ],
    "Crankcase": [
        (0.37, 0.228), (0.36, 0.258), (0.359, 0.296), (0.371, 0.334), (0.4, 0.357),
        (0.424, 0.369), (0.416, 0.391), (0.433, 0.408), (0.462, 0.413), (0.495, 0.414),
        (0.518, 0.393), (0.527, 0.352), (0.594, 0.341), (0.627, 0.337), (0.638, 0.355),
        (0.642, 0.338), (0.634, 0.31), (0.644, 0.291), (0.639, 0.257), (0.609, 0.231),
        (0.547, 0.201), (0.491, 0.197), (0.404, 0.208),
    ],
    "Cylinder block": [
        (0.525, 0.343), (0.525, 0.468), (0.539, 0.484), (0.572, 0.481), (0.583, 0.453),
        (0.611, 0.451), (0.633, 0.477), (0.682, 0.437), (0.649, 0.393), (0.609, 0.346),
        (0.581, 0.331),
    ],
    "Cylinder head": [
        (0.566, 0.457), (0.563, 0.512), (0.625, 0.514), (0.652, 0.499), (0.684, 0.48),
        (0.692, 0.458), (0.682, 0.433), (0.63, 0.418), (0.582, 0.426),
    ],
    "Rear cam cover": [
        (0.525, 0.477), (0.526, 0.502), (0.533, 0.52), (0.556, 0.521), (0.571, 0.511),
        (0.574, 0.496), (0.563, 0.476), (0.535, 0.473),
    ],
    "Front cam cover": [
        (0.627, 0.457), (0.639, 0.497), (0.655, 0.503), (0.676, 0.493), (0.675, 0.471),
        (0.663, 0.443), (0.64, 0.441),
    ],
    "Carburettor": [
        (0.422, 0.481), (0.442, 0.497), (0.476, 0.5), (0.491, 0.481), (0.499, 0.457),
        (0.488, 0.436), (0.474, 0.407), (0.444, 0.405), (0.439, 0.432), (0.423, 0.451),
    ],
    "Airbox": [
        (0.376, 0.477), (0.425, 0.493), (0.45, 0.395), (0.411, 0.348), (0.368, 0.271),
        (0.337, 0.262), (0.353, 0.373),
    ],
    "Engine core": [(0.467, 0.512), (0.571, 0.52), (0.586, 0.411), (0.497, 0.383)],
    "Silencer": [
        (0.658, -0.06, 0.417, 0.011), (0.676, -0.07, 0.392, 0.013), (0.684, -0.08, 0.359, 0.013),
        (0.678, -0.085, 0.315, 0.013), (0.659, -0.09, 0.272, 0.013), (0.631, -0.095, 0.236, 0.013),
        (0.597, -0.1, 0.209, 0.015), (0.559, -0.105, 0.198, 0.015), (0.495, -0.11, 0.192, 0.013),
        (0.409, -0.115, 0.198, 0.013), (0.33, -0.12, 0.213, 0.018), (0.238, -0.135, 0.236, 0.023),
        (0.14, -0.15, 0.264, 0.028), (0.044, -0.168, 0.304, 0.03), (-0.011, -0.178, 0.325, 0.026),
    ],
    "Far header": [
        (0.655, 0.06, 0.399), (0.67, 0.06, 0.385), (0.679, 0.06, 0.354), (0.678, 0.05, 0.316),
        (0.667, 0.04, 0.27), (0.65, 0.03, 0.232), (0.618, 0.02, 0.195),
    ],
    "Swing arm": [
        (0.14, 0.298), (0.166, 0.314), (0.271, 0.309), (0.308, 0.313), (0.359, 0.287),
        (0.363, 0.23), (0.325, 0.226), (0.271, 0.249), (0.181, 0.269),
    ],
    "Foot rest bracket": [
        (0.311, 0.303), (0.328, 0.315), (0.356, 0.307), (0.365, 0.249), (0.373, 0.205),
        (0.336, 0.193), (0.325, 0.231), (0.332, 0.258),
    ],
    "Rear brake arm": [
        (-0.069, 0.206), (-0.013, 0.207), (0.028, 0.189), (0.083, 0.181), (0.091, 0.162),
        (0.019, 0.146), (0, 0.172), (-0.056, 0.174),
    ],
    "Stand near leg": [
        (0.318, -0.05, 0.175), (0.342, -0.05, 0.153), (0.353, -0.06, 0.126),
        (0.36, -0.075, 0.079), (0.361, -0.085, 0.018),
    ],
    "Stand far leg": [
        (0.312, 0, 0.149), (0.338, 0.05, 0.099), (0.349, 0.065, 0.066), (0.365, 0.085, 0.013),
    ],
    "Stand foot": [
        (0.338, 0.012), (0.348, 0.008), (0.371, 0.019), (0.379, 0.034), (0.384, 0.032),
        (0.384, 0.018), (0.372, 0.005), (0.343, 0.003),
    ],
    "Brake caliper": [
        (0.837, 0.268), (0.846, 0.304), (0.867, 0.326), (0.888, 0.291), (0.901, 0.25),
        (0.874, 0.242), (0.85, 0.254),
    ],
    "Fender stay": [
        (0.836, 0.416), (0.858, 0.447), (0.89, 0.445), (0.894, 0.422), (0.887, 0.397),
        (0.888, 0.355), (0.874, 0.354), (0.862, 0.394), (0.846, 0.403),
    ],
    "Headlamp ears": [
        (0.713, 0.717), (0.765, 0.709), (0.825, 0.641), (0.764, 0.618), (0.735, 0.649),
    ],
    "Frame head": [
        (0.666, 0.607), (0.712, 0.618), (0.724, 0.58), (0.693, 0.551), (0.654, 0.526),
        (0.664, 0.571),
    ],
    "Brake hose": [
        (0.734, -0.05, 0.559), (0.753, -0.05, 0.52), (0.753, -0.05, 0.479), (0.765, -0.05, 0.436),
        (0.791, -0.05, 0.394), (0.828, -0.05, 0.363), (0.841, -0.05, 0.332),
    ],
    "Speedometer cable": [(0.826, 0, 0.609), (0.833, 0, 0.55), (0.842, 0, 0.465)],
    "Clock bracket": [
        (0.702, 0.802), (0.738, 0.823), (0.754, 0.798), (0.732, 0.748), (0.708, 0.769),
    ],
    "Right switch gear": [
        (0.471, 0.742), (0.474, 0.765), (0.492, 0.78), (0.519, 0.786), (0.55, 0.812),
        (0.568, 0.806), (0.578, 0.786), (0.572, 0.752), (0.54, 0.723), (0.517, 0.733),
        (0.489, 0.73),
    ],
    "Right bar": [
        (0.473, -0.107, 0.736), (0.53, -0.1, 0.765), (0.573, -0.09, 0.791), (0.601, -0.07, 0.767),
        (0.625, -0.055, 0.752), (0.661, -0.04, 0.731), (0.706, -0.02, 0.716),
    ],
    "Brake lever": [
        (0.54, -0.13, 0.748), (0.524, -0.135, 0.725), (0.503, -0.14, 0.707),
        (0.494, -0.147, 0.684), (0.488, -0.15, 0.662), (0.485, -0.15, 0.643),
    ],
    "Left bar": [
        (0.737, 0, 0.733), (0.72, 0.05, 0.772), (0.709, 0.07, 0.811), (0.702, 0.082, 0.85),
        (0.705, 0.1, 0.876), (0.722, 0.12, 0.882), (0.755, 0.135, 0.868),
    ],
    "Left switch gear": [
        (0.699, 0.861), (0.707, 0.881), (0.735, 0.884), (0.755, 0.873), (0.764, 0.847),
        (0.748, 0.839), (0.721, 0.848), (0.705, 0.842),
    ],
    "Throttle cable": [
        (0.578, -0.08, 0.76), (0.596, -0.07, 0.737), (0.629, -0.06, 0.723), (0.663, -0.05, 0.721),
        (0.703, -0.04, 0.708),
    ],
    "Right mirror": [
        (0.366, 0.799), (0.454, 0.838), (0.461, 0.831), (0.46, 0.807), (0.436, 0.789),
        (0.383, 0.763), (0.374, 0.765),
    ],
    "Left mirror": [
        (0.73, 1.034), (0.736, 1.02), (0.726, 0.977), (0.706, 0.949), (0.702, 0.952),
        (0.708, 0.991), (0.721, 1.01),
    ],
    "Bicycle saddle": [
        (-2.274, 0.436, 0.445, 0.015), (-2.246, 0.422, 0.451, 0.015),
        (-2.218, 0.414, 0.455, 0.015), (-2.19, 0.41, 0.459, 0.015), (-2.162, 0.411, 0.457, 0.015),
        (-2.133, 0.413, 0.454, 0.015),
    ],
    "Paddle white blade": [
        (-2.771, 4.15, 0.459, 0.01), (-2.797, 4.14, 0.386, 0.04), (-2.824, 4.13, 0.289, 0.06),
        (-2.83, 4.12, 0.167, 0.05),
    ],
    "Paddle blue blade": [
        (-2.691, 4.05, 0.422, 0.01), (-2.701, 4.05, 0.355, 0.055), (-2.712, 4.05, 0.259, 0.075),
        (-2.72, 4.05, 0.114, 0.06),
    ],
    "Paddle right blade": [
        (-2.712, 4.16, 0.461, 0.01), (-2.705, 4.16, 0.389, 0.035), (-2.693, 4.16, 0.293, 0.045),
        (-2.694, 4.16, 0.171, 0.04),
    ],
    "Tank": [
        (0.325, 0.533, 0.54, 0.054), (0.349, 0.519, 0.57, 0.067), (0.373, 0.503, 0.587, 0.08),
        (0.397, 0.487, 0.604, 0.087), (0.421, 0.496, 0.619, 0.089), (0.445, 0.504, 0.634, 0.092),
        (0.469, 0.512, 0.65, 0.095), (0.493, 0.519, 0.663, 0.098), (0.517, 0.522, 0.675, 0.1),
        (0.541, 0.525, 0.685, 0.1), (0.565, 0.525, 0.693, 0.1), (0.589, 0.525, 0.7, 0.1),
        (0.613, 0.523, 0.706, 0.098), (0.637, 0.527, 0.71, 0.093), (0.661, 0.547, 0.704, 0.087),
        (0.685, 0.595, 0.634, 0.075),
    ],
    "Seat": [
        (-0.113, 0.648, 0.645, 0.09), (-0.089, 0.57, 0.652, 0.093), (-0.066, 0.56, 0.651, 0.098),
        (-0.042, 0.559, 0.645, 0.1), (-0.018, 0.557, 0.639, 0.102), (0.006, 0.556, 0.637, 0.104),
        (0.03, 0.551, 0.637, 0.105), (0.053, 0.545, 0.638, 0.106), (0.077, 0.536, 0.639, 0.107),
        (0.101, 0.521, 0.638, 0.108), (0.125, 0.502, 0.624, 0.109), (0.149, 0.479, 0.607, 0.11),
        (0.172, 0.462, 0.596, 0.109), (0.196, 0.458, 0.589, 0.108), (0.22, 0.465, 0.584, 0.107),
        (0.244, 0.484, 0.584, 0.106), (0.268, 0.499, 0.588, 0.105), (0.291, 0.513, 0.595, 0.103),
        (0.315, 0.531, 0.603, 0.099), (0.339, 0.549, 0.61, 0.095), (0.363, 0.567, 0.61, 0.091),
        (0.387, 0.586, 0.592, 0.075),
    ],
    "Rear fender": [
        (-0.225, 0.447, 0.45, 0.071), (-0.2, 0.457, 0.484, 0.076), (-0.176, 0.475, 0.507, 0.082),
        (-0.151, 0.49, 0.529, 0.088), (-0.126, 0.502, 0.546, 0.091), (-0.101, 0.509, 0.555, 0.092),
        (-0.076, 0.509, 0.559, 0.094), (-0.052, 0.509, 0.559, 0.095), (-0.027, 0.51, 0.559, 0.097),
        (-0.002, 0.511, 0.556, 0.098), (0.023, 0.51, 0.551, 0.1), (0.048, 0.508, 0.545, 0.101),
        (0.072, 0.498, 0.535, 0.102), (0.097, 0.484, 0.521, 0.102), (0.122, 0.466, 0.502, 0.103),
        (0.147, 0.442, 0.478, 0.104), (0.172, 0.413, 0.461, 0.105), (0.197, 0.393, 0.457, 0.104),
        (0.221, 0.399, 0.466, 0.102), (0.246, 0.412, 0.485, 0.1), (0.271, 0.425, 0.5, 0.099),
        (0.296, 0.439, 0.516, 0.097), (0.321, 0.452, 0.535, 0.095), (0.345, 0.465, 0.535, 0.093),
        (0.37, 0.478, 0.516, 0.092), (0.395, 0.491, 0.495, 0.09),
    ],
    "Frame tube": [
        (0.398, -0.085, 0.488), (0.376, -0.09, 0.425), (0.356, -0.095, 0.362),
        (0.334, -0.1, 0.305), (0.332, -0.1, 0.245),
    ],
    "Shock": [(0.219, -0.09, 0.393), (0.276, -0.093, 0.346), (0.333, -0.095, 0.293)],
    "Brake pedal": [
        (0.372, -0.13, 0.217), (0.412, -0.13, 0.219), (0.441, -0.13, 0.225),
        (0.456, -0.13, 0.239), (0.472, -0.13, 0.241),
    ],
    "Head cable": [
        (0.648, -0.03, 0.524), (0.684, -0.05, 0.551), (0.718, -0.06, 0.567), (0.741, -0.06, 0.574),
    ],
    "Low cable": [(0.657, -0.03, 0.495), (0.71, -0.04, 0.494), (0.754, -0.05, 0.498)],
    "Yoke cable": [(0.782, -0.05, 0.594), (0.798, -0.05, 0.559), (0.791, -0.05, 0.528)],
    "Clutch lever": [
        (0.751, 0.13, 0.859), (0.776, 0.12, 0.851), (0.795, 0.11, 0.846), (0.81, 0.1, 0.839),
    ],
    "Right mirror stalk": [
        (0.441, -0.178, 0.803), (0.474, -0.15, 0.801), (0.496, -0.135, 0.794),
        (0.506, -0.125, 0.783), (0.511, -0.12, 0.767),
    ],
    "Left mirror stalk": [
        (0.721, 0.187, 0.972), (0.738, 0.18, 0.978), (0.733, 0.175, 0.957), (0.722, 0.155, 0.922),
        (0.714, 0.13, 0.886),
    ],
    "near fork leg": [
        (-2.624, 3.885, 0.17), (-2.567, 3.9, 0.246), (-2.534, 3.92, 0.305), (-2.525, 3.95, 0.343),
    ],
    "far fork leg": [
        (-2.639, 3.98, 0.171), (-2.601, 3.985, 0.239), (-2.56, 3.985, 0.308),
        (-2.534, 3.98, 0.347),
    ],
    "head tube": [(-2.544, 3.97, 0.325), (-2.531, 3.98, 0.394)],
    "top tube": [
        (-2.531, 3.985, 0.361), (-2.437, 3.99, 0.301), (-2.341, 4, 0.278), (-2.268, 4.01, 0.3),
    ],
    "down tube": [(-2.532, 3.985, 0.337), (-2.44, 3.99, 0.25), (-2.37, 4, 0.183)],
    "seat tube": [(-2.263, 4.01, 0.319), (-2.296, 4, 0.24), (-2.355, 4, 0.17)],
    "seat stay": [(-2.269, 4.02, 0.304), (-2.214, 4.03, 0.259), (-2.14, 4.04, 0.198)],
    "seat post": [(-2.263, 4.01, 0.315), (-2.246, 4.01, 0.366), (-2.224, 4.01, 0.409)],
    "stem": [(-2.531, 3.98, 0.389), (-2.512, 3.97, 0.433), (-2.51, 3.96, 0.457)],
    "handlebar": [
        (-2.498, 3.87, 0.579), (-2.485, 3.88, 0.561), (-2.494, 3.9, 0.536), (-2.515, 3.96, 0.457),
        (-2.527, 4.03, 0.471), (-2.563, 4.1, 0.503),
    ],
    "brake cable": [
        (-2.489, 3.9, 0.523), (-2.521, 3.88, 0.456), (-2.524, 3.88, 0.402), (-2.524, 3.95, 0.366),
    ],
    "crank": [(-2.41, 3.97, 0.171), (-2.338, 3.97, 0.172), (-2.307, 3.97, 0.165)],
    "Paddle white": [(-2.817, 4.2, 0.888), (-2.762, 4.13, 0.58), (-2.715, 4.08, 0.351)],
    "Paddle blue": [(-2.736, 4.2, 0.968), (-2.74, 4.13, 0.675), (-2.698, 4.05, 0.403)],
    "Paddle right": [(-2.746, 4.25, 0.875), (-2.728, 4.2, 0.623), (-2.712, 4.16, 0.446)],
}
# fmt: on


# ---------------------------------------------------------------- building blocks


def material(name, rgb, roughness=0.6, metallic=0.0):
    """Return a plain principled material; rgb is linear, in 0..1."""
    made = bpy.data.materials.new(name)
    shader = made.node_tree.nodes["Principled BSDF"]
    shader.inputs["Base Color"].default_value = (*rgb, 1.0)
    shader.inputs["Roughness"].default_value = roughness
    shader.inputs["Metallic"].default_value = metallic
    made.diffuse_color = (*rgb, 1.0)
    return made


def add(name, data, parent=None, place=None):
    """Link an object made of `data`; `place` is its matrix in the parent's frame."""
    made = bpy.data.objects.new(name, data)
    bpy.context.scene.collection.objects.link(made)
    made.parent = parent
    if place is not None:
        made.matrix_local = place
    return made


def frame(name, origin, rotation=None, parent=None, **labels):
    """Add an Empty that holds parts together; `labels` become its custom properties."""
    place = Matrix.Translation(origin) @ (rotation or Matrix.Identity(4))
    made = add(name, None, parent, place)
    made.empty_display_size = 0.1
    for key, value in labels.items():
        made[key] = value
    return made


def mesh(name, vertices, faces, look, parent=None, place=None, smooth=True):
    """Add a mesh object with one material."""
    data = bpy.data.meshes.new(name)
    data.from_pydata(vertices, [], faces)
    data.materials.append(look)
    data.validate()
    if smooth:
        data.shade_smooth()
    return add(name, data, parent, place)


def bevel(target, width, segments=2):
    """Round the edges of `target` by `width` metres."""
    modifier = target.modifiers.new("Bevel", "BEVEL")
    modifier.width, modifier.segments, modifier.limit_method = width, segments, "ANGLE"
    return target


def rings(name, loops, look, parent=None):
    """Skin a list of equally long vertex loops and cap both ends."""
    count = len(loops[0])
    vertices = [point for loop in loops for point in loop]
    faces = []
    for i in range(len(loops) - 1):
        a, b = i * count, (i + 1) * count
        for j in range(count):
            k = (j + 1) % count
            faces.append((a + j, a + k, b + k, b + j))
    faces.append(tuple(reversed(range(count))))
    faces.append(tuple(range(len(vertices) - count, len(vertices))))
    return mesh(name, vertices, faces, look, parent)


def body(name, stations, look, parent, squareness=0.7, middle_y=0.0, sides=20):
    """Loft superellipse sections along x; a station is (x, z low, z high, half width)."""
    loops = []
    for x, z_low, z_high, half_width in stations:
        centre, half_height = (z_low + z_high) / 2, (z_high - z_low) / 2
        loop = []
        for k in range(sides):
            angle = 2 * math.pi * k / sides
            across, up = math.cos(angle), math.sin(angle)
            across = math.copysign(abs(across) ** squareness, across)
            up = math.copysign(abs(up) ** squareness, up)
            loop.append((x, middle_y + half_width * across, centre + half_height * up))
        loops.append(loop)
    return rings(name, loops, look, parent)


def towards(axis, origin=(0, 0, 0)):
    """Return the placement that carries local z onto `axis` and the origin to `origin`."""
    turn = Vector(axis).to_track_quat("Z", "Y").to_matrix().to_4x4()
    return Matrix.Translation(origin) @ turn


def lathe(name, profile, look, parent=None, place=None, sides=40, closed=False):
    """Turn a profile of (radius, height) around local z."""
    loops = []
    for k in range(sides):
        angle = 2 * math.pi * k / sides
        c, s = math.cos(angle), math.sin(angle)
        loops.append([(radius * c, radius * s, height) for radius, height in profile])
    count = len(profile)
    vertices = [point for loop in loops for point in loop]
    faces = []
    for i in range(sides):
        a, b = i * count, (i + 1) % sides * count
        for j in range(count if closed else count - 1):
            k = (j + 1) % count
            faces.append((a + j, b + j, b + k, a + k))
    return mesh(name, vertices, faces, look, parent, place)


def hoop(name, section, look, parent):
    """Turn a closed section of (radius, height) pairs into a ring around the parent's z."""
    return lathe(name, section, look, parent, sides=64, closed=True)


def strands(name, paths, radius, look, parent=None):
    """Sweep a circle along smooth paths; a fourth number in a point is its own radius."""
    data = bpy.data.curves.new(name, "CURVE")
    data.dimensions, data.bevel_depth, data.bevel_resolution = "3D", radius, 2
    data.resolution_u, data.use_fill_caps = 6, True
    for points in paths:
        path = data.splines.new("BEZIER")
        path.bezier_points.add(len(points) - 1)
        for knot, point in zip(path.bezier_points, points, strict=True):
            knot.co = point[:3]
            knot.handle_left_type = knot.handle_right_type = "AUTO"
            knot.radius = point[3] / radius if len(point) == 4 else 1.0
    data.materials.append(look)
    return add(name, data, parent)


def tube(name, points, radius, look, parent=None):
    """Sweep a circle along one smooth path."""
    return strands(name, [points], radius, look, parent)


def rod(name, start, end, radius, look, parent=None):
    """Add a straight cylinder between two points."""
    start, end = Vector(start), Vector(end)
    profile = [(0, 0), (radius, 0), (radius, (end - start).length), (0, (end - start).length)]
    made = lathe(name, profile, look, parent, towards(end - start, start), sides=20)
    made.modifiers.new("Sharp ends", "EDGE_SPLIT")
    return made


def block(name, low, high, look, parent=None, round_by=0.004, place=None):
    """Add a box between two corners, with rounded edges."""
    (x0, y0, z0), (x1, y1, z1) = low, high
    vertices = [(x, y, z) for x in (x0, x1) for y in (y0, y1) for z in (z0, z1)]
    faces = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    return bevel(mesh(name, vertices, faces, look, parent, place, smooth=False), round_by)


def plate(name, outline_xz, y_near, y_far, look, parent, round_by=0.006):
    """Extrude an outline in the x-z plane from y_near to y_far, edges rounded."""
    count = len(outline_xz)
    vertices = [(x, y, z) for y in (y_near, y_far) for x, z in outline_xz]
    faces = [tuple(range(count)), tuple(reversed(range(count, 2 * count)))]
    for i in range(count):
        j = (i + 1) % count
        faces.append((j, i, count + i, count + j))
    made = mesh(name, vertices, faces, look, parent, smooth=False)
    return bevel(made, round_by) if round_by else made


def beam(name, start, end, width, thickness, look, parent=None, flat=(0, 1, 0)):
    """Add a plank from start to end: `width` across, `thickness` along the direction `flat`."""
    start, end = Vector(start), Vector(end)
    along = (end - start).normalized()
    depth = (Vector(flat) - along * along.dot(Vector(flat))).normalized()
    across = depth.cross(along)
    turn = Matrix((across, depth, along)).transposed().to_4x4()
    w, d, length = width / 2, thickness / 2, (end - start).length
    place = Matrix.Translation(start) @ turn
    return block(name, (-w, -d, 0), (w, d, length), look, parent, 0.003, place)


# ---------------------------------------------------------------- wheels


def wheel_frame(name, bike, axle, direction):
    """Add the Empty of a wheel: its z is the axle (away from the camera), its x points forward."""
    z = Vector(direction).normalized()
    x = z.cross(Vector((0, 0, 1))).normalized()
    turn = Matrix((x, z.cross(x), z)).transposed().to_4x4()
    return frame(name, axle, turn, bike)


def tyre_profile(rim_radius, outer_radius, half_width):
    """Return the closed section of a tyre as (radius, axial) pairs."""
    middle, half_height = (rim_radius + outer_radius) / 2, (outer_radius - rim_radius) / 2
    section = []
    for k in range(16):
        angle = 2 * math.pi * k / 16
        section.append((middle + half_height * math.cos(angle), half_width * math.sin(angle)))
    return section


def rim_profile(inner_radius, outer_radius, half_width):
    """Return the closed section of a cast rim: two flanges and a well between them."""
    well = inner_radius + 0.3 * (outer_radius - inner_radius)
    return [
        (inner_radius, -0.6 * half_width),
        (outer_radius, -half_width),
        (outer_radius, -0.8 * half_width),
        (well, -0.4 * half_width),
        (well, 0.4 * half_width),
        (outer_radius, 0.8 * half_width),
        (outer_radius, half_width),
        (inner_radius, 0.6 * half_width),
    ]


def cast_spokes(wheel, pairs, inner_radius, outer_radius, start_deg, sweep_deg, look):
    """Add pairs of swept cast spokes; angles run from straight ahead over the top."""
    paths = []
    for k in range(2 * pairs):
        base = start_deg + (k // 2) * 360 / pairs + (k % 2) * PAIR_SPREAD_DEG
        points = []
        for step in range(4):
            share = step / 3
            radius = inner_radius + share * (outer_radius - inner_radius)
            angle = math.radians(base + share * sweep_deg)
            points.append((radius * math.cos(angle), -radius * math.sin(angle), 0.0))
        paths.append(points)
    strands(f"{wheel.name} spokes", paths, 0.0065, look, wheel)


def build_rear_wheel(bike, looks):
    """Rear wheel: fat tyre, cast rim, drum hub."""
    wheel = wheel_frame("Rear wheel", bike, REAR_AXLE, (-0.0305, 0.9993, 0.004))
    wheel["lvis_category"] = "wheel"
    hoop("Rear tyre", tyre_profile(0.155, 0.2245, 0.05), looks["rubber"], wheel)
    hoop("Rear rim", rim_profile(0.134, 0.157, 0.042), looks["alloy"], wheel)
    hub = [
        (0, -0.045),
        (0.05, -0.04),
        (0.055, -0.02),
        (0.078, 0.0),
        (0.078, 0.03),
        (0.035, 0.045),
        (0, 0.05),
    ]
    lathe("Rear hub", hub, looks["alloy"], wheel)
    cast_spokes(wheel, 5, 0.05, 0.137, 18, 36, looks["alloy"])


def build_front_wheel(bike, looks):
    """Front wheel: narrow tyre, rim, and the brake disc on the near side."""
    wheel = wheel_frame("Front wheel", bike, FRONT_AXLE, FRONT_AXLE_DIRECTION)
    wheel["lvis_category"] = "wheel"
    hoop("Front tyre", tyre_profile(0.187, 0.246, 0.031), looks["rubber"], wheel)
    hoop("Front rim", rim_profile(0.166, 0.193, 0.026), looks["alloy"], wheel)
    hub = [(0, -0.04), (0.03, -0.04), (0.034, -0.02), (0.034, 0.03), (0, 0.035)]
    lathe("Front hub", hub, looks["black"], wheel)
    disc = [(0.058, -0.034), (0.094, -0.034), (0.094, -0.029), (0.058, -0.029)]
    hoop("Brake disc", disc, looks["chrome"], wheel)
    carrier = [(0.02, -0.036), (0.06, -0.033), (0.06, -0.028), (0.02, -0.026)]
    hoop("Disc carrier", carrier, looks["black"], wheel)
    cast_spokes(wheel, 5, 0.03, 0.175, -39, 43, looks["black"])


def build_front_fender(bike, looks):
    """Front mudguard: an arched shell swept around the front wheel."""
    holder = wheel_frame("Front fender frame", bike, FENDER_CENTRE, FRONT_AXLE_DIRECTION)
    first_deg, last_deg = FENDER_ARC_DEG
    vertices, faces = [], []
    for step in range(17):
        angle = math.radians(first_deg + (last_deg - first_deg) * step / 16)
        for k in range(9):
            lean = math.pi * (k / 8 - 0.5)
            radius = FENDER_EDGE_M + FENDER_RISE_M * math.cos(lean)
            across = FENDER_HALF_WIDTH_M * math.sin(lean)
            vertices.append((radius * math.cos(angle), -radius * math.sin(angle), across))
    for i in range(16):
        for j in range(8):
            a = 9 * i + j
            faces.append((a, a + 1, a + 10, a + 9))
    shell = mesh("Front fender", vertices, faces, looks["red"], holder)
    shell.modifiers.new("Thickness", "SOLIDIFY").thickness = 0.004


# ---------------------------------------------------------------- motorcycle body


def build_bodywork(bike, looks):
    """Tank, seat, tail and side covers."""
    body("Tank", TRACED["Tank"], looks["red"], bike, 0.8)
    body("Seat", TRACED["Seat"], looks["black"], bike, 0.6)
    body("Rear fender", TRACED["Rear fender"], looks["red"], bike, 0.5)
    plate("Tail", TRACED["Tail"], -0.065, 0.03, looks["red"], bike, 0.008)
    lamp = plate("Tail lamp", TRACED["Tail lamp"], -0.07, -0.005, looks["red glass"], bike, 0.006)
    lamp["lvis_category"] = "taillight"
    plate("Plate bracket", TRACED["Plate bracket"], -0.06, -0.02, looks["black"], bike)
    plate("License plate", TRACED["License plate"], -0.074, 0.03, looks["grey"], bike, 0.001)
    tube("Grab bar", TRACED["Grab bar"], 0.0105, looks["chrome"], bike)
    plate("Inner fender", TRACED["Inner fender"], -0.06, 0.06, looks["black"], bike)
    plate("Side cover", TRACED["Side cover"], -0.1, 0.1, looks["black"], bike)


# ---------------------------------------------------------------- engine and exhaust


def build_engine(bike, looks):
    """Crankcase, clutch cover, finned cylinders and heads, carburettor."""
    plate("Crankcase", TRACED["Crankcase"], -0.085, 0.085, looks["alloy"], bike, 0.012)
    clutch = [(0, -0.05), (0.034, -0.05), (0.037, -0.047), (0.06, -0.04), (0.068, -0.02), (0.07, 0)]
    place = towards((0, 1, 0), (0.436, -0.085, 0.277))
    lathe("Clutch cover", clutch, looks["alloy"], bike, place)
    plate("Cylinder block", TRACED["Cylinder block"], -0.07, 0.07, looks["dark alloy"], bike)
    plate("Cylinder head", TRACED["Cylinder head"], -0.06, 0.08, looks["alloy"], bike)
    plate("Rear cam cover", TRACED["Rear cam cover"], -0.085, 0.085, looks["alloy"], bike)
    plate("Front cam cover", TRACED["Front cam cover"], -0.085, 0.085, looks["alloy"], bike)
    for k in range(10):
        share = k / 9
        rear = Vector((0.526, -0.088, 0.356)).lerp(Vector((0.527, -0.088, 0.465)), share)
        front = Vector((0.617, -0.088, 0.352)).lerp(Vector((0.68, -0.088, 0.437)), share)
        middle = rear.lerp(front, 0.45) + Vector((0, 0, -0.012))
        edge = [(point.x, point.z) for point in (rear, middle, front)]
        fin = edge + [(x, z + 0.003) for x, z in reversed(edge)]
        plate(f"Fin {k}", fin, -0.088, 0.088, looks["alloy"], bike, 0.0)
    plate("Carburettor", TRACED["Carburettor"], -0.055, 0.055, looks["alloy"], bike, 0.01)
    plate("Airbox", TRACED["Airbox"], -0.05, 0.05, looks["black"], bike)
    plate("Engine core", TRACED["Engine core"], -0.02, 0.05, looks["black"], bike)
    rod("Intake", (0.481, -0.02, 0.458), (0.526, -0.02, 0.451), 0.02, looks["black"], bike)


def build_exhaust(bike, looks):
    """Two header pipes that end in the near-side silencer."""
    tube("Silencer", TRACED["Silencer"], 0.0135, looks["chrome"], bike)
    tube("Far header", TRACED["Far header"], 0.0125, looks["chrome"], bike)


def build_running_gear(bike, looks):
    """Frame tubes, swing arm, foot rests, centre stand."""
    tube("Frame tube", TRACED["Frame tube"], 0.0085, looks["black"], bike)
    tube("Shock", TRACED["Shock"], 0.008, looks["black"], bike)
    plate("Swing arm", TRACED["Swing arm"], -0.11, -0.09, looks["alloy"], bike)
    plate("Foot rest bracket", TRACED["Foot rest bracket"], -0.118, -0.09, looks["black"], bike)
    rod("Foot rest", (0.36, -0.11, 0.221), (0.374, -0.17, 0.245), 0.014, looks["black"], bike)
    rod("Passenger rest", (0.149, -0.12, 0.288), (0.163, -0.21, 0.317), 0.014, looks["grey"], bike)
    tube("Brake pedal", TRACED["Brake pedal"], 0.006, looks["chrome"], bike)
    plate("Rear brake arm", TRACED["Rear brake arm"], -0.03, 0.0, looks["alloy"], bike)
    beam("Stay", (0.053, -0.1, 0.311), (0.191, -0.1, 0.429), 0.02, 0.015, looks["pale"], bike)
    tube("Stand near leg", TRACED["Stand near leg"], 0.0075, looks["grey"], bike)
    tube("Stand far leg", TRACED["Stand far leg"], 0.0075, looks["grey"], bike)
    plate("Stand foot", TRACED["Stand foot"], -0.095, -0.08, looks["grey"], bike, 0.002)
    block("Stand bar", (0.31, -0.05, 0.165), (0.36, 0.05, 0.185), looks["black"], bike)


# ---------------------------------------------------------------- steering


def build_fork(bike, looks):
    """Two fork legs with their lower sliders, and the yoke between them."""
    chrome, alloy, black = looks["chrome"], looks["alloy"], looks["black"]
    rod("Near stanchion", (0.7, -0.077, 0.698), (0.828, -0.075, 0.43), 0.0115, chrome, bike)
    rod("Near slider", (0.823, -0.075, 0.437), (0.936, -0.075, 0.207), 0.0155, alloy, bike)
    rod("Near fork collar", (0.824, -0.075, 0.442), (0.833, -0.075, 0.421), 0.0205, alloy, bike)
    rod("Far stanchion", (0.803, 0.024, 0.686), (0.907, 0.028, 0.471), 0.0115, chrome, bike)
    rod("Far fork collar", (0.904, 0.028, 0.48), (0.913, 0.028, 0.461), 0.02, alloy, bike)
    rod("Far slider", (0.907, 0.028, 0.471), (1.023, 0.028, 0.222), 0.0155, alloy, bike)
    beam("Lower yoke", (0.728, -0.08, 0.587), (0.844, 0.03, 0.629), 0.034, 0.03, black, bike)
    beam("Upper yoke", (0.693, -0.08, 0.707), (0.793, 0.03, 0.732), 0.03, 0.03, black, bike)
    plate("Brake caliper", TRACED["Brake caliper"], -0.06, -0.02, looks["black"], bike)
    plate("Fender stay", TRACED["Fender stay"], -0.065, -0.055, looks["red"], bike, 0.002)
    plate("Headlamp ears", TRACED["Headlamp ears"], -0.06, -0.02, black, bike)
    plate("Frame head", TRACED["Frame head"], -0.03, 0.03, black, bike)
    tube("Head cable", TRACED["Head cable"], 0.006, black, bike)
    tube("Low cable", TRACED["Low cable"], 0.003, black, bike)
    tube("Yoke cable", TRACED["Yoke cable"], 0.005, black, bike)
    rod("Steering head", (0.676, 0, 0.73), (0.749, -0.02, 0.584), 0.026, looks["black"], bike)
    tube("Brake hose", TRACED["Brake hose"], 0.0045, looks["black"], bike)
    tube("Speedometer cable", TRACED["Speedometer cable"], 0.0035, looks["black"], bike)


def build_lamps(bike, looks):
    """Headlamp and the three turn signals in view."""
    lamp = frame(
        "Headlamp", (0.822, -0.13, 0.746), towards(HEADLAMP_AXIS), bike, lvis_category="headlight"
    )
    bucket = [(0, -0.085), (0.04, -0.08), (0.062, -0.055), (0.076, 0.0), (0.07, 0.004)]
    lathe("Headlamp bucket", bucket, looks["chrome"], lamp)
    lathe("Headlamp lens", [(0.07, 0.004), (0.05, 0.012), (0, 0.017)], looks["glass"], lamp)
    signals = (
        ("Front right", (0.694, -0.215, 0.684), (0.718, -0.1, 0.694), (0.95, -0.25, 0.0), 0.0255),
        ("Front left", (0.883, 0.04, 0.781), (0.849, -0.03, 0.79), (0.95, -0.3, 0.0), 0.024),
        ("Rear right", (-0.046, -0.205, 0.525), (-0.031, -0.097, 0.507), (-1, 0.05, 0.0), 0.0265),
    )
    lens = [(0, -1), (0.5, -1), (0.85, -0.65), (1, 0), (0.97, 0.65), (0.6, 0.93), (0, 0.96)]
    for name, centre, root, axis, radius in signals:
        shape = [(share * radius, height * radius) for share, height in lens]
        lathe(f"{name} signal", shape, looks["amber"], bike, towards(axis, centre), sides=24)
        rod(f"{name} signal stem", root, centre, 0.007, looks["chrome"], bike)


def build_clocks(bike, looks):
    """Speedometer and tachometer on their bracket."""
    clock = [(0, -0.05), (0.033, -0.05), (0.038, -0.03), (0.04, 0.0), (0.04, 0.02), (0, 0.022)]
    speed, revs = (0.7, -0.12, 0.788), (0.761, -0.05, 0.824)
    lathe("Speedometer", clock, looks["black"], bike, towards(CLOCK_AXIS, speed), sides=28)
    lathe("Tachometer", clock, looks["black"], bike, towards(CLOCK_AXIS, revs), sides=28)
    plate("Clock bracket", TRACED["Clock bracket"], -0.1, -0.06, looks["black"], bike)


def build_handlebar(bike, looks):
    """Bars, grips, switch gear, levers and a cable."""
    rod("Right grip", (0.418, -0.12, 0.684), (0.474, -0.107, 0.732), 0.0125, looks["black"], bike)
    plate("Right switch gear", TRACED["Right switch gear"], -0.135, -0.095, looks["black"], bike)
    tube("Right bar", TRACED["Right bar"], 0.0085, looks["chrome"], bike)
    tube("Brake lever", TRACED["Brake lever"], 0.006, looks["black"], bike)
    tube("Left bar", TRACED["Left bar"], 0.0085, looks["chrome"], bike)
    plate("Left switch gear", TRACED["Left switch gear"], 0.115, 0.15, looks["black"], bike)
    tube("Clutch lever", TRACED["Clutch lever"], 0.0045, looks["black"], bike)
    tube("Throttle cable", TRACED["Throttle cable"], 0.004, looks["black"], bike)


def build_mirrors(bike, looks):
    """Two mirrors on stalks."""
    right = plate("Right mirror", TRACED["Right mirror"], -0.19, -0.175, looks["chrome"], bike)
    right["lvis_category"] = "rearview_mirror"
    tube("Right mirror stalk", TRACED["Right mirror stalk"], 0.004, looks["chrome"], bike)
    left = plate("Left mirror", TRACED["Left mirror"], 0.18, 0.195, looks["chrome"], bike, 0.003)
    left["lvis_category"] = "rearview_mirror"
    tube("Left mirror stalk", TRACED["Left mirror stalk"], 0.005, looks["chrome"], bike)


def build_motorcycle(looks):
    """Gather every part under one labelled Empty."""
    turn = Matrix.Rotation(math.radians(BIKE_YAW_DEG), 4, "Z")
    lean = Matrix.Rotation(math.radians(BIKE_LEAN_DEG), 4, "X")
    bike = frame("Motorcycle", BIKE_ORIGIN, turn @ lean, category="motorcycle")
    build_rear_wheel(bike, looks)
    build_front_wheel(bike, looks)
    build_front_fender(bike, looks)
    build_bodywork(bike, looks)
    build_engine(bike, looks)
    build_exhaust(bike, looks)
    build_running_gear(bike, looks)
    build_fork(bike, looks)
    build_lamps(bike, looks)
    build_clocks(bike, looks)
    build_handlebar(bike, looks)
    build_mirrors(bike, looks)


# ---------------------------------------------------------------- bench and bicycle


def build_bench(looks):
    """Garden bench: posts, rails, slats and two crosses in the back, seat and one arm seen."""
    turn = Matrix.Rotation(math.radians(BENCH_YAW_DEG), 4, "Z")
    bench = frame("Bench", BENCH_ORIGIN, turn, category="bench")
    wood = looks["weathered wood"]
    back = (  # name, start, end, width: planks of the back, read off the photo on its plane
        ("Back post left", (0.004, 0.395, 0.648), (0.011, 0.35, 0.299), 0.034),
        ("Back leg left", (0.012, 0.35, 0.307), (0.014, 0.352, 0.011), 0.03),
        ("Back post right", (0.839, 0.395, 0.668), (0.867, 0.35, 0.144), 0.032),
        ("Top rail left half", (0.019, 0.39, 0.612), (0.423, 0.39, 0.627), 0.055),
        ("Top rail right half", (0.42, 0.39, 0.627), (0.834, 0.39, 0.617), 0.055),
        ("Lower rail", (0.024, 0.355, 0.359), (0.859, 0.355, 0.356), 0.028),
        ("Slat 1", (0.047, 0.385, 0.59), (0.05, 0.355, 0.366), 0.022),
        ("Slat 2", (0.092, 0.385, 0.59), (0.094, 0.355, 0.365), 0.022),
        ("Slat 3", (0.336, 0.385, 0.592), (0.338, 0.355, 0.361), 0.021),
        ("Slat 4", (0.381, 0.385, 0.592), (0.383, 0.355, 0.36), 0.021),
        ("Slat 5", (0.422, 0.385, 0.592), (0.425, 0.355, 0.359), 0.021),
        ("Slat 6", (0.466, 0.385, 0.592), (0.466, 0.355, 0.359), 0.021),
        ("Slat 7", (0.509, 0.385, 0.592), (0.512, 0.355, 0.358), 0.021),
        ("Slat 8", (0.757, 0.385, 0.598), (0.764, 0.355, 0.353), 0.021),
        ("Slat 9", (0.8, 0.385, 0.598), (0.811, 0.355, 0.353), 0.021),
        ("Cross 1 down", (0.108, 0.38, 0.587), (0.331, 0.358, 0.376), 0.026),
        ("Cross 1 up", (0.108, 0.355, 0.365), (0.329, 0.38, 0.586), 0.026),
        ("Cross 2 down", (0.528, 0.38, 0.588), (0.741, 0.358, 0.393), 0.026),
        ("Cross 2 up", (0.524, 0.355, 0.389), (0.731, 0.38, 0.591), 0.026),
    )
    for name, start, end, width in back:
        beam(f"Bench {name}", start, end, width, 0.022, wood, bench)
    seat = (
        ("front post left", (-0.011, 0, 0.425), (-0.007, -0.002, 0.009), 0.031),
        ("front rail", (0.007, -0.005, 0.287), (0.563, -0.005, 0.276), 0.041),
        ("side rail", (0.015, 0.0, 0.285), (0.015, 0.34, 0.31), 0.035),
    )
    for name, start, end, width in seat:
        beam(f"Bench {name}", start, end, width, 0.03, wood, bench)
    for k in range(4):
        y = 0.04 + 0.085 * k
        block(f"Bench seat slat {k}", (0.04, y, 0.29), (0.84, y + 0.06, 0.312), wood, bench)
    bolster = [(0.14, -0.01, 0.335), (0.16, 0.14, 0.345), (0.2, 0.3, 0.35)]
    tube("Bench seat bolster", bolster, 0.021, wood, bench)
    block("Bench right arm", (0.815, -0.005, 0.0), (0.85, 0.03, 0.437), wood, bench)
    brace = (-0.019, 0.34, 0.004), (0.015, 0.34, 0.104)
    beam("Bench brace", brace[0], brace[1], 0.02, 0.02, wood, bench)


def build_bicycle_wheels(bicycle, looks):
    """Two spoked wheels."""
    for name, centre, axis in (
        ("front", BICYCLE_FRONT_AXLE, (0.12, 0.99, 0.02)),
        ("rear", BICYCLE_REAR_AXLE, (0.0, 1.0, 0.0)),
    ):
        place = towards(axis, centre)
        wheel = frame(f"Bicycle {name} wheel", (0, 0, 0), place, bicycle, lvis_category="wheel")
        title, alloy = f"Bicycle {name}", looks["alloy"]
        hoop(f"{title} tyre", tyre_profile(0.118, 0.151, 0.02), looks["rubber"], wheel)
        hoop(f"{title} rim", rim_profile(0.108, 0.12, 0.012), alloy, wheel)
        lathe(f"{title} hub", [(0, -0.03), (0.012, -0.03), (0.012, 0.03), (0, 0.03)], alloy, wheel)
        paths = []
        for k in range(14):
            angle = math.pi * k / 14
            end = (0.113 * math.cos(angle), 0.113 * math.sin(angle), 0)
            paths.append([end, (-end[0], -end[1], 0)])
        strands(f"{title} spokes", paths, 0.0016, alloy, wheel)


def build_bicycle(looks):
    """Child's bicycle behind the bench: wheels, fork, frame, saddle, handlebar."""
    bicycle = frame("Bicycle", (0, 0, 0), category="bicycle")
    build_bicycle_wheels(bicycle, looks)
    red, black = looks["red"], looks["black"]
    tubes = (  # name, points, radius
        ("near fork leg", TRACED["near fork leg"], 0.009, red),
        ("far fork leg", TRACED["far fork leg"], 0.008, red),
        ("head tube", TRACED["head tube"], 0.014, red),
        ("top tube", TRACED["top tube"], 0.011, red),
        ("down tube", TRACED["down tube"], 0.011, red),
        ("seat tube", TRACED["seat tube"], 0.01, red),
        ("seat stay", TRACED["seat stay"], 0.007, red),
        ("seat post", TRACED["seat post"], 0.009, black),
        ("stem", TRACED["stem"], 0.009, black),
        ("handlebar", TRACED["handlebar"], 0.009, black),
        ("brake cable", TRACED["brake cable"], 0.003, black),
        ("crank", TRACED["crank"], 0.008, looks["alloy"]),
    )
    for name, points, radius, look in tubes:
        tube(f"Bicycle {name}", points, radius, look, bicycle)
    body("Bicycle saddle", TRACED["Bicycle saddle"], black, bicycle, 0.8, 4.02)


# ---------------------------------------------------------------- garage


def build_room(looks):
    """Floor, back wall and door."""
    block("Floor", (-6, -1, -0.1), (6, 6, 0), looks["concrete"])
    block("Wall", (-6, 4.35, 0), (6, 4.5, 3), looks["plywood"])
    block("Wall right", (-1.281, 4.24, 0), (6, 4.35, 3), looks["plywood"])
    x0, x1, _, _ = (-1.939, -1.351, -0.018, 1.147)
    block("Door", (x0, 4.2, 0.0), (x1, 4.35, 2.0), looks["white"])


def build_shelves(looks):
    """Steel rack: boards on slotted posts."""
    for name, (x0, x1, z0, z1) in SHELF_BOARDS:
        block(name, (x0, 3.76, z0), (x1, 4.2, z1), looks["steel"], round_by=0.002)
    posts = (
        ("Post left", (-1.038, -1.013, -0.042, 1.124)),
        ("Post mid left", (-0.382, -0.36, 0.028, 1.133)),
        ("Post mid right", (-0.351, -0.329, 0.031, 1.133)),
        ("Post right", (0.251, 0.277, 0.073, 1.142)),
    )
    for name, (x0, x1, _, z1) in posts:
        block(name, (x0, 3.74, 0), (x1, 3.77, z1), looks["steel"], round_by=0.001)


def build_goods(looks):
    """Boxes, crates, tubs, bottles and a paint can on the shelves; paddles against the wall."""
    for name, (x0, x1, z0, z1), y, depth, look, lvis_name in BOXES:
        made = block(name, (x0, y, z0), (x1, y + depth, z1), looks[look])
        if lvis_name:
            made["lvis_category"] = lvis_name
    tub = container("Red tub", (RED_TUB_X, 4.0), RED_TUB, looks["red"])
    container("Red tub lid", (RED_TUB_X, 4.0), RED_TUB_LID, looks["red"]).parent = tub
    build_bottles(looks)
    for name, shaft, blade in (
        ("Paddle white", TRACED["Paddle white"], TRACED["Paddle white blade"]),
        ("Paddle blue", TRACED["Paddle blue"], TRACED["Paddle blue blade"]),
        ("Paddle right", TRACED["Paddle right"], TRACED["Paddle right blade"]),
    ):
        paddle = frame(name, (0, 0, 0), lvis_category="paddle")
        tube(f"{name} shaft", shaft, 0.011, looks["dark"], paddle)
        tube(f"{name} blade", blade, 0.03, looks["navy" if "blue" in name else "white"], paddle)


def container(name, centre_xy, sections, look, squareness=0.35):
    """Stack rounded-square sections (height, half width, half depth) into a bottle or tub."""
    loops = []
    for z, half_width, half_depth in sections:
        loop = []
        for k in range(20):
            angle = 2 * math.pi * k / 20
            c, s = math.cos(angle), math.sin(angle)
            dx = math.copysign(abs(c) ** squareness, c) * half_width
            dy = math.copysign(abs(s) ** squareness, s) * half_depth
            loop.append((centre_xy[0] + dx, centre_xy[1] + dy, z))
        loops.append(loop)
    return rings(name, loops, look)


def build_bottles(looks):
    """Add the yellow car-wash bottle, the grey oil bottle and the blue paint can."""
    x0, x1, z0, z1 = (-0.822, -0.755, 0.73, 0.861)
    x, half = (x0 + x1) / 2, (x1 - x0) / 2
    wash = [(z0, half - 0.003, 0.02), (z0 + 0.006, half, 0.022), (z1 - 0.006, half, 0.022)]
    wash += [(z1, half - 0.004, 0.02), (z1 + 0.003, 0.011, 0.011)]
    bottle = container("Car wash bottle", (x, 3.84), wash, looks["yellow"], 0.5)
    bottle["category"] = "bottle"
    cap = [(z1 + 0.001, 0.0105, 0.0105), (z1 + 0.024, 0.0105, 0.0105)]
    container("Car wash cap", (x, 3.84), cap, looks["black"], 0.9).parent = bottle

    x0, x1, z0, z1 = (-0.562, -0.492, 0.775, 0.853)
    x, half = (x0 + x1) / 2, (x1 - x0) / 2
    oil = [(z0, half, 0.025), (z1 - 0.004, half, 0.025), (z1, half - 0.006, 0.022)]
    bottle = container("Oil bottle", (x, 4.025), oil, looks["grey plastic"], 0.4)
    bottle["category"] = "bottle"
    x0, x1, z0, z1 = (-0.512, -0.493, 0.853, 0.892)
    neck = [(z0 - 0.005, 0.022, 0.02), (z0 + 0.012, 0.012, 0.012), (z1, 0.01, 0.01)]
    container(
        "Oil bottle neck", ((x0 + x1) / 2, 4.025), neck, looks["grey plastic"], 0.9
    ).parent = bottle
    cap = [(z1 - 0.002, 0.011, 0.011), (z1 + 0.012, 0.011, 0.011)]
    container("Oil bottle cap", ((x0 + x1) / 2, 4.025), cap, looks["black"], 0.9).parent = bottle

    x0, x1, z0, z1 = (-0.621, -0.547, 0.753, 0.821)
    radius = (x1 - x0) / 2
    profile = [(0, z0), (radius, z0), (radius, z1), (radius - 0.004, z1 - 0.003), (0, z1 - 0.003)]
    can = lathe(
        "Paint can",
        profile,
        looks["navy"],
        place=Matrix.Translation(((x0 + x1) / 2, 3.835 + radius, 0)),
    )
    can["lvis_category"] = "can"


def build_light_and_camera():
    """One large lamp near the camera, a dim sky, and the camera matched to the photo."""
    scene = bpy.context.scene
    world = bpy.data.worlds.new("World")
    world.node_tree.nodes["Background"].inputs["Color"].default_value = (1, 0.95, 0.9, 1)
    world.node_tree.nodes["Background"].inputs["Strength"].default_value = 0.5
    scene.world = world
    light = bpy.data.lights.new("Lamp", "AREA")
    light.energy, light.size = 120, 1.5
    lamp = add("Lamp", light, place=Matrix.Translation((-0.5, -0.5, 2.6)))
    lamp.rotation_euler = (math.radians(50), 0, 0)

    width, height = IMAGE_SIZE_WH_PX
    camera = bpy.data.cameras.new("Camera")
    camera.sensor_fit, camera.sensor_width = "HORIZONTAL", 36.0
    camera.lens = FOCAL_PX / width * camera.sensor_width
    camera.shift_x = (width / 2 - PRINCIPAL_POINT_PX[0]) / width
    camera.shift_y = (PRINCIPAL_POINT_PX[1] - height / 2) / width
    holder = add("Camera", camera, place=Matrix.Translation((0, 0, CAMERA_HEIGHT_M)))
    holder.rotation_euler = [math.radians(angle) for angle in CAMERA_EULER_DEG]
    scene.camera = holder
    scene.render.resolution_x, scene.render.resolution_y = IMAGE_SIZE_WH_PX
    scene.render.resolution_percentage = 100
    scene.render.engine = "CYCLES"
    scene.cycles.samples = 16


def make_looks():
    """Return every material by name."""
    return {
        "red": material("Red paint", (0.6, 0.02, 0.02), 0.25),
        "red glass": material("Red glass", (0.7, 0.03, 0.02), 0.2),
        "amber": material("Amber lens", (0.8, 0.3, 0.02), 0.2),
        "black": material("Black", (0.015, 0.015, 0.016), 0.4),
        "dark": material("Dark plastic", (0.02, 0.022, 0.03), 0.6),
        "rubber": material("Rubber", (0.04, 0.04, 0.042), 0.8),
        "chrome": material("Chrome", (0.7, 0.68, 0.65), 0.2, 0.9),
        "alloy": material("Cast alloy", (0.6, 0.58, 0.54), 0.45, 0.5),
        "dark alloy": material("Dark alloy", (0.25, 0.25, 0.24), 0.5, 0.5),
        "pale": material("Pale metal", (0.75, 0.73, 0.68), 0.5),
        "grey": material("Grey metal", (0.25, 0.23, 0.21), 0.5),
        "glass": material("Lamp glass", (0.75, 0.7, 0.6), 0.15),
        "steel": material("Painted steel", (0.15, 0.17, 0.23), 0.5),
        "white": material("White plastic", (0.75, 0.74, 0.76), 0.5),
        "grey plastic": material("Grey plastic", (0.35, 0.35, 0.36), 0.5),
        "yellow": material("Yellow plastic", (0.8, 0.6, 0.03), 0.4),
        "navy": material("Navy", (0.03, 0.03, 0.15), 0.4),
        "blue": material("Printed blue", (0.1, 0.12, 0.35), 0.6),
        "cardboard": material("Cardboard", (0.5, 0.32, 0.18), 0.9),
        "plywood": material("Plywood", (0.35, 0.14, 0.06), 0.8),
        "wood": material("Pine", (0.5, 0.28, 0.13), 0.8),
        "pale wood": material("Pale wood", (0.65, 0.5, 0.3), 0.8),
        "weathered wood": material("Weathered wood", (0.3, 0.24, 0.17), 0.9),
        "concrete": material("Concrete", (0.4, 0.37, 0.34), 0.9),
    }


def main():
    """Build the whole scene from an empty file."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    looks = make_looks()
    build_motorcycle(looks)
    build_bench(looks)
    build_bicycle(looks)
    build_room(looks)
    build_shelves(looks)
    build_goods(looks)
    build_light_and_camera()


main()
