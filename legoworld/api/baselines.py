"""`baseline_run` and `baseline_import`: specialists' answers as runs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Literal, TypedDict, Unpack, cast

from legoworld.api.arguments import check_arguments, optional_path
from legoworld.api.listener import SILENT, Listener
from legoworld.api.readout import Run
from legoworld.api.settings import refuse_other_task
from legoworld.baselines.baseline_import import ImportRequest
from legoworld.baselines.baseline_import import images_run as read_images_run
from legoworld.baselines.baseline_run import run_baseline
from legoworld.baselines.cards import load_baseline
from legoworld.baselines.confinement import BaselineConfinement
from legoworld.baselines.family import (
    BaselineFamily,
    ImportListener,
    ImportOptions,
    load_baseline_family,
)
from legoworld.baselines.foreign_results import next_step_for
from legoworld.baselines.labels import label_map as read_label_map
from legoworld.baselines.request import BaselineRequest, ModelOptions, choose_model
from legoworld.baselines.truth_prompts import read_truth_prompts
from legoworld.errors import UsageError
from legoworld.evaluation.depth.labelled import UNITS, is_unit
from legoworld.readouts.family import Protocol, protocol
from legoworld.running.readout_run import RunResult, selected_images
from legoworld.tracks.track import Track, load_track


class Declarations(TypedDict, total=False):
    """What imported results do not say themselves: the options of `legoworld baseline import`."""

    box_format: Literal["xywh", "xyxy", "cxcywh"] | None
    category_ids: str | None
    label_map: str | Path | None
    space: str | None
    unit: str | None
    sign: str | None
    array: str | None
    suffix: str | None
    intrinsics: str | Path | None


@check_arguments
def baseline_run(
    name: str,
    output: str | Path,
    *,
    task: str,
    track: str | Path,
    photos: str | Path,
    weights: str,
    batch_size: int = 1,
    label_map: str | Path | None = None,
    prompts_from_truth: str | Path | None = None,
    limit: int | None = None,
    image_ids: Sequence[int] = (),
    inputs: Sequence[str | Path] = (),
    pass_variables: Sequence[str] = (),
    load_time_limit_s: float | None = None,
    overwrite: bool = False,
    listener: Listener = SILENT,
    **model: Unpack[ModelOptions],
) -> Run:
    """Run a baseline over a track's photos, in its own process; repeat the call to resume.

    weights: a file, a folder or a hub id. label_map: JSON {"their label": "category name" or null};
    prompts_from_truth: LVIS only, prompt with each image's verified categories, which is recorded.
    inputs: what it may read besides its weights and photos; pass_variables: variables of the
    environment it gets. model: `ModelOptions`. Other arguments: as in `readout`. `listener.log`
    gets the baseline's output. An image that it cannot process is a row. UsageError for a task, or
    a label_map, that the baseline has no use for.
    """
    card = load_baseline(name)
    if task not in card.about.tasks:
        raise UsageError(
            f"the baseline {name} is for {', '.join(card.about.tasks)}, not for {task}"
        )
    if label_map is not None and not card.about.label_map:
        raise UsageError(
            f"the baseline {name} matches no labels by name, so --label-map would have no effect"
        )
    images, reading = _track_and_protocol(task, track)
    request = BaselineRequest(
        **vars(choose_model(card, weights, model, inputs)),
        photos=Path(photos),
        batch_size=batch_size,
        overwrite=overwrite,
        limit=limit,
        image_ids=tuple(image_ids),
        load_time_limit_s=load_time_limit_s or model.get("time_limit_s"),
        pass_variables=tuple(pass_variables),
        protocol=reading,
        track=images,
        run=Path(output),
        labels=_labels(label_map, reading),
        prompts=(
            read_truth_prompts(Path(prompts_from_truth), images.images, card, task)
            if prompts_from_truth is not None
            else None
        ),
    )
    listener.total(len(selected_images(images, image_ids, limit)))
    warn_unconfined(request.confinement, listener)
    result = run_baseline(
        request,
        progress=listener.row,
        notice=listener.notice,
        log=listener.log,
        kept=listener.kept,
    )
    return _run(result, output)


@check_arguments
def baseline_import(
    results: str | Path,
    output: str | Path,
    *,
    task: str,
    track: str | Path,
    name: str | None = None,
    images_run: str | Path | None = None,
    subset: bool = False,
    overwrite: bool = False,
    listener: Listener = SILENT,
    **declared: Unpack[Declarations],
) -> Run:
    """Import a results JSON, or a folder of depth or normals, as a run.

    name: of the baseline, None for the file's. images_run: a file with the ids or names of the
    images the model was run on, None for all of the track. subset: ignore results of other images.
    declared: `Declarations`; one that the task does not take is a UsageError. An image without an
    array is recorded as missing.
    """
    given: dict[str, Any] = {key: value for key, value in declared.items() if value is not None}
    given |= {key: Path(given[key]) for key in ("label_map", "intrinsics") if key in given}
    given |= {"subset": True} if subset else {}
    images, reading = _track_and_protocol(task, track)
    family, given_path = load_baseline_family(task), Path(results)
    for key in given:
        if key not in family.options or (key == "box_format" and reading.card.reads != "boxes"):
            raise UsageError(f"--{key.replace('_', '-')} is not for --task {task}")
    _check_depth(given, reading.card.reads)
    if given_path.is_dir() != family.of_folder:
        raise UsageError(_not_of_the_task(given_path, task, family))
    request = ImportRequest(
        protocol=reading,
        track=images,
        run=Path(output),
        name=name or given_path.resolve().stem,
        ran_on=(None if images_run is None else read_images_run(Path(images_run), images.images)),
        subset=subset,
        overwrite=overwrite,
    )
    telling = ImportListener(total=listener.total, progress=listener.row, notice=listener.notice)
    return _run(
        family.import_answers(request, given_path, cast("ImportOptions", given), telling), output
    )


def warn_unconfined(confinement: BaselineConfinement, listener: Listener) -> None:
    """Say what a baseline's process is not kept from where there is no bubblewrap."""
    if confinement.protections.bubblewrap is None:
        listener.warn(
            f"without bubblewrap ({confinement.protections.why_not}) the baseline runs with your "
            f"permissions; not kept from it: {', '.join(confinement.record().does_not_hold)}"
        )


