"""What the alpha rule reads of each shader node, held to numbers worked out by hand."""

from __future__ import annotations

import json
import subprocess
import sys
from math import cos, sin
from pathlib import Path
from typing import Any

import pytest

pytestmark = pytest.mark.blender

# Where alpha depends on the image: at the image values 0, 0.25, 0.6 and 1.
VALUES: dict[str, Any] = {
    "ADD 0.25 0.5": 0.75,
    "ADD 0.75 0.5": 1.25,
    "ADD 0.75 0.5 use_clamp": 1.0,
    "SUBTRACT 0.25 0.5": -0.25,
    "SUBTRACT 0.25 0.5 use_clamp": 0.0,
    "MULTIPLY 0.25 0.5": 0.125,
    "DIVIDE 0.25 0.5": 0.5,
    "DIVIDE 0.25 0.0": 0.0,
    "MULTIPLY_ADD 0.25 0.5 0.5": 0.625,
    "MINIMUM 0.25 0.5": 0.25,
    "MAXIMUM 0.25 0.5": 0.5,
    "GREATER_THAN 0.5 0.25": 1.0,
    "GREATER_THAN 0.5 0.5": 0.0,
    "LESS_THAN 0.25 0.5": 1.0,
    "LESS_THAN 0.5 0.5": 0.0,
    "ROUND 0.5": 1.0,
    "ROUND 1.25": 1.0,
    "CEIL 0.25": 1.0,
    "FLOOR 1.75": 1.0,
    "POWER 0.5 2.0": "alpha comes from a Math (power) node",
    "SUBTRACT 1.0 image": [1.0, 0.75, 0.4, 0.0],
    "MULTIPLY image 2.0 use_clamp": [0.0, 0.5, 1.0, 1.0],
    "camera ray": 1.0,
    "shadow ray": 0.0,
    "ray length": "alpha comes from a Light Path node (ray length)",
    "transparent depth": "alpha comes from a Light Path node (transparent depth)",
    "mapped": 0.75,  # 0.25 of 0..0.5 is half way from 0.5 to 1
    "mapped beyond": 2.0,
    "mapped beyond, held": 1.0,
    "mapped below, held": 1.0,
    "mapped in steps": "alpha comes from a Map Range node that is not linear",
    "ramp in the middle": 0.5 * 0.7152 + 0.5 * 0.0722,
    "ramp's alpha": 0.75,
    "ramp before": 0.0722,
    "ramp after": 0.7152,
    "ramp in steps": 0.0722,
    "ramp eased": "alpha comes from a Color Ramp that is neither linear nor steps",
    "ramp of hues": "alpha comes from a Color Ramp that is neither linear nor steps",
    "inverted": 0.75 * 0.75 + 0.25 * 0.25,
    "inverted constant": "alpha comes from a Invert Color node",
    "back": {"front": 0.0, "back": 1.0},
    "position": "alpha comes from a Geometry node",
    "grouped": [0.0, 0.125, 0.3, 0.5],
    "muted": "a muted node or link decides its alpha",
}
RULES: dict[str, list[Any]] = {
    "nothing": ["there"],
    "only a volume": ["gone"],
    "transparent": ["gone"],
    "tinted": ["there"],  # a mean of 0.5
    "rather clear": ["gone"],
    "emission": ["there"],
    "holdout": ["holdout"],
    "mixed to the second": ["there"],
    "mixed to the first": ["gone"],
    "mixed beyond": ["there"],  # the factor is held to 1
    "mixed with a holdout": [
        "there", "a Holdout shader mixed with others; its surface is taken as opaque"
    ],
    "added": ["gone"],
    "added twice": ["there"],
    "displaced": ["there", "read undisplaced"],
    "bumped": ["there"],
    "cut": [[0.25, True]],
}  # fmt: skip
(CX, CY, CZ), (SX, SY, SZ) = ([turn(a) for a in (0.3, -0.5, 0.7)] for turn in (cos, sin))
# What the turned x and y axes have in the flat: columns of Rz Ry Rx.
XX, XY = CZ * CY, SZ * CY
YX, YY = CZ * SY * SX - SZ * CX, SZ * SY * SX + CZ * CX
TURNED = [round(v, 6) for v in (2 * XX, 4 * YX, 0.25, 2 * XY, 4 * YY, 0.5)]
TURNED_BACK = [
    round(v, 6)
    for v in (
        XX / 2, XY / 2, -(XX * 0.25 + XY * 0.5) / 2, YX / 4, YY / 4, -(YX * 0.25 + YY * 0.5) / 4
    )
]  # fmt: skip
AS_IT_IS = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0]
PLAIN = ["leaf", "alpha", None, AS_IT_IS, "repeat", "linear"]
LOOKUPS: dict[str, Any] = {
    "plain": PLAIN,
    "clipped": [*PLAIN[:4], "clip", "linear"],
    "extended": [*PLAIN[:4], "extend", "linear"],
    "mirrored": [*PLAIN[:4], "mirror", "linear"],
    "closest": [*PLAIN[:4], "repeat", "closest"],
    "cubic": PLAIN,
    "box": "alpha comes from a box projection",
    "own mapping": "alpha comes from an image node with its own mapping",
    "film": "alpha comes from an image that is not a single picture",
    "no image": "alpha comes from an image that is not a single picture",
    # Cycles multiplies colour by alpha, unless the alpha is in use or is no transparency.
    "color": ["c", "premultiplied", *PLAIN[2:]],
    "color and alpha": ["c.001", "luminance", *PLAIN[2:]],
    "packed color": ["c.002", "luminance", *PLAIN[2:]],
    "color alone": ["c.003", "luminance", *PLAIN[2:]],
    "data": ["c.004", "luminance", *PLAIN[2:]],
    "map": ["leaf", "alpha", "second", *PLAIN[3:]],
    "default map": PLAIN,
    "instancer's map": "alpha texture coordinates come from a UV Map node",
    "uv": PLAIN,
    "instancer's uv": "alpha texture coordinates come from a Texture Coordinate node",
    "generated": "alpha texture coordinates come from a Texture Coordinate node",
    # u' = 2 u + 0.25, v' = 4 v + 0.5, and back.
    "mapped": ["leaf", "alpha", "second", [2.0, 0.0, 0.25, 0.0, 4.0, 0.5], "repeat", "linear"],
    "mapped back": [
        "leaf", "alpha", "second", [0.5, 0.0, -0.125, 0.0, 0.25, -0.125], "repeat", "linear"
    ],
    # The same about x, y and z by 0.3, -0.5 and 0.7, before the shift and after the scale.
    "mapped and turned": ["leaf", "alpha", "second", TURNED, "repeat", "linear"],
    "mapped and turned back": ["leaf", "alpha", "second", TURNED_BACK, "repeat", "linear"],
    "mapped vector": "alpha texture coordinates come from a vector Mapping",
    "mapped flat": "alpha texture coordinates come from a point Mapping",
    "mapped nothing": "alpha texture coordinates come from a Mapping node",
}  # fmt: skip


@pytest.fixture(scope="module")
def told() -> Any:
    program = Path(__file__).with_name("alpha_nodes.py")
    done = subprocess.run([sys.executable, program], capture_output=True, text=True, check=True)
    return json.loads(done.stdout.splitlines()[-1])


def test_values(told):
    assert told["values"].keys() == VALUES.keys()
    for name, expected in VALUES.items():
        value = told["values"][name]
        exact = isinstance(expected, str)
        assert value == (expected if exact else pytest.approx(expected, abs=1e-6)), name


def test_shaders(told):
    assert told["rules"] == RULES


def test_lookups_of_images(told):
    assert told["images"] == LOOKUPS
