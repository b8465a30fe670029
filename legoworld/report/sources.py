"""Evaluation and comparison folders, read and checked, in the order a page shows them."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from legoworld.errors import LegoWorldError
from legoworld.evaluation.folder import (
    EVIDENCE,
    MATCHES,
    PER_CATEGORY,
    PER_IMAGE,
    SUMMARY,
    VIEW,
    Row,
    read_rows,
    read_summary,
)
from legoworld.files import sha256_of_file

COMPARISON: Final = "comparison.json"
RUN_VIEW: Final = "run.json"

#: The order of the sections of a page.
_TASKS: Final = ("coco", "coco-masks", "lvis", "eth3d")


class ReportInputError(LegoWorldError):
    """What a page should be made of cannot be shown together, or is not what it says it is."""

    code = "report_input"


@dataclass(frozen=True, kw_only=True)
class Side:
    """One evaluation. label: what the page calls it, unique within its section."""

    folder: Path
    label: str
    summary: dict[str, Any]
    evidence: dict[str, Any]
    rows: tuple[Row, ...]
    categories: tuple[Row, ...]
    run: dict[str, Any]

    @property
    def is_scene(self) -> bool:
        """Whether the run read scenes; a baseline otherwise."""
        return self.summary.get("kind") == "scene"

    @property
    def task(self) -> str:
        """Coco, lvis or eth3d."""
        return str(self.summary["task"])

    @property
    def used_truth(self) -> bool:
        """Whether the run was told what to look for out of the truth."""
        return bool((self.run.get("configuration") or {}).get("used_truth"))

    @cached_property
    def run_rows(self) -> dict[int, Row]:
        """The run's own row of each image, by image id."""
        return {int(row["image_id"]): row for row in self.run["images"]}

    @cached_property
    def matches(self) -> dict[str, NDArray[Any]]:
        """The arrays of matches.npz."""
        with np.load(self.folder / MATCHES, allow_pickle=False) as arrays:
            return dict(arrays)

    def view(self, name: str) -> Any:
        """A file of view/, checked against evidence.json."""
        checked(self.folder, self.evidence, f"{VIEW}/{name}")
        return json.loads((self.folder / VIEW / name).read_text(encoding="utf-8"))

    def has_view(self, name: str) -> bool:
        """Whether view/ holds a file."""
        return f"{VIEW}/{name}" in self.evidence["files"]


@dataclass(frozen=True, kw_only=True)
class Section:
    """Evaluations of one task over one truth, scenes first; with a comparison of them if any."""

    key: str
    task: str
    sides: tuple[Side, ...]
    comparison: dict[str, Any] | None


def read_sources(folders: Sequence[Path]) -> list[Section]:
    """The sections of a page from evaluation and comparison folders.

    A comparison brings the evaluations it was computed from, where they still lie where it found
    them. ReportInputError when a folder is neither, or was changed after it was written.
    """
    sides: dict[Path, Side] = {}
    comparisons: list[tuple[dict[str, Any], tuple[Path, ...]]] = []
    for folder in folders:
        if (folder / COMPARISON).is_file():
            document, origins = _comparison(folder)
            comparisons.append((document, origins))
            sides |= {p.resolve(): _side(p) for p in origins if p.resolve() not in sides}
        elif folder.resolve() not in sides:
            sides[folder.resolve()] = _side(folder)
    groups: dict[tuple[str, str], list[Side]] = {}
    for side in sides.values():
        groups.setdefault((side.task, _truth_of(side)), []).append(side)
    sections = [
        _section(task, found, _comparison_of(found, task, comparisons))
        for (task, _), found in sorted(groups.items(), key=lambda g: _TASKS.index(g[0][0]))
    ]
    shown = [s.comparison for s in sections if s.comparison is not None]
    lone = [document for document, _ in comparisons if document not in shown]
    sections += [Section(key="", task=c["task"], sides=(), comparison=c) for c in lone]
    return _with_keys(sections)


def checked(folder: Path, evidence: dict[str, Any], name: str) -> Path:
    """A file of an evaluation; ReportInputError when it is not what evidence.json has on record."""
    path = folder / name
    expected = evidence["files"].get(name)
    found = sha256_of_file(path) if path.is_file() else "no file"
    if expected != found:
        raise ReportInputError(
            f"{folder.name}/{name} is not what was written",
            found=found,
            expected=str(expected),
            next_step="evaluate again; `legoworld evidence verify` names every difference",
        )
    return path


