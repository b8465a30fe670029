"""The conventions every number in legoworld follows, stated once.

Axes.   Blender's world is used as it is (right-handed, z up). The camera frame is OpenCV's:
        x right, y down, z forward. Blender's camera frame (x right, y up, looking along -z) is
        turned into it once, where the scene is read (`CV_FROM_BLENDER_CAMERA`).
Pixels. Pixel (row r, column c) is sampled once, at its centre (x, y) = (c + 0.5, r + 0.5);
        the origin is the top left corner of the top left pixel.
Depth.  Planar z in the camera frame, in metres = scene units x the scene's unit scale.
        `NO_DEPTH` (+inf) where no surface is hit; never 0 and never a large number.
Ids.    Instance ids count from 0; `NO_INSTANCE` (-1) where no surface is hit.
Boxes.  COCO's x, y, width, height in pixel edges: columns 10..49 are x = 10, width = 40.
Sizes.  `size_wh` is (width, height); array shapes are (height, width).
"""

from __future__ import annotations

from typing import Final

SCHEMA_VERSION: Final = 1

NO_INSTANCE: Final = -1
NO_DEPTH: Final = float("inf")

#: A surface sample whose alpha is below this is not there (Cycles' data passes use the same value).
ALPHA_THRESHOLD: Final = 0.5
#: Values of Cycles' object index.
MOST_OBJECTS: Final = 32768

#: How the warning ends that names a material whose alpha cannot be read.
TAKEN_AS_OPAQUE: Final = "taken as opaque"

#: Confidence of every exported prediction: a scene does not rank what it contains.
EQUAL_CONFIDENCE: Final = 1.0

#: Diagonal of the matrix that turns Blender camera coordinates into OpenCV ones.
CV_FROM_BLENDER_CAMERA: Final = (1.0, -1.0, -1.0)

#: Custom properties that make their owner an instance; the task's own one wins over `category`.
CATEGORY_KEY: Final = "category"
