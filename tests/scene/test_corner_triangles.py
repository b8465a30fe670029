"""Triangles read from Blender's memory are those it gives when asked, or they are asked for."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.blender


def test_corners_from_memory_are_the_ones_blender_gives():
    checks = Path(__file__).with_name("corner_checks.py")
    done = subprocess.run([sys.executable, checks], capture_output=True, text=True, check=True)
    assert json.loads(done.stdout.splitlines()[-1]) == {
        "first": True,
        "verdict": True,
        "second_without_asking": True,
        "second_can_be_changed": False,
        "materials": True,
        "empty": [0, 3],
        "laid_out_otherwise": True,
        "laid_out_otherwise_from_the_start": True,
        "verdict_then": False,
    }
