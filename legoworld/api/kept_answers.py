"""Answers in memory as the run and the ground truth that an evaluation is made of."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, cast

from legoworld.api.baselines import baseline_import
from legoworld.api.scoring import GivenAnswers
from legoworld.api.tracks import track_make
from legoworld.errors import UsageError
from legoworld.evaluation.family import Picture
from legoworld.files import canonical_json, sha256_of_text, write_text
from legoworld.readouts.pixels import PixelFile
from legoworld.records.base import canonical
from legoworld.records.track import ImageInfo
from legoworld.track_making.make_track import write_track
from legoworld.tracks.track import Source, TrackImage, load_track
from legoworld.workers.scratch import ScratchFolder, scratch_folder

#: Names in the folder of an evaluation of answers in memory.
EVALUATION: Final = "evaluation"
_RUN, _TRUTH, _TRACK = "run", "truth", "track.json"


@dataclass(frozen=True, kw_only=True)
class AnswerFolders:
    """The folders. truth: a file that was read, or the arrays."""

    run: Path
    truth: Path


def named_folder(output: str | Path | None) -> tuple[Path, str, Callable[[], None]]:
    """A folder, the name of what is in it, and what deletes it: one of its own for None."""
    if output is not None:
        return Path(output), Path(output).name, lambda: None
    scratch = ScratchFolder("legoworld-answers-")
    return scratch.path, "answers", scratch.close


def keep_answers(given: GivenAnswers, folder: Path, *, name: str, overwrite: bool) -> AnswerFolders:
    """Write folder/run, folder/track.json, and folder/truth of arrays. name: of the run.

    Raises as `baseline_import` and `track_make`, and UsageError for a folder of another truth.
    """
    source, track = given.truth.source, folder / _TRACK
    truth = Path(source) if isinstance(source, str | Path) else folder / _TRUTH
    with scratch_folder("legoworld-answers-") as scratch:
        made = scratch / "made"
        made.mkdir()
        _keep_truth(given, made)
        if not overwrite:
            _refuse_other(made, folder)
        shutil.copytree(made, folder, dirs_exist_ok=True)
        answers, stored = scratch / "answers", given.truth.family.stored
        declared: dict[str, Any] = {}
        if stored is None:
            answers = scratch / "answers.json"
            write_text(answers, canonical_json(list(given.answers)))
            declared["category_ids"] = "dataset"
        else:
            arrays = cast("Mapping[int, Picture]", given.answers)
            _keep_arrays(stored, answers, arrays, load_track(track).images)
        baseline_import(
            answers,
            folder / _RUN,
            task=given.truth.task,
            track=track,
            name=name,
            overwrite=overwrite,
            **declared,
        )
    return AnswerFolders(run=folder / _RUN, truth=truth)


def _refuse_other(made: Path, folder: Path) -> None:
    """UsageError where the folder has another track or truth under the same names."""
    for file in sorted(path for path in made.rglob("*") if path.is_file()):
        there = folder / file.relative_to(made)
        if there.exists() and there.read_bytes() != file.read_bytes():
            raise UsageError(
                f"{folder} holds answers to other images, or another truth",
                found=there.relative_to(folder).as_posix(),
                expected="a new folder, or the same images and truth",
                next_step="choose another folder, or pass overwrite=True",
            )


def _keep_truth(given: GivenAnswers, folder: Path) -> None:
    """Write the track of the images that are answered, and a truth that is arrays."""
    held, track = given.truth, folder / _TRACK
    every = given.image_ids is None or {*given.image_ids} == {*held.sizes_wh}
    chosen = None if every else [*map(str, given.image_ids or ())]
    if isinstance(held.source, str | Path):
        track_make(track, truth=held.source, task=held.task, images=chosen)
        return
    images = tuple(
        ImageInfo(id=i, file_name=f"{i}.png", width=w, height=h)
        for i, (w, h) in sorted(held.sizes_wh.items())
    )
    source = Source(
        name="arrays", version="custom", sha256=sha256_of_text(canonical(images)), images=images
    )
    write_track(held.task, source, track, chosen=chosen)
    assert held.family.stored is not None
    _keep_arrays(held.family.stored, folder / _TRUTH, held.source, load_track(track).images)


def _keep_arrays(
    file: PixelFile, folder: Path, arrays: Mapping[int, Picture], images: tuple[TrackImage, ...]
) -> None:
    """Write the array of each image."""
    for image in images:
        path = folder / f"{image.scene}.npz"
        path.parent.mkdir(parents=True, exist_ok=True)
        file.write(path, arrays[image.id], {})
