"""A readout over damaged files through the command line, with everything it leaves behind noted."""

from __future__ import annotations

import json
import os
import sys
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from scene.foreign.mutants import mutant
from scene.foreign.processes import open_files, peak, resident, run_measured, zombies

from legoworld.files import sha256_of_file

STATUSES = frozenset({"ok", "missing", "invalid", "changed", "failed", "timeout"})
#: A whole file, read again after every so many damaged ones: it must not notice them.
CONTROL_EVERY = 4


@dataclass(frozen=True, kw_only=True)
class Planned:
    """One scene folder: `kind` is what was done to `source`, None for a whole copy of it."""

    name: str
    source: str
    kind: str | None


@dataclass(frozen=True, kw_only=True)
class Sample:
    """The main process at one moment: images done, resident bytes, open files, zombies."""

    done: int
    resident: int
    open_files: int
    zombies: int


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """What a run over damaged files came to.

    strays: files that are new or different outside the run folder. leftovers: worker processes
    that were still there after the command had ended.
    """

    returncode: int | None
    rows: dict[str, dict[str, Any]]
    predictions: dict[str, list[dict[str, Any]]]
    strays: list[str]
    leftovers: list[int]
    samples: list[Sample]
    wall_s: float
    main_peak: int
    worker_peak: int
    n_workers: int


def lay_out(
    folder: Path,
    sources: Mapping[str, bytes],
    *,
    turns: Sequence[str],
    seed: int,
    count: int,
    control: str,
) -> list[Planned]:
    """Write every source whole, then `count` mutants with controls between them.

    The sources take their turns as `turns` names them, again and again.
    """
    taken = Counter[str]()
    planned = [Planned(name=intact(name), source=name, kind=None) for name in sources]
    contents = list(sources.values())
    for i in range(count):
        source = turns[i % len(turns)]
        made = mutant(sources[source], seed=seed, number=taken[source])
        taken[source] += 1
        planned.append(Planned(name=f"{i + 1:04d}-{source}", source=source, kind=made.kind))
        contents.append(made.data)
        if (i + 1) % CONTROL_EVERY == 0:
            planned.append(Planned(name=f"{i + 1:04d}-z-control", source=control, kind=None))
            contents.append(sources[control])
    for plan, content in zip(planned, contents, strict=True):
        scene = folder / "scenes" / plan.name
        scene.mkdir(parents=True)
        (scene / "scene.blend").write_bytes(content)
    images = [
        {"id": i + 1, "file_name": f"{plan.name}.jpg", "width": 64, "height": 48}
        for i, plan in enumerate(planned)
    ]
    track = {"info": {}, "images": images, "categories": []}
    (folder / "track.json").write_text(json.dumps(track))
    return planned


def intact(source: str) -> str:
    """The scene that is an undamaged copy of a source."""
    return f"0000-{source}"


def read_out(
    folder: Path,
    run: str,
    *,
    workers: int = 2,
    time_limit_s: float = 20,
    memory_limit_gib: float = 2,
) -> Outcome:
    """Read a folder made by `lay_out`, with a home and a temporary folder of the run's own."""
    env = dict(os.environ)
    for name in ("home", "tmp"):
        (folder / name).mkdir(exist_ok=True)
    env |= {"HOME": str(folder / "home"), "TMPDIR": str(folder / "tmp"), "LEGOWORLD_CACHE": ""}
    env.pop("XDG_CACHE_HOME", None)
    (folder / run).mkdir()
    before = _files(folder)
    samples: list[Sample] = []

    def watch(pid: int) -> None:
        journal = folder / run / "journal.jsonl"
        done = journal.read_bytes().count(b"\n") if journal.is_file() else 0
        if done and (not samples or done >= samples[-1].done + 5):
            samples.append(
                Sample(done=done, resident=resident(pid), open_files=open_files(pid),
                       zombies=zombies(pid))
            )  # fmt: skip

    command = [
        sys.executable, "-m", "legoworld", "readout", str(folder / "scenes"), "--task", "coco",
        "--track", str(folder / "track.json"), "-o", str(folder / run), "-q", "--no-cache",
        "--workers", str(workers), "--time-limit", str(time_limit_s),
        "--memory-limit", str(memory_limit_gib),
    ]  # fmt: skip
    usage = run_measured(command, env=env, watch=watch)
    after = {n: h for n, h in _files(folder).items() if not n.startswith(f"{run}/")}
    rows = _rows(folder / run)
    return Outcome(
        returncode=usage.returncode,
        rows=rows,
        predictions=_predictions(folder / run, rows),
        strays=sorted(n for n in {*before, *after} if before.get(n) != after.get(n)),
        leftovers=sorted(pid for pid in usage.workers if peak(pid)),
        samples=samples,
        wall_s=usage.wall_s,
        main_peak=usage.main_peak,
        worker_peak=usage.worker_peak,
        n_workers=len(usage.workers),
    )


