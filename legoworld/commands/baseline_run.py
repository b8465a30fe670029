"""`legoworld baseline run`."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import click

from legoworld.commands import baseline_output, options
from legoworld.commands.model_options import model_options
from legoworld.commands.options import flag, option
from legoworld.commands.output import Output
from legoworld.commands.param_types import AMOUNT, COUNT, EXISTING_FILE
from legoworld.commands.progress import shown_progress


@click.command("run")
@click.argument("name")
@baseline_output.task("What to predict.")
@option("--track", required=True)
@option("--photos")
@option("--output", "Run folder to write.")
@model_options(
    "Seconds from one answer to the next, and for loading the model [default: none].", required=True
)
@option(
    "--load-time-limit load_time_limit_s",
    "Seconds for loading the model [default: --time-limit].",
    AMOUNT,
)
@option("--batch-size", "Images per batch, where the baseline supports it.", COUNT, default=1)
@option("--label-map")
@option(
    "--prompts-from-truth",
    "LVIS only: prompt with each image's verified categories; recorded as used_truth.",
    EXISTING_FILE,
)
@option(
    "--pass-env pass_variables",
    "Environment variable to pass to the baseline; repeatable. Others are hidden from it.",
    multiple=True,
    metavar="NAME",
)
@option("--limit")
@option("--image-id")
@option(
    "--input", "File or folder the baseline may read besides its weights and photos; repeatable."
)
@flag("--resume", "Resume an interrupted run (the default).")
@option("--overwrite")
@options.printing
def run_command(name: str, output: Path, resume: bool, out: Output, **given: Any) -> int:
    """Run the baseline NAME over a track's photos, in its own process.

    Predictions are saved as they are made: re-run the same command to resume, with the same
    weights, options, code and versions. An image that the baseline cannot process, or that crashes
    it twice, is recorded as failed; the exit code is then 1. -v shows the baseline's output.

    With bubblewrap the baseline reads its own files, WEIGHTS, the photos and each --input, writes
    to none of your files, and has the network only to download WEIGHTS that are no path.

    \b
    Examples:
      legoworld baseline run dino --task coco --track track.json --photos val2017 \\
          --weights checkpoint0023_4scale.pth -o runs/dino --device cuda
      legoworld baseline run hf-detector --task coco --track track.json --photos val2017 \\
          --weights PekingU/rtdetr_r50vd -o runs/rtdetr --limit 5
      legoworld baseline run sam3 --task lvis --track lvis.json --photos coco \\
          --weights facebook/sam3 -o runs/sam3 --offline --option per_image=300
    """
    from legoworld.api.baselines import baseline_run

    if resume and given["overwrite"]:
        raise click.UsageError(
            "--resume keeps existing results, --overwrite deletes them: pass one"
        )
    with shown_progress("image", quiet=out.quiet) as listener:
        if out.verbose and not out.quiet:
            listener = replace(listener, log=listener.notice)
        run = baseline_run(name, output, listener=listener, **given)
    return baseline_output.show(run, out)
