"""Builds every scene of the modules `scenes_*` below a folder: build.py OUT [module...].

A scene is a function without arguments; it may return numbers Blender computed, which are kept
as expected.json beside its scene.blend.
"""

from __future__ import annotations

import importlib
import inspect
import json
import sys
from pathlib import Path

import bpy
from cases.stage import fresh


def main(output: Path, modules: list[str]) -> None:
    """Build the scenes of these modules."""
    for module in modules:
        for name, build in inspect.getmembers(importlib.import_module(module), inspect.isfunction):
            if build.__module__ != module or name.startswith("_"):
                continue
            folder = output / name
            folder.mkdir(parents=True)
            fresh()
            expected = build()
            bpy.ops.wm.save_as_mainfile(
                filepath=str(folder / "scene.blend"), check_existing=False, compress=False
            )
            if expected is not None:
                (folder / "expected.json").write_text(json.dumps(expected), encoding="utf-8")


if __name__ == "__main__":
    main(Path(sys.argv[1]), sys.argv[2:])
