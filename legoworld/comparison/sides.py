"""The evaluations that are compared, under distinct names."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from legoworld.errors import UsageError
from legoworld.evaluation.stored import StoredEvaluation, read_evaluation


def read_sides(
    folders: Sequence[Path], *, names: Sequence[str] | None = None
) -> tuple[StoredEvaluation, ...]:
    """The evaluations in their given order, the scene's first, under distinct names.

    names: the names to use; by default each evaluation's recorded name, or its folder's name.
    UsageError: fewer than two folders. EvaluationFolderError: a folder is not a finished
    evaluation. EvaluationChangedError: a file differs from the one recorded in its evidence.json.
    """
    if len(folders) < 2:
        raise UsageError(
            "a comparison needs two evaluations",
            found=f"{len(folders)}",
            expected="EVAL_SCENE and at least one EVAL_BASELINE",
        )
    sides = [read_evaluation(folder) for folder in folders]
    if names is not None:
        return tuple(replace(s, name=name) for s, name in zip(sides, names, strict=True))
    names = distinct_names([(s.name, s.folder.resolve().name) for s in sides])
    return tuple(
        replace(side, name=f"{name} (prompted with truth)" if side.used_truth else name)
        for side, name in zip(sides, names, strict=True)
    )


def distinct_names(candidates: Sequence[tuple[str, str]]) -> list[str]:
    """Distinct names from (name, folder name): extended by the folder name, then by a number."""
    common = Counter(name for name, _ in candidates)
    names = [name if common[name] == 1 else f"{name} ({folder})" for name, folder in candidates]
    seen: Counter[str] = Counter()
    repeated = Counter(names)
    for place, name in enumerate(names):
        seen[name] += 1
        if repeated[name] > 1:
            names[place] = f"{name} {seen[name]}"
    return names
