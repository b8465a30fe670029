"""Every table of ratios in one run, as Markdown, with the machine they were taken on.

    python benchmarks/run.py --quick > quick.md        # a few minutes
    python benchmarks/run.py --full > full.md          # half an hour: the counts that docs/ gives
    python benchmarks/run.py --quick --only kernel,evaluate

Runs the programs of the other folders here, one after another, and prints what they print; what
one of them measures is said in its own docstring. --kernel-python: a Python that has embreex,
open3d and pykdtree, where they are not beside bpy. Exit 1 when a program fails; the others still
run.
"""

from __future__ import annotations

import argparse
import os
import platform
import shlex
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path

HERE = Path(__file__).resolve().parent
ROOT = HERE.parent
#: Who is timed, and what it is timed with; one that is not installed is said to be so.
PACKAGES = ("legoworld", "bpy", "numpy", "scipy", "pycocotools", "lvis", "hotcoco")
#: What the kernels are timed beside, in the Python of --kernel-python.
CONTENDERS = ("embreex", "open3d", "pykdtree")
#: The tables that --kernel-python prints.
KERNELS = ("kernel", "nearest", "views")


@dataclass(frozen=True, kw_only=True)
class Table:
    """One program and its arguments; `{scene}` and `{python}` stand for a built scene's folder and
    the Python that has bpy. needs: the package without which there is nothing to compare."""

    title: str
    name: str
    program: str
    quick: str
    full: str
    needs: str | None = None


TABLES = (
    Table(
        title="The kernel against its floor, Embree, Open3D and Cycles",
        name="kernel",
        program="kernel/run.py",
        quick="--scenes primitives,spheres,sliver_room --widths 640 --rounds 3"
        " --cycles-python {python}",
        full="--rounds 3 --slowest 15 --most-rows 256 --cycles-python {python}",
    ),
    Table(
        title="One scene from a cold start, against importing bpy and opening the file",
        name="startup",
        program="startup/cold_start.py",
        quick="{scene} --rounds 3",
        full="{scene} --rounds 9",
    ),
    Table(
        title="Many scenes, against Blender alone",
        name="throughput",
        program="throughput/throughput.py",
        quick="--count 12 --low 5000 --high 50000 --rounds 1",
        full="--count 200 --rounds 3",
    ),
    Table(
        title="Many simple scenes",
        name="simple",
        program="throughput/throughput.py",
        quick="--count 24 --low 5000 --high 5000 --rounds 1",
        full="--count 200 --low 5000 --high 5000 --rounds 3",
    ),
    Table(
        title="More workers than cores: the same bytes, images per second, memory",
        name="workers",
        program="throughput/workers.py",
        quick="--count 8 --workers 1,4",
        full="--count 240 --rounds 2",
    ),
    Table(
        title="Many folders, half of them odd: messages, seconds, memory",
        name="odd",
        program="soak/odd_folders.py",
        quick="--count 60",
        full="--count 1000",
    ),
    Table(
        title="Large and odd scenes: right, seconds, memory, stages",
        name="scale",
        program="scale/scale.py",
        quick="placements_10k near_plane_room",
        full="",
    ),
    Table(
        title="Many views of one scene: masks, boxes and depth, against ray tracers and Cycles",
        name="views",
        program="labels/views.py",
        quick="--scenes coffee,5k --views 1,50 --rounds 2 --cycles-python {python}",
        full="--scenes coffee,motorcycle,5k,100k,1m --views 1,10,100,1000 --cycles-python {python}",
    ),
    Table(
        title="Boxes: scoring against the official evaluator",
        name="evaluate",
        program="evaluate/scale.py",
        quick="--task coco --images 500 --predictions 20000 --draws 200 --official",
        full="--task coco --images 5000 --predictions 500000 --official",
        needs="pycocotools",
    ),
    Table(
        title="Masks: scoring against the official evaluator",
        name="evaluate",
        program="evaluate/scale.py",
        quick="--task lvis --images 200 --predictions 8000 --draws 200 --official",
        full="--task lvis --images 2000 --predictions 200000 --official",
        needs="lvis",
    ),
    Table(
        title="The bench: nearest neighbours, against k-d trees",
        name="nearest",
        program="bench/nearest.py",
        quick="--rounds 1 --check 10",
        full="--rounds 3",
    ),
    Table(
        title="The bench: scoring a case in parts, and a run from its files",
        name="scoring",
        program="bench/scoring.py",
        quick="--cases 6 --rounds 1",
        full="--cases 208",
    ),
)


