"""Builds the trap scenes: `python build.py FOLDER` with the tests' folder on the path.

Each becomes FOLDER/<name>/scene.blend and FOLDER/<name>/expect.json. Imports bpy, so it runs in a
process of its own.
"""

from __future__ import annotations

import importlib
import json
import os
import sys
from pathlib import Path

import bpy
from agreement.traps.stage import empty_stage

ROOMS = (
    "geometry",
    "cameras",
    "states",
    "instancing",
    "visibility",
    "materials",
    "wirings",
    "attributes",
    "kinds",
    "strands",
    "particle_hair",
    "files",
)


def build_all(folder: Path) -> None:
    """Build every trap of every room."""
    for room in ROOMS:
        for trap in importlib.import_module(f"agreement.traps.{room}").TRAPS:
            place = folder / trap.__name__
            place.mkdir(parents=True)
            os.chdir(place)  # where a trap puts files of its own
            empty_stage()
            expected = trap()
            bpy.ops.wm.save_as_mainfile(filepath=str(place / "scene.blend"), compress=False)
            record = {
                "room": room,
                "about": " ".join((trap.__doc__ or "").split()),
                "seen": list(expected.seen),
                "unseen": list(expected.unseen),
                "limited": list(expected.limited),
            }
            (place / "expect.json").write_text(json.dumps(record), encoding="utf-8")


if __name__ == "__main__":
    build_all(Path(sys.argv[1]).resolve())
    sys.stdout.flush()
    os._exit(0)  # some simulations abort in Blender's own exit code
