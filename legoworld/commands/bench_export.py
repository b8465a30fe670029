"""`legoworld bench export` and `legoworld bench reward`, which its tasks call."""

from __future__ import annotations

from pathlib import Path

import click

from legoworld.commands import options
from legoworld.pluralize import counted

_HELP = {"help_option_names": ["-h", "--help"]}


@click.command("export", context_settings=_HELP)
@click.argument("dataset", type=options.EXISTING_FOLDER)
@click.option("--harbor", is_flag=True, required=True, help="Task folders for Harbor.")
@click.option("-o", "--output", type=options.FOLDER, required=True, help="Folder of the tasks.")
@click.option(
    "--agent-image",
    default="legoworld:latest",
    show_default=True,
    help="Container image the agent works in; it has legoworld and Blender.",
)
@click.option(
    "--verifier-image",
    default="legoworld:latest",
    show_default=True,
    help="Container image with legoworld and bpy; the repository's Dockerfile builds one.",
)
@click.option(
    "--agent-timeout", type=click.FloatRange(min=1), default=3600, show_default=True,
    help="Seconds the agent has.",
)  # fmt: skip
@click.option(
    "--verifier-timeout", type=click.FloatRange(min=1), default=900, show_default=True,
    help="Seconds the verifier has.",
)  # fmt: skip
@click.option(
    "--cpus",
    type=click.IntRange(min=1),
    default=2,
    show_default=True,
    help="CPU cores of agent and verifier.",
)
@click.option(
    "--memory-mb", type=click.IntRange(min=512), default=8192, show_default=True,
    help="Memory of agent and verifier.",
)  # fmt: skip
def export_command(
    dataset: Path,
    harbor: bool,
    output: Path,
    agent_image: str,
    verifier_image: str,
    agent_timeout: float,
    verifier_timeout: float,
    cpus: int,
    memory_mb: int,
) -> int:
    """Write each case of DATASET as a task folder: instruction, environment, verifier.

    The agent's environment holds the picture and what the public half says. The private half of
    the case lies in tests/, which only the separate verifier gets; it writes reward.json.

    \b
    Examples:
      legoworld bench export --harbor bench -o tasks
      legoworld bench export --harbor bench -o tasks --agent-image my/blender:5.0
    """
    from legoworld.bench.harbor import HarborOptions, export_harbor
    from legoworld.evaluation.reconstruction.dataset import read_dataset

    assert harbor  # the only form there is
    tasks = export_harbor(
        read_dataset(dataset / "private"),
        output,
        HarborOptions(
            agent_image=agent_image,
            verifier_image=verifier_image,
            agent_timeout_s=agent_timeout,
            verifier_timeout_s=verifier_timeout,
            cpus=cpus,
            memory_mb=memory_mb,
        ),
    )
    click.echo(f"{counted(len(tasks), 'task', 'tasks')} -> {output}")
    return 0


@click.command("reward", context_settings=_HELP)
@click.argument("evaluation", type=options.FOLDER)
@click.option(
    "-o",
    "--output",
    type=click.Path(path_type=Path, dir_okay=False),
    required=True,
    help="The file to write.",
)
def reward_command(evaluation: Path, output: Path) -> int:
    """Write reward.json of an evaluation of one case: finite numbers with the key `reward`.

    reward is S, or R of a run without a render; 0 for a submission that is missing or invalid.
    Where nothing was scored no file is written, and the exit code is 5.

    \b
    Examples:
      legoworld bench reward evals/one -o reward.json
      legoworld bench reward /tmp/evaluation -o /logs/verifier/reward.json
    """
    from legoworld.bench.reward import write_reward

    reward = write_reward(evaluation, output)
    click.echo(f"reward {reward['reward']:.6f} -> {output}")
    return 0
