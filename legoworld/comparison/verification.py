"""Verification of a comparison folder: all hashes, then all numbers from the evaluations."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from legoworld.comparison.compatibility import read_sides
from legoworld.comparison.document import compare
from legoworld.comparison.folder import (
    COMPARISON,
    KINDS,
    initial_evidence,
    paired_evidence,
    read_comparison,
    read_document,
    rendered_tables,
)
from legoworld.comparison.make_comparison import join_comparisons
from legoworld.comparison.tables import Document
from legoworld.evaluation.checks import Check, check_files, check_inputs, find_input, until_damage
from legoworld.evaluation.detection.scoring import AGREEMENT
from legoworld.files import Json
from legoworld.records.base import Storable, as_json, to_record
from legoworld.records.comparison import Comparison, ComparisonSettings, JoinedComparison
from legoworld.records.evaluation import AnyEvidence
from legoworld.records.folders.read_evaluation import EVIDENCE, read_evidence


def verify_comparison(folder: Path, root: Path | None) -> list[Check]:
    """Every check of a comparison folder, joined or not.

    The evaluations (or joined comparisons) are looked for below `root` if given. If one is missing
    or changed, the numbers cannot be recomputed and only hashes are checked.
    """
    evidence = read_evidence(folder, KINDS)
    checks = [*check_files(folder, evidence), *check_inputs(folder, evidence, root)]
    if any(c.status != "ok" for c in checks):
        return checks
    return [*checks, *until_damage(_remake(folder, evidence, root))]


def _remake(folder: Path, evidence: AnyEvidence, root: Path | None) -> Iterator[Check]:
    document = read_document(folder)
    if isinstance(document, JoinedComparison):
        yield from until_damage(_check_joined(folder, evidence, root))
    else:
        yield from until_damage(_check_comparison(folder, evidence, document, root))
    yield from _tables(folder, document)


def _check_comparison(
    folder: Path, evidence: AnyEvidence, document: Comparison, root: Path | None
) -> Iterator[Check]:
    """Checks of the document against one recomputed from the evaluations."""
    evaluations = [path.parent for path in _find_inputs(folder, evidence, EVIDENCE, root)]
    sides = read_sides(evaluations, names=[method.name for method in document.methods])
    settings = to_record(ComparisonSettings, evidence.configuration)
    again = compare(sides, settings)
    recorded = _json(folder / EVIDENCE)
    yield _agrees("numbers from the evaluations", again, _json(folder / COMPARISON))
    raw = initial_evidence(folder, sides, settings).methods
    yield _agrees("raw numbers of the evaluations", raw, recorded["methods"])
    yield _agrees("paired images and numbers", paired_evidence(again), recorded["pairs"])


def _check_joined(folder: Path, evidence: AnyEvidence, root: Path | None) -> Iterator[Check]:
    """Checks of the document against one recomputed from the joined comparisons."""
    paths = _find_inputs(folder, evidence, COMPARISON, root)
    again = join_comparisons([read_comparison(path) for path in paths])
    yield _agrees("numbers from the comparisons", again, _json(folder / COMPARISON))


def _json(path: Path) -> Any:
    """The whole content of a file, so that unknown keys are found as well."""
    return json.loads(path.read_bytes())


def _find_inputs(folder: Path, evidence: AnyEvidence, name: str, root: Path | None) -> list[Path]:
    """The locations of the inputs with this file name, in recorded order."""
    entries = [e.path for e in evidence.inputs if Path(e.path).name == name]
    paths = [find_input(folder, path, root) for path in entries]
    return [path for path in paths if path is not None]


def _agrees(what: str, computed: Storable, recorded: Json) -> Check:
    """Equality up to summation order, which may differ between machines' NumPy builds."""
    worst, where = _largest_difference(json.loads(json.dumps(as_json(computed))), recorded, "")
    status = "ok" if worst <= AGREEMENT else "DIFFERS"
    return Check(status, what, f"largest difference {worst:.1e}{where and ' at ' + where}")


def _largest_difference(value: Json, recorded: Json, where: str) -> tuple[float, str]:
    """The largest difference of two numbers; infinite if anything else differs."""
    numbers = type(value) in (int, float) and type(recorded) in (int, float)
    if numbers and isinstance(value, int | float) and isinstance(recorded, int | float):
        difference = abs(value - recorded)
        if math.isnan(difference):  # which no comparison below would find the largest
            return float("inf"), where
        return difference, where if value != recorded else ""
    pairs: list[tuple[Json, Json, str]] = []
    if isinstance(value, dict) and isinstance(recorded, dict) and value.keys() == recorded.keys():
        pairs = [(value[k], recorded[k], f"{where}.{k}") for k in value]
    elif isinstance(value, list) and isinstance(recorded, list) and len(value) == len(recorded):
        both = zip(value, recorded, strict=True)
        pairs = [(a, b, f"{where}[{k}]") for k, (a, b) in enumerate(both)]
    elif value != recorded:
        return float("inf"), where
    differences = (_largest_difference(*pair) for pair in pairs)
    return max(differences, key=lambda one: one[0], default=(0.0, ""))


def _tables(folder: Path, document: Document) -> Iterator[Check]:
    for name, text in rendered_tables(document).items():
        same = (folder / name).read_bytes() == text.encode("utf-8")
        yield Check("ok" if same else "DIFFERS", f"{name} from {COMPARISON}", "")
