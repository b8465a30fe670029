"""The evaluations that are compared: read, held to their own hashes, given names."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from legoworld.errors import LegoWorldError, UsageError
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
from legoworld.evaluation.protocols import PROTOCOLS
from legoworld.files import sha256_of_file

RUN_VIEW: Final = f"{VIEW}/run.json"
#: Everything a comparison reads, in the order it is listed; absent files are none of the task's.
READ: Final = (EVIDENCE, SUMMARY, PER_IMAGE, PER_CATEGORY, MATCHES, RUN_VIEW)


class EvaluationChangedError(LegoWorldError):
    """An evaluation folder is no longer what was written."""

    code = "evaluation_changed"


@dataclass(frozen=True, kw_only=True)
class Side:
    """One evaluation.

    name: how tables call it; run: its view/run.json; rows: of per_image.jsonl, ascending image
    id; categories: of per_category.jsonl.
    """

    folder: Path
    name: str
    summary: dict[str, Any]
    evidence: dict[str, Any]
    run: dict[str, Any]
    rows: tuple[Row, ...]
    categories: tuple[Row, ...]

    @property
    def task(self) -> str:
        """coco, lvis or eth3d."""
        return str(self.summary["task"])

    @property
    def kind(self) -> str:
        """Either "scene", or what made the predictions instead."""
        return str(self.summary["kind"])

    @property
    def camera_model(self) -> str | None:
        """Depth only: none or dataset."""
        model = self.summary.get("protocol", {}).get("camera_model")
        return None if model is None else str(model)

    @property
    def max_side(self) -> int | None:
        """What a scene's depth was read out at, where that is smaller than the photos."""
        asked = self.run["configuration"].get("max_side")
        return asked if asked and self.summary.get("resampled") else None

    @property
    def used_truth(self) -> Any:
        """What the run says of truth it was prompted with; None for a run that saw none."""
        return self.run["configuration"].get("used_truth")

    def matches(self) -> dict[str, NDArray[Any]]:
        """The arrays of matches.npz."""
        with np.load(self.folder / MATCHES) as stored:
            return dict(stored)


def read_sides(folders: Sequence[Path], *, names: Sequence[str] | None = None) -> tuple[Side, ...]:
    """The evaluations in their given order, the scene's first, under distinct names.

    names: those they are to have; by default what each says of itself, or its folder's name.

    EvaluationFolderError: a folder is no finished evaluation. EvaluationChangedError: a file is
    not the one its evidence.json has on record.
    """
    if len(folders) < 2:
        raise UsageError(
            "a comparison needs two evaluations",
            found=f"{len(folders)}",
            expected="EVAL_SCENE and at least one EVAL_BASELINE",
        )
    found = [_read(folder) for folder in folders]
    if names is not None:
        return tuple(replace(s, name=name) for s, name in zip(found, names, strict=True))
    names = distinct_names([(s.name, s.folder.resolve().name) for s in found])
    return tuple(
        replace(side, name=f"{name} (prompted with truth)" if side.used_truth else name)
        for side, name in zip(found, names, strict=True)
    )


def distinct_names(candidates: Sequence[tuple[str, str]]) -> list[str]:
    """(name, folder name) each to a name no other has: with its folder's, then with a number."""
    common = Counter(name for name, _ in candidates)
    names = [name if common[name] == 1 else f"{name} ({folder})" for name, folder in candidates]
    seen: Counter[str] = Counter()
    repeated = Counter(names)
    for place, name in enumerate(names):
        seen[name] += 1
        if repeated[name] > 1:
            names[place] = f"{name} {seen[name]}"
    return names


def _read(folder: Path) -> Side:
    summary = read_summary(folder)
    evidence = json.loads((folder / EVIDENCE).read_text(encoding="utf-8"))
    wanted = [name for name in READ[1:] if name in evidence["files"]]
    needed = {SUMMARY, PER_IMAGE, RUN_VIEW, *([MATCHES] if summary["task"] in PROTOCOLS else [])}
    missing = sorted(needed - set(wanted))
    if missing:
        raise EvaluationChangedError(
            f"{folder.name} lacks what a comparison reads",
            found=f"no {', '.join(missing)}",
            expected="an evaluation of this version",
            next_step="evaluate the run again",
        )
    for name in wanted:
        _check_hash(folder, name, evidence["files"][name])
    run = json.loads((folder / RUN_VIEW).read_text(encoding="utf-8"))
    rows = read_rows(folder / PER_IMAGE)
    categories = read_rows(folder / PER_CATEGORY) if PER_CATEGORY in wanted else []
    return Side(
        folder=folder,
        name=_own_name(folder, run, str(summary["kind"])),
        summary=summary,
        evidence=evidence,
        run=run,
        rows=tuple(rows),
        categories=tuple(categories),
    )


def _check_hash(folder: Path, name: str, recorded: str) -> None:
    path = folder / name
    found = sha256_of_file(path)[:12] if path.is_file() else "no such file"
    if found != recorded[:12]:
        raise EvaluationChangedError(
            f"{folder.name}/{name} is not the file that was evaluated",
            found=found,
            expected=f"{recorded[:12]}, as in {EVIDENCE}",
            next_step="evaluate the run again",
        )


def _own_name(folder: Path, run: dict[str, Any], kind: str) -> str:
    """What to call it: "scene", or the baseline's recorded name, or the folder's."""
    if kind == "scene":
        return "scene"
    return str(run["configuration"].get("baseline") or folder.resolve().name)
