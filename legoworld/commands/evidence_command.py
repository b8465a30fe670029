"""`legoworld evidence`: the group, and `verify`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from legoworld.commands import options
from legoworld.pluralize import share, word_for

_HELP: dict[str, Any] = {"help_option_names": ["-h", "--help"]}


@click.group("evidence", context_settings=_HELP)
def command() -> None:
    """Check the evidence of an evaluation or a comparison: the hashes and numbers on record.

    \b
    Examples:
      legoworld evidence verify evals/coco
      legoworld evidence verify comparisons/coco
    """


@command.command("verify", context_settings=_HELP)
@click.argument("folder", type=options.EXISTING_FOLDER)
@click.option(
    "--root",
    type=options.EXISTING_FOLDER,
    help="Look for the inputs below here [default: where they were, seen from FOLDER].",
)
@options.output_options
def verify_command(
    folder: Path, root: Path | None, as_json: bool, quiet: bool, verbose: bool
) -> int:
    """Check that an evaluation's or a comparison's FOLDER is what its evidence.json says.

    Every file of the folder and every input is hashed again. The numbers of an evaluation are
    computed again from matches.npz and per_image.jsonl, of depth also the rows of up to ten
    images from the arrays; those of a comparison from its evaluations. Exit code 1 when anything
    differs or an input is not there.

    \b
    Examples:
      legoworld evidence verify evals/coco
      legoworld evidence verify evals/coco --root /data
      legoworld evidence verify comparisons/coco
    """
    from legoworld.comparison.folder import KINDS
    from legoworld.comparison.verification import verify_comparison
    from legoworld.evaluation.evidence import verify
    from legoworld.records.folders.evaluation_reading import read_evidence

    kind = read_evidence(folder, ("evaluation", *KINDS)).kind
    checks = verify_comparison(folder, root) if kind in KINDS else verify(folder, root)
    bad = [check for check in checks if check.status != "ok"]
    if as_json:
        options.print_json({"ok": not bad, "checks": [check.__dict__ for check in checks]})
    else:
        shown = checks if verbose else bad
        if shown:
            rows = [(check.status, check.what, check.found) for check in shown]
            click.echo(options.table(("", "what", "found"), rows))
        n_good = len(checks) - len(bad)
        good = share(n_good, len(checks), "check", "checks")
        click.echo(f"{good} {word_for(n_good, 'holds', 'hold')}: {folder}")
    return 1 if bad else 0
