"""reward.json: an evaluation of one case as the finite numbers that a trainer reads."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from legoworld.files import readable_json, write_text
from legoworld.records.base import RecordError, decode_lines
from legoworld.records.reconstruction_rows import ReconstructionRow

_ROWS: Final = "per_image.jsonl"


def reward_of(evaluation: Path) -> dict[str, float]:
    """`reward` (S, or R where nothing was rendered) with V, R, A and S; zeros without a row.

    An evaluation that could not be made is a submission of no worth, never a missing reward.
    """
    try:
        rows = decode_lines(ReconstructionRow, (evaluation / _ROWS).read_bytes())
    except (OSError, RecordError):
        rows = []
    if len(rows) != 1:
        return {"reward": 0.0, "V": 0.0, "R": 0.0, "A": 0.0, "S": 0.0}
    (row,) = rows
    r = row.R or 0.0
    scores = {"V": float(row.valid), "R": r}
    if row.A is not None and row.S is not None:
        scores |= {"A": row.A, "S": row.S}
    return {"reward": scores.get("S", r), **scores}


def write_reward(evaluation: Path, output: Path) -> dict[str, float]:
    """Write reward.json; what is in it."""
    reward = reward_of(evaluation)
    write_text(output, readable_json(reward))
    return reward
