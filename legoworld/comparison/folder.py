"""The comparison folder: comparison.json, evidence.json, and the tables in three forms."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

from msgspec.structs import replace

from legoworld.comparison.tables import coverage_table, csv_table, headline_table
from legoworld.errors import ConfigurationMismatchError, LegoWorldError, cause
from legoworld.evaluation.stored import READ, StoredEvaluation
from legoworld.files import TEMPORARY_SUFFIX, sha256_of_file, write_text
from legoworld.records.base import RecordError, as_json, readable
from legoworld.records.comparison import (
    JOINED,
    KIND,
    Comparison,
    ComparisonEvidence,
    ComparisonSettings,
    JoinedComparison,
    Pair,
    PairedNumbers,
    PairEvidence,
    decode_comparison,
)
from legoworld.records.evaluation import AnyEvidence, Input, load_record_family
from legoworld.records.folders.evaluation_folder import input_file, installed_versions
from legoworld.records.folders.read_evaluation import EVIDENCE, read_evidence
from legoworld.tables.files import FORMATS

COMPARISON: Final = "comparison.json"
KINDS: Final = (KIND, JOINED)
_TABLES: Final = ("table", "coverage")
_OURS: Final = (
    COMPARISON,
    EVIDENCE,
    *(f"{name}.{suffix}" for name in _TABLES for suffix in ("md", "tex", "csv")),
)


class ComparisonFolderError(LegoWorldError):
    """A comparison folder is unusable."""

    code = "comparison_folder"


def prepare_folder(
    folder: Path, evidence: AnyEvidence | ComparisonEvidence, *, overwrite: bool
) -> None:
    """Create the folder; refuse one that holds a different comparison or anything else.

    The same comparison is rewritten. ConfigurationMismatchError names the differences from an
    existing one; with `overwrite` that one is replaced.
    """
    folder.mkdir(parents=True, exist_ok=True)
    strangers = sorted(p.name for p in folder.iterdir() if not _is_ours(p.name))
    if (folder / EVIDENCE).is_file() and not (folder / COMPARISON).is_file():
        strangers.append(EVIDENCE)  # an evaluation's
    if strangers:
        raise ConfigurationMismatchError(
            "the output folder contains something other than a comparison",
            found=", ".join(strangers[:5]),
            expected="an empty folder or an earlier comparison",
            next_step="choose another -o",
        )
    if not (folder / EVIDENCE).is_file() or overwrite:
        return
    earlier = read_evidence(folder, KINDS)
    before, now = _depends_on(earlier), _depends_on(evidence)
    changed = sorted(key for key in {*before, *now} if before.get(key) != now.get(key))
    if changed:
        raise ConfigurationMismatchError(
            "the output folder contains a different comparison",
            found="; ".join(f"{k}: {before.get(k)} -> {now.get(k)}" for k in changed),
            expected="the same evaluations and options",
            next_step="choose another -o, or pass --overwrite",
        )


def _depends_on(evidence: AnyEvidence | ComparisonEvidence) -> dict[str, Any]:
    """The options and input hashes (by role) that determine a comparison."""
    hashes: dict[str, list[str]] = {}
    for entry in evidence.inputs:
        hashes.setdefault(entry.role, []).append(entry.sha256[:12])
    return {"kind": evidence.kind, **as_json(evidence.configuration), **hashes}


def write_comparison(
    folder: Path,
    document: Comparison | JoinedComparison,
    evidence: AnyEvidence | ComparisonEvidence,
    *,
    overwrite: bool,
) -> None:
    """Write every file atomically, evidence.json last; see `prepare_folder`."""
    prepare_folder(folder, evidence, overwrite=overwrite)
    (folder / EVIDENCE).unlink(missing_ok=True)  # marks the comparison as incomplete
    for path in folder.iterdir():
        path.unlink()
    write_text(folder / COMPARISON, readable(document))
    for name, text in rendered_tables(document).items():
        write_text(folder / name, text)
    files = {p.name: sha256_of_file(p) for p in sorted(folder.iterdir())}
    write_text(folder / EVIDENCE, readable(replace(evidence, files=files)))


def rendered_tables(document: Comparison | JoinedComparison) -> dict[str, str]:
    """The tables by file name. The CSV has every row, unrounded; the others the displayed rows."""
    headline, coverage = headline_table(document), coverage_table(document)
    files = {}
    for suffix, render in FORMATS.items():
        shown = csv_table(document) if suffix == "csv" else headline
        files[f"table.{suffix}"] = render(shown)
        files[f"coverage.{suffix}"] = render(coverage)
    return files


def read_document(folder: Path) -> Comparison | JoinedComparison:
    """comparison.json. ComparisonFolderError unless the folder is a finished comparison."""
    if not (folder / EVIDENCE).is_file() or not (folder / COMPARISON).is_file():
        raise ComparisonFolderError(
            f"{folder.name or folder} is not a finished comparison",
            found=f"no {COMPARISON} with {EVIDENCE}",
            expected="a folder that `legoworld compare` wrote",
        )
    return read_comparison(folder / COMPARISON)


def read_comparison(path: Path) -> Comparison | JoinedComparison:
    """A comparison.json. ComparisonFolderError when it is damaged."""
    try:
        return decode_comparison(path.read_bytes())
    except (OSError, RecordError) as error:
        raise ComparisonFolderError(
            f"{path.parent.name}/{path.name} cannot be read",
            found=cause(error),
            expected="a file written by `legoworld compare`",
            next_step="compare again with --overwrite",
        ) from error


def initial_evidence(
    folder: Path, sides: Sequence[StoredEvaluation], settings: ComparisonSettings
) -> ComparisonEvidence:
    """evidence.json before anything is computed: the evaluations and their raw numbers.

    `paired_evidence` completes it.
    """
    common: dict[str, Any] = {
        "task": sides[0].task,
        "configuration": settings,
        "versions": installed_versions(),
        "inputs": tuple(e for k, s in enumerate(sides) for e in _side_inputs(folder, s, k)),
        "files": {},
    }
    own = ("evaluator", *load_record_family(sides[0].task).method)
    return ComparisonEvidence(**common, methods=tuple(_side_evidence(side, own) for side in sides))


def _side_evidence(side: StoredEvaluation, own: Sequence[str]) -> dict[str, Any]:
    """A side's own evidence: its evaluator's numbers, and the hashes of its files by role."""
    evidence = as_json(side.evidence)
    return {
        "name": side.name,
        "inputs": [{"role": file["role"], "sha256": file["sha256"]} for file in evidence["inputs"]],
        **{name: evidence[name] for name in own},
    }


def paired_evidence(document: Comparison) -> tuple[PairEvidence, ...]:
    """Per pair: the paired images, the reason for each dropped one, the paired numbers."""
    return tuple(_pair_evidence(pair) for pair in document.pairs)


def _side_inputs(folder: Path, side: StoredEvaluation, place: int) -> list[Input]:
    """The files of an evaluation that a comparison reads; paths relative to the comparison."""
    paths = [(f"evaluation {place}", side.folder / name) for name in (EVIDENCE, *READ)]
    return [input_entry(folder, role, path) for role, path in paths if path.is_file()]


def input_entry(folder: Path, role: str, path: Path) -> Input:
    """An input's entry in evidence.json."""
    file = input_file(role, path)
    relative = os.path.relpath(path.resolve(), folder.resolve())
    return Input(
        role=role, path=Path(relative).as_posix(), sha256=file.sha256, bytes=file.size_bytes
    )


def _pair_evidence(pair: Pair) -> PairEvidence:
    return PairEvidence(
        scene=pair.scene,
        baseline=pair.baseline,
        coverage=pair.coverage,
        paired_image_ids=pair.paired_image_ids,
        dropped=pair.dropped,
        paired_metrics={
            row.metric: PairedNumbers(
                scene=row.scene.value, baseline=row.baseline.value, difference=row.difference.value
            )
            for row in pair.rows
            if row.images == "paired"
        },
    )


def _is_ours(name: str) -> bool:
    return name in _OURS or (name.startswith(".") and name.endswith(TEMPORARY_SUFFIX))
