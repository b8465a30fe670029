"""Reads each scene twice, without and with the viewport's evaluation; run in its own process.

    python unwatched.py SCENE.blend ...

Prints a JSON object: path to [whether the viewport was left out, content hash or error, the same
with the viewport's evaluation].
"""

from __future__ import annotations

import json
import os
import sys
from pathlib import Path

from legoworld.errors import LegoWorldError
from legoworld.scene.blender import viewport
from legoworld.scene.blender.extract import read_blend_snapshot


def read(path: str) -> str:
    try:
        return read_blend_snapshot(Path(path)).content_sha256()
    except LegoWorldError as error:
        return str(error)


def main() -> None:
    answers = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(2, 1)
    is_still = viewport._is_still
    found: dict[str, list[object]] = {}
    for path in sys.argv[1:]:
        asked: list[bool] = []

        def judged(scene, asked=asked):
            asked.append(is_still(scene))
            return asked[0]

        viewport._is_still = judged
        without = read(path)
        viewport._is_still = lambda _scene: False
        found[path] = [asked[0], without, read(path)]
    answers.write(json.dumps(found))
    answers.flush()
    os._exit(0)


if __name__ == "__main__":
    main()
