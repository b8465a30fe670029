"""`legoworld bench make`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import click

from legoworld.commands import options
from legoworld.commands.progress import shown_progress
from legoworld.pluralize import counted, share
from legoworld.tasks.shipped import BENCH

if TYPE_CHECKING:
    from legoworld.bench.family import MadeFamily
    from legoworld.bench.making import MadeDataset


@click.command("make", context_settings={"help_option_names": ["-h", "--help"]})
@click.argument("scenes", type=options.EXISTING_FOLDER)
@click.option("-o", "--output", type=options.FOLDER, required=True, help="The dataset to write.")
@click.option(
    "--size",
    type=options.SizeType(),
    default="1920x1080",
    show_default=True,
    help="Size of the pictures.",
)
@click.option("--limit", type=click.IntRange(min=1), help="Only the first N reference scenes.")
@click.option(
    "--samples",
    type=click.IntRange(min=1),
    default=128,
    show_default=True,
    help="Cycles samples of the pictures.",
)
@click.option("--no-denoise", is_flag=True, help="Leave the pictures as Cycles samples them.")
@click.option(
    "--noise-seeds",
    type=click.IntRange(min=0),
    default=3,
    show_default=True,
    help="Renders by the render card of which A's noise floor is measured; 0: none.",
)
@click.option(
    "--keep-scenes",
    type=options.FOLDER,
    help="Also write each case as a scene folder: the reference submitted as itself. Private.",
)
@click.option("--require-frozen", is_flag=True, help="Refuse scenes without a frozen.json.")
@click.option("--workers", type=click.IntRange(min=1), help="Blender processes [default: cores].")
@click.option("--overwrite", is_flag=True, help="Delete an earlier dataset first.")
@options.engine
@options.caching
@options.limits
@options.output_options
def make_command(
    scenes: Path,
    output: Path,
    size: tuple[int, int],
    limit: int | None,
    samples: int,
    no_denoise: bool,
    noise_seeds: int,
    keep_scenes: Path | None,
    require_frozen: bool,
    workers: int | None,
    overwrite: bool,
    engine: Literal["local", "ray"],
    cache: Path | None,
    no_cache: bool,
    time_limit: float,
    memory_limit: float,
    as_json: bool,
    quiet: bool,
    verbose: bool,
) -> int:
    """Make cases from reference SCENES: DATASET/public for agents, DATASET/private for evaluate.

    Every camera with a custom property `view` is a view, otherwise the active camera. The property
    `tier` (easy, medium, hard) of an object or collection says from which tier on it is there. The
    visible instances labelled with `category` are scored, unless `scored` is false. A scene that
    cannot become cases is named with its reason; exit code 1 then. --time-limit is for reading a
    scene; each render has 20 s more for every million samples (pixels times samples). Finished
    renders are in the snapshot cache: re-run the same command to resume.

    \b
    Examples:
      legoworld bench make references -o bench
      legoworld bench make references -o bench --size 960x540 --keep-scenes itself
    """
    from legoworld.api.settings import limits_of, snapshot_cache
    from legoworld.bench.family import MakeOptions
    from legoworld.bench.making import MakeRequest, make_dataset
    from legoworld.cards import load_card
    from legoworld.records.base import to_record
    from legoworld.records.bench_dataset import PictureCard, RenderCard
    from legoworld.records.run_rows import RunRow
    from legoworld.workers.engines import engine_cores

    card = load_card(BENCH)
    workers = workers or engine_cores(engine)
    request = MakeRequest(
        scenes=scenes,
        options=MakeOptions(
            output=output.absolute(),
            size_wh=size,
            picture=PictureCard(
                engine="CYCLES", device="CPU", samples=samples, seed=0, denoised=not no_denoise
            ),
            card=to_record(RenderCard, card.value("render")),
            delta=card.value("scoring.delta"),
            noise_seeds=noise_seeds,
            scenes=keep_scenes.absolute() if keep_scenes else None,
            cache=snapshot_cache(options.cache_choice(cache, no_cache)),
            require_frozen=require_frozen,
            threads=1,
            notice=None if engine != "local" or as_json else options.notifier(quiet),
        ),
        limits=limits_of(time_limit, memory_limit),
        engine=engine,
        workers=workers,
        limit=limit,
        overwrite=overwrite,
    )
    with shown_progress("scene", quiet=quiet) as listener:

        def progress(made: MadeFamily) -> None:
            listener.row(RunRow(image_id=0, file_name=made.family, status=made.status))

        made = make_dataset(request, total=listener.total, progress=progress)
    if as_json:
        options.print_json(_document(made, output))
    else:
        _print(made, output, verbose=verbose)
    return 1 if made.refused else 0


def _document(made: MadeDataset, output: Path) -> dict[str, Any]:
    families = [
        {
            "family": f.family,
            "status": f.status,
            "reason": f.reason,
            "cases": [c.file_name for c in f.cases],
        }
        for f in made.families
    ]
    return {"dataset": str(output), "families": families}


def _print(made: MadeDataset, output: Path, *, verbose: bool) -> None:
    for family in made.refused:
        click.echo(f"{family.status}: {family.family}: {family.reason}")
    for family in made.families if verbose else ():
        for line in _cases(family):
            click.echo(line)
    good = len(made.families) - len(made.refused)
    cases = sum(len(f.cases) for f in made.families)
    line = f"{share(good, len(made.families), 'scene', 'scenes')} made into "
    line += counted(cases, "case", "cases")
    if made.track is None:
        click.echo(f"{line}: no dataset was written")
        return
    click.echo(f"{line}, {counted(len(made.track.categories), 'category', 'categories')}")
    spread = [f.truth.noise_floor for m in made.families for f in m.cases if f.truth.noise_floor]
    if spread:
        lowest = min(min(n.a_self) for n in spread)
        click.echo(
            f"A of the references rendered by the card: {lowest:.4f} at least; seed to seed sd "
            f"{max(n.sd for n in spread):.4f} at most ({len(spread[0].seeds)} seeds a case)"
        )
    click.echo(f"public -> {output / 'public'}; private -> {output / 'private'}")


def _cases(family: MadeFamily) -> list[str]:
    return [
        f"{case.file_name}: {counted(len(case.truth.scored), 'scored object', 'scored objects')}"
        for case in family.cases
    ]
