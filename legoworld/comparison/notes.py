"""The notes of a comparison: caveats to read with its numbers."""

from __future__ import annotations

from collections.abc import Sequence

from legoworld.errors import one_line
from legoworld.evaluation.detection.protocols import PROTOCOLS
from legoworld.evaluation.stored import Evaluated
from legoworld.records.base import as_json


def notes_of(sides: Sequence[Evaluated]) -> list[str]:
    """Notes on every difference between the sides that does not make them incomparable."""
    notes = [f"Differences are {sides[0].name} minus the other method."]
    notes += [_truth_prompts(side) for side in sides if side.used_truth]
    if sides[0].is_depth:
        notes += _depth(sides)
    elif sides[0].task in PROTOCOLS:
        notes += _scores(sides)
    else:
        notes += _bench(sides)
    return [*notes, *_versions(sides)]


def _truth_prompts(side: Evaluated) -> str:
    return (
        f"{side.name} was prompted with the truth of the images it is scored on: "
        f"{one_line(str(as_json(side.used_truth)), 160)}."
    )


def _scores(sides: Sequence[Evaluated]) -> list[str]:
    """Which sides rank their predictions."""
    ranked = [s.name for s in sides if s.ranked]
    unranked = [s.name for s in sides if not s.ranked]
    if not ranked or not unranked:
        return []
    return [
        f"Official metrics: {', '.join(ranked)} ranked by own scores, {', '.join(unranked)} "
        "equally confident in everything and ordered canonically. Those of equal_confidence and "
        "tie_orders: no method ranks."
    ]


def _depth(sides: Sequence[Evaluated]) -> list[str]:
    notes = ["Images scored: each method over its own, so their differences are of other images."]
    models = {s.name: s.camera_model for s in sides}
    if set(models.values()) != {"none"}:
        listed = ", ".join(f"{name} {model}" for name, model in models.items())
        notes.append(
            f"Camera model: {listed}. A scene's pinhole view is warped to the distorted photo that "
            "the other methods saw."
        )
    notes += [
        f"{s.name}: {s.resampled} of {s.summary.coverage.scored} depth maps are "
        "smaller than the truth and were resampled to it."
        for s in sides
        if s.resampled
    ]
    return notes


def _bench(sides: Sequence[Evaluated]) -> list[str]:
    """What A's noise and unequal attempts mean for a difference."""
    notes = ["Attempted: a submission that is not valid counts 0. Paired: valid on both sides."]
    for side in sides:
        noise = side.bench.noise
        if noise.reference_sd is not None:
            notes.append(
                f"{side.name}: A of the reference's own renders has a standard deviation of "
                f"{noise.reference_sd:.4f} between seeds ({noise.n_reference} cases)."
            )
    return notes


def _versions(sides: Sequence[Evaluated]) -> list[str]:
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
