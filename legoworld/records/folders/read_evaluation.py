"""The files of an evaluation folder, read and checked."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Final

from legoworld.errors import LegoWorldError, cause
from legoworld.records.base import RecordError, decode, decode_lines
from legoworld.records.detection import CategoryRow
from legoworld.records.evaluation import (
    AnyEvidence,
    EvaluationEvidence,
    EvaluationRow,
    OfKind,
    Summary,
    decode_evidence,
    decode_rows,
    decode_summary,
)
from legoworld.records.folders.read_run import describe_other_folder

SUMMARY: Final = "summary.json"
PER_IMAGE: Final = "per_image.jsonl"
PER_CATEGORY: Final = "per_category.jsonl"
MATCHES: Final = "matches.npz"
EVIDENCE: Final = "evidence.json"
VIEW: Final = "view"


class EvaluationFolderError(LegoWorldError):
    """An evaluation folder is not what it should be."""

    code = "evaluation_folder"


def require_finished(folder: Path) -> None:
    """EvaluationFolderError when a folder is no finished evaluation."""
    if not (folder / EVIDENCE).is_file() or not (folder / SUMMARY).is_file():
        raise EvaluationFolderError(
            describe_other_folder(folder, "an evaluation") or f"{folder} is no finished evaluation",
            found=f"no {SUMMARY} with {EVIDENCE}",
            expected="a folder that `legoworld evaluate` wrote",
        )


def read_summary(folder: Path) -> Summary:
    """summary.json of a finished evaluation. EvaluationFolderError."""
    require_finished(folder)
    with translate_read_errors(folder, SUMMARY) as path:
        return decode_summary(path.read_bytes())


def read_evidence(folder: Path, kinds: Sequence[str] = ("evaluation",)) -> AnyEvidence:
    """evidence.json of any of the kinds, as far as all are alike. EvaluationFolderError."""
    with _reading_evidence(folder):
        data = _evidence_bytes(folder)
        kind = decode(OfKind, data).kind
        if kind in kinds:
            return decode(AnyEvidence, data)
    raise EvaluationFolderError(
        f"{EVIDENCE} is of another kind", found=repr(kind), expected=" or ".join(map(repr, kinds))
    )


def read_evaluation_evidence(folder: Path) -> EvaluationEvidence:
    """evidence.json of an evaluation. EvaluationFolderError."""
    with _reading_evidence(folder):
        return decode_evidence(_evidence_bytes(folder))


def _evidence_bytes(folder: Path) -> bytes:
    try:
        return (folder / EVIDENCE).read_bytes()
    except OSError as error:
        raise EvaluationFolderError(
            describe_other_folder(folder, "an evaluation")
            or f"{folder} has no readable {EVIDENCE}",
            found=cause(error),
            expected="a folder that `legoworld evaluate` or `legoworld compare` wrote",
        ) from error


@contextmanager
def _reading_evidence(folder: Path) -> Iterator[None]:
    try:
        yield
    except RecordError as error:
        raise EvaluationFolderError(
            f"{folder}/{EVIDENCE} is damaged",
            found=str(error),
            expected="a sha256 for each file, and a role, a path and a sha256 for each input",
            next_step="evaluate or compare again with --overwrite",
        ) from error


def read_image_rows(folder: Path, summary: Summary) -> Sequence[EvaluationRow]:
    """per_image.jsonl: a row of each image, ascending id. EvaluationFolderError."""
    with translate_read_errors(folder, PER_IMAGE) as path:
        return decode_rows(path.read_bytes(), summary)


def read_category_rows(folder: Path) -> list[CategoryRow]:
    """per_category.jsonl, ascending id. EvaluationFolderError."""
    with translate_read_errors(folder, PER_CATEGORY) as path:
        return decode_lines(CategoryRow, path.read_bytes())


@contextmanager
def translate_read_errors(folder: Path, name: str) -> Iterator[Path]:
    """EvaluationFolderError for a file that is not as it was written."""
    try:
        yield folder / name
    except (OSError, RecordError) as error:
        raise EvaluationFolderError(
            f"{folder}/{name} cannot be read",
            found=cause(error),
            expected="what `legoworld evaluate` wrote",
            next_step="evaluate the run again with --overwrite",
        ) from error
