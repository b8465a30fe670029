"""`legoworld reconstruct`."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from legoworld.commands import options
from legoworld.commands.options import flag, option
from legoworld.commands.output import Output
from legoworld.commands.param_types import COUNT, EXISTING, EXISTING_FILE, EXISTING_FOLDER, Choice
from legoworld.plugin.modules import MODULES

if TYPE_CHECKING:
    from legoworld.records.agents import TrialRow


@click.command("reconstruct")
@click.argument("track", type=EXISTING_FILE)
@option("--photos")
@option("--agent", "An agent's name, or the path of a card (.toml).", required=True)
@option("--output", "Folder of the scenes.")
@option("--task", "Task that the agent builds for [default: the track's].")
@option("--programs", "Programs that `program` plays.", EXISTING_FOLDER)
@option("--model", "The agent's model [default: the agent's own].")
@option("--prices", "A price card (.toml) [default: the one that is shipped].", EXISTING_FILE)
@flag("--record", "Count tokens by a proxy between the agent and its API.")
@option("--limit", "Only the first N images.")
@option("--repeat", "Independent runs; above 1 each has a folder run_K.", COUNT, default=1)
@option("--workers", "Trials at once.", default=1)
@option(
    "--time-limit trial_limit_s",
    "Seconds of one trial [default: the card's].",
    click.FloatRange(min=1),
)
@option("--max-calls", "Calls to Blender of one trial [default: the card's, or any].", COUNT)
@option("--max-tokens", "Tokens of one trial, cached ones included [default: the same].", COUNT)
@option(
    "--max-cost",
    "US dollars of one trial [default: the same].",
    click.FloatRange(min=0, min_open=True),
)
@option("--memory-limit", "Memory limit of Blender, and of the agent, in GiB.")
@option("--sandbox")
@flag("--plugin", "Give agents the plugin's server as well.")
@option("--without", kind=Choice(MODULES))
@option(
    "--regions", "The plugin's regions: a run or results of boxes or masks; repeatable.", EXISTING
)
@option("--depth", "The plugin's depth: a run of depth, or arrays by photo name.", EXISTING_FOLDER)
@option("--engine")
@options.printing
def command(track: Path, output: Path, out: Output, **given: Any) -> int:
    """Have an agent rebuild every photo of TRACK in Blender; each becomes a frozen scene folder.

    Each image gets a workspace of its own with the photo, its public metadata and the prompt, a
    headless Blender, and the agent's process; never ground truth, never a metric. When the agent
    ends or its time is over, the scene it saved last is exported and frozen. Run the same command
    again to resume. Exit code 1 when some image has no scene.

    \b
    Examples:
      legoworld reconstruct track.json --photos val2017 --agent codex --record -o scenes
      legoworld reconstruct track.json --photos val2017 --agent program \\
          --programs examples/coco-val2017 -o scenes --workers 2
      legoworld reconstruct track.json --photos val2017 --agent claude --plugin \\
          --regions sam3-run --depth da3-run -o scenes-plugin
    """
    from legoworld.agents.campaign import reconstruct
    from legoworld.agents.scene_content import content_sentence
    from legoworld.pluralize import share

    done = tokens = total = 0
    dollars = 0.0

    def count(trials: int) -> None:
        nonlocal total
        total = trials

    def report_trial(row: TrialRow) -> None:
        nonlocal done, tokens, dollars
        done += 1
        tokens += row.usage.completion_tokens or 0
        dollars += row.usage.cost_usd or 0.0
        said = "" if row.status == "ok" else f": {row.status}: {row.reason}"
        if row.content is not None:
            said += f": {content_sentence(row.content)}"
        kept = "kept" if row.kept else f"{row.seconds:.0f} s"
        spent = f", {tokens:,} output tokens in all" if tokens else ""
        spent += f", ${dollars:.2f}" if dollars else ""
        out.notice(
            f"{done}/{total} {row.scene} ({kept}, {row.checkpoints} checkpoints{spent}){said}"
        )

    listener = replace(out.listener(), total=count, trial=report_trial)
    rows = reconstruct(track, output, listener=listener, **given)
    good = sum(row.status == "ok" for row in rows)
    shown = f"{share(good, len(rows), 'trial', 'trials')} left a scene -> {output}"
    out.show({"trials": rows}, shown)
    return 0 if good == len(rows) else 1
