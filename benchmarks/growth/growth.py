"""How the time and memory of a readout grow: with triangles, instances, pixels, scenes, workers.

    python benchmarks/growth/growth.py                # 5 thousand triangles to 5 million, and so on
    python benchmarks/growth/growth.py --small        # minutes less: without the largest of each
    python benchmarks/growth/growth.py --only pixels,workers

Each number is one whole `legoworld readout`: CPU seconds of the command and its Blender processes
together (less disturbed by other load than wall seconds), and the memory of the largest of them.
"fresh" reads with Blender, "cached" from the snapshots. The exponent k is that of the least-squares
fit fixed + each * n ** k in relative error: 1 is linear, and below it part of the cost is shared.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.optimize import nnls

HERE = Path(__file__).resolve().parent
#: Pixels as width x height of 4:3.
SIDES = {300_000: (640, 480), 2_000_000: (1632, 1224), 8_000_000: (3264, 2448),
         24_000_000: (5664, 4248)}  # fmt: skip
SERIES = {
    "triangles": (5_000, 50_000, 500_000, 5_000_000),
    "instances": (10, 100, 1_000, 10_000, 70_000),
    "pixels": tuple(SIDES),
    "scenes": (10, 30, 100, 300),
    "workers": (1, 2),
}
SMALL = {**SERIES, "triangles": (5_000, 50_000, 500_000), "instances": (10, 100, 1_000, 10_000),
         "pixels": tuple(SIDES)[:3], "scenes": (10, 30, 100)}  # fmt: skip
SCENES_FOR_WORKERS = 24
#: Below this share of the largest cost, noise decides the exponent.
ENOUGH = 0.5


@dataclass(frozen=True, kw_only=True)
class Cost:
    """What one command used; peak: bytes of its largest process."""

    wall_s: float
    cpu_s: float
    peak: int


def main() -> int:
    """Print every series; see the module's docstring."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", 1)[0])
    parser.add_argument("--small", action="store_true", help="without the largest of each")
    parser.add_argument("--only", default=",".join(SERIES), help=f"some of {', '.join(SERIES)}")
    chosen = parser.parse_args()
    series = SMALL if chosen.small else SERIES
    print(f"load average {', '.join(f'{x:.1f}' for x in os.getloadavg())}, {os.cpu_count()} cores")
    print("\n| what | n | fresh CPU s | cached CPU s | fresh wall s | cached wall s "
          "| fresh peak MiB | cached peak MiB |")  # fmt: skip
    print("|---|---|---|---|---|---|---|---|", flush=True)
    fits = []
    for what in chosen.only.split(","):
        costs = [both(what, n) for n in series[what]]
        if what != "workers":
            for i, kind in enumerate(("fresh", "cached")):
                fits.append(fit_line(what, kind, series[what], [pair[i] for pair in costs]))
    print("\n| what | | fixed s | share of the largest that grows | exponent k |")
    print("|---|---|---|---|---|")
    print("\n".join(fits))
    return 0


def both(what: str, n: int) -> tuple[Cost, Cost]:
    """One row: the readout with Blender, then from the cache it filled."""
    with tempfile.TemporaryDirectory(prefix="growth-") as temporary:
        folder = Path(temporary)
        more = prepared(folder, what, n)
        fresh, cached = (readout(folder, f"run{i}", more) for i in range(2))
    cells = [f"{n:,}", *(f"{c.cpu_s:.2f}" for c in (fresh, cached)),
             *(f"{c.wall_s:.2f}" for c in (fresh, cached)),
             *(f"{c.peak / 2**20:,.0f}" for c in (fresh, cached))]  # fmt: skip
    print(f"| {what} | {' | '.join(cells)} |", flush=True)
    return fresh, cached


def prepared(folder: Path, what: str, n: int) -> list[str]:
    """Build what is read; the options that the readout needs besides."""
    kind, count = (what, n) if what in ("triangles", "instances") else ("triangles", 5_000)
    build = [sys.executable, str(HERE / "build.py"), str(folder / "scenes" / "one"), kind]
    subprocess.run([*build, str(count)], check=True, stdout=subprocess.DEVNULL)
    if what == "pixels":
        width, height = SIDES[n]
        image = {"id": 1, "file_name": "one.jpg", "width": width, "height": height}
        track = {"info": {}, "images": [image], "categories": []}
        (folder / "track.json").write_text(json.dumps(track))
        return ["--task", "eth3d", "--track", str(folder / "track.json"), "--workers", "1"]
    if what in ("scenes", "workers"):
        copies(folder / "scenes", n if what == "scenes" else SCENES_FOR_WORKERS)
    return ["--task", "lvis", "--workers", str(n if what == "workers" else 1)]


def copies(scenes: Path, count: int) -> None:
    """`count` scenes of other bytes and one content; the first stays."""
    data = (scenes / "one" / "scene.blend").read_bytes()
    if not data.startswith(b"BLENDER"):  # Zstandard: a frame of eight bytes that readers skip
        data += (0x184D2A50).to_bytes(4, "little") + (8).to_bytes(4, "little")
    for i in range(1, count):
        scene = scenes / f"{i:05d}"
        scene.mkdir()
        (scene / "scene.blend").write_bytes(data + i.to_bytes(8, "little"))


def readout(folder: Path, run: str, more: Sequence[str]) -> Cost:
    """One command that must succeed."""
    command = [
        sys.executable, "-m", "legoworld", "readout", str(folder / "scenes"), "-q",
        "-o", str(folder / run), "--cache", str(folder / "cache"), "--time-limit", "600", *more,
    ]  # fmt: skip
    began = time.perf_counter()
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL)
    _, status, used = os.wait4(process.pid, 0)
    wall_s = time.perf_counter() - began
    process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode:
        raise SystemExit(f"exit code {process.returncode}: {' '.join(command)}")
    unit = 1 if sys.platform == "darwin" else 1024
    return Cost(wall_s=wall_s, cpu_s=used.ru_utime + used.ru_stime, peak=used.ru_maxrss * unit)


def fit_line(what: str, kind: str, counts: Sequence[int], costs: Sequence[Cost]) -> str:
    """The fit of one series as a table's row."""
    fixed, each, exponent = fitted(counts, [cost.cpu_s for cost in costs])
    largest = each * counts[-1] ** exponent
    share = largest / (fixed + largest)
    shown = f"{exponent:.2f}" if share > ENOUGH else "too little grows to tell"
    return f"| {what} | {kind} | {fixed:.2f} | {share:.0%} | {shown} |"


def fitted(counts: Sequence[int], seconds: Sequence[float]) -> tuple[float, float, float]:
    """(fixed, each, k) >= 0 of fixed + each * n ** k, k in steps of 0.01 up to 2."""
    n, t = np.array(counts, float), np.array(seconds)
    best = (np.inf, 0.0, 0.0, 0.0)
    for k in np.arange(0.3, 2.0, 0.01):
        columns = np.stack([np.ones_like(n), (n / n[-1]) ** k], 1) / t[:, None]
        (fixed, last), error = nnls(columns, np.ones_like(t))
        best = min(best, (error, float(fixed), float(last / n[-1] ** k), float(k)))
    return best[1:]


if __name__ == "__main__":
    sys.exit(main())
