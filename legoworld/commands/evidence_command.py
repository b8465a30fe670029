"""`legoworld evidence`: the group, and `verify`."""

from __future__ import annotations

from pathlib import Path

import click

from legoworld.commands import options
from legoworld.commands.options import option
from legoworld.commands.output import Output, table
from legoworld.commands.param_types import EXISTING_FOLDER
from legoworld.pluralize import share, word_for


@options.group("evidence")
def command() -> None:
    """Verify the evidence of an evaluation or a comparison: recorded hashes and numbers.

    \b
    Examples:
      legoworld evidence verify evals/coco
      legoworld evidence verify comparisons/coco
    """


@command.command("verify")
@click.argument("folder", type=EXISTING_FOLDER)
@option(
    "--root",
    "Folder to look for the inputs in [default: their recorded paths, relative to FOLDER].",
    EXISTING_FOLDER,
)
@options.printing
def verify_command(folder: Path, root: Path | None, out: Output) -> int:
    """Verify the FOLDER of an evaluation or a comparison, or of several tasks', by evidence.json.

    Every file of the folder and every input is hashed again. The numbers of an evaluation are
    recomputed from matches.npz and per_image.jsonl, and for depth the rows of up to ten images
    from the arrays; those of a comparison are recomputed from its evaluations. Exit code 1 when
    anything differs or an input is missing.

    \b
    Examples:
      legoworld evidence verify evals/coco
      legoworld evidence verify evals/coco --root /data
      legoworld evidence verify comparisons/coco
    """
    from legoworld.api.evidence import evidence_verify

    checks = evidence_verify(folder, root=root)
    bad = [check for check in checks if check.status != "ok"]
    rows = [(check.status, check.what, check.found) for check in (checks if out.verbose else bad)]
    n_good = len(checks) - len(bad)
    good = share(n_good, len(checks), "check", "checks")
    out.show(
        {"ok": not bad, "checks": [check.__dict__ for check in checks]},
        [
            *([table(("", "what", "found"), rows)] if rows else []),
            f"{good} {word_for(n_good, 'holds', 'hold')}: {folder}",
        ],
    )
    return 1 if bad else 0
