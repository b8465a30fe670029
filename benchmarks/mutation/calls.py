"""Which test calls which function, and how long it takes; see mutate.py."""

from __future__ import annotations

import hashlib
import json
import multiprocessing
import os
import sys
import threading
import time
from collections import defaultdict
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import pytest

MARKERS = "not real_data and not packaging"
#: hypothesis is imported before pytest could rewrite its assertions.
IGNORED = ("-W", "ignore::pytest.PytestAssertRewriteWarning")


class _Watch:
    """A pytest plugin: seconds of each test, and the functions it calls, its fixtures' included."""

    def __init__(self, folder: Path) -> None:
        self.folder = str(folder / "legoworld") + os.sep
        self.now: set[tuple[str, str]] = set()
        self.fixtures: dict[str, set[tuple[str, str]]] = defaultdict(set)
        self.tests: dict[str, dict[str, Any]] = {}

    def _trace(self, frame: Any, _event: str, _argument: object) -> None:
        code = frame.f_code
        if code.co_filename.startswith(self.folder):
            self.now.add((code.co_filename[len(self.folder) - 10 :], code.co_qualname))

    @pytest.hookimpl(hookwrapper=True)
    def pytest_fixture_setup(self, fixturedef: Any) -> Iterator[None]:
        before, self.now = self.now, set()
        yield
        own = self.fixtures[f"{fixturedef.baseid}::{fixturedef.argname}"]
        own |= self.now
        self.now = before | own

    @pytest.hookimpl(hookwrapper=True)
    def pytest_runtest_protocol(self, item: Any) -> Iterator[None]:
        self.now, started = set(), time.process_time()
        threading.settrace(self._trace)
        sys.settrace(self._trace)
        yield
        sys.settrace(None)
        for name, definitions in item._fixtureinfo.name2fixturedefs.items():
            for definition in definitions:
                self.now |= self.fixtures.get(f"{definition.baseid}::{name}", set())
        row = self.tests.setdefault(item.nodeid, {"passed": False})
        row |= {"seconds": time.process_time() - started, "calls": sorted(self.now)}

    def pytest_runtest_logreport(self, report: Any) -> None:
        if report.when == "call":
            self.tests.setdefault(report.nodeid, {})["passed"] = report.passed
            self.tests[report.nodeid]["wall"] = report.duration  # with what other processes took


def calls_of_tests(
    path: Path, given: Sequence[str], longest: float, sources: Sequence[str]
) -> dict[str, dict[str, Any]]:
    """Every test that passes on the unchanged tree and takes no more than `longest` seconds.

    path: where it is kept; only files of tests that changed run again, all when one of `sources`
    did. Each has its `calls` ((file, qualified name) pairs of functions below legoworld/),
    `seconds` and `wall`.
    """
    now = {name: hashlib.sha256(Path(name).read_bytes()).hexdigest() for name in _files(given)}
    seen = {name: hashlib.sha256(Path(name).read_bytes()).hexdigest() for name in sources}
    known = json.loads(path.read_text()) if path.is_file() else {}
    if known.get("sources") != seen:
        known = {"files": {}, "tests": {}}
    changed = [name for name, sha256 in now.items() if known["files"].get(name) != sha256]
    if changed:
        receiver, sender = multiprocessing.Pipe(duplex=False)
        process = multiprocessing.get_context("fork").Process(target=_watch, args=(sender, changed))
        process.start()
        sender.close()
        found = receiver.recv()
        process.join()
        kept = {
            name: row
            for name, row in known["tests"].items()
            if name.split("::")[0] in now and name.split("::")[0] not in changed
        }
        known = {"sources": seen, "files": now, "tests": kept | found}
        path.write_text(json.dumps(known))
    tests = known["tests"]
    passed = {name: row for name, row in tests.items() if row["passed"]}
    quick = {name: row for name, row in passed.items() if cost(row) <= longest}
    print(f"{len(tests)} tests, {len(passed)} pass unchanged, {len(quick)} are quick enough")
    return quick


def _files(given: Sequence[str]) -> list[str]:
    paths = [Path(name) for name in given]
    files = [p for path in paths for p in (path.rglob("test_*.py") if path.is_dir() else [path])]
    return sorted(map(str, files))


def _watch(pipe: Any, tests: list[str]) -> None:
    watch = _Watch(Path.cwd())
    pytest.main(options(tests), plugins=[watch])
    pipe.send(watch.tests)


def options(tests: list[str], *, blender: bool = False) -> list[str]:
    """What pytest is started with. blender: with the tests that start it."""
    markers = MARKERS if blender else f"not blender and {MARKERS}"
    fixed = ["-q", "-n0", "-p", "no:cacheprovider", "--hypothesis-seed=0", "-m", markers, *IGNORED]
    return [*fixed, *tests]


def cost(row: dict[str, Any]) -> float:
    """Seconds of a test: its process's own, or a part of the clock's when others did the work."""
    return max(float(row["seconds"]), float(row["wall"]) / 5)
