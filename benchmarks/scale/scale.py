"""Large and odd scenes with known answers: are they right, how long, how much memory?

    python benchmarks/scale/scale.py [NAME ...] [--keep FOLDER]

Builds each scene with bpy, reads it out through the command line, checks the answer, and times the
stages in processes of their own. Exit 1 when an answer is wrong.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "tests"))

from answers import CASES, Case
from scene.foreign.processes import Usage, run_measured

HERE = Path(__file__).resolve().parent
STAGES = ("open", "evaluate", "extract", "save", "load", "group", "kernel", "encode")


def main() -> int:
    """Print the table; see the module's docstring for exit codes."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", 1)[0])
    parser.add_argument("names", nargs="*", help="only these scenes")
    parser.add_argument("--keep", type=Path, help="folder for scenes and runs, kept")
    arguments = parser.parse_args()
    cases = [c for c in CASES if not arguments.names or c.name in arguments.names]
    print(f"{'scene':16} {'task':6} {'wall':>6} {'main':>6} {'worker':>6}  "
          + " ".join(f"{s:>8}" for s in STAGES))  # fmt: skip
    print(f"{'':16} {'':6} {'s':>6} {'MiB':>6} {'MiB':>6}  "
          + " ".join(f"{'s':>8}" for _ in STAGES))  # fmt: skip
    wrong = 0
    with tempfile.TemporaryDirectory(prefix="scale-") as temporary:
        folder = arguments.keep or Path(temporary)
        for case in cases:
            wrong += not _measure(case, folder)
    return 1 if wrong else 0


def _measure(case: Case, folder: Path) -> bool:
    scenes = folder / "scenes" / case.name
    if not scenes.is_dir():
        _python("build.py", case.name, str(scenes / case.name))
    run = folder / "runs" / f"{case.name}-{case.task}"
    usage = _readout(scenes, case.task, run)
    stages = _stages(scenes / case.name / "scene.blend", case, folder)
    print(
        f"{case.name:16} {case.task:6} {usage.wall_s:6.1f} {usage.main_peak / 2**20:6.0f} "
        f"{usage.worker_peak / 2**20:6.0f}  " + " ".join(f"{stages[s]:8.2f}" for s in STAGES)
    )
    sizes = (
        f"{stages['meshes']:,.0f} meshes, {stages['surfaces']:,.0f} surfaces, "
        f"{stages['triangles']:,.0f} triangles stored, {stages['virtual_triangles']:,.0f} shown"
    )
    try:
        assert usage.returncode == 0, f"exit code {usage.returncode}"
        print(f"{'':16} right: {case.check(run)}; {sizes}", flush=True)
    except AssertionError as error:
        print(f"{'':16} WRONG: {error}; {sizes}", flush=True)
        return False
    return True


def _readout(scenes: Path, task: str, run: Path) -> Usage:
    return run_measured(
        [sys.executable, "-m", "legoworld", "readout", str(scenes), "--task", task, "-q",
         "-o", str(run), "--no-cache", "--workers", "1", "--overwrite", "--time-limit", "600"]
    )  # fmt: skip


def _stages(blend: Path, case: Case, folder: Path) -> dict[str, Any]:
    snapshot = folder / f"{case.name}.snapshot"
    blender = json.loads(_python("stages.py", "blender", str(blend), str(snapshot)))
    after = json.loads(_python("stages.py", "main", str(snapshot), case.task))
    snapshot.unlink()
    return {**blender, **after}


def _python(program: str, *arguments: str) -> str:
    done = subprocess.run(
        [sys.executable, str(HERE / program), *arguments],
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode:
        raise SystemExit(f"{program} {' '.join(arguments)}: {done.stderr[-2000:]}")
    return done.stdout.strip().splitlines()[-1] if done.stdout.strip() else ""


if __name__ == "__main__":
    sys.exit(main())
