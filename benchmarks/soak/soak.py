"""Many scenes in one run: does memory stay flat, does anything pile up?

    python benchmarks/soak/soak.py [--count 1000] [--workers N] [--keep FOLDER]

Makes `count` scene folders of different content from four built scenes, reads them out twice
through the command line (by Blender, then from the cache) and samples the processes. Exit 1 when
the main process grows by more than 50 MB after the first 100 scenes, when open files or zombies
pile up, when something is left behind, or when a scene is not ok.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import textwrap
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "tests"))

from conftest import _PRELUDE as PRELUDE
from scene.foreign.processes import (
    Usage,
    descendants,
    open_files,
    resident,
    run_measured,
    zombies,
)
from scene.foreign.sources import PROGRAM

MB = 1e6
GROWTH_MB = 50.0
SETTLED = 100

#: Besides the scene of `scene.foreign.sources`: many objects, one large mesh, many placements.
SCENES = """
fresh(); camera(z=40)
for i in range(300):
    quad(f"Tile{i}", x=i % 20 - 10, y=i // 20 - 7, z=i % 7, half=0.4, category="dog")
save("objects")
fresh(); camera()
bpy.ops.mesh.primitive_ico_sphere_add(subdivisions=8, radius=3)
bpy.context.object["category"] = "sports ball"
save("large_mesh")
scene = fresh(); camera(z=40)
group = bpy.data.collections.new("Set"); group["category"] = "chair"
for i in range(5):
    part = quad(f"Part{i}", x=i * 0.1, z=i * 0.1, half=0.2)
    scene.collection.objects.unlink(part); group.objects.link(part)
for i in range(400):
    empty = bpy.data.objects.new(f"Place{i}", None)
    empty.instance_type = "COLLECTION"; empty.instance_collection = group
    empty.location = (i % 20 - 10, i // 20 - 10, 0); scene.collection.objects.link(empty)
save("placements")
"""


@dataclass(frozen=True, kw_only=True)
class Sample:
    """One moment of a run; bytes, workers: the largest and the sum."""

    done: int
    main: int
    worker_largest: int
    workers_sum: int
    open_files: int
    zombies: int


def main() -> int:
    """Run both halves and judge; see the module's docstring for exit codes."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", 1)[0])
    parser.add_argument("--count", type=int, default=1000)
    parser.add_argument("--workers", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--keep", type=Path, help="folder for scenes, cache and runs, kept")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="soak-") as temporary:
        folder = arguments.keep or Path(temporary)
        _make_scenes(folder, arguments.count)
        wrong = []
        for name in ("by Blender", "from the cache"):
            usage, samples = _read_out(folder, name, arguments.workers)
            _print(name, usage, samples, arguments.count)
            wrong += [f"{name}: {line}" for line in _faults(folder, name, usage, samples)]
    for line in wrong:
        print(f"WRONG: {line}")
    return 1 if wrong else 0


def _make_scenes(folder: Path, count: int) -> None:
    built = folder / "built"
    for program in (PROGRAM, SCENES):
        source = PRELUDE + textwrap.dedent(program)
        command = [sys.executable, "-W", "ignore", "-c", source, str(built)]
        subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    kinds = sorted(p for p in built.iterdir() if p.name != "packed")
    contents = [(p / "scene.blend").read_bytes() for p in kinds]
    for i in range(count):
        scene = folder / "scenes" / f"{i:05d}"
        scene.mkdir(parents=True)
        # Bytes after the last block are not read, and make another file of it for the cache.
        data = _with_room_behind(contents[i % len(contents)]) + i.to_bytes(8, "little")
        (scene / "scene.blend").write_bytes(data)
    for name in ("home", "tmp"):
        (folder / name).mkdir()


def _with_room_behind(data: bytes) -> bytes:
    """The file, ready for eight bytes that no reader reads: in Zstandard, a skipped frame."""
    if data.startswith(b"BLENDER"):
        return data
    return data + (0x184D2A50).to_bytes(4, "little") + (8).to_bytes(4, "little")


def _read_out(folder: Path, name: str, workers: int) -> tuple[Usage, list[Sample]]:
    run = folder / f"run {name}"
    samples: list[Sample] = []
    environment = {
        **os.environ,
        "HOME": str(folder / "home"),
        "TMPDIR": str(folder / "tmp"),
    }
    command = [
        sys.executable, "-m", "legoworld", "readout", str(folder / "scenes"), "--task", "coco",
        "-o", str(run), "-q", "--cache", str(folder / "cache"), "--workers", str(workers),
    ]  # fmt: skip
    usage = run_measured(command, env=environment, watch=_sampler(run / "journal.jsonl", samples))
    return usage, samples


def _sampler(journal: Path, samples: list[Sample]) -> Callable[[int], None]:
    def watch(pid: int) -> None:
        done = journal.read_bytes().count(b"\n") if journal.is_file() else 0
        if not done or (samples and done < samples[-1].done + 10):
            return
        workers = [resident(worker) for worker in descendants(pid)]
        samples.append(
            Sample(
                done=done,
                main=resident(pid),
                worker_largest=max(workers, default=0),
                workers_sum=sum(workers),
                open_files=open_files(pid),
                zombies=zombies(pid),
            )
        )

    return watch


def _print(name: str, usage: Usage, samples: list[Sample], count: int) -> None:
    print(
        f"{name}: {count} scenes in {usage.wall_s:.0f} s "
        f"({count / usage.wall_s:.1f} a second), {len(usage.workers)} worker processes, "
        f"peak: main {usage.main_peak / MB:.0f} MB, one worker {usage.worker_peak / MB:.0f} MB"
    )
    print(f"{'done':>6} {'main':>8} {'largest':>8} {'workers':>8} {'files':>6} {'zombies':>8}")
    for wanted in (SETTLED, count // 4, count // 2, 3 * count // 4, count):
        s = min(samples, key=lambda s: abs(s.done - wanted))
        print(
            f"{s.done:6} {s.main / MB:8.1f} {s.worker_largest / MB:8.1f} "
            f"{s.workers_sum / MB:8.1f} {s.open_files:6} {s.zombies:8}",
            flush=True,
        )


def _faults(folder: Path, name: str, usage: Usage, samples: list[Sample]) -> list[str]:
    wrong = []
    settled = next((s for s in samples if s.done >= SETTLED), samples[0])
    growth = (samples[-1].main - settled.main) / MB
    if growth > GROWTH_MB:
        wrong.append(f"the main process grew by {growth:.0f} MB after {settled.done} scenes")
    if samples[-1].open_files > settled.open_files + 8:
        wrong.append(f"{settled.open_files} open files became {samples[-1].open_files}")
    if samples[-1].zombies > 2:
        wrong.append(f"{samples[-1].zombies} processes that nobody waited for")
    alive = [pid for pid in usage.workers if Path(f"/proc/{pid}").exists()]
    if alive:
        wrong.append(f"still running: {alive}")
    strays = [str(p) for top in ("home", "tmp") for p in (folder / top).rglob("*")]
    if strays:
        wrong.append(f"{len(strays)} strays, such as {strays[0]}")
    rows = (folder / f"run {name}" / "per_image.jsonl").read_text().splitlines()
    bad = [row for row in map(json.loads, rows) if row["status"] != "ok"]
    if bad or usage.returncode:
        wrong.append(f"exit code {usage.returncode}, {len(bad)} scenes not ok: {bad[:1]}")
    return wrong


if __name__ == "__main__":
    sys.exit(main())
