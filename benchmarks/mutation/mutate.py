"""Changes the source in one place at a time and looks whether a test notices.

    python benchmarks/mutation/mutate.py legoworld/evaluation --tests tests/evaluation \\
        --count 300 --seed 1 --out FOLDER [--longest 4] [--budget 15] [--only ID ...] \\
        [--in-place]

Works in a copy of the tree below FOLDER. The tests run once unchanged, which tells which tests call
which functions; then for each change of a random sample those tests run, quickest first, until one
fails. A change at module level has the tests of the functions that read what it binds. Each change
is made to the file itself, so a process that a test starts sees it as well.
FOLDER/results.jsonl has a line for each change; the same command goes on where it stopped. Prints
survivors, and the killed with their 95 % Wilson interval. A change whose tests run past 120 s and
ten times their time on the unchanged tree counts as killed; how many did is printed. A test
that kills for the first time runs once more without the change, under the same limits; if it fails,
it is left out.

--in-place changes this checkout instead of a copy, and restores it: where it is the one installed
(use a worktree with an environment of its own), Blender's and other workers see the change. Then
tests marked `blender` run, too.
"""

from __future__ import annotations

import argparse
import contextlib
import ctypes
import hashlib
import importlib
import itertools
import json
import multiprocessing
import os
import random
import resource
import shutil
import signal
import subprocess
import sys
import time
from collections import Counter, defaultdict
from collections.abc import Iterator
from dataclasses import asdict
from itertools import accumulate
from pathlib import Path
from typing import Any

import pytest
from calls import calls_of_tests, cost, options
from operators import Change, changes
from reach import reached_by_tests
from readers import Readers

ROOT = Path(__file__).resolve().parents[2]
#: Imported once, before the processes fork: most of a test run's start.
PRELOADED = (
    "cv2", "click", "hotcoco", "hypothesis", "jinja2", "numpy", "pycocotools.mask",
    "scipy.optimize",
)  # fmt: skip
MEMORY = 12 << 30
LATE = "time limit"
_PR_SET_CHILD_SUBREAPER = 36
#: Times of changed files, none twice: a compiled file is told stale by its source's time and size.
_STAMPS = itertools.count(int(time.time()) - 10**6)


def main() -> int:
    """Run and report."""
    arguments = _arguments()
    out = arguments.out.resolve()
    out.mkdir(parents=True, exist_ok=True)
    tree = ROOT if arguments.in_place else out / "tree"
    if not arguments.in_place:
        _copy(tree)
    os.chdir(tree)
    os.environ.update(PYTHONPATH=str(tree), PYTHONDONTWRITEBYTECODE="1", OPENBLAS_NUM_THREADS="1")
    sys.dont_write_bytecode = True
    sys.path[0] = str(tree)
    for name in PRELOADED:
        importlib.import_module(name)
    if arguments.in_place:
        words = options(arguments.tests, blender=True)
        called = reached_by_tests(out / "reach.json", ROOT, words, arguments.longest)
    else:
        sources = list(_sources(arguments.sources))
        called = calls_of_tests(out / "map.json", arguments.tests, arguments.longest, sources)
    # What tests leave behind becomes this process's child, and can be ended.
    ctypes.CDLL(None).prctl(_PR_SET_CHILD_SUBREAPER, 1, 0, 0, 0)
    sample = _sample(arguments)
    readers = Readers(tree)
    results = out / "results.jsonl"
    known = {}
    killers: dict[str, Counter[str]] = defaultdict(Counter)
    sound: set[str] = set()
    if results.is_file():
        known = {row["id"]: row for row in map(json.loads, results.read_text().splitlines())}
    print(f"{len(sample)} changes; {len(called)} tests", flush=True)
    for place, (path, change) in enumerate(sample):
        name = _identity(path, change)
        source = hashlib.sha256(Path(path).read_bytes()).hexdigest()
        if known.get(name, {}).get("source") == source and not arguments.only:
            continue
        row = {
            "id": name,
            "path": path,
            "source": source,
            **asdict(change),
            **_try(path, change, called, killers[path], sound, readers, arguments),
        }
        known[name] = row
        with results.open("a") as file:
            file.write(json.dumps(row) + "\n")
        print(f"{place + 1}/{len(sample)} {row['outcome']} {row['seconds']} s {name}", flush=True)
    _report([known[_identity(path, change)] for path, change in sample])
    return 0


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("sources", nargs="+", type=Path, help="folders or files, from the root")
    parser.add_argument("--tests", nargs="+", required=True, help="what pytest is given")
    parser.add_argument("--count", type=int, default=100)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--longest", type=float, default=4, help="seconds, default 4")
    parser.add_argument("--budget", type=float, default=15, help="seconds of tests per change")
    parser.add_argument("--in-place", action="store_true", help="change this checkout")
    parser.add_argument("--only", nargs="+", help="these changes, whatever is known of them")
    return parser.parse_args()


