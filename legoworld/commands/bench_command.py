"""`legoworld bench`; `serve`, `table` and `judges` are in modules of their own."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import click

from legoworld.commands import options
from legoworld.commands.bench_serve import serve_command
from legoworld.commands.bench_table import judges_command, table_command
from legoworld.commands.options import off, option, refuse_given
from legoworld.commands.output import Output
from legoworld.commands.param_types import COUNT, EXISTING_FOLDER, FILE, FOLDER, FROM_ZERO
from legoworld.commands.progress import shown_progress
from legoworld.pluralize import plural, share

if TYPE_CHECKING:
    from legoworld.bench.dataset import MadeDataset
    from legoworld.bench.family import MadeFamily


@options.group("bench")
def command() -> None:
    """Make reference cases from any scene, and use them: LEGO-Bench.

    \b
    Examples:
      legoworld bench make references -o bench
      legoworld bench serve bench --no-render < requests.jsonl
      legoworld bench export --harbor bench -o tasks
      legoworld bench table evals/mine evals/other -o table
    """


command.add_command(serve_command)
command.add_command(table_command)
command.add_command(judges_command)


@command.command("make")
@click.argument("scenes", type=FOLDER)
@option("--output", "The dataset to write.")
@option("--size", "Size of the pictures.", default="1920x1080")
@option("--limit", "Only the first N reference scenes.")
@option("--samples", "Cycles samples of the pictures.", COUNT, default=128)
@off("--no-denoise denoised", "Leave the pictures as Cycles samples them.")
@option(
    "--noise-seeds",
    "Renders by the render card of which A's noise floor is measured; 0: none.",
    FROM_ZERO,
    default=3,
)
@option(
    "--keep-scenes",
    "Also write each case as a scene folder: the reference submitted as itself. Private.",
    FOLDER,
)
@option(
    "--procedural",
    "Draw the reference scenes into SCENES by this seed, from eight programs, first.",
    FROM_ZERO,
)
@option("--count", "How many scenes to draw.", COUNT, default=8)
@option(
    "--assets",
    "Folder of KayKit's packs, which the programs read.",
    EXISTING_FOLDER,
    envvar="LEGOWORLD_KAYKIT",
)
@option("--require-frozen")
@option("--workers")
@option("--overwrite", "Delete an earlier dataset first.")
@option("--engine")
@options.cache
@options.limits
@options.printing
def make_command(scenes: Path, output: Path, out: Output, **given: Any) -> int:
    """Make cases from reference SCENES: DATASET/public for agents, DATASET/private for evaluate.

    Every camera with a custom property `view` is a view, otherwise the active camera. The property
    `tier` (easy, medium, hard) of an object or collection says from which tier on it is there. The
    visible instances labelled with `category` are scored, unless `scored` is false. A scene that
    cannot become cases is named with its reason; exit code 1 then. --time-limit is for reading a
    scene; each render has 20 s more for every million samples (pixels times samples). Finished
    renders are in the snapshot cache: re-run the same command to resume. A scene.glb without a
    scene.blend is a reference, too; its properties are the extras of its nodes.

    \b
    Examples:
      legoworld bench make references -o bench
      legoworld bench make references -o bench --size 960x540 --keep-scenes itself
      legoworld bench make drawn --procedural 7 --count 40 --assets kaykit -o training
    """
    from legoworld.api.bench import bench_make

    if given["procedural"] is None:
        refuse_given(("count", "assets"), "needs --procedural")
        if not scenes.is_dir():
            raise click.BadParameter(f"Directory '{scenes}' does not exist.", param_hint="'SCENES'")
    with shown_progress("scene", quiet=out.quiet) as listener:
        made = bench_make(scenes, output, listener=listener, **given)
    out.show(lambda: _document(made, output), _lines(made, output, verbose=out.verbose))
    return 1 if made.refused_families else 0


def _document(dataset: MadeDataset, output: Path) -> dict[str, Any]:
    from legoworld.bench.hidden import hidden_things

    families = [
        {
            "family": f.family,
            "status": f.status,
            "reason": f.reason,
            "cases": [c.file_name for c in f.cases],
            "hidden": {name: list(things) for name, things in hidden_things(f.cases).items()},
        }
        for f in dataset.families
    ]
    return {"dataset": str(output), "families": families}


def _lines(dataset: MadeDataset, output: Path, *, verbose: bool) -> Iterator[str]:
    from legoworld.bench.hidden import hidden_things

    for family in dataset.refused_families:
        yield f"{family.status}: {family.family}: {family.reason}"
    for family in dataset.families:
        for name, things in hidden_things(family.cases).items():
            hidden = ", ".join(things)
            yield f"{name}: hidden here and not scored, though in an earlier tier: {hidden}"
    for family in dataset.families if verbose else ():
        yield from _cases(family)
    good = len(dataset.families) - len(dataset.refused_families)
    cases = sum(len(f.cases) for f in dataset.families)
    line = f"{share(good, len(dataset.families), 'scene', 'scenes')} made into "
    line += plural(cases, "case", "cases")
    if dataset.track is None:
        yield f"{line}: no dataset was written"
        return
    yield f"{line}, {plural(len(dataset.track.categories), 'category', 'categories')}"
    spread = [f.truth.noise_floor for m in dataset.families for f in m.cases if f.truth.noise_floor]
    if spread:
        lowest = min(min(n.a_self) for n in spread)
        yield (
            f"A of the references rendered by the card: {lowest:.4f} at least; seed to seed sd "
            f"{max(n.sd for n in spread):.4f} at most ({len(spread[0].seeds)} seeds a case)"
        )
    yield f"public -> {output / 'public'}; private -> {output / 'private'}"


def _cases(family: MadeFamily) -> list[str]:
    return [
        f"{case.file_name}: {plural(len(case.truth.scored), 'scored object', 'scored objects')}"
        for case in family.cases
    ]


_TIMEOUT: Final = click.FloatRange(min=1)


@command.command("export")
@click.argument("dataset", type=EXISTING_FOLDER)
@click.option("--harbor", is_flag=True, required=True, help="Task folders for Harbor.")
@option("--output", "Folder of the tasks.")
@option(
    "--agent-image",
    "Container image the agent works in; it has legoworld and Blender.",
    default="legoworld:latest",
)
@option(
    "--verifier-image",
    "Container image with legoworld and bpy; the repository's Dockerfile builds one.",
    default="legoworld:latest",
)
@option(
    "--prebuilt",
    "Run agent and verifier in this image as it is, and write no Dockerfile: for verifiers, which "
    "builds none.",
)
@option("--agent-timeout agent_timeout_s", "Seconds the agent has.", _TIMEOUT, default=3600)
@option("--verifier-timeout verifier_timeout_s", "Seconds the verifier has.", _TIMEOUT, default=900)
@option("--cpus", "CPU cores of agent and verifier.", COUNT, default=2)
@option("--memory-mb", "Memory of agent and verifier.", click.IntRange(min=512), default=8192)
def export_command(dataset: Path, harbor: bool, output: Path, **settings: Any) -> int:
    """Write each case of DATASET as a task folder: instruction, environment, verifier.

    The agent's environment holds the picture and what the public half says. The private half of
    the case lies in tests/, which only the separate verifier gets; it writes reward.json.

    \b
    Examples:
      legoworld bench export --harbor bench -o tasks
      legoworld bench export --harbor bench -o tasks --agent-image my/blender:5.0
      legoworld bench export --harbor bench -o tasks --prebuilt registry.example/legoworld:1.0.0
    """
    from legoworld.api.bench import bench_export

    assert harbor  # the only form there is
    tasks = bench_export(dataset, output, **settings)
    click.echo(f"{plural(len(tasks), 'task', 'tasks')} -> {output}")
    return 0


@command.command("reward")
@click.argument("evaluation", type=FOLDER)
@option("--output", "The file to write.", FILE)
@option("--overwrite", "Replace the file.")
def reward_command(evaluation: Path, output: Path, overwrite: bool) -> int:
    """Write reward.json of an evaluation of one case: finite numbers with the key `reward`.

    reward is S, or R of a run without a render; 0 for a submission that is missing or invalid.
    Where nothing was scored no file is written, and the exit code is 5.

    \b
    Examples:
      legoworld bench reward evals/one -o reward.json
      legoworld bench reward /tmp/evaluation --overwrite -o /logs/verifier/reward.json
    """
    from legoworld.bench.reward import bench_reward

    reward = bench_reward(evaluation, output, overwrite=overwrite)
    click.echo(f"reward {reward['reward']:.6f} -> {output}")
    return 0
