"""Evaluation and comparison folders, read and checked, in the order a page shows them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

from legoworld.comparison.folder import COMPARISON, KINDS, read_comparison
from legoworld.errors import LegoWorldError
from legoworld.evaluation.stored import StoredEvaluation, check_file, read_evaluation
from legoworld.files import sha256_of_file
from legoworld.records.base import UNSET, Record, RecordError, UnsetType, decode
from legoworld.records.comparison import JOINED, KIND, Comparison, JoinedComparison
from legoworld.records.folders.read_evaluation import SUMMARY, read_evidence
from legoworld.report.family import load_page_family
from legoworld.tasks.registry import task_names

#: What a baseline is called that recorded no name.
_UNNAMED: Final = "baseline"


class ReportInputError(LegoWorldError):
    """What a page should be made of cannot be shown together, or is not what it says it is."""

    code = "report_input"


@dataclass(frozen=True, kw_only=True)
class Section:
    """Evaluations of one task over one truth, scenes first; with a comparison of them if any."""

    key: str
    task: str
    sides: tuple[StoredEvaluation, ...]
    comparison: Comparison | None


def read_sources(folders: Sequence[Path]) -> list[Section]:
    """The sections of a page from evaluation and comparison folders.

    A comparison brings the evaluations it was computed from, where they still lie where it found
    them. ReportInputError where they do not go together; EvaluationFolderError for a folder that
    is neither, EvaluationChangedError for one that was changed after it was written.
    """
    for folder in folders:
        _require_known_task(folder)
    sides: dict[Path, StoredEvaluation] = {}
    comparisons: list[tuple[Comparison, tuple[Path, ...]]] = []
    for folder in folders:
        if (folder / COMPARISON).is_file():
            document, origins = _comparison(folder)
            comparisons.append((document, origins))
            sides |= {
                p.resolve(): read_evaluation(p, unnamed=_UNNAMED)
                for p in origins
                if p.resolve() not in sides
            }
        elif folder.resolve() not in sides:
            sides[folder.resolve()] = read_evaluation(folder, unnamed=_UNNAMED)
    groups: dict[tuple[str, str], list[StoredEvaluation]] = {}
    for side in sides.values():
        groups.setdefault((side.task, _truth_key(side)), []).append(side)
    sections = [
        _section(task, group, _find_comparison(group, task, comparisons))
        for (task, _), group in sorted(groups.items(), key=lambda g: task_names().index(g[0][0]))
    ]
    shown = [s.comparison for s in sections if s.comparison is not None]
    lone = [document for document, _ in comparisons if document not in shown]
    sections += [Section(key="", task=c.task, sides=(), comparison=c) for c in lone]
    return _with_keys(sections)


class _OfTask(Record, frozen=True, kw_only=True):
    task: str | UnsetType = UNSET


def _require_known_task(folder: Path) -> None:
    """ReportInputError for an evaluation or a comparison of a task that a page cannot show."""
    for name in (SUMMARY, COMPARISON):
        try:
            task = decode(_OfTask, (folder / name).read_bytes()).task
        except (OSError, RecordError):
            continue  # reading the file reports what is wrong with it
        if task is not UNSET and task not in task_names():
            raise ReportInputError(
                f"{folder.name} cannot be shown in a report",
                found=f"task {task!r}",
                expected=f"a task among {', '.join(task_names())}",
                next_step="leave the folder out; its own files hold its numbers",
            )


def _truth_key(side: StoredEvaluation) -> str:
    """What must agree for evaluations to stand in one table: every hash of the truth."""
    truth = [i.sha256 for i in side.evidence.inputs if i.role.startswith("truth")]
    return " ".join(sorted(truth))


def _section(
    task: str, sides: Sequence[StoredEvaluation], comparison: Comparison | None
) -> Section:
    """Scenes first; two of one name are told apart by their folders."""
    ordered = sorted(sides, key=lambda s: not s.is_scene)
    labels, folders = [s.name for s in ordered], [s.folder.name for s in ordered]
    several = comparison is None and len(set(folders)) == len(folders) > 1
    if several and load_page_family(task).by_folder:
        labels = folders
        ordered = [replace(s, name=s.folder.name) for s in ordered]
    named = [
        s if labels.count(s.name) == 1 else replace(s, name=f"{s.name} ({s.folder.name})")
        for s in ordered
    ]
    images = [[(r.image_id, r.file_name) for r in s.rows] for s in named]
    if any(other != images[0] for other in images[1:]):
        raise ReportInputError(
            f"evaluations of {task} are over different images",
            found=", ".join(f"{s.folder.name}: {len(s.rows)}" for s in named),
            expected="one track",
            next_step="make a page of each",
        )
    return Section(key="", task=task, sides=tuple(named), comparison=comparison)


def _comparison(folder: Path) -> tuple[Comparison, tuple[Path, ...]]:
    """comparison.json, and the evaluation folders of its evidence that are still there."""
    evidence = read_evidence(folder, KINDS)
    document = read_comparison(check_file(folder, evidence, COMPARISON))
    if isinstance(document, JoinedComparison):
        raise ReportInputError(
            f"{folder.name} is no comparison of evaluations",
            found=repr(JOINED),
            expected=repr(KIND),
            next_step="name the comparisons it joins instead",
        )
    folders: dict[Path, None] = {}
    for entry in evidence.inputs:
        path = folder / entry.path
        if path.name == SUMMARY and path.is_file():
            if sha256_of_file(path) != entry.sha256:
                raise ReportInputError(
                    f"{path.parent.name} is not what {folder.name} was computed from",
                    found=f"another {SUMMARY}",
                    expected=f"sha256 {entry.sha256}",
                    next_step="compare again",
                )
            folders[path.parent] = None
    return document, tuple(folders)


def _find_comparison(
    sides: Sequence[StoredEvaluation],
    task: str,
    comparisons: Sequence[tuple[Comparison, tuple[Path, ...]]],
) -> Comparison | None:
    mine = {s.folder.resolve() for s in sides}
    for document, origins in comparisons:
        if document.task == task and origins and {p.resolve() for p in origins} <= mine:
            return document
    return None


def _with_keys(sections: Sequence[Section]) -> list[Section]:
    """Each section's name in links: its task, numbered where there are several."""
    seen: dict[str, int] = {}
    keyed = []
    for s in sections:
        seen[s.task] = seen.get(s.task, 0) + 1
        key = s.task if seen[s.task] == 1 else f"{s.task}-{seen[s.task]}"
        keyed.append(replace(s, key=key))
    return keyed
