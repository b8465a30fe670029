"""reward.json: an evaluation of one case as the finite numbers that a trainer reads."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from legoworld.errors import NotAssessedError, cause
from legoworld.files import readable_json, refuse_existing, write_text
from legoworld.records.base import RecordError, decode_lines
from legoworld.records.reconstruction import EVALUATOR_ERROR, ReconstructionRow

_ROWS: Final = "per_image.jsonl"


def read_reward(evaluation: Path) -> dict[str, float]:
    """`reward` (S, or R where nothing was rendered) with V, R, A and S of the only case.

    Zeros are the protocol's answer to a submission that is missing or invalid. Raises
    NotAssessedError where no submission was scored: no evaluation of the bench, an unreadable row,
    another number of cases than one, or an evaluator that failed.
    """
    try:
        rows = decode_lines(ReconstructionRow, (evaluation / _ROWS).read_bytes())
    except (OSError, RecordError) as error:
        raise _not_assessed(evaluation, f"{_ROWS}: {cause(error)}") from error
    if len(rows) != 1:
        raise _not_assessed(evaluation, f"{len(rows)} cases")
    (row,) = rows
    if row.status == EVALUATOR_ERROR or row.R is None:
        raise _not_assessed(evaluation, f"{row.file_name}: {row.reason or 'R was not computed'}")
    scores = {"V": float(row.valid), "R": row.R}
    if row.A is not None and row.S is not None:
        scores |= {"A": row.A, "S": row.S}
    return {"reward": scores.get("S", row.R), **scores}


def _not_assessed(evaluation: Path, found: str) -> NotAssessedError:
    return NotAssessedError(
        f"{evaluation} gives no reward",
        found=found,
        expected="an evaluation of one case of the bench",
        next_step="read what `legoworld evaluate` printed; a trainer repeats the case or drops it",
    )


def bench_reward(
    evaluation: str | Path, output: str | Path, *, overwrite: bool = False
) -> dict[str, float]:
    """Write reward.json; what is in it. UsageError for a file that is there, unless `overwrite`.

    That is removed before anything is read, so that after a NotAssessedError there is none.
    """
    path = Path(output)
    refuse_existing(path, overwrite=overwrite)
    path.unlink(missing_ok=True)
    reward = read_reward(Path(evaluation))
    write_text(path, readable_json(reward))
    return reward
