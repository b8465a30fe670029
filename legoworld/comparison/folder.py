"""The comparison folder: comparison.json, evidence.json, and the tables in three forms."""

from __future__ import annotations

import json
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

from legoworld.comparison.document import KIND
from legoworld.comparison.formats import FORMATS
from legoworld.comparison.tables import coverage_table, csv_table, headline_table
from legoworld.conventions import SCHEMA_VERSION
from legoworld.errors import ConfigurationMismatchError, LegoWorldError
from legoworld.evaluation.folder import EVIDENCE, Row, input_file, installed_versions
from legoworld.evaluation.stored import READ, Evaluated
from legoworld.files import TEMPORARY_SUFFIX, readable_json, sha256_of_file, write_text

COMPARISON: Final = "comparison.json"
_TABLES: Final = ("table", "coverage")
_OURS: Final = (
    COMPARISON,
    EVIDENCE,
    *(f"{name}.{suffix}" for name in _TABLES for suffix in ("md", "tex", "csv")),
)


class ComparisonFolderError(LegoWorldError):
    """A comparison folder is not what it should be."""

    code = "comparison_folder"


def prepare_folder(folder: Path, evidence: dict[str, Any], *, overwrite: bool) -> None:
    """Make the folder; refuse one that holds another comparison, or something else altogether.

    The same comparison is written again over itself. ConfigurationMismatchError names what
    differs from an earlier one; with `overwrite` that one is replaced.
    """
    folder.mkdir(parents=True, exist_ok=True)
    strangers = sorted(p.name for p in folder.iterdir() if not _is_ours(p.name))
    if (folder / EVIDENCE).is_file() and not (folder / COMPARISON).is_file():
        strangers.append(EVIDENCE)  # an evaluation's
    if strangers:
        raise ConfigurationMismatchError(
            "the output folder holds something that is not a comparison",
            found=", ".join(strangers[:5]),
            expected="an empty folder or an earlier comparison",
            next_step="choose another -o",
        )
    if not (folder / EVIDENCE).is_file() or overwrite:
        return
    earlier = json.loads((folder / EVIDENCE).read_text(encoding="utf-8"))
    before, now = _depends_on(earlier), _depends_on(evidence)
    changed = sorted(key for key in {*before, *now} if before.get(key) != now.get(key))
    if changed:
        raise ConfigurationMismatchError(
            "the output folder holds another comparison",
            found="; ".join(f"{k}: {before.get(k)} -> {now.get(k)}" for k in changed),
            expected="the same evaluations and options",
            next_step="choose another -o, or pass --overwrite",
        )


def _depends_on(evidence: dict[str, Any]) -> dict[str, Any]:
    """Options and input hashes by role: what decides a comparison."""
    hashes: dict[str, list[str]] = {}
    for entry in evidence["inputs"]:
        hashes.setdefault(entry["role"], []).append(entry["sha256"][:12])
    return {"kind": evidence["kind"], **evidence["configuration"], **hashes}


def write_comparison(
    folder: Path, document: dict[str, Any], evidence: dict[str, Any], *, overwrite: bool
) -> None:
    """Write every file, each whole or not at all, evidence.json last; see `prepare_folder`."""
    prepare_folder(folder, evidence, overwrite=overwrite)
    (folder / EVIDENCE).unlink(missing_ok=True)  # half of a comparison is never taken for whole
    for path in folder.iterdir():
        path.unlink()
    write_text(folder / COMPARISON, readable_json(document))
    for name, text in rendered_tables(document).items():
        write_text(folder / name, text)
    files = {p.name: sha256_of_file(p) for p in sorted(folder.iterdir())}
    write_text(folder / EVIDENCE, readable_json({**evidence, "files": files}))


def rendered_tables(document: dict[str, Any]) -> dict[str, str]:
    """The tables by file name. The CSV has every row, unrounded; the others what people read."""
    headline, coverage = headline_table(document), coverage_table(document)
    found = {}
    for suffix, render in FORMATS.items():
        shown = csv_table(document) if suffix == "csv" else headline
        found[f"table.{suffix}"] = render(shown)
        found[f"coverage.{suffix}"] = render(coverage)
    return found


def read_document(folder: Path) -> dict[str, Any]:
    """comparison.json. ComparisonFolderError when the folder is no finished comparison."""
    if not (folder / EVIDENCE).is_file() or not (folder / COMPARISON).is_file():
        raise ComparisonFolderError(
            f"{folder.name or folder} is no finished comparison",
            found=f"no {COMPARISON} with {EVIDENCE}",
            expected="a folder that `legoworld compare` wrote",
        )
    document: dict[str, Any] = json.loads((folder / COMPARISON).read_text(encoding="utf-8"))
    return document


def evidence_of(
    folder: Path, sides: Sequence[Evaluated], configuration: dict[str, Any]
) -> dict[str, Any]:
    """What evidence.json says before anything is computed: the evaluations and their raw numbers.

    `paired_evidence` completes it.
    """
    return {
        "schema_version": SCHEMA_VERSION,
        "kind": KIND,
        "task": sides[0].task,
        "configuration": configuration,
        "versions": installed_versions(),
        "inputs": [entry for k, s in enumerate(sides) for entry in _side_inputs(folder, s, k)],
        "methods": [_raw(side) for side in sides],
    }


def paired_evidence(document: dict[str, Any]) -> list[Row]:
    """Per pair: the paired images, why each other one was dropped, the paired numbers."""
    return [_paired(pair) for pair in document["pairs"]]


def _side_inputs(folder: Path, side: Evaluated, place: int) -> list[Row]:
    """The files of an evaluation that a comparison reads; paths relative to the comparison."""
    paths = [(f"evaluation {place}", side.folder / name) for name in (EVIDENCE, *READ)]
    return [input_entry(folder, role, path) for role, path in paths if path.is_file()]


def input_entry(folder: Path, role: str, path: Path) -> Row:
    """An input as evidence.json lists it."""
    found = input_file(role, path)
    relative = os.path.relpath(path.resolve(), folder.resolve())
    return {
        "role": role,
        "path": Path(relative).as_posix(),
        "sha256": found.sha256,
        "bytes": found.size_bytes,
    }


def _raw(side: Evaluated) -> Row:
    """One side's own evidence: what its evaluator said, and of which files."""
    keys = ("raw", "equal_confidence", "metrics", "protocol", "run", "evaluator", "configuration")
    kept = {key: side.evidence[key] for key in keys if key in side.evidence}
    return {"name": side.name, **kept, "inputs": _hashes(side.evidence["inputs"])}


def _hashes(inputs: Sequence[Row]) -> list[Row]:
    """An evaluation's inputs by role and hash; where they lie is in its own evidence."""
    return [{"role": entry["role"], "sha256": entry["sha256"]} for entry in inputs]


def _paired(pair: dict[str, Any]) -> Row:
    means = {
        row["metric"]: {
            "scene": row["scene"]["value"],
            "baseline": row["baseline"]["value"],
            "difference": row["difference"]["value"],
        }
        for row in pair["rows"]
        if row["images"] == "paired"
    }
    keys = ("scene", "baseline", "coverage", "paired_image_ids", "dropped")
    return {**{key: pair[key] for key in keys}, "paired_metrics": means}


def _is_ours(name: str) -> bool:
    return name in _OURS or (name.startswith(".") and name.endswith(TEMPORARY_SUFFIX))
