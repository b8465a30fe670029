"""A of copies: the bench's render of a scene whose objects are moved, small and with few samples.

A program in a process of its own, for it runs Blender: python appearances.py SCENE.blend, then a
JSON line for each picture: {"motions": {object: (4, 4) of the world, in order}, "output": PNG}.
"""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any, Final

SIZE_WH: Final = (192, 108)
SAMPLES: Final = 4


class Appearances:
    """A of one case's copies. Pictures stay in a folder, and are not rendered a second time."""

    def __init__(self, blend: Path, reference: Path, pictures: Path) -> None:
        from legoworld.evaluation.reconstruction.appearance import decode_picture, resize_picture

        self._reference = resize_picture(decode_picture(reference.read_bytes()), SIZE_WH)
        self._blend, self._pictures = blend, pictures
        self._program: subprocess.Popen[str] | None = None
        pictures.mkdir(parents=True, exist_ok=True)

    def a_of(self, motions: dict[str, Any], delta: int) -> float:
        """The share of pixels within delta of the reference. motions: as the program takes them."""
        from legoworld.evaluation.reconstruction.appearance import agreement, decode_picture
        from legoworld.files import sha256_of_text

        asked = json.dumps([SIZE_WH, SAMPLES, motions], sort_keys=True)
        picture = self._pictures / f"{sha256_of_text(asked)}.png"
        if not picture.is_file():
            self._render({"motions": motions, "output": str(picture)})
        return agreement(decode_picture(picture.read_bytes()), self._reference).share(delta)

    def _render(self, wanted: dict[str, Any]) -> None:
        if self._program is None:
            command = [sys.executable, __file__, str(self._blend)]
            pipe = subprocess.PIPE
            self._program = subprocess.Popen(command, stdin=pipe, stdout=pipe, text=True)
        assert self._program.stdin is not None
        assert self._program.stdout is not None
        self._program.stdin.write(json.dumps(wanted) + "\n")
        self._program.stdin.flush()
        while (line := self._program.stdout.readline()) and line != "rendered\n":
            pass
        assert line, "Blender ended"

    def close(self) -> None:
        """End the program."""
        if self._program is not None:
            self._program.communicate()


def _serve(blend: Path) -> None:
    """Render what each line of standard input asks for."""
    import bpy  # noqa: F401  (it brings mathutils)
    from mathutils import Matrix

    from legoworld.scene.blender.card_render import open_by_card
    from legoworld.scene.blender.render_state import render_scene, rendered_view_layer
    from legoworld.scene.requests import CardRequest

    card = CardRequest(size_wh=SIZE_WH, samples=SAMPLES, seed=0, denoise=False, threads=1)
    scene = open_by_card(blend, card)
    settings = scene.render.image_settings
    settings.media_type, settings.file_format, settings.color_mode = "IMAGE", "PNG", "RGB"
    rendered_view_layer(scene).update()  # an opened file has no placements before
    there = {item.name: item.matrix_world.copy() for item in scene.objects}
    for line in sys.stdin:
        wanted = json.loads(line)
        for name, motion in wanted["motions"].items():
            scene.objects[name].matrix_world = Matrix(motion) @ there[name]
        scene.render.filepath = wanted["output"] + ".part.png"
        render_scene(scene, write_still=True)
        Path(scene.render.filepath).rename(wanted["output"])
        for name in wanted["motions"]:
            scene.objects[name].matrix_world = there[name]
        print("rendered", flush=True)


if __name__ == "__main__":
    _serve(Path(sys.argv[1]))
