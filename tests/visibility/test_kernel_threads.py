"""A kernel that is refused threads draws with fewer: the same bytes, and no abort."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

TESTS = Path(__file__).resolve().parents[1]

#: Two sizes: the room left for thread stacks of 8 MB, far below the 64 that are asked for.
PROGRAM = """
import resource, sys
import numpy as np
from visibility.kernel_scenes import pixel_camera, pixel_rectangle, place
from legoworld.visibility.kernel import coverage, render
size = (120, 90)
camera = pixel_camera(size)
near, far = pixel_rectangle(camera, 20, 10, 100, 50), pixel_rectangle(camera, 5, 5, 90, 80, 6)
surfaces = place([near, far])
alone = render(surfaces, camera, size, threads=1)
reach = coverage(surfaces, camera, size, threads=1)
used = int(open("/proc/self/statm").read().split()[0]) * resource.getpagesize()
limit = used + int(sys.argv[1]) * 2**20
resource.setrlimit(resource.RLIMIT_AS, (limit, limit))
many = render(surfaces, camera, size, threads=64)
assert np.array_equal(alone.instance, many.instance)
assert np.array_equal(alone.depth_z_m, many.depth_z_m)
assert np.array_equal(reach, coverage(surfaces, camera, size, threads=64))
print("same")
"""


@pytest.mark.skipif(sys.platform != "linux", reason="limits the address space by /proc and rlimit")
@pytest.mark.parametrize("room_mb", [24, 48])
def test_threads_that_cannot_start_are_done_without(room_mb):
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM, str(room_mb)],
        cwd=TESTS,
        capture_output=True,
        text=True,
        timeout=600,
        check=False,
    )
    assert (done.returncode, done.stdout.strip()) == (0, "same"), done.stderr[-2000:]