def _copy(tree: Path) -> None:
    """The tracked and new files of this tree and its compiled kernels."""
    shutil.rmtree(tree, ignore_errors=True)
    listed = subprocess.run(
        ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"],
        cwd=ROOT, check=True, capture_output=True, text=True,
    ).stdout  # fmt: skip
    kernels = [str(path.relative_to(ROOT)) for path in (ROOT / "legoworld").rglob("_kernel*.so")]
    for name in [*filter(None, listed.split("\0")), *kernels]:
        if (ROOT / name).is_file():
            (tree / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(ROOT / name, tree / name)


def _sources(sources: list[Path]) -> Iterator[str]:
    for source in sources:
        files = sorted(source.rglob("*.py")) if source.is_dir() else [source]
        yield from (str(path) for path in files)


def _identity(path: str, change: Change) -> str:
    key = hashlib.sha256(f"{path}{change.start}{change.end}{change.after}".encode()).hexdigest()
    return f"{path}:{change.line}:{change.operator}:{key[:8]}"


def _sample(arguments: argparse.Namespace) -> list[tuple[str, Change]]:
    every = [
        (path, change)
        for path in _sources(arguments.sources)
        for change in changes(Path(path).read_bytes())
    ]
    print(f"{len(every)} changes in all: {dict(Counter(c.operator for _, c in every))}")
    if arguments.only:
        return [one for one in every if _identity(*one) in arguments.only]
    random.Random(arguments.seed).shuffle(every)
    return every[: arguments.count]


def _chosen(
    path: str, change: Change, called: dict[str, dict[str, Any]], readers: Readers
) -> list[str]:
    """The tests that call a change's function or, at module level, one that reads what it binds.

    Where none does, those of the test files that call any function of its file.
    """
    functions, files = {(path, change.function)}, set[str]()
    if not change.function:
        functions, files = readers.of(path, Path(path).read_bytes(), change.start)
    calls = {test: {(file, name) for file, name in row["calls"]} for test, row in called.items()}
    direct = [test for test in called if calls[test] & functions or test.split("::")[0] in files]
    near = {test.split("::")[0] for test in called if any(f == path for f, _ in calls[test])}
    return direct or [test for test in called if test.split("::")[0] in near]


def _stages(
    chosen: list[str], called: dict[str, dict[str, Any]], killers: Counter[str], budget: float
) -> list[list[str]]:
    """The quick tests of the two likeliest files, then all others, cheapest first, within budget.

    Likely is what killed a change of the same source, and what calls little else.
    """
    files: dict[str, list[str]] = {}
    for test in chosen:
        files.setdefault(test.split("::")[0], []).append(test)
    aim = {file: min(len(called[t]["calls"]) for t in tests) for file, tests in files.items()}
    likely = sorted(files, key=lambda file: (-killers[file], aim[file]))[:2]
    quick = [test for file in likely for test in files[file] if cost(called[test]) < budget / 20]
    others = sorted({*chosen} - {*quick}, key=lambda test: (cost(called[test]), test))
    spent = accumulate(cost(called[test]) for test in others)
    rest = [test for test, seconds in zip(others, spent, strict=True) if seconds <= budget]
    return [stage for stage in (quick, sorted(rest)) if stage]


def _try(
    path: str,
    change: Change,
    called: dict[str, dict[str, Any]],
    killers: Counter[str],
    sound: set[str],
    readers: Readers,
    arguments: argparse.Namespace,
) -> dict[str, object]:
    """Change the file, run the tests, put it back.

    called: loses a test that fails without the change as well. sound: gets those that pass.
    """
    file = Path.cwd() / path
    chosen = _chosen(path, change, called, readers)
    if not chosen:
        return {"outcome": "survived", "by": "no test calls its file", "seconds": 0}
    before, stat, started = file.read_bytes(), file.stat(), time.monotonic()
    outcome, by = "survived", ""
    try:
        file.write_bytes(before[: change.start] + change.after.encode() + before[change.end :])
        os.utime(file, (stat.st_atime, next(_STAMPS)))
        for stage in _stages(chosen, called, killers, arguments.budget):
            limit = 120 + 10 * sum(called[test]["wall"] for test in stage)
            outcome, by = _run(options(stage, blender=arguments.in_place), limit)
            if outcome == "killed":
                killers[by.split("::")[0]] += 1
                break
    finally:
        file.write_bytes(before)
        os.utime(file, (stat.st_atime, stat.st_mtime))
    if by in called and by not in sound:
        if _run(options([by], blender=arguments.in_place), 120)[0] == "killed":
            print(f"left out, fails unchanged: {by}", flush=True)
            killers[by.split("::")[0]] -= 1
            del called[by]
            return _try(path, change, called, killers, sound, readers, arguments)
        sound.add(by)
    seconds = round(time.monotonic() - started, 1)
    return {"outcome": outcome, "by": by, "seconds": seconds, "tests": len(chosen)}


def _run(words: list[str], limit: float) -> tuple[str, str]:
    context = multiprocessing.get_context("fork")
    theirs, ours = context.Pipe(duplex=False)[::-1]
    process = context.Process(target=_child, args=(words, theirs))
    process.start()
    theirs.close()
    process.join(limit)
    late = process.is_alive()
    with contextlib.suppress(ProcessLookupError):  # and what its tests left running
        os.killpg(process.pid or 0, signal.SIGKILL)
    process.join()
    _end_orphans()
    by = ""
    with contextlib.suppress(EOFError):  # it ended without a word
        by = ours.recv()
    if late:
        return "killed", LATE
    return ("survived" if process.exitcode == 0 else "killed"), by or f"exit {process.exitcode}"


def _end_orphans() -> None:
    """End the processes that a test left in sessions of their own."""
    children = Path(f"/proc/self/task/{os.getpid()}/children")
    while own := children.read_text().split():
        for pid in map(int, own):
            with contextlib.suppress(ProcessLookupError):
                os.kill(pid, signal.SIGKILL)
            with contextlib.suppress(ChildProcessError):
                os.waitpid(pid, 0)


def _child(words: list[str], pipe: Any) -> None:
    os.setsid()
    # Not RLIMIT_AS: a browser reserves far more address space than it writes to.
    resource.setrlimit(resource.RLIMIT_DATA, (MEMORY, MEMORY))
    nothing = os.open(os.devnull, os.O_RDWR)
    for stream in (0, 1, 2):
        os.dup2(nothing, stream)

    class Failed:
        def pytest_runtest_logreport(self, report: Any) -> None:
            if report.failed:
                pipe.send(report.nodeid)

    code = int(pytest.main(["-x", *words], plugins=[Failed()]))
    os._exit(code)


def _report(rows: list[dict[str, Any]]) -> None:
    survivors = [row for row in rows if row["outcome"] == "survived"]
    print("\nsurvivors")
    for row in sorted(survivors, key=lambda row: str(row["id"])):
        print(f"  {row['id']}\n    - {row['before']}\n    + {row['after']}   ({row['by']})")
    killed = len(rows) - len(survivors)
    low, high = _wilson(killed, len(rows))
    share = killed / max(len(rows), 1)
    late = sum(row["by"] == LATE for row in rows)
    print(f"\n{killed} of {len(rows)} killed: {share:.1%} (95 %: {low:.1%} to {high:.1%})")
    print(f"{late} of the killed by the {LATE}")


def _wilson(hits: int, count: int) -> tuple[float, float]:
    """The 95 % interval of a share."""
    z, n = 1.959964, max(count, 1)
    share = hits / n
    middle = (share + z * z / (2 * n)) / (1 + z * z / n)
    half = z / (1 + z * z / n) * (share * (1 - share) / n + z * z / (4 * n * n)) ** 0.5
    return middle - half, middle + half


if __name__ == "__main__":
    raise SystemExit(main())
