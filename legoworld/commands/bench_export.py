"""`legoworld bench export` and `legoworld bench reward`, which its tasks call."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

import click

from legoworld.commands.options import option
from legoworld.commands.param_types import COUNT, EXISTING_FOLDER, FILE, FOLDER
from legoworld.pluralize import plural

_TIMEOUT: Final = click.FloatRange(min=1)


@click.command("export")
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


@click.command("reward")
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
