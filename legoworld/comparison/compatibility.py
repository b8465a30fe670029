"""The evaluations that are compared: read under distinct names, and checked to be comparable."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from legoworld.comparison.family import load_comparison_family
from legoworld.errors import LegoWorldError, UsageError, one_line
from legoworld.evaluation.stored import StoredEvaluation, read_evaluation
from legoworld.records.base import UnsetType, as_json

_TRUTH_ROLES = ("truth", "truth_declaration")
#: The fields of per_image rows that depend only on the ground truth.
_TRUTH_FACTS = ("n_truth", "n_ignored_truth", "truth_wh", "n_valid")


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


class IncomparableError(LegoWorldError):
    """Two evaluations cannot be compared."""

    code = "incomparable"


def check_comparable(sides: Sequence[StoredEvaluation], *, allow_truth_prompts: bool) -> None:
    """Check every baseline against the first side. IncomparableError names all differences."""
    first = sides[0]
    family = load_comparison_family(first.task)
    for side in sides:
        if side.summary.partial:
            raise IncomparableError(
                f"{side.name} is a partial run",
                found=f"{side.summary.coverage.attempted} of its track's images attempted",
                expected="a run over the whole track",
                next_step="run it without --limit or --image-id and evaluate again",
            )
        _check_truth_prompts(side, allow=allow_truth_prompts)
    for other in sides[1:]:
        if first.task != other.task:
            raise _different(first, other, [f"task {first.task} and {other.task}"])
        differences = [*_differences(first, other), *family.differences(first, other)]
        ours, theirs = (family.facts(side).dataset_version for side in (first, other))
        if ours != theirs:
            differences.append(f"dataset version {ours} and {theirs}")
        if differences:
            raise _different(first, other, differences)


def _check_truth_prompts(side: StoredEvaluation, *, allow: bool) -> None:
    if side.used_truth and not allow:
        raise IncomparableError(
            f"{side.name} was prompted with the ground truth of the images it is scored on",
            found=f"used_truth {one_line(str(as_json(side.used_truth)), 120)}",
            expected="a run that only saw the photos and the vocabulary",
            next_step="pass --allow-truth-prompts: every score is then marked",
        )


def _different(
    first: StoredEvaluation, other: StoredEvaluation, differences: list[str]
) -> IncomparableError:
    return IncomparableError(
        f"{first.name} and {other.name} cannot be compared",
        found="; ".join(differences),
        expected="the same ground truth, track, card, evaluator, task and dataset version",
        next_step="evaluate both over one track, with the same --truth and --evaluator",
    )


def _differences(first: StoredEvaluation, other: StoredEvaluation) -> list[str]:
    """Differences in what must be equal for every task."""
    facts: dict[str, Callable[[StoredEvaluation], Any]] = {
        "evaluator": lambda s: f"{s.summary.evaluator.name} {s.summary.evaluator.version}",
        "card": lambda s: _short(s.evidence.configuration.card_sha256),
        "truth": _truth_files,
        "categories": lambda s: _short(s.run.configuration.vocabulary_sha256),
    }
    differences = []
    for name, fact in facts.items():
        ours, theirs = fact(first), fact(other)
        if ours != theirs:
            differences.append(f"{name} {ours} and {theirs}")
    tracks = [s.run.configuration.track_sha256 or None for s in (first, other)]
    if None not in tracks and tracks[0] != tracks[1]:
        differences.append(f"track {_short(tracks[0])} and {_short(tracks[1])}")
    return differences + _image_differences(first, other)


def _truth_files(side: StoredEvaluation) -> str:
    """Short hashes of the ground truth, in the order of its images."""
    entries = side.evidence.inputs
    hashes = [e.sha256 for e in entries if e.role in _TRUTH_ROLES]
    return _short(hashes[0]) if len(hashes) == 1 else "+".join(_short(h) for h in hashes)


def _image_differences(first: StoredEvaluation, other: StoredEvaluation) -> list[str]:
    """Images that only one side has, or whose ground truth differs."""
    ours, theirs = ({(r.image_id, r.file_name) for r in s.rows} for s in (first, other))
    if ours != theirs:
        example = min(ours ^ theirs)
        return [f"images: {len(ours ^ theirs)} on one side, such as {example[0]} ({example[1]})"]
    facts = [
        {r.image_id: [getattr(r, k, None) for k in _TRUTH_FACTS] for r in s.rows}
        for s in (first, other)
    ]
    unlike = [i for i in facts[0] if facts[0][i] != facts[1][i]]
    return [f"the ground truth of image {unlike[0]}"] if unlike else []


def _short(sha256: str | UnsetType | None) -> str:
    """The first digits of a hash; what was left out and what is null were not recorded alike."""
    return str(sha256)[:12] if sha256 else "not recorded"
