"""`evidence_verify`: the recorded hashes and numbers of an evaluation or a comparison."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from legoworld.api.arguments import check_arguments, optional_path
from legoworld.api.by_task import task_folders
from legoworld.comparison.folder import KINDS
from legoworld.comparison.verification import verify_comparison
from legoworld.evaluation.checks import Check
from legoworld.evaluation.evidence import verify
from legoworld.records.folders.read_evaluation import EVIDENCE, read_evidence


@check_arguments
def evidence_verify(folder: str | Path, *, root: str | Path | None = None) -> list[Check]:
    """Check an evaluation or a comparison, or those of several tasks, by its evidence.json.

    root: where to look for the inputs; None for their recorded paths. A check whose status is not
    "ok" names a file that differs or is missing, or a number that cannot be made again.
    """
    top, inputs = Path(folder), optional_path(root)
    checks: list[Check] = []
    for one in task_folders(top, EVIDENCE):
        kind = read_evidence(one, ("evaluation", *KINDS)).kind
        found = verify_comparison(one, inputs) if kind in KINDS else verify(one, inputs)
        prefix = f"{one.name}: " if one != top else ""
        checks += [replace(check, what=prefix + check.what) for check in found]
    return checks
