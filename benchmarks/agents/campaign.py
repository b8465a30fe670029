"""A campaign that is disturbed: its photos, its track, what its agent does, its command."""

from __future__ import annotations

import json
import os
import shutil
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from agent_programs.model_server import ModelServer, Turn
from agent_programs.programs import AGENTS, KEY, KEYS, code, write_card
from PIL import Image

SMALL = (
    "import bpy\nr = bpy.context.scene.render\nr.resolution_x, r.resolution_y = 64, 48\n"
    "bpy.data.objects['Cube']['category'] = 'chair'"
)
#: Half a second each, so that kills meet them.
ADD = (
    "import bpy, time\nbpy.ops.mesh.primitive_cube_add(location=({n}, 3, 0))\n"
    "bpy.context.object['category'] = 'chair'\ntime.sleep(0.5)"
)
SAVE = "import bpy, os\nbpy.ops.wm.save_as_mainfile(filepath=os.getcwd() + '/scene.blend')"
CODES = (SMALL, *(ADD.format(n=n) for n in range(8)), SAVE)


@dataclass(frozen=True, kw_only=True)
class Campaign:
    """A folder with all that its command reads. server: of a real agent's model."""

    folder: Path
    command: tuple[str, ...]
    server: ModelServer | None

    @property
    def scenes(self) -> Path:
        """Where its scenes are."""
        return self.folder / "scenes"


def script(agent: str, suffix: str) -> list[Turn]:
    """What the model of a real agent says: it looks at the photo, builds, and saves."""
    tool = AGENTS[agent].reads
    path = {"file_path": f"{{workspace}}/reference{suffix}"}
    looks = [] if tool is None else [Turn(says="I look.", tool=tool, arguments=path)]
    built = (SMALL, *(ADD.format(n=n) for n in range(2)), SAVE)
    return [*looks, *(code("I build.", text) for text in built), Turn(says="Done.")]


def make_campaign(
    folder: Path,
    agent: str,
    photos: Sequence[Path],
    server: ModelServer | None,
    codes: Sequence[str] = CODES,
) -> Campaign:
    """A new folder for one agent. photos: none for one grey one; codes: what `program` plays."""
    for name in ("photos", "programs"):
        (folder / name).mkdir(parents=True)
    for photo in photos:
        shutil.copyfile(photo, folder / "photos" / photo.name)
    if not photos:
        Image.new("RGB", (64, 48), "grey").save(folder / "photos" / "room.png")
    images = []
    for number, photo in enumerate(sorted((folder / "photos").iterdir()), start=1):
        with Image.open(photo) as opened:
            width, height = opened.size
        images.append({"id": number, "file_name": photo.name, "width": width, "height": height})
        steps = [{"tool": "execute_blender_code", "arguments": {"code": text}} for text in codes]
        text = "".join(json.dumps(step) + "\n" for step in steps)
        (folder / "programs" / f"{photo.stem}.steps.jsonl").write_text(text)
    track = {"info": {"task": "coco"}, "images": images, "categories": [{"id": 1, "name": "chair"}]}
    (folder / "track.json").write_text(json.dumps(track))
    if server is None:
        chosen = ["--agent", "program", "--programs", str(folder / "programs")]
    else:
        server.script = tuple(script(agent, Path(images[0]["file_name"]).suffix))
        server.asked.clear()
        chosen = ["--agent", str(write_card(agent, server.url, folder)), "--record"]
    words = [
        "reconstruct",
        str(folder / "track.json"),
        "--photos",
        str(folder / "photos"),
        "--json",
    ]
    command = (sys.executable, "-m", "legoworld", *words, *chosen, "-o", str(folder / "scenes"))
    return Campaign(folder=folder, command=command, server=server)


def environment(programs: Path | None) -> Mapping[str, str]:
    """The environment of a command. programs: the folder of the real agents' programs."""
    if programs is None:
        return os.environ
    found = f"{programs}/bin:{os.environ['PATH']}"
    return {**os.environ, "PATH": found, **dict.fromkeys(KEYS, KEY)}
