"""A readout over many scene folders of which half are odd: what a user sees, seconds, memory.

    python benchmarks/soak/odd_folders.py [--count 1000] [--workers N] [--keep FOLDER]

Half of the folders are copies of the shipped examples, each with other bytes behind the last
block; the others have one thing wrong besides, in `ODDITIES`, as people and programs leave them.
Reads a quarter of the images, half and all, each by Blender. Prints seconds and memory of each, the
rows by status and code, and what the command printed. Exit 1 when a folder has no row or not the
status of its oddity, when time or the main process's memory grows by more than the folders did
(1.5x, 50 MB after the first 100), when what is printed grows with them, or something is left.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import tempfile
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "tests"))

from scene.foreign.processes import open_files, resident, run_measured, zombies

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"
MB = 1e6
GROWTH_MB = 50.0
SETTLED = 100
SLOWER = 1.5
MOST_LINES = 60
HEADER = 12  # bytes of a .blend before its first block


@dataclass(frozen=True, kw_only=True)
class Oddity:
    """One thing wrong with a scene folder, and its status; "": without a track it is no image."""

    name: str
    status: str
    spoil: Callable[[Path], None]


def blend(folder: Path) -> Path:
    return folder / "scene.blend"


def shortened(folder: Path) -> None:
    data = blend(folder).read_bytes()
    blend(folder).write_bytes(data[: len(data) // 2])


def another_format(folder: Path) -> None:
    blend(folder).write_bytes(b"\x89PNG\r\n\x1a\n" + blend(folder).read_bytes()[HEADER:2000])


def scene_is_a_folder(folder: Path) -> None:
    blend(folder).unlink()
    blend(folder).mkdir()


def scene_is_a_fifo(folder: Path) -> None:
    blend(folder).unlink()
    os.mkfifo(blend(folder))


def dangling(folder: Path) -> None:
    blend(folder).unlink()
    blend(folder).symlink_to(folder / "nowhere.blend")


def only_glb(folder: Path) -> None:
    blend(folder).rename(folder / "scene.glb")


def labels(text: bytes) -> Callable[[Path], None]:
    return lambda folder: _written(folder / "labels.json", text)


def provenance(folder: Path) -> None:
    (folder / "provenance.json").symlink_to("/etc/hostname")


def frozen_of_another(folder: Path) -> None:
    entry = {"sha256": "0" * 64, "bytes": 1}
    record = {"schema_version": 1, "files": {"scene.blend": entry}, "dependencies": {}}
    record |= {"status": "ok", "legoworld": "0.1.0", "checks": {}}
    _written(folder / "frozen.json", json.dumps(record).encode())


def _written(path: Path, data: bytes) -> None:
    path.write_bytes(data)


ODDITIES = (
    Oddity(name="cut in half", status="invalid", spoil=shortened),
    Oddity(name="empty", status="invalid", spoil=lambda f: _written(blend(f), b"")),
    Oddity(name="text", status="invalid", spoil=lambda f: _written(blend(f), b"see scene.py\n")),
    Oddity(name="another format", status="invalid", spoil=another_format),
    Oddity(name="a folder named scene.blend", status="", spoil=scene_is_a_folder),
    Oddity(name="a FIFO", status="invalid", spoil=scene_is_a_fifo),
    Oddity(name="a link to nothing", status="missing", spoil=dangling),
    Oddity(name="no scene", status="", spoil=lambda f: blend(f).rename(f / "scene.py")),
    Oddity(name="only scene.glb", status="invalid", spoil=only_glb),
    Oddity(name="labels.json is no JSON", status="invalid", spoil=labels(b"{'version': 1}")),
    Oddity(name="labels.json is nested deep", status="invalid", spoil=labels(b"[" * 100_000)),
    Oddity(name="a label of nothing", status="ok", spoil=labels(
        b'{"version": 1, "labels": [{"object": "Not there", "category": "dog"}]}')),
    Oddity(name="a label outside the vocabulary", status="ok", spoil=labels(
        b'{"version": 1, "labels": [{"object": "Camera", "category": "flying saucer"}]}')),
    Oddity(name="provenance.json leads outside", status="invalid", spoil=provenance),
    Oddity(name="changed after freezing", status="changed", spoil=frozen_of_another),
)  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class Reading:
    """One readout: cost, printed lines, rows, faults. main_mb: growth of the main process."""

    wall_s: float
    cpu_s: float
    main_mb: float
    printed: list[str]
    rows: list[dict[str, object]]
    wrong: list[str]


def main() -> int:
    """Make, read, judge; see the module's docstring."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", 1)[0])
    parser.add_argument("--count", type=int, default=1000)
    parser.add_argument("--workers", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--keep", type=Path, help="folder for scenes and runs, kept")
    chosen = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="odd-folders-") as temporary:
        folder = chosen.keep or Path(temporary)
        expected = make_folders(folder / "scenes", chosen.count)
        images = sum(status != "" for status in expected.values())
        counts = (images // 4, images // 2, images)
        found = [read_out(folder, count, chosen.workers, expected) for count in counts]
    print_table(counts, found)
    wrong = [line for reading in found for line in reading.wrong] + not_linear(counts, found)
    for line in wrong:
        print(f"WRONG: {line}")
    return 1 if wrong else 0


def make_folders(scenes: Path, count: int) -> dict[str, str]:
    """The folders, and the status that each must have."""
    sources = [p.read_bytes() for p in sorted(EXAMPLES.glob("*/scene.blend"))]
    expected = {}
    for number in range(count):
        folder = scenes / f"{number:05d}"
        folder.mkdir(parents=True)
        data = sources[number // 2 % len(sources)]
        blend(folder).write_bytes(with_number(data, number))
        odd = ODDITIES[number // 2 % len(ODDITIES)] if number % 2 else None
        if odd is not None:
            odd.spoil(folder)
        expected[folder.name] = odd.status if odd else "ok"
    return expected


def with_number(data: bytes, number: int) -> bytes:
    """A .blend with eight bytes behind it that no reader reads: in Zstandard, a skipped frame."""
    if not data.startswith(b"BLENDER"):
        data += (0x184D2A50).to_bytes(4, "little") + (8).to_bytes(4, "little")
    return data + number.to_bytes(8, "little")


def read_out(folder: Path, count: int, workers: int, expected: dict[str, str]) -> Reading:
    """Read the first `count` folders."""
    run = folder / f"run {count}"
    samples: list[tuple[int, int, int, int]] = []

    def watch(pid: int) -> None:
        journal = run / "journal.jsonl"
        done = journal.read_bytes().count(b"\n") if journal.is_file() else 0
        if done and (not samples or done >= samples[-1][0] + 10):
            samples.append((done, resident(pid), open_files(pid), zombies(pid)))

    command = [
        "/bin/sh", "-c", 'exec "$@" 2>&1', "sh",
        sys.executable, "-m", "legoworld", "readout", str(folder / "scenes"), "--task", "coco",
        "-o", str(run), "--no-cache", "--workers", str(workers), "--limit", str(count),
    ]  # fmt: skip
    before = os.times()
    with (folder / "printed").open("wb+") as printed:
        usage = run_measured(command, watch=watch, stdout=printed.fileno())
        printed.seek(0)
        lines = printed.read().decode("utf-8", "replace").splitlines()
    after = os.times()
    rows = [json.loads(line) for line in (run / "per_image.jsonl").read_text().splitlines()]
    images = [name for name, status in expected.items() if status]
    settled = next((s for s in samples if s[0] >= SETTLED), samples[0])
    wrong = [f"{count}: {r['scene']} is {r['status']}: {r.get('reason')}"
             for r in rows if r["status"] != expected[r["scene"]]]  # fmt: skip
    if {r["scene"] for r in rows} != set(sorted(images)[:count]):
        wrong.append(f"{count}: {len(rows)} rows")
    if samples[-1][2] > settled[2] + 8 or samples[-1][3] > 2:
        wrong.append(
            f"{count}: open files {settled[2]} to {samples[-1][2]}, {samples[-1][3]} zombies"
        )
    if alive := [pid for pid in usage.workers if Path(f"/proc/{pid}").exists()]:
        wrong.append(f"{count}: still running: {alive}")
    cpu_s = sum(after[2:4]) - sum(before[2:4])
    growth = (samples[-1][1] - settled[1]) / MB
    return Reading(
        wall_s=usage.wall_s, cpu_s=cpu_s, main_mb=growth, printed=lines, rows=rows, wrong=wrong
    )


def not_linear(counts: tuple[int, ...], found: list[Reading]) -> list[str]:
    """What grew by more than the number of folders, from half of them to all."""
    half, whole = found[-2], found[-1]
    wrong = []
    if whole.cpu_s > SLOWER * half.cpu_s * counts[-1] / counts[-2]:
        wrong.append(f"{half.cpu_s:.0f} CPU s became {whole.cpu_s:.0f}")
    if whole.main_mb > GROWTH_MB:
        wrong.append(f"the main process grew by {whole.main_mb:.0f} MB after {SETTLED} folders")
    if len(whole.printed) > MOST_LINES:
        wrong.append(f"{len(whole.printed)} lines were printed")
    return wrong


def print_table(counts: tuple[int, ...], found: list[Reading]) -> None:
    heads = ("folders", "seconds", "CPU s", "CPU ms each", "growth MB", "lines")
    print("".join(f"{head:>13}" for head in heads))
    for count, one in zip(counts, found, strict=True):
        cells = (count, one.wall_s, one.cpu_s, 1000 * one.cpu_s / count, one.main_mb)
        print("".join(f"{cell:13.1f}" for cell in cells) + f"{len(one.printed):13}")
    codes = Counter((str(r["status"]), str(r["code"])) for r in found[-1].rows)
    for (status, code), count in sorted(codes.items()):
        print(f"  {status:8} {code:28} {count:5}")
    print("what was printed of all:")
    for line in found[-1].printed:
        print(f"  | {line}")


if __name__ == "__main__":
    sys.exit(main())
