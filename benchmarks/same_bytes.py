"""Whether a change leaves every written byte as it is: two checkouts over the shipped examples.

    git worktree add ../before HEAD~1            # and its kernels: python setup.py build_kernel -i
    python benchmarks/same_bytes.py ../before
    python benchmarks/same_bytes.py ../before --also RUN TRUTH --also RUN TRUTH
    python benchmarks/same_bytes.py ../before --real DATA

Each checkout reads the example scenes out, evaluates them, imports and evaluates a worse version
of its own results, compares, joins, exports, reports and verifies; then every file's sha256 is
compared, and what each command printed. Only run.json's time is left out. Both run under this
Python. --also: a run and its truth, which both evaluate, too. --real: the folder of real data that
tests use; the twelve scenes of examples/coco-val2017 are made once, then read out by both for every
task, scored and compared with a detector, and the evaluators' own samples are imported and scored.
Exit 1 and the files' names where anything differs.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
TASKS = ("coco", "coco-masks", "lvis")
TRUTHS = {"coco": "coco", "coco-masks": "coco", "lvis": "lvis"}
DRAWS = ("--draws", "200")
COCO, YOLOX = "coco/instances_val2017_188.json", "coco/yolox_nano_val2017_188_results.json"
#: task, ground truth, results of it; below the real data.
SAMPLES = {
    "boxes": ("coco", "evaluators/instances_val2014_100.json",
              "evaluators/instances_val2014_fakebbox100_results.json"),
    "masks": ("coco-masks", "evaluators/instances_val2014_100.json",
              "evaluators/instances_val2014_fakesegm100_results.json"),
    "lvis": ("lvis", "lvis/lvis_val_100.json", "lvis/lvis_val_100_synthetic_results.json"),
    "yolox": ("coco", COCO, YOLOX),
}  # fmt: skip


def main() -> int:
    """Print what differs; see the module's docstring."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", 1)[0])
    parser.add_argument("before", type=Path, help="the other checkout, its kernels built")
    parser.add_argument("--also", nargs=2, type=Path, action="append", metavar=("RUN", "TRUTH"))
    parser.add_argument("--real", type=Path, metavar="DATA", help="the folder of real data")
    chosen = parser.parse_args()
    also = [(run.resolve(), truth.resolve()) for run, truth in chosen.also or ()]
    with tempfile.TemporaryDirectory(prefix="legoworld-bytes-") as temporary:
        found = []
        made = scenes_of_programs(Path(temporary)) if chosen.real else None
        for name, checkout in (("before", chosen.before.resolve()), ("after", ROOT)):
            folder = Path(temporary) / name
            work = folder / "work"
            work.mkdir(parents=True)
            commands = Checkout(checkout, folder, work)
            commands.everything(also)
            if made:
                commands.twelve_scenes(made, chosen.real.resolve())
                commands.samples(chosen.real.resolve())
            found.append(hashes(work))
    before, after = found
    unlike = sorted(n for n in {*before, *after} if before.get(n) != after.get(n))
    for name in unlike:
        print(f"differs: {name}")
    print(f"{len(before)} files before, {len(after)} after, {len(unlike)} differ")
    return 1 if unlike else 0


def scenes_of_programs(folder: Path) -> Path:
    """The scenes of the twelve programs, made once: Blender's files differ from save to save."""
    for program in sorted((ROOT / "examples" / "coco-val2017").glob("*/scene.py")):
        words = ["execute", program, "-o", folder / "scenes" / program.parent.name, "--no-picture"]
        subprocess.run(
            [sys.executable, "-m", "legoworld", *map(str, words), "-q"], cwd=ROOT, check=True
        )
    return folder / "scenes"