def main() -> int:
    """Print everything; see the module's docstring."""
    names = sorted({table.name for table in TABLES})
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", 1)[0])
    how = parser.add_mutually_exclusive_group(required=True)
    how.add_argument("--quick", action="store_true", help="small counts, a few minutes")
    how.add_argument("--full", action="store_true", help="the counts of docs/, half an hour")
    parser.add_argument("--only", default=",".join(names), help=f"some of {', '.join(names)}")
    parser.add_argument(
        "--kernel-python", default=sys.executable, help="with embreex, open3d, pykdtree"
    )
    chosen = parser.parse_args()
    wanted = chosen.only.split(",")
    if unknown := sorted({*wanted} - {*names}):
        parser.error(f"--only: {unknown[0]} is none of {', '.join(names)}")
    print(f"# Benchmarks ({'quick' if chosen.quick else 'full'})", flush=True)
    print(f"\n{machine(chosen.kernel_python)}", flush=True)
    with tempfile.TemporaryDirectory(prefix="legoworld-benchmarks-") as temporary:
        scene = built_scene(Path(temporary))
        tables = [table for table in TABLES if table.name in wanted]
        failed = [table.title for table in tables if not printed(table, scene, chosen)]
    print(f"\nLoad average at the end: {load()}.")
    for title in failed:
        print(f"\nFAILED: {title}")
    return 1 if failed else 0


def printed(table: Table, scene: Path, chosen: argparse.Namespace) -> bool:
    """Run one program under its heading; False when it failed."""
    print(f"\n## {table.title}\n", flush=True)
    if table.needs and version(table.needs) is None:
        print(f"Not measured: {table.needs} is not installed.")
        return True
    template = table.quick if chosen.quick else table.full
    shown = f"python benchmarks/{table.program} {template}".strip()
    print(f"    {shown.format(scene='SCENE', python='PYTHON')}\n", flush=True)
    python = chosen.kernel_python if table.name in KERNELS else sys.executable
    arguments = shlex.split(template.format(scene=scene, python=sys.executable))
    began = time.perf_counter()
    done = subprocess.run(
        [python, str(HERE / table.program), *arguments],
        stdout=subprocess.PIPE,
        text=True,
        check=False,
        cwd=ROOT,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
    )
    print("\n".join(as_markdown(done.stdout.splitlines())))
    print(f"\n{time.perf_counter() - began:.0f} s in all, load average {load()}.", flush=True)
    if done.returncode:
        print(f"\nIt ended with exit code {done.returncode}.")
    return done.returncode == 0


def as_markdown(lines: list[str]) -> list[str]:
    """Tables as they are, everything else as a code block, so that columns stay aligned."""
    found: list[str] = []
    for line in lines:
        is_table = line.startswith("|")
        if found and is_table != found[-1].startswith("|"):
            found.append("")
        found.append(line if is_table or not line else f"    {line}")
    return found


def built_scene(folder: Path) -> Path:
    """A room of 5,000 triangles to start cold with."""
    command = [sys.executable, HERE / "throughput" / "build.py", folder, 1, 5000, 5000, 0]
    subprocess.run([str(part) for part in command], check=True, stdout=subprocess.DEVNULL)
    return folder / f"{0:012d}"


def machine(kernel_python: str) -> str:
    """The machine and everything whose version a ratio depends on, as a table."""
    rows = {
        "processor": cpu_model(),
        "cores": f"{len(os.sched_getaffinity(0))} of {os.cpu_count()}"
        if hasattr(os, "sched_getaffinity")
        else str(os.cpu_count()),
        "memory": f"{os.sysconf('SC_PAGE_SIZE') * os.sysconf('SC_PHYS_PAGES') / 2**30:.0f} GiB",
        "system": f"{platform.system()} {platform.release()}",
        "load average at the start": load(),
        "Python": platform.python_version(),
        **{name: version(name) or "not installed" for name in PACKAGES},
        **{name: version_in(kernel_python, name) for name in CONTENDERS},
    }
    return "\n".join(["| | |", "|---|---|", *(f"| {k} | {v} |" for k, v in rows.items())])


def cpu_model() -> str:
    """The processor's own name for itself."""
    info = Path("/proc/cpuinfo")
    for line in info.read_text().splitlines() if info.is_file() else ():
        if line.startswith("model name"):
            return line.partition(":")[2].strip()
    return platform.processor() or platform.machine()


def load() -> str:
    """Processes that were ready to run, over 1, 5 and 15 minutes."""
    return ", ".join(f"{value:.1f}" for value in os.getloadavg())


def version(package: str) -> str | None:
    """The installed version; None where there is none."""
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return None


def version_in(python: str, package: str) -> str:
    """The version installed for another Python, or that there is none."""
    asked = f"from importlib import metadata; print(metadata.version({package!r}))"
    done = subprocess.run([python, "-c", asked], capture_output=True, text=True, check=False)
    return done.stdout.strip() or "not installed"


if __name__ == "__main__":
    sys.exit(main())
