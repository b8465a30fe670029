"""`legoworld reconstruct`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Literal

import click

from legoworld.commands import options
from legoworld.plugin.modules import MODULES
from legoworld.workers.engines import EngineName

if TYPE_CHECKING:
    from legoworld.agents.trial_plugin import PluginOptions


@click.command("reconstruct", context_settings={"help_option_names": ["-h", "--help"]})
@click.argument("track", type=options.EXISTING_FILE)
@click.option("--photos", type=options.EXISTING_FOLDER, required=True, help="The track's photos.")
@click.option("--agent", required=True, help="An agent's name, or the path of a card (.toml).")
@click.option("-o", "--output", type=options.FOLDER, required=True, help="The folder of scenes.")
@click.option("--task", help="Task that the agent builds for [default: the track's].")
@click.option("--programs", type=options.EXISTING_FOLDER, help="Programs that `program` plays.")
@click.option("--model", help="The agent's model [default: the agent's own].")
@click.option("--prices", type=options.EXISTING_FILE,
              help="A price card (.toml) [default: the one that is shipped].")  # fmt: skip
@click.option("--limit", type=click.IntRange(min=1), help="Only the first N images.")
@click.option("--repeat", default=1, show_default=True, type=click.IntRange(min=1),
              help="Independent runs; above 1 each has a folder run_K.")  # fmt: skip
@click.option("--workers", default=1, show_default=True, type=click.IntRange(min=1),
              help="Trials at once.")  # fmt: skip
@click.option("--time-limit", type=click.FloatRange(min=1),
              help="Seconds of one trial [default: the card's].")  # fmt: skip
@click.option("--memory-limit", default=8.0, show_default=True, type=click.FloatRange(min=0.1),
              help="GiB Blender may use, and the agent as well.")  # fmt: skip
@click.option("--sandbox", type=options.Choice(["auto", "bubblewrap", "limits"]), default="auto",
              show_default=True,
              help="auto: bubblewrap where it works, otherwise resource limits only.")  # fmt: skip
@click.option("--plugin", is_flag=True, help="Give agents the plugin's server as well.")
@click.option("--without", multiple=True, type=options.Choice(MODULES),
              help="Leave a module of the plugin out; repeat.")  # fmt: skip
@click.option("--regions", multiple=True, type=click.Path(path_type=Path, exists=True),
              help="The plugin's regions: a run or results of boxes or masks; repeat.")  # fmt: skip
@click.option("--depth", type=options.EXISTING_FOLDER,
              help="The plugin's depth: a run of depth, or arrays by photo name.")  # fmt: skip
@options.engine
@options.output_options
def command(
    track: Path,
    photos: Path,
    agent: str,
    output: Path,
    task: str | None,
    programs: Path | None,
    model: str | None,
    prices: Path | None,
    limit: int | None,
    repeat: int,
    workers: int,
    time_limit: float | None,
    memory_limit: float,
    sandbox: Literal["auto", "bubblewrap", "limits"],
    plugin: bool,
    without: tuple[str, ...],
    regions: tuple[Path, ...],
    depth: Path | None,
    engine: EngineName,
    as_json: bool,
    quiet: bool,
    verbose: bool,
) -> int:
    """Have an agent rebuild every photo of TRACK in Blender; each becomes a frozen scene folder.

    Each image gets a workspace of its own with the photo, its public metadata and the prompt, a
    headless Blender, and the agent's process; never ground truth, never a metric. When the agent
    ends or its time is over, the scene it saved last is exported and frozen. Run the same command
    again to resume. Exit code 1 when some image has no scene.

    \b
    Examples:
      legoworld reconstruct track.json --photos val2017 --agent codex -o scenes
      legoworld reconstruct track.json --photos val2017 --agent program \\
          --programs examples/coco-val2017 -o scenes --workers 2
      legoworld reconstruct track.json --photos val2017 --agent claude --plugin \\
          --regions sam3-run --depth da3-run -o scenes-plugin
    """
    from legoworld.agents.reconstruct import Progress, TrialRow, reconstruct
    from legoworld.agents.run_plan import plan_run
    from legoworld.pluralize import share

    plan = plan_run(
        track, photos=photos, agent=agent, task=task, programs=programs, model=model,
        time_limit_s=time_limit, memory_bytes=int(memory_limit * 2**30), sandbox=sandbox,
        plugin=_plugin(plugin, without, regions, depth), prices=prices, output=output,
    )  # fmt: skip
    notice = options.notifier(quiet)
    for held, who in ((plan.agent_held, plan.card.name), (plan.blender_held, "Blender")):
        if held.does_not_hold:
            notice(f"not kept from {who}: {', '.join(held.does_not_hold)}")
    images = plan.work.track.images[:limit]
    done = tokens = total = 0
    dollars = 0.0

    def count(trials: int) -> None:
        nonlocal total
        total = trials

    def told(row: TrialRow) -> None:
        nonlocal done, tokens, dollars
        done += 1
        tokens += row.usage.completion_tokens or 0
        dollars += row.usage.cost_usd or 0.0
        said = "" if row.status == "ok" else f": {row.status}: {row.reason}"
        kept = "kept" if row.kept else f"{row.seconds:.0f} s"
        spent = f", {tokens:,} output tokens in all" if tokens else ""
        spent += f", ${dollars:.2f}" if dollars else ""
        notice(f"{done}/{total} {row.scene} ({kept}, {row.checkpoints} checkpoints{spent}){said}")

    rows = reconstruct(
        plan, output, images=images, repeat=repeat, workers=workers, engine=engine,
        progress=Progress(total=count, row=told),
    )  # fmt: skip
    good = sum(row.status == "ok" for row in rows)
    if as_json:
        options.print_json({"trials": rows})
    else:
        click.echo(f"{share(good, len(rows), 'trial', 'trials')} left a scene -> {output}")
    return 0 if good == len(rows) else 1


def _plugin(
    on: bool, without: tuple[str, ...], regions: tuple[Path, ...], depth: Path | None
) -> PluginOptions | None:
    from legoworld.agents.trial_plugin import PluginOptions
    from legoworld.errors import UsageError
    from legoworld.plugin.modules import modules_without

    if on:
        modules = modules_without(without)
        return PluginOptions(modules=modules, regions=regions, depth=depth)
    if without or regions or depth:
        raise UsageError(
            "an option of the plugin is given without it",
            found="--without, --regions or --depth",
            expected="--plugin",
            next_step="pass --plugin, or leave them out",
        )
    return None
