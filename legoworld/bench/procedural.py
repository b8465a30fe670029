"""`legoworld bench make --procedural`: reference scenes drawn by a seed from shipped programs."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from legoworld.errors import CatalogError, UsageError
from legoworld.scene.folder import BLEND
from legoworld.shipped.catalog import folder
from legoworld.workers.scratch import scratch_folder

#: Folders of the assets that the programs read.
PACKS: Final = ("furniture", "restaurant", "city_builder")


@dataclass(frozen=True, kw_only=True)
class DrawRequest:
    """What is drawn. scenes: folder of the reference scenes; assets: folder of KayKit's packs."""

    scenes: Path
    seed: int
    count: int
    assets: Path | None
    workers: int


def draw_scenes(request: DrawRequest, notice: Callable[[str], None]) -> None:
    """Write scenes 0 to count - 1 of the seed, each into a folder of its own; those present stay.

    Raises UsageError without the assets, or where the folder has other scenes, and CatalogError
    where a program ends without a scene.
    """
    assets = request.assets
    if assets is None or not all((assets / pack).is_dir() for pack in PACKS):
        raise UsageError(
            "KayKit's assets are needed to draw scenes",
            found=f"{assets}" if assets else "no folder",
            expected=f"a folder with {', '.join(PACKS)}: the gltf folders of KayKit's packs (CC0)",
            next_step="name it with --assets or LEGOWORLD_KAYKIT",
        )
    request.scenes.mkdir(parents=True, exist_ok=True)
    endings = {f"-{request.seed}-{number:04d}": number for number in range(request.count)}
    present = {path.name for path in request.scenes.iterdir() if (path / BLEND).is_file()}
    done = {number for end, number in endings.items() for name in present if name.endswith(end)}
    if len(present) > len(done):
        raise UsageError(
            "the folder has scenes that this seed and count do not draw",
            found=next(n for n in sorted(present) if not n.endswith(tuple(endings))),
            expected="an empty folder, or earlier scenes of the same seed",
            next_step="choose another folder",
        )
    missing = [number for number in endings.values() if number not in done]
    if missing:
        notice(f"drawing {len(missing)} of {request.count} scenes of seed {request.seed}")
    with ThreadPoolExecutor(request.workers) as pool:
        list(pool.map(lambda number: _draw(request, assets, number), missing))


def _draw(request: DrawRequest, assets: Path, number: int) -> None:
    program = folder("examples") / "bench" / "drawn.py"
    with scratch_folder(".drawing-", request.scenes) as scratch:
        command = [sys.executable, str(program), "--kaykit", str(assets.resolve())]
        command += ["--seed", str(request.seed), "--number", str(number), "-o", str(scratch)]
        done = subprocess.run(
            command, stdin=subprocess.DEVNULL, capture_output=True, text=True, check=False
        )
        made = [path for path in scratch.iterdir() if path.is_dir()]
        if done.returncode or len(made) != 1:
            raise CatalogError(
                f"scene {number} of seed {request.seed} cannot be drawn",
                found=(done.stderr.strip().splitlines() or [f"exit code {done.returncode}"])[-1],
                expected="a scene",
                next_step="use another seed; with every asset there, please report it",
            )
        made[0].rename(request.scenes / made[0].name)
