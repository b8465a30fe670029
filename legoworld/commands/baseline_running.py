"""`legoworld baseline run`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from legoworld.commands import baseline_output, options
from legoworld.commands.progress import shown_progress

if TYPE_CHECKING:
    from legoworld.workers.protections import Confinement


@click.command("run", context_settings={"help_option_names": ["-h", "--help"]})
@click.argument("name")
@click.option("--task", required=True, type=baseline_output.TASKS, help="What to predict.")
@click.option("--track", required=True, type=options.EXISTING_FILE, help="Track file (images).")
@click.option("--photos", required=True, type=options.EXISTING_FOLDER, help="Folder of the photos.")
@click.option("--weights", required=True, help="Weights: a file, a folder or a hub id.")
@click.option("-o", "--output", type=options.FOLDER, required=True, help="Run folder to write.")
@click.option(
    "--python",
    type=click.Path(path_type=Path, exists=True, dir_okay=False),
    envvar="LEGOWORLD_BASELINE_PYTHON",
    help="Python with the baseline's requirements [default: its installed environment].",
)
@click.option(
    "--device",
    default="cpu",
    show_default=True,
    help="cpu, cuda, cuda:1, mps; auto: a GPU if present.",
)
@click.option(
    "--dtype",
    type=options.Choice(["float32", "float16", "bfloat16", "auto"]),
    default="float32",
    show_default=True,
    help="Type the network computes in; auto: the original's on that device.",
)
@click.option(
    "--batch-size",
    type=click.IntRange(min=1),
    default=1,
    show_default=True,
    help="Images per batch, where the baseline supports it.",
)
@click.option(
    "--option", "given", multiple=True, metavar="KEY=VALUE", help="Baseline option; repeatable."
)
@click.option(
    "--label-map", type=options.EXISTING_FILE, help='JSON {"their label": "category name" or null}.'
)
@click.option(
    "--prompts-from-truth",
    type=options.EXISTING_FILE,
    help="LVIS only: prompt with each image's verified categories; recorded as used_truth.",
)
@click.option("--offline", is_flag=True, help="Use local files only; download nothing.")
@click.option(
    "--pass-env",
    "variables",
    multiple=True,
    metavar="NAME",
    help="Environment variable to pass to the baseline; repeatable. Others are hidden from it.",
)
@click.option(
    "--limit", type=click.IntRange(min=1), help="Run the first N images only (partial run)."
)
@click.option(
    "--image-id", "image_ids", multiple=True, type=int, help="Run this image only; repeatable."
)
@click.option(
    "--time-limit", type=click.FloatRange(min=0.1),
    help="Seconds from one answer to the next, and for loading the model [default: none].",
)  # fmt: skip
@click.option(
    "--load-time-limit", type=click.FloatRange(min=0.1),
    help="Seconds for loading the model [default: --time-limit].",
)  # fmt: skip
@click.option(
    "--input", "inputs", multiple=True, type=click.Path(path_type=Path, exists=True),
    help="File or folder the baseline may read besides its weights and photos; repeatable.",
)  # fmt: skip
@baseline_output.sandbox_option
@click.option("--resume", is_flag=True, help="Resume an interrupted run (the default).")
@click.option("--overwrite", is_flag=True, help="Delete the results of an earlier run first.")
@options.output_options
def run_command(
    name: str,
    task: str,
    track: Path,
    photos: Path,
    weights: str,
    output: Path,
    python: Path | None,
    device: str,
    dtype: str,
    batch_size: int,
    given: tuple[str, ...],
    label_map: Path | None,
    prompts_from_truth: Path | None,
    offline: bool,
    variables: tuple[str, ...],
    limit: int | None,
    image_ids: tuple[int, ...],
    time_limit: float | None,
    load_time_limit: float | None,
    inputs: tuple[Path, ...],
    sandbox: Confinement,
    resume: bool,
    overwrite: bool,
    as_json: bool,
    quiet: bool,
    verbose: bool,
) -> int:
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
    from legoworld.baselines.accelerators import chosen_device, chosen_dtype
    from legoworld.baselines.baseline_run import run_baseline
    from legoworld.baselines.cards import chosen_options, load_baseline
    from legoworld.baselines.confinement import confined
    from legoworld.baselines.environments import chosen_python
    from legoworld.baselines.request import BaselineRequest, selected_images
    from legoworld.baselines.truth_prompts import read_truth_prompts

    if resume and overwrite:
        raise click.UsageError(
            "--resume keeps existing results, --overwrite deletes them: pass one"
        )
    card = load_baseline(name)
    if task not in card.about.tasks:
        raise click.UsageError(
            f"the baseline {name} is for {', '.join(card.about.tasks)}, not for {task}"
        )
    if label_map is not None and not card.about.label_map:
        raise click.UsageError(
            f"the baseline {name} matches no labels by name, so --label-map would have no effect"
        )
    images, protocol = baseline_output.track_of(task, track)
    with_python = chosen_python(card, python)
    device = chosen_device(device, with_python)
    request = BaselineRequest(
        card=card,
        protocol=protocol,
        track=images,
        photos=photos,
        weights=weights,
        run=output,
        python=with_python,
        device=device,
        dtype=chosen_dtype(dtype, device, card),
        batch_size=batch_size,
        options=chosen_options(card, given),
        labels=baseline_output.labels(label_map, protocol),
        prompts=(
            read_truth_prompts(prompts_from_truth, images.images, card, task)
            if prompts_from_truth
            else None
        ),
        offline=offline,
        overwrite=overwrite,
        limit=limit,
        image_ids=image_ids,
        load_time_limit_s=load_time_limit or time_limit,
        time_limit_s=time_limit,
        confined=confined(card, weights, sandbox, offline=offline, inputs=inputs),
        pass_variables=variables,
    )
    total = len(selected_images(images, image_ids, limit))
    with shown_progress("image", quiet=quiet) as shown:
        shown.total(total)
        baseline_output.warn_unconfined(request.confined, shown.notice)
        result = run_baseline(
            request,
            progress=shown.row,
            notice=shown.notice,
            log=shown.notice if verbose and not quiet else lambda _line: None,
            kept=shown.kept,
        )
    return baseline_output.show(result, output, as_json=as_json, verbose=verbose)
