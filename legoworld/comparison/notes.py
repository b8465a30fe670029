"""The notes of a comparison: caveats to read with its numbers."""

from __future__ import annotations

from collections.abc import Sequence

from legoworld.comparison.family import comparison_of_task
from legoworld.errors import one_line
from legoworld.evaluation.stored import StoredEvaluation
from legoworld.records.base import as_json


def note_differences(sides: Sequence[StoredEvaluation]) -> list[str]:
    """Notes on every difference between the sides that does not make them incomparable."""
    notes = [f"Differences are {sides[0].name} minus the other method."]
    notes += [_truth_prompts(side) for side in sides if side.used_truth]
    notes += comparison_of_task(sides[0].task).notes(sides)
    return [*notes, *_versions(sides)]


def _truth_prompts(side: StoredEvaluation) -> str:
    return (
        f"{side.name} was prompted with the truth of the images it is scored on: "
        f"{one_line(str(as_json(side.used_truth)), 160)}."
    )


def _versions(sides: Sequence[StoredEvaluation]) -> list[str]:
    """Different package versions: the 1e-12 agreement is checked within one version only."""
    versions = [s.evidence.versions for s in sides]
    names = sorted({name for packages in versions for name in packages})
    notes = []
    for name in names:
        of_sides = [v.get(name, "absent") for v in versions]
        if len(set(of_sides)) > 1:
            listed = ", ".join(f"{s.name} {v}" for s, v in zip(sides, of_sides, strict=True))
            notes.append(f"Evaluated with other versions of {name}: {listed}.")
    return notes