def faults(planned: list[Planned], outcome: Outcome, folder: Path) -> list[str]:
    """Everything that is wrong with a run over damaged files, one line each."""
    wrong = [f"left behind: {name}" for name in outcome.strays]
    wrong += [f"still running: process {pid}" for pid in outcome.leftovers]
    if outcome.returncode not in (0, 1):
        wrong.append(f"exit code {outcome.returncode}")
    for plan in planned:
        row = outcome.rows.get(plan.name)
        if row is None:
            wrong.append(f"{plan.name}: no row")
            continue
        reason = row["reason"]
        if row["status"] not in STATUSES:
            wrong.append(f"{plan.name}: status {row['status']!r}")
        if (row["status"] == "ok") != (reason is None):
            wrong.append(f"{plan.name}: status {row['status']} with the reason {reason!r}")
        if reason is not None and ("\n" in reason or not reason.strip()):
            wrong.append(f"{plan.name}: the reason is not one line")
        if str(folder) in json.dumps(row):
            wrong.append(f"{plan.name}: the row names a folder of this machine")
        if plan.kind is None:
            if row["status"] != "ok" and plan.name != intact(plan.source):
                wrong.append(f"{plan.name}: the control is {row['status']}: {reason}")
            if _comparable(outcome, plan.name) != _comparable(outcome, intact(plan.source)):
                wrong.append(f"{plan.name}: the file before it changed its row")
    return wrong


def disagreements(first: Outcome, second: Outcome) -> tuple[list[str], list[str]]:
    """Scenes whose row or predictions differ between two runs, and in what.

    Apart and first: those that crashed Blender in one run only. A damaged pointer makes Blender
    read whatever lies there, which depends on what the process has read before.
    """
    unstable, other = [], []
    for name in sorted({*first.rows, *second.rows}):
        one, two = first.rows.get(name, {}), second.rows.get(name, {})
        keys = sorted(k for k in {*one, *two} if one.get(k) != two.get(k))
        if first.predictions.get(name) != second.predictions.get(name):
            keys.append("predictions")
        if keys:
            shown = "; ".join(f"{k}: {one.get(k)!r} then {two.get(k)!r}" for k in keys)
            crashed = (one.get("code"), two.get("code")).count("worker_crashed") == 1
            (unstable if crashed else other).append(f"{name}: {shown[:200]}")
    return unstable, other


def _comparable(outcome: Outcome, name: str) -> object:
    """A scene's row and predictions without what names the scene."""
    row = {k: v for k, v in outcome.rows.get(name, {}).items()
           if k not in ("image_id", "file_name", "scene")}  # fmt: skip
    boxes = [{**p, "image_id": 0} for p in outcome.predictions.get(name, [])]
    return row, boxes


def _rows(run: Path) -> dict[str, dict[str, Any]]:
    lines = (run / "per_image.jsonl").read_text().splitlines()
    return {row["scene"]: row for row in map(json.loads, lines)}


def _predictions(run: Path, rows: dict[str, dict[str, Any]]) -> dict[str, list[dict[str, Any]]]:
    name = {row["image_id"]: scene for scene, row in rows.items()}
    found: dict[str, list[dict[str, Any]]] = {}
    for prediction in json.loads((run / "predictions.json").read_text()):
        found.setdefault(name[prediction["image_id"]], []).append(prediction)
    return found


def _files(folder: Path) -> dict[str, str]:
    return {
        str(path.relative_to(folder)): sha256_of_file(path) if path.is_file() else "folder"
        for path in sorted(folder.rglob("*"))
    }
