"""Damage .glb files in many seeded ways and read each in a process with limits.

    python benchmarks/fuzz/fuzz_glb.py --count 300 [--start 0] [--seconds 10] [FILE.glb ...]

Prints how many mutants of each kind ended how, the slowest, and the peak memory. Exit code 1 when
one ended in anything but a picture or a verdict, or took longer than --seconds.
"""

from __future__ import annotations

import argparse
import collections
import json
import resource
import subprocess
import sys
import tempfile
from pathlib import Path

TESTS = Path(__file__).parents[2] / "tests"


def main() -> int:
    arguments = _arguments()
    if arguments.worker:
        _worker(arguments)
        return 0
    command = [sys.executable, __file__, "--worker", *sys.argv[1:]]
    rows, start = [], arguments.start
    end = arguments.start + arguments.count
    while start < end:
        command[3:] = [*sys.argv[1:], "--start", str(start), "--count", str(end - start)]
        found = _run(command, arguments.seconds)
        rows += found
        start += max(len(found), 1)
    return _report(rows, arguments.seconds)


def _run(command: list[str], seconds: float) -> list[dict]:
    """The rows of one worker; the last says how the worker ended when it did not finish."""
    rows: list[dict] = []
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        for line in process.stdout:
            row = json.loads(line)
            if "ended" in row:
                rows.append(row)
            else:
                current = row
    if process.returncode:
        rows.append({**current, "ended": f"process ended {process.returncode}", "seconds": seconds})
    return rows


def _worker(arguments: argparse.Namespace) -> None:
    sys.path.insert(0, str(TESTS))
    from scene.gltf.mutants import mutant, outcome, rich_glb

    resource.setrlimit(resource.RLIMIT_AS, (4 << 30, 4 << 30))
    files = [path.read_bytes() for path in arguments.files] or [rich_glb()]
    with tempfile.TemporaryDirectory() as folder:
        for seed in range(arguments.start, arguments.start + arguments.count):
            kind, data = mutant(files[seed // 8 % len(files)], seed)
            print(json.dumps({"seed": seed, "kind": kind}), flush=True)
            try:
                ended, seconds = outcome(data, Path(folder))
            except Exception as error:  # noqa: BLE001  that is what is looked for
                ended, seconds = f"TRACEBACK {type(error).__name__}: {error}", 0.0
            peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
            row = {"seed": seed, "kind": kind, "ended": ended, "seconds": seconds, "peak_mb": peak}
            print(json.dumps(row), flush=True)


def _report(rows: list[dict], seconds: float) -> int:
    counts = collections.Counter((row["kind"], row["ended"]) for row in rows)
    for (kind, ended), n in sorted(counts.items()):
        print(f"{n:6}  {kind:12} {ended}")
    slowest = max(rows, key=lambda row: row["seconds"])
    peak = max(row.get("peak_mb", 0) for row in rows)
    print(f"{len(rows)} mutants; slowest {slowest['seconds']:.3f} s (seed {slowest['seed']}); "
          f"peak memory of a worker {peak:.0f} MB")  # fmt: skip
    bad = [
        row
        for row in rows
        if row["ended"].startswith(("TRACEBACK", "process ended")) or row["seconds"] > seconds
    ]
    for row in bad:
        print(f"BAD seed {row['seed']} {row['kind']}: {row['ended']}, {row['seconds']:.2f} s")
    return 1 if bad else 0


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("files", nargs="*", type=Path)
    parser.add_argument("--count", type=int, default=300)
    parser.add_argument("--start", type=int, default=0)
    parser.add_argument("--seconds", type=float, default=10.0)
    parser.add_argument("--worker", action="store_true", help=argparse.SUPPRESS)
    return parser.parse_args()


if __name__ == "__main__":
    raise SystemExit(main())