class Checkout:
    """Commands of one checkout, in a folder of their own."""

    def __init__(self, checkout: Path, folder: Path, work: Path) -> None:
        self.data = checkout / "datasets" / "skimage_examples"
        self.work = work
        self.environment = {
            **os.environ,
            "PYTHONPATH": str(checkout),
            "LEGOWORLD_CACHE": str(folder / "cache"),
        }
        self.commands = 0

    def everything(self, also: list[tuple[Path, Path]]) -> None:
        """All steps, in their order."""
        shutil.copytree(self.data, self.work / "data")  # at the same relative path in both
        for task in TASKS:
            self.detections(task)
        self.depth()
        self.call("compare", "--join", *(f"compare-{t}" for t in ("coco", "lvis", "eth3d")),
                  "-o", "joined")  # fmt: skip
        for k, (run, truth) in enumerate(also):
            self.call("evaluate", run, "--truth", truth, "-o", f"also-{k}", *DRAWS)
            self.call("evidence", "verify", f"also-{k}")
            self.call("report", f"also-{k}", "-o", f"also-{k}.html")

    def detections(self, task: str) -> None:
        """Boxes or masks, and a worse version of them as a baseline's."""
        truth, track = (f"data/{k}_{TRUTHS[task]}.json" for k in ("truth", "track"))
        self.call("readout", "--task", task, "-o", f"run-{task}")
        results = json.loads((self.work / f"run-{task}" / "predictions.json").read_text())
        worse = [{**entry, "score": 1 / (2 + k)} for k, entry in enumerate(results[::2])]
        (self.work / f"worse-{task}.json").write_text(json.dumps(worse))
        self.call("baseline", "import", f"worse-{task}.json", "--task", task, "--track", track,
                  "--category-ids", "dataset", "-o", f"worse-{task}")  # fmt: skip
        for side in ("run", "worse"):
            self.call("evaluate", f"{side}-{task}", "--truth", truth, "-o", f"eval-{side}-{task}",
                      *DRAWS, "-v")  # fmt: skip
            self.call(
                "export", f"{side}-{task}", "--track", track, "-o", f"{side}-{task}.coco.json"
            )
        self.compared(task)

    def depth(self) -> None:
        """Depth against itself: the examples have no other."""
        self.call("readout", "--task", "eth3d", "-o", "run-eth3d")
        for side in ("run", "worse"):
            self.call("evaluate", "run-eth3d", "--truth", "run-eth3d/depth",
                      "-o", f"eval-{side}-eth3d", *DRAWS, "-v")  # fmt: skip
        self.compared("eth3d")

    def twelve_scenes(self, made: Path, data: Path) -> None:
        """Scenes of COCO's photos, for every task; boxes are scored beside a detector's."""
        shutil.copytree(made, self.work / "scenes")
        names = sorted(path.name for path in made.iterdir())
        (self.work / "photos.txt").write_text("".join(f"{name}.jpg\n" for name in names))
        self.call("track", "make", "--task", "coco", "--truth", data / COCO, "--images",
                  "photos.txt", "-o", "twelve.json")  # fmt: skip
        for task in (*TASKS, "eth3d"):
            track = () if task in ("lvis", "eth3d") else ("--track", "twelve.json")
            self.call("readout", "scenes", "--task", task, *track, "-o", f"twelve-{task}")
        self.call("baseline", "import", data / YOLOX, "--task", "coco", "--track", "twelve.json",
                  "--subset", "-o", "twelve-yolox")  # fmt: skip
        for side in ("coco", "coco-masks", "yolox"):
            self.call("evaluate", f"twelve-{side}", "--truth", data / COCO,
                      "-o", f"eval-twelve-{side}", *DRAWS, "-v")  # fmt: skip
        self.call(
            "compare", "eval-twelve-coco", "eval-twelve-yolox", "-o", "compare-twelve", *DRAWS
        )
        self.call("report", "compare-twelve", "--photos", data / "coco" / "val2017",
                  "-o", "report-twelve.html")  # fmt: skip

    def samples(self, data: Path) -> None:
        """The evaluators' samples: results that others made."""
        for name, (task, truth, results) in SAMPLES.items():
            self.call("track", "make", "--task", task, "--truth", data / truth,
                      "-o", f"track-{name}.json")  # fmt: skip
            self.call("baseline", "import", data / results, "--task", task,
                      "--track", f"track-{name}.json", "-o", f"sample-{name}")  # fmt: skip
            self.call("evaluate", f"sample-{name}", "--truth", data / truth,
                      "-o", f"eval-sample-{name}", *DRAWS, "-v")  # fmt: skip
            self.call("evidence", "verify", f"eval-sample-{name}", "-v")

    def compared(self, task: str) -> None:
        """Comparison, verification and report of the two evaluations of a task."""
        sides = [f"eval-{side}-{task}" for side in ("run", "worse")]
        self.call("compare", *sides, "-o", f"compare-{task}", *DRAWS, "-v")
        for folder in (*sides, f"compare-{task}"):
            self.call("evidence", "verify", folder, "-v")
        self.call("report", f"compare-{task}", "-o", f"report-{task}.html")

    def call(self, *arguments: object) -> None:
        """Run a command and keep what it printed."""
        words = [str(argument) for argument in arguments]
        done = subprocess.run(
            [sys.executable, "-m", "legoworld", *words, *(["-q"] if words[0] == "readout" else [])],
            cwd=self.work,
            env=self.environment,
            capture_output=True,
            check=False,
        )
        self.commands += 1
        shown = self.work / "printed" / f"{self.commands:03}-{words[0]}.txt"
        shown.parent.mkdir(exist_ok=True)
        shown.write_bytes(b"%d\n%s\n%s" % (done.returncode, done.stdout, done.stderr))
        if done.returncode:
            print(f"{' '.join(words)} ended with {done.returncode}: {done.stderr.decode()}")


def hashes(folder: Path) -> dict[str, str]:
    """sha256 of every file by its path; of a run.json without its time."""
    return {p.relative_to(folder).as_posix(): hash_of(p) for p in files_below(folder)}


def files_below(folder: Path) -> Iterator[Path]:
    return (p for p in folder.rglob("*") if p.is_file() and p.name != ".lock")


def hash_of(path: Path) -> str:
    data = path.read_bytes()
    if path.name == "run.json":
        document = json.loads(data)
        document.pop("finished_at", None)
        data = json.dumps(document, sort_keys=True).encode()
    return hashlib.sha256(data).hexdigest()


if __name__ == "__main__":
    sys.exit(main())
