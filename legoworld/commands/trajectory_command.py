"""`legoworld trajectory`."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Literal

import click

from legoworld.commands import options
from legoworld.pluralize import counted

_HELP: dict[str, Any] = {"help_option_names": ["-h", "--help"]}
_SCENES = click.argument("scenes", type=options.EXISTING_FOLDER)
_SCORES = click.option(
    "--scores", type=options.EXISTING_FOLDER, help="What `trajectory score` wrote."
)
_SANDBOX = click.option(
    "--sandbox", type=options.Choice(["auto", "bubblewrap", "limits"]), default="auto",
    show_default=True, help="auto: bubblewrap where it works, otherwise resource limits only.",
)  # fmt: skip


@click.group("trajectory", context_settings=_HELP)
def command() -> None:
    """What happened on the way to each scene of `legoworld reconstruct`.

    \b
    Examples:
      legoworld trajectory show scenes/coffee
      legoworld trajectory score scenes --truth bench/private -o scores
      legoworld trajectory report scenes --photos photos --scores scores -o page.html
    """


@command.command("show", context_settings=_HELP)
@click.argument("scene", type=options.EXISTING_FOLDER)
@_SCORES
@options.output_options
def show(scene: Path, scores: Path | None, as_json: bool, quiet: bool, verbose: bool) -> int:
    """Print the calls of one trial, and which of them changed the scene.

    \b
    Examples:
      legoworld trajectory show scenes/coffee
      legoworld trajectory show scenes/room0 --scores scores
    """
    from legoworld.tables.terminal import terminal
    from legoworld.trajectories.folder import read_trial
    from legoworld.trajectories.showing import calls_table, read_scores, score_of

    trial = read_trial(scene)
    score = score_of(read_scores(scores), trial)
    if as_json:
        options.print_json({"trial": trial.about, "calls": trial.calls, "score": score})
        return 0
    click.echo(terminal(calls_table(trial, score)))
    about = trial.about
    source = about.finalisation.source
    submitted = "nothing was submitted" if source == "none" else f"submitted: its {source} scene"
    click.echo(
        f"{about.agent}: {about.status}, ended by {about.ended} after {about.agent_seconds:.0f} s; "
        f"{submitted}"
    )
    if score is not None:
        click.echo(f"final Q {score.final_q:.4f}, regret {score.regret:.4f}")
    return 0


@command.command("score", context_settings=_HELP)
@click.argument("scenes", type=options.EXISTING_FOLDER, nargs=-1, required=True)
@click.option("--truth", type=options.EXISTING_FOLDER, required=True, help="DATASET/private.")
@click.option("-o", "--output", type=options.FOLDER, required=True, help="Where scores go.")
@click.option("--workers", default=1, show_default=True, type=click.IntRange(min=1),
              help="Scenes read out at once.")  # fmt: skip
@click.option("--draws", default=10_000, show_default=True, type=click.IntRange(min=1),
              help="Bootstrap samples, over families.")  # fmt: skip
@click.option("--seed", default=0, show_default=True, help="RNG seed for the bootstrap.")
@_SANDBOX
@options.output_options
def score(
    scenes: tuple[Path, ...],
    truth: Path,
    output: Path,
    workers: int,
    draws: int,
    seed: int,
    sandbox: Literal["auto", "bubblewrap", "limits"],
    as_json: bool,
    quiet: bool,
    verbose: bool,
) -> int:
    """Score every checkpoint of every trial below SCENES against a bench: Q over time.

    The result is private, like an evaluation. Run the same command again to resume.

    \b
    Examples:
      legoworld trajectory score scenes --truth bench/private -o scores
      legoworld trajectory score codex claude --truth bench/private -o scores --workers 4
    """
    from legoworld.tables.terminal import terminal
    from legoworld.trajectories.scoring import ScoringPlan, score_trajectories
    from legoworld.trajectories.showing import agents_table
    from legoworld.workers.protections import protections
    from legoworld.workers.sandbox import SandboxLimits

    plan = ScoringPlan(
        private=truth,
        output=output,
        limits=SandboxLimits(time_s=600.0, memory_bytes=8 << 30),
        held=protections(sandbox),
        workers=workers,
        draws=draws,
        seed=seed,
        notice=options.notifier(quiet),
    )
    document = score_trajectories(scenes, plan)
    if as_json:
        options.print_json({"agents": document.agents, "common": document.common})
        return 0
    click.echo(terminal(agents_table(document.agents)))
    if document.common is not None:
        shared = counted(len(document.common_images), "image", "images")
        click.echo(f"\nOver {shared} that all agents have:")
        click.echo(terminal(agents_table(document.common)))
    return 0


@command.command("report", context_settings=_HELP)
@_SCENES
@click.option("--photos", type=options.EXISTING_FOLDER, help="The track's photos.")
@_SCORES
@click.option("-o", "--output", type=click.Path(path_type=Path, dir_okay=False), required=True,
              help="The HTML file.")  # fmt: skip
@options.output_options
def report(
    scenes: Path,
    photos: Path | None,
    scores: Path | None,
    output: Path,
    as_json: bool,
    quiet: bool,
    verbose: bool,
) -> int:
    """Write one HTML page to scrub through: photo, render, Q and code of every call.

    \b
    Examples:
      legoworld trajectory report scenes --photos val2017 -o page.html
      legoworld trajectory report scenes --photos images --scores scores -o page.html
    """
    from legoworld.trajectories.folder import recorded_trials
    from legoworld.trajectories.showing import write_page

    trials = recorded_trials(scenes)
    write_page(trials, output, photos=photos, scores=scores)
    if as_json:
        options.print_json({"page": str(output), "trials": len(trials)})
    else:
        click.echo(f"{counted(len(trials), 'trial', 'trials')} -> {output}")
    return 0


@command.command("pick", context_settings=_HELP)
@_SCENES
@click.option(
    "--by", type=options.Choice(["last", "residuals"]), required=True,
    help="last: the open scene at the end; residuals: what the plugin measures.",
)  # fmt: skip
@click.option("--evidence", type=options.EXISTING_FOLDER,
              help="<scene>/requirements.json and public evidence, for residuals.")  # fmt: skip
@_SCORES
@click.option("-o", "--output", type=options.FOLDER, required=True, help="The folder of scenes.")
@_SANDBOX
@options.output_options
def pick(
    scenes: Path,
    by: Literal["last", "residuals"],
    evidence: Path | None,
    scores: Path | None,
    output: Path,
    sandbox: Literal["auto", "bubblewrap", "limits"],
    as_json: bool,
    quiet: bool,
    verbose: bool,
) -> int:
    """Choose each trial's submission again, among its own checkpoints, by public signals alone.

    With --scores, which no choice depends on, it says how much regret the choice would have saved.

    \b
    Examples:
      legoworld trajectory pick scenes --by last -o scenes-last
      legoworld trajectory pick scenes --by residuals --evidence evidence -o scenes-picked
    """
    from legoworld.trajectories import picking
    from legoworld.trajectories.showing import q_of_scores, read_scores
    from legoworld.workers.protections import protections
    from legoworld.workers.sandbox import SandboxLimits

    plan = picking.PickPlan(
        by=by,
        evidence=evidence,
        limits=SandboxLimits(time_s=600.0, memory_bytes=8 << 30),
        held=protections(sandbox),
        notice=options.notifier(quiet),
    )
    picks = picking.pick(scenes, output, plan)
    document = read_scores(scores)
    saved = picking.saved_regret(picks, q_of_scores(document)) if document else None
    if as_json:
        options.print_json({"picks": picks, "regret_saved": saved})
        return 0
    other = sum(p.ordinal != p.submitted for p in picks)
    click.echo(f"{other} of {len(picks)} submissions are another checkpoint -> {output}")
    if saved is not None:
        click.echo(
            f"mean regret saved: {saved[0]:+.4f} over {counted(saved[1], 'scene', 'scenes')}"
        )
    return 0