def _run(result: RunResult, output: str | Path) -> Run:
    return Run(folder=Path(output), rows=result.rows, summary=result.summary, strangers=())


def _track_and_protocol(task: str, track: str | Path) -> tuple[Track, Protocol]:
    images = load_track(Path(track))
    refuse_other_task(images, task)
    return images, protocol(task, images.vocabulary)


def _labels(path: str | Path | None, reading: Protocol) -> dict[str, str | None]:
    """The model's labels mapped to category names: the known ones and those of a label map."""
    if reading.vocabulary is None:
        if path is not None:
            raise UsageError("--label-map is for boxes and masks: depth has no labels")
        return {}
    return read_label_map(optional_path(path), reading.vocabulary, reading.task.name)


def _check_depth(given: Mapping[str, object], reads: str) -> None:
    """UsageError for what is declared about depth arrays and cannot hold together."""
    space, unit = given.get("space"), given.get("unit")
    if unit is not None and not is_unit(str(unit)):
        raise UsageError(f"--unit {unit!r} is not one of {UNITS}")
    if space == "disparity" and unit:
        raise UsageError("--unit is for depth: disparity has an unknown scale and shift")
    if space in ("depth", "disparity") and "intrinsics" in given and reads == "depth":
        raise UsageError(f"--intrinsics is for ray distance, not for --space {space}")


def _not_of_the_task(source: Path, task: str, family: BaselineFamily) -> str:
    what = f"--task {task} imports {family.what}"
    if family.of_folder:
        return what
    advice = next_step_for(source)
    what += f", but {source.name} is a folder"
    if (source / "run.json").is_file():
        return f"{what}: it is already a run, evaluate it directly"
    return what + (f": {advice}" if advice else "")
