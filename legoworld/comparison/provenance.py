"""Recorded provenance: agents, prompts, cameras given, feedback."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Sequence
from typing import Final

from legoworld.evaluation.stored import StoredEvaluation
from legoworld.files import Json, canonical_json
from legoworld.records.base import UNSET
from legoworld.records.comparison import ByField, MadeBy

NOT_RECORDED: Final = "not recorded"

#: The fields of a scene's provenance.json, by which runs are compared.
FIELDS: Final = (
    "agent",
    "model",
    "plugin",
    "prompt_sha256",
    "task",
    "vocabulary_sha256",
    "camera_given",
    "metric_feedback",
)


def recorded_provenance(side: StoredEvaluation) -> list[MadeBy]:
    """Each distinct provenance of a run with the number of its scenes, most frequent first.

    A baseline has one provenance for all its images. Images without a scene have none.
    """
    if side.is_scene:
        sources = (side.run.scenes or {}).values()
        provenances = [UNSET if source is None else source.provenance for source in sources]
    else:
        provenances = [side.run.configuration.provenance] * side.summary.coverage.attempted
    counted = Counter(canonical_json(NOT_RECORDED if one is UNSET else one) for one in provenances)
    ordered = sorted(counted.items(), key=lambda item: (-item[1], item[0]))
    return [MadeBy(provenance=json.loads(text), images=n) for text, n in ordered]


def provenance_by_field(sides: Sequence[StoredEvaluation]) -> ByField:
    """Provenance of scenes for all fields recorded anywhere; baselines have their own."""
    by_method = {side.name: recorded_provenance(side) for side in sides if side.is_scene}
    by_field = {}
    for field in FIELDS:
        values = {name: _values(groups, field) for name, groups in by_method.items()}
        if any(set(counts) - {NOT_RECORDED} for counts in values.values()):
            by_field[field] = values
    return by_field


def provenance_notes(by_field: ByField) -> list[str]:
    """One sentence per field that differs between scenes, or one if nothing is recorded."""
    if not by_field:
        what = "agent, prompts, camera given, metric feedback"
        return [f"How the scenes were made ({what}) is not recorded."]
    notes = []
    for field, by_method in by_field.items():
        if len({value for counts in by_method.values() for value in counts}) < 2:
            continue
        parts = [
            f"{name} {', '.join(f'{value} ({n})' for value, n in counts.items()) or NOT_RECORDED}"
            for name, counts in by_method.items()
        ]
        notes.append(f"Scenes differ in {field} (images): {'; '.join(parts)}.")
    return notes


def _values(groups: Sequence[MadeBy], field: str) -> dict[str, int]:
    counts: Counter[str] = Counter()
    for group in groups:
        counts[_format_field(group.provenance, field)] += group.images
    return dict(sorted(counts.items()))


def _format_field(provenance: Json, field: str) -> str:
    if not isinstance(provenance, dict):
        return NOT_RECORDED if provenance == NOT_RECORDED else "unreadable"
    if field not in provenance:
        return NOT_RECORDED
    value = provenance[field]
    return value if isinstance(value, str) else canonical_json(value)
