"""`legoworld trajectory`."""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import Any

import click

from legoworld.commands import options
from legoworld.commands.options import option
from legoworld.commands.output import Output
from legoworld.commands.param_types import EXISTING_FOLDER, FILE, Choice
from legoworld.pluralize import plural


@options.group("trajectory")
def command() -> None:
    """What happened on the way to each scene of `legoworld reconstruct`.

    \b
    Examples:
      legoworld trajectory show scenes/coffee
      legoworld trajectory score scenes --truth bench/private -o scores
      legoworld trajectory report scenes --photos photos --scores scores -o page.html
    """


@command.command("show")
@click.argument("scene", type=EXISTING_FOLDER)
@option("--scores")
@options.printing
def show(scene: Path, scores: Path | None, out: Output) -> int:
    """Print the calls of one trial, and which of them changed the scene.

    \b
    Examples:
      legoworld trajectory show scenes/coffee
      legoworld trajectory show scenes/room0 --scores scores
    """
    from legoworld.tables.terminal import terminal
    from legoworld.trajectories.api import trajectory_show
    from legoworld.trajectories.page import calls_table

    trial, score = trajectory_show(scene, scores=scores)
    about = trial.about
    source = about.finalisation.source
    submitted = "nothing was submitted" if source == "none" else f"submitted: its {source} scene"
    lines = [
        terminal(calls_table(trial, score)),
        f"{about.agent}: {about.status}, ended by {about.ended} after {about.agent_seconds:.0f} s; "
        f"{submitted}",
    ]
    if score is not None:
        lines.append(f"final Q {score.final_q:.4f}, regret {score.regret:.4f}")
    out.show({"trial": about, "calls": trial.calls, "score": score}, lines)
    return 0


@command.command("score")
@click.argument("scene_folders", type=EXISTING_FOLDER, nargs=-1, required=True, metavar="SCENES...")
@option("--truth", "DATASET/private.", EXISTING_FOLDER)
@option("--output", "Where scores go.")
@option("--workers", "Scenes read out at once.", default=1)
@option("--draws", "Bootstrap samples, over families.", default=10_000)
@option("--seed", "RNG seed for the bootstrap.")
@option("--sandbox")
@options.printing
def score(scene_folders: tuple[Path, ...], output: Path, out: Output, **given: Any) -> int:
    """Score every checkpoint of every trial below SCENES against a bench: Q over time.

    The result is private, like an evaluation. Run the same command again to resume.

    \b
    Examples:
      legoworld trajectory score scenes --truth bench/private -o scores
      legoworld trajectory score codex claude --truth bench/private -o scores --workers 4
    """
    from legoworld.tables.terminal import terminal
    from legoworld.trajectories.api import trajectory_score
    from legoworld.trajectories.page import agents_table

    document = trajectory_score(scene_folders, output, listener=out.listener(), **given)
    lines = [terminal(agents_table(document.agents))]
    if document.common is not None:
        shared = plural(len(document.common_images), "image", "images")
        lines.append(f"\nOver {shared} that all agents have:")
        lines.append(terminal(agents_table(document.common)))
    out.show({"agents": document.agents, "common": document.common}, lines)
    return 0


@command.command("pairs")
@click.argument("scene_folders", type=EXISTING_FOLDER, nargs=-1, required=True, metavar="SCENES...")
@option("--scores", required=True)
@option("--seed", "RNG seed of the choice.")
@option("--output", "The file of pairs, JSON lines.", FILE)
@options.printing
def pairs(
    scene_folders: tuple[Path, ...], scores: Path, seed: int, output: Path, out: Output
) -> int:
    """Choose pairs of checkpoints for judges: 20 of each agent at gaps of 1-2, 3-5, >= 6 edits.

    Show a judge a pair's two `renders` beside the photo. Its answer is a line for `bench judges`:
    the pair with "judge", "aspect" and "chosen" in place of "gap" and "renders". Asked once more
    with `shown` turned round, it also audits the order.

    \b
    Examples:
      legoworld trajectory pairs scenes --scores scores -o pairs.jsonl
      legoworld trajectory pairs codex claude --scores scores --seed 1 -o pairs.jsonl
    """
    from legoworld.trajectories.api import trajectory_pairs

    chosen = trajectory_pairs(scene_folders, scores, output, seed=seed)
    counts = Counter((pair.builder, pair.gap) for pair in chosen)
    lines = [f"{builder}, gap {gap}: {n}" for (builder, gap), n in counts.items()]
    out.show({"pairs": chosen}, [*lines, f"-> {output}"])
    return 0


@command.command("report")
@click.argument("scenes", type=EXISTING_FOLDER)
@option("--photos", required=False)
@option("--scores")
@option("--report", "Page of `legoworld report` to link to.", FILE, required=False)
@option("--output", "The HTML file.", FILE)
@options.printing
def report_command(scenes: Path, output: Path, out: Output, **given: Any) -> int:
    """Write one HTML page to scrub through: photo, render, Q and code of every call.

    \b
    Examples:
      legoworld trajectory report scenes --photos val2017 -o page.html
      legoworld trajectory report scenes --photos images --scores scores -o page.html
    """
    from legoworld.trajectories.api import trajectory_report

    trials = trajectory_report(scenes, output, listener=out.listener(), **given)
    out.show(
        {"page": str(output), "trials": len(trials)},
        f"{plural(len(trials), 'trial', 'trials')} -> {output}",
    )
    return 0


@command.command("pick")
@click.argument("scenes", type=EXISTING_FOLDER)
@option(
    "--by",
    "last: the open scene at the end; residuals: what the plugin measures; regions: of several "
    "runs over a photo, whichever fits its regions best.",
    Choice(["last", "residuals", "regions"]),
    required=True,
)
@option(
    "--evidence",
    "<scene>/ with public evidence, and requirements.json for residuals [for regions: the runs' "
    "own].",
)
@option("--scores")
@option("--output", "Folder of the scenes.")
@option("--sandbox")
@options.printing
def pick(scenes: Path, scores: Path | None, output: Path, out: Output, **given: Any) -> int:
    """Choose each trial's submission again, among its own checkpoints, by public signals alone.

    With --scores, which no choice depends on, it says how much regret the choice would have saved.

    \b
    Examples:
      legoworld trajectory pick scenes --by last -o scenes-last
      legoworld trajectory pick scenes --by residuals --evidence evidence -o scenes-picked
      legoworld trajectory pick scenes --by regions -o scenes-best
    """
    from legoworld.trajectories.api import trajectory_pick
    from legoworld.trajectories.page import final_scores, read_scores
    from legoworld.trajectories.pick import saved_regret

    picks = trajectory_pick(scenes, output, listener=out.listener(), **given)
    document = read_scores(scores)
    saved = saved_regret(picks, final_scores(document)) if document else None
    other = sum(p.run is None and p.ordinal != p.submitted for p in picks)
    lines = [f"{other} of {len(picks)} submissions are another checkpoint -> {output}"]
    if given["by"] == "regions":
        lines = [f"{plural(len(picks), 'run', 'runs')} picked -> {output}"]
    if saved is not None:
        of = plural(saved[1], "scene", "scenes")
        lines.append(f"mean regret saved: {saved[0]:+.4f} over {of}")
    out.show({"picks": picks, "regret_saved": saved}, lines)
    return 0
