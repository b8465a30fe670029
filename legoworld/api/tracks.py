"""`track_make` and `track_check`: the public half of a ground truth, and its photos."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from legoworld.api.arguments import check_arguments
from legoworld.api.listener import SILENT, Listener
from legoworld.errors import UsageError
from legoworld.files import refuse_existing
from legoworld.readouts.pictures import read_photo
from legoworld.records.track import MadeTrack
from legoworld.track_making.family import load_track_family
from legoworld.track_making.make_track import PhotoProblem, check_photos, make_track, make_tracks
from legoworld.tracks.track import load_track


@check_arguments
def track_make(
    output: str | Path,
    *,
    truth: str | Path | Mapping[str, str | Path],
    task: str | None = None,
    every: bool = False,
    sample: int | None = None,
    seed: int = 0,
    images: Sequence[str | int] | None = None,
    scene_names: Sequence[str] | None = None,
    dataset: str | None = None,
    photos: str | Path | None = None,
    space: str | None = None,
    unit: str | None = None,
    sign: str | None = None,
    overwrite: bool = False,
    listener: Listener = SILENT,
) -> dict[str, MadeTrack]:
    """Write the public half of a ground truth as a track file; the documents by task.

    truth: the ground truth of `task`, or ground truths by task: output is then the folder of
    <task>.json, over the photos that all of them list, with `every` those that any lists. sample,
    seed: a random sample of this many images; images: these ids or file names only. scene_names: of
    ETH3D's layout; dataset: the name of another depth dataset; photos: the photos whose depth or
    normals in `truth` have the same names; space, unit: what such depth files hold, which is
    written to their depth.toml; sign: which way such normals point, to their normals.toml.
    overwrite: replace existing track files. UsageError for arguments that exclude each other.
    """
    truths = {name: Path(one) for name, one in truth.items()} if isinstance(truth, Mapping) else {}
    files = {name: Path(output) / f"{name}.json" for name in truths}
    if not isinstance(truth, Mapping):
        if task is None:
            raise UsageError("the truth of no task is given", expected="a task, or truths by task")
        truths, files = {task: Path(truth)}, {task: Path(output)}
    for path in files.values():
        refuse_existing(path, overwrite=overwrite)
    if images is not None and sample is not None:
        raise UsageError("--images and --sample exclude each other", expected="one of them")
    named = {
        "scenes": scene_names,
        "dataset": dataset,
        "photos": photos,
        "space": space,
        "unit": unit,
        "sign": sign,
    }
    own = {name: value for name, value in named.items() if value is not None}
    takers = _takers(list(truths), own)
    if photos is not None:
        for one in takers:
            _declare(one, truths[one], named, listener.notice)
    options = {name: own[name] for name in own if name in ("scenes", "dataset", "photos")}
    if photos is not None:
        options["photos"] = Path(photos)
    given: dict[str, Any] = {
        "sample": sample,
        "seed": seed,
        "chosen": None if images is None else [str(image) for image in images],
        "notice": listener.notice,
    }
    if isinstance(truth, Mapping):
        by_task = dict.fromkeys(takers, options)
        return make_tracks(truths, Path(output), every=every, options=by_task, **given)
    ((name, source),) = truths.items()
    return {name: make_track(name, source, Path(output), options=options, **given)}


def _takers(tasks: Sequence[str], given: Mapping[str, object]) -> list[str]:
    """The tasks whose tracks take the given options; UsageError for an option of none."""
    families = {task: load_track_family(task) for task in tasks}
    for name in given:
        if not any(name in family.options for family in families.values()):
            raise UsageError(f"--{name} is not for the task {', '.join(tasks)}")
        declared = any(name in family.declared for family in families.values())
        if declared and "photos" not in given:
            raise UsageError(f"--{name} is for a folder's files, with --photos")
    return [task for task, family in families.items() if family.options & set(given)]


def _declare(
    task: str, truth: Path, named: Mapping[str, Any], notice: Callable[[str], None]
) -> None:
    family = load_track_family(task)
    if family.declare is None or not truth.is_dir():
        return
    written = family.declare(truth, {name: named[name] for name in sorted(family.declared)})
    if written is not None:
        name, text = written
        notice(f"{truth.name}/{name} now says: {' '.join(text.split())}")


@check_arguments
def track_check(track: str | Path, *, photos: str | Path) -> list[PhotoProblem]:
    """The photos of a track that are missing, do not decode, or have another size."""

    def photo_size_wh(path: Path) -> tuple[int, int]:
        height, width = read_photo(path).shape[:2]
        return width, height

    return check_photos(load_track(Path(track)).images, Path(photos), photo_size_wh)
