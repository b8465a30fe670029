"""Damaged .blend files: each must end in a verdict within its limits, and the run must live on.

    python benchmarks/fuzz/fuzz_blend.py [--count 345] [--seed 1] [--real FOLDER] [--keep FOLDER]
                                         [--once]

Damages one built scene (plain, Zstandard, gzip) and the scenes below FOLDER/scenes, reads all of
them through `legoworld readout`, twice, and prints what became of each kind of damage. Exit 1 when
anything but a verdict came of it, or when the second run says something else.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
import textwrap
from collections import Counter
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "tests"))

from conftest import _PRELUDE as PRELUDE
from conftest import REAL_DATA
from scene.foreign.sandbox import Outcome, Planned, disagreements, faults, intact, lay_out, read_out
from scene.foreign.sources import PROGRAM, sources


def main() -> int:
    """Run and report; see the module's docstring for exit codes."""
    arguments = _arguments()
    with tempfile.TemporaryDirectory(prefix="fuzz-") as temporary:
        folder = arguments.keep or Path(temporary)
        built = folder / "built"
        subprocess.run(
            [sys.executable, "-W", "ignore", "-c", PRELUDE + textwrap.dedent(PROGRAM), str(built)],
            check=True, stdout=subprocess.DEVNULL,
        )  # fmt: skip
        real = arguments.real if arguments.real.is_dir() else None
        files = sources(built, real)
        place = folder / f"seed-{arguments.seed}"
        planned = lay_out(
            place,
            files,
            turns=_turns(files),
            seed=arguments.seed,
            count=arguments.count,
            control="plain",
        )
        print(f"{arguments.count} mutants of {len(files)} files, seed {arguments.seed}")
        first = _run(place, planned, "run-1", arguments.workers)
        wrong = faults(planned, first, place)
        _print_statuses(planned, first)
        _print_read(planned, first)
        if not arguments.once:
            second = _run(place, planned, "run-2", arguments.workers)
            wrong += faults(planned, second, place)
            unstable, other = disagreements(first, second)
            wrong += other
            for line in unstable:
                print(f"unstable: {line}")
    for line in wrong:
        print(f"WRONG: {line}")
    return 1 if wrong else 0


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", 1)[0])
    parser.add_argument("--count", type=int, default=345)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--real", type=Path, default=REAL_DATA, help="holds scenes/*/scene.blend")
    parser.add_argument("--keep", type=Path, help="folder for the mutants and runs, kept")
    parser.add_argument("--workers", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--once", action="store_true", help="do not run a second time")
    return parser.parse_args()


def _run(folder: Path, planned: list[Planned], name: str, workers: int) -> Outcome:
    outcome = read_out(folder, name, workers=workers)
    mib = 2**20
    print(
        f"{name}: {len(planned)} files in {outcome.wall_s:.0f} s, {outcome.n_workers} processes, "
        f"main peak {outcome.main_peak / mib:.0f} MiB, worker peak "
        f"{outcome.worker_peak / mib:.0f} MiB, exit code {outcome.returncode}",
        flush=True,
    )
    print("  done  main MiB  open files  zombies")
    step = max(1, len(outcome.samples) // 6)
    for s in outcome.samples[::step]:
        print(f"  {s.done:4}  {s.resident / mib:8.1f}  {s.open_files:10}  {s.zombies:7}")
    return outcome


def _print_statuses(planned: list[Planned], outcome: Outcome) -> None:
    codes = Counter(
        (plan.kind.removeprefix("gzip: "), f"{row['status']}/{row['code']}")
        for plan in planned
        if plan.kind is not None and (row := outcome.rows.get(plan.name))
    )
    columns = sorted({code for _, code in codes})
    print("kind of damage" + "".join(f"\n  {i + 1} = {c}" for i, c in enumerate(columns)))
    for kind in sorted({kind for kind, _ in codes}):
        cells = "".join(f"{codes[kind, c] or '.':>5}" for c in columns)
        print(f"{kind:24}{cells}")
    totals = "".join(f"{sum(n for (_, x), n in codes.items() if x == c):5}" for c in columns)
    print(f"{'all':24}{totals}", flush=True)


def _turns(files: dict[str, bytes]) -> list[str]:
    """Every file once, and those three times whose blocks can be reached."""
    return [*files, *(n for n, d in files.items() if d[:2] in (b"BL", b"\x1f\x8b") for _ in "12")]


def _print_read(planned: list[Planned], outcome: Outcome) -> None:
    """The damaged files that were read: as if they were whole, or with other content."""
    same, other = 0, []
    for plan in planned:
        row, good = outcome.rows.get(plan.name, {}), outcome.rows.get(intact(plan.source), {})
        if plan.kind is not None and row.get("status") == "ok":
            same += row["snapshot_sha256"] == good["snapshot_sha256"]
            if row["snapshot_sha256"] != good["snapshot_sha256"]:
                other.append((plan, row, good))
    print(f"read although damaged: {same} with the whole file's content, {len(other)} with other")
    for plan, row, good in other:
        print(
            f"  {plan.name} ({plan.kind}): {row['instances']['total']} instances of "
            f"{good['instances']['total']}, {row['geometry_px']} px of {good['geometry_px']}, "
            f"new warnings: {[w for w in row['warnings'] if w not in good['warnings']]}"
        )


if __name__ == "__main__":
    sys.exit(main())
