"""`legoworld trajectory`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Final, Unpack

import click

from legoworld.commands import options
from legoworld.commands.options import option
from legoworld.commands.output import Output
from legoworld.commands.param_types import EXISTING_FOLDER, FILE, Choice
from legoworld.pluralize import plural

if TYPE_CHECKING:
    from legoworld.trajectories.pick import By
    from legoworld.trajectories.score_checkpoints import ScoringOptions
    from legoworld.workers.protections import Protections
    from legoworld.workers.sandbox import SandboxLimits

_SCORES: Final = option("--scores", "What `trajectory score` wrote.", EXISTING_FOLDER)


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
@_SCORES
@options.printing
def show(scene: Path, scores: Path | None, out: Output) -> int:
    """Print the calls of one trial, and which of them changed the scene.

    \b
    Examples:
      legoworld trajectory show scenes/coffee
      legoworld trajectory show scenes/room0 --scores scores
    """
    from legoworld.tables.terminal import terminal
    from legoworld.trajectories.folder import read_trial
    from legoworld.trajectories.page import calls_table, find_score, read_scores

    trial = read_trial(scene)
    score = find_score(read_scores(scores), trial)
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
@click.argument("scenes", type=EXISTING_FOLDER, nargs=-1, required=True)
@option("--truth private", "DATASET/private.", EXISTING_FOLDER)
@option("--output", "Where scores go.")
@option("--workers", "Scenes read out at once.", default=1)
@option("--draws", "Bootstrap samples, over families.", default=10_000)
@option("--seed", "RNG seed for the bootstrap.")
@options.protections()
@options.printing
def score(scenes: tuple[Path, ...], out: Output, **given: Unpack[ScoringOptions]) -> int:
    """Score every checkpoint of every trial below SCENES against a bench: Q over time.

    The result is private, like an evaluation. Run the same command again to resume.

    \b
    Examples:
      legoworld trajectory score scenes --truth bench/private -o scores
      legoworld trajectory score codex claude --truth bench/private -o scores --workers 4
    """
    from legoworld.tables.terminal import terminal
    from legoworld.trajectories.page import agents_table
    from legoworld.trajectories.score_checkpoints import ScoringPlan, score_trajectories

    plan = ScoringPlan(**given, limits=_limits(), notice=out.notice)
    document = score_trajectories(scenes, plan)
    lines = [terminal(agents_table(document.agents))]
    if document.common is not None:
        shared = plural(len(document.common_images), "image", "images")
        lines.append(f"\nOver {shared} that all agents have:")
        lines.append(terminal(agents_table(document.common)))
    out.show({"agents": document.agents, "common": document.common}, lines)
    return 0


def _limits() -> SandboxLimits:
    """Limits of each Blender that exports or measures a checkpoint."""
    from legoworld.workers.sandbox import SandboxLimits

    return SandboxLimits(time_s=600.0, memory_bytes=8 << 30)


@command.command("report")
@click.argument("scenes", type=EXISTING_FOLDER)
@option("--photos", required=False)
@_SCORES
@option("--output", "The HTML file.", FILE)
@options.printing
def report(
    scenes: Path, photos: Path | None, scores: Path | None, output: Path, out: Output
) -> int:
    """Write one HTML page to scrub through: photo, render, Q and code of every call.

    \b
    Examples:
      legoworld trajectory report scenes --photos val2017 -o page.html
      legoworld trajectory report scenes --photos images --scores scores -o page.html
    """
    from legoworld.trajectories.folder import recorded_trials
    from legoworld.trajectories.page import write_page

    trials = recorded_trials(scenes)
    write_page(trials, output, photos=photos, scores=scores)
    out.show(
        {"page": str(output), "trials": len(trials)},
        f"{plural(len(trials), 'trial', 'trials')} -> {output}",
    )
    return 0


@command.command("pick")
@click.argument("scenes", type=EXISTING_FOLDER)
@option(
    "--by",
    "last: the open scene at the end; residuals: what the plugin measures.",
    Choice(["last", "residuals"]),
    required=True,
)
@option("--evidence", "<scene>/requirements.json and public evidence, for residuals.")
@_SCORES
@option("--output", "Folder of the scenes.")
@options.protections()
@options.printing
def pick(
    scenes: Path,
    by: By,
    evidence: Path | None,
    scores: Path | None,
    output: Path,
    held: Protections,
    out: Output,
) -> int:
    """Choose each trial's submission again, among its own checkpoints, by public signals alone.

    With --scores, which no choice depends on, it says how much regret the choice would have saved.

    \b
    Examples:
      legoworld trajectory pick scenes --by last -o scenes-last
      legoworld trajectory pick scenes --by residuals --evidence evidence -o scenes-picked
    """
    from legoworld.trajectories import pick
    from legoworld.trajectories.page import final_scores, read_scores

    plan = pick.PickPlan(by=by, evidence=evidence, limits=_limits(), held=held, notice=out.notice)
    picks = pick.pick(scenes, output, plan)
    document = read_scores(scores)
    saved = pick.saved_regret(picks, final_scores(document)) if document else None
    other = sum(p.ordinal != p.submitted for p in picks)
    lines = [f"{other} of {len(picks)} submissions are another checkpoint -> {output}"]
    if saved is not None:
        of = plural(saved[1], "scene", "scenes")
        lines.append(f"mean regret saved: {saved[0]:+.4f} over {of}")
    out.show({"picks": picks, "regret_saved": saved}, lines)
    return 0
