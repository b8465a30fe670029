"""`legoworld bench table` and `legoworld bench judges`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from legoworld.commands import options
from legoworld.commands.options import option
from legoworld.commands.output import Output, print_json
from legoworld.commands.output import table as output_table
from legoworld.commands.param_types import EXISTING_FILE, EXISTING_FOLDER, FILE

if TYPE_CHECKING:
    from legoworld.records.bench_results import AspectAgreement


@click.command("table")
@click.argument("evaluations", nargs=-1, required=True, type=EXISTING_FOLDER)
@option("--output", "The folder to write.")
@option("--draws", "Bootstrap samples, over families.", default=10_000)
@option("--seed", "RNG seed for the bootstrap.")
@option("--overwrite", "Replace another table in the folder.")
@options.printing
def table_command(evaluations: tuple[Path, ...], output: Path, out: Output, **given: Any) -> int:
    """One row for each agent and model of bench EVALUATIONS; several of one are repeated runs.

    The agent and the model are those of the scenes' provenance.json. Means over runs with their
    standard deviation (ddof = 1): V, R, A, S over all attempted cases with zeros included, and R,
    A, S over the valid ones, for all cases and by split, environment, theme and tier. Ranks and
    paired differences between all systems have intervals. What a trial cost, as far as the scenes
    tell, gives the cost frontier, also with all tokens at one price. Writes leaderboard.json, .md,
    .tex and .csv, and standings.md, .tex and .csv. -v prints every group.

    \b
    Examples:
      legoworld bench table evals/mine -o table
      legoworld bench table evals/a1 evals/a2 evals/a3 evals/b1 evals/b2 evals/b3 -o table
    """
    from legoworld.api.bench import bench_table
    from legoworld.comparison.leaderboard import wide_table
    from legoworld.comparison.standings import standings_table
    from legoworld.records.base import as_json as plain
    from legoworld.tables.terminal import terminal

    board = bench_table(evaluations, output, **given)
    if out.as_json:
        print_json({"folder": str(output), "leaderboard": plain(board)})
        return 0
    table = wide_table(board, every_group=out.verbose)
    click.echo(terminal(table))
    click.echo("\n".join(["", *table.notes]))
    if len(board.rows) > 1:
        standings = standings_table(board)
        click.echo("\n".join(["", terminal(standings), "", *standings.notes]))
    click.echo(f"-> {output}")
    return 0


@click.command("judges")
@click.argument("judgements", type=EXISTING_FILE)
@click.argument("evaluations", nargs=-1, type=EXISTING_FOLDER)
@option("--trajectories", "What `trajectory score` wrote, for checkpoints.", EXISTING_FOLDER)
@option("--seed", "Of `trajectory pairs`.")
@option("-o --output json_file", "Also write the result as JSON.", FILE, required=False)
@option("--overwrite", "Replace that file.")
@options.printing
def judges_command(
    judgements: Path, evaluations: tuple[Path, ...], out: Output, **given: Any
) -> int:
    """How far recorded JUDGEMENTS agree with the scores: builders in rows, judges in columns.

    A line of the file is {"builder", "judge", "aspect", "item", "shown", "chosen", "better"}: of
    the two submissions shown, the one the judge chose ("tie", "both_bad" and "failed" count, too)
    and the one with the higher score ("tie" within 1e-6). With EVALUATIONS the scores come from
    there: `shown` holds two of their folders' names, `item` a case's file name, and `better` is
    left out. With --trajectories they are of checkpoints, in the pairs that `trajectory pairs`
    chose: a pair without a judgement counts as failed. Prints the agreement in percent, means of
    judges over their own builds and over others', and how often a judge chose the same when the
    order was swapped.

    \b
    Examples:
      legoworld bench judges judgements.jsonl
      legoworld bench judges judgements.jsonl -o judges.json
      legoworld bench judges judgements.jsonl evals/a evals/b
      legoworld bench judges judgements.jsonl --trajectories scores
    """
    from legoworld.api.bench import bench_judges
    from legoworld.records.base import as_json as plain

    if given["trajectories"] is None:
        options.refuse_given(["seed"], "is for --trajectories: it chooses their pairs")
    agreement = bench_judges(judgements, evaluations, **given)
    if out.as_json:
        print_json(plain(agreement))
        return 0
    for aspect, of_aspect in agreement.aspects.items():
        click.echo(f"{aspect}\n{_matrix(of_aspect)}\n")
    return 0


def _matrix(agreement: AspectAgreement) -> str:
    judges = list(dict.fromkeys(judge for row in agreement.matrix.values() for judge in row))
    rows = [
        (builder, *(f"{100 * row[j].share:.1f}" if j in row else "-" for j in judges))
        for builder, row in agreement.matrix.items()
    ]
    lines = [output_table(("builder", *judges), rows)]
    cells = [cell for row in agreement.matrix.values() for cell in row.values()]
    counts = {
        name: sum(getattr(cell, name) for cell in cells)
        for name in ("n", "ties", "both_bad", "failed", "score_ties")
    }
    lines.append(
        "{n} judgements: {ties} ties, {both_bad} both_bad, {failed} failed; "
        "the score ties in {score_ties}".format(**counts)
    )
    means = (agreement.self_mean, agreement.cross_mean)
    own, cross = ("-" if mean is None else f"{100 * mean:.2f}" for mean in means)
    lines.append(
        f"own builds {own}, others' {cross}; own above the others' mean for "
        f"{agreement.self_above_others} of {agreement.builders} builders"
    )
    for gap, cell in (agreement.by_gap or {}).items():
        lines.append(f"gap {gap}: {100 * cell.share:.1f} of {cell.n}")
    for judge, swaps in agreement.order_swaps.items():
        shown = "-" if swaps.share is None else f"{swaps.share:.1%}"
        lines.append(
            f"{judge}: the same choice in {shown} of {swaps.swapped} swapped items; "
            f"chose the first shown in {swaps.first_share:.1%}"
        )
    return "\n".join(lines)