def _side(folder: Path) -> Side:
    summary = read_summary(folder)
    evidence = json.loads((folder / EVIDENCE).read_text(encoding="utf-8"))
    for name in (SUMMARY, PER_IMAGE):
        checked(folder, evidence, name)
    categories: list[Row] = []
    if PER_CATEGORY in evidence["files"]:
        categories = read_rows(checked(folder, evidence, PER_CATEGORY))
    if MATCHES in evidence["files"]:
        checked(folder, evidence, MATCHES)
    if f"{VIEW}/{RUN_VIEW}" not in evidence["files"]:
        raise ReportInputError(
            f"{folder.name} does not say what it scored",
            found=f"no {VIEW}/{RUN_VIEW}",
            expected="a folder of this version's `legoworld evaluate`",
            next_step="evaluate again with --overwrite",
        )
    path = checked(folder, evidence, f"{VIEW}/{RUN_VIEW}")
    run = json.loads(path.read_text(encoding="utf-8"))
    return Side(
        folder=folder,
        label=_label(summary, run),
        summary=summary,
        evidence=evidence,
        rows=tuple(read_rows(folder / PER_IMAGE)),
        categories=tuple(categories),
        run=run,
    )


def _label(summary: dict[str, Any], run: dict[str, Any]) -> str:
    if summary.get("kind") == "scene":
        return "scene"
    return str((run.get("configuration") or {}).get("baseline") or "baseline")


def _truth_of(side: Side) -> str:
    """What must agree for evaluations to stand in one table: every hash of the truth."""
    truth = [i["sha256"] for i in side.evidence["inputs"] if i["role"].startswith("truth")]
    return " ".join(sorted(truth))


def _section(task: str, sides: Sequence[Side], comparison: dict[str, Any] | None) -> Section:
    """Scenes first; two of one name are told apart by their folders."""
    ordered = sorted(sides, key=lambda s: not s.is_scene)
    labels = [s.label for s in ordered]
    named = [
        s if labels.count(s.label) == 1 else _relabelled(s, f"{s.label} ({s.folder.name})")
        for s in ordered
    ]
    images = [[(r["image_id"], r["file_name"]) for r in s.rows] for s in named]
    if any(other != images[0] for other in images[1:]):
        raise ReportInputError(
            f"evaluations of {task} are over different images",
            found=", ".join(f"{s.folder.name}: {len(s.rows)}" for s in named),
            expected="one track",
            next_step="make a page of each",
        )
    return Section(key="", task=task, sides=tuple(named), comparison=comparison)


def _relabelled(side: Side, label: str) -> Side:
    return Side(
        folder=side.folder,
        label=label,
        summary=side.summary,
        evidence=side.evidence,
        rows=side.rows,
        categories=side.categories,
        run=side.run,
    )


def _comparison(folder: Path) -> tuple[dict[str, Any], tuple[Path, ...]]:
    """comparison.json, and the evaluation folders of its evidence that are still there."""
    evidence = json.loads((folder / EVIDENCE).read_text(encoding="utf-8"))
    document = json.loads(checked(folder, evidence, COMPARISON).read_text(encoding="utf-8"))
    if document.get("kind") != "comparison":
        raise ReportInputError(
            f"{folder.name} is no comparison of evaluations",
            found=repr(document.get("kind")),
            expected="'comparison'",
            next_step="name the comparisons it joins instead",
        )
    found: dict[Path, None] = {}
    for entry in evidence["inputs"]:
        path = folder / entry["path"]
        if path.name == SUMMARY and path.is_file():
            if sha256_of_file(path) != entry["sha256"]:
                raise ReportInputError(
                    f"{path.parent.name} is not what {folder.name} was computed from",
                    found=f"another {SUMMARY}",
                    expected=f"sha256 {entry['sha256']}",
                    next_step="compare again",
                )
            found[path.parent] = None
    return document, tuple(found)


def _comparison_of(
    sides: Sequence[Side],
    task: str,
    comparisons: Sequence[tuple[dict[str, Any], tuple[Path, ...]]],
) -> dict[str, Any] | None:
    mine = {s.folder.resolve() for s in sides}
    for document, origins in comparisons:
        if document["task"] == task and origins and {p.resolve() for p in origins} <= mine:
            return document
    return None


def _with_keys(sections: Sequence[Section]) -> list[Section]:
    """Each section's name in links: its task, numbered where there are several."""
    seen: dict[str, int] = {}
    keyed = []
    for s in sections:
        seen[s.task] = seen.get(s.task, 0) + 1
        key = s.task if seen[s.task] == 1 else f"{s.task}-{seen[s.task]}"
        keyed.append(Section(key=key, task=s.task, sides=s.sides, comparison=s.comparison))
    return keyed
