"""`reconstruct` killed at any moment and run again: what differs from a trial left alone.

    python benchmarks/endpoint/kills.py [--kills 10] [--seed 0]

The agent `program` plays ten recorded steps. Each kill is a SIGKILL of legoworld at a random
moment; the same command then makes the rest. scene.blend is compared field by field, by the names
that the file itself has for them. Needs mcp-for-blender and the program `zstd`.
"""

from __future__ import annotations

import argparse
import json
import random
import re
import signal
import struct
import subprocess
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path
from typing import Any

from PIL import Image

#: Half a second each, so that kills meet them.
ADD = "import bpy, time\nbpy.ops.mesh.primitive_cube_add(location=({n}, 3, 0))\ntime.sleep(0.5)"
SMALL = "import bpy\nr = bpy.context.scene.render\nr.resolution_x, r.resolution_y = 64, 48"
SAVE = "import bpy, os\nbpy.ops.wm.save_as_mainfile(filepath=os.getcwd() + '/scene.blend')"
CODES = [SMALL, *(ADD.format(n=n) for n in range(8)), SAVE]
_BLOCK = struct.Struct("<4siQqq")


def make(folder: Path) -> list[str]:
    """A track of one photo and its program; the command."""
    for name in ("photos", "programs"):
        (folder / name).mkdir(parents=True)
    Image.new("RGB", (64, 48), "grey").save(folder / "photos" / "room.png")
    images = [{"id": 1, "file_name": "room.png", "width": 64, "height": 48}]
    (folder / "track.json").write_text(json.dumps({"info": {"task": "bench"}, "images": images}))
    steps = [{"tool": "execute_blender_code", "arguments": {"code": code}} for code in CODES]
    text = "".join(json.dumps(step) + "\n" for step in steps)
    (folder / "programs" / "room.steps.jsonl").write_text(text)
    return [
        *(sys.executable, "-m", "legoworld", "reconstruct", str(folder / "track.json"), "-q"),
        *("--photos", str(folder / "photos"), "--agent", "program"),
        *("--programs", str(folder / "programs"), "-o", str(folder / "scenes")),
    ]


def left(folder: Path) -> dict[str, Any]:
    """What a trial left."""
    scene = folder / "scenes" / "room"
    rows = [json.loads(row) for row in (scene / "trial" / "calls.jsonl").read_text().splitlines()]
    return {
        "scene.glb": (scene / "scene.glb").read_bytes(),
        "final.png": (scene / "final.png").read_bytes(),
        "code": [row["code"] for row in rows if row["command"] == "execute_code"],
        "scene.blend": blend(scene / "scene.blend"),
    }


def blend(path: Path) -> bytes:
    """A .blend of Blender 5.0 as it is before it is compressed."""
    return subprocess.run(["zstd", "-dcq", str(path)], capture_output=True, check=True).stdout


def blocks(data: bytes) -> list[tuple[bytes, int, int, bytes]]:
    """Code, struct, address and content of each block."""
    at, found = 17, []
    while at < len(data):
        code, kind, address, length, _ = _BLOCK.unpack_from(data, at)
        at += _BLOCK.size
        found.append((code, kind, address, data[at : at + length]))
        at += length
    return found


class Names:
    """The structs that a .blend names in its block DNA1."""

    def __init__(self, dna: bytes) -> None:
        self.dna, self.at = dna, 8
        self.fields = self._texts()
        self.at += 4
        self.types = self._texts()
        self.at += 4
        self.sizes = struct.unpack_from(f"<{len(self.types)}H", dna, self.at)
        self.at = (self.at + 2 * len(self.types) + 3) // 4 * 4 + 4
        self.structs = []
        for _ in range(self._number("<i")):
            kind = self._number("<H")
            members = [(self._number("<H"), self._number("<H")) for _ in range(self._number("<H"))]
            self.structs.append((kind, members))

    def _number(self, form: str) -> int:
        (value,) = struct.unpack_from(form, self.dna, self.at)
        self.at += struct.calcsize(form)
        return int(value)

    def _texts(self) -> list[str]:
        found = []
        for _ in range(self._number("<i")):
            end = self.dna.index(b"\0", self.at)
            found.append(self.dna[self.at : end].decode())
            self.at = end + 1
        self.at = (self.at + 3) // 4 * 4
        return found

    def member(self, kind: int, offset: int) -> str:
        """The member of a struct, or of an array of it, that an offset is in."""
        name, members = self.structs[kind]
        at, offset = 0, offset % self.sizes[name]
        for of, field in members:
            text = self.fields[field]
            count = 1
            for size in re.findall(r"\[(\d+)\]", text):
                count *= int(size)
            at += count * (8 if text.startswith(("*", "(*")) else self.sizes[of])
            if offset < at:
                return f"{self.types[name]}.{text}"
        return f"{self.types[name]}: padding"


def differing(one: bytes, other: bytes) -> Counter[str]:
    """Bytes that differ, by member."""
    ours, theirs = blocks(one), blocks(other)
    names = Names(next(content for code, _, _, content in ours if code == b"DNA1"))
    found: Counter[str] = Counter()
    if len(ours) != len(theirs):
        found["blocks"] = abs(len(ours) - len(theirs))
    for (_, kind, address, content), (_, _, again, content_again) in zip(
        ours, theirs, strict=False
    ):
        found["addresses of blocks"] += address != again
        found["lengths of blocks"] += len(content) != len(content_again)
        for at, (a, b) in enumerate(zip(content, content_again, strict=False)):
            if a != b:
                found[names.member(kind, at)] += 1
    return +found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--kills", type=int, default=10)
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    moments = random.Random(given.seed)
    with tempfile.TemporaryDirectory(prefix="legoworld-kills-") as name:
        alone = Path(name, "alone")
        begun = time.monotonic()
        subprocess.run(make(alone), check=True, capture_output=True)
        took, whole = time.monotonic() - begun, left(alone)
        print(json.dumps({"alone_s": round(took, 1)}), flush=True)
        for number in range(given.kills):
            folder, share = Path(name, str(number)), moments.uniform(0.05, 0.95)
            command = make(folder)
            with subprocess.Popen(command, start_new_session=True, stderr=-3, stdout=-3) as run:
                time.sleep(share * took)
                run.send_signal(signal.SIGKILL)
            calls = list(folder.rglob("calls.jsonl"))
            answered = len(calls[0].read_text().splitlines()) if calls else 0
            subprocess.run(command, check=True, capture_output=True)
            found = left(folder)
            about = json.loads((folder / "scenes" / "room" / "reconstruction.json").read_text())
            row = {
                "killed_at": round(share, 2),
                "answered": answered,
                "continued": about["continued"],
                **{key: found[key] == whole[key] for key in ("scene.glb", "final.png", "code")},
                "scene.blend": differing(whole["scene.blend"], found["scene.blend"]),
                "left": sorted(path.name for path in (folder / "scenes").iterdir()),
            }
            print(json.dumps(row), flush=True)


if __name__ == "__main__":
    main()
