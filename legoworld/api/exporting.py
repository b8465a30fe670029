"""Runs and scenes in the formats of others: a row of `exports.formats` each."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Final, Literal, TypedDict, Unpack, cast, overload

from legoworld.api.arguments import check_arguments
from legoworld.api.reader import Reader, Reading
from legoworld.api.scene_view import SceneView
from legoworld.api.settings import MEMORY_LIMIT_GIB, TIME_LIMIT_S, Cache, make_limits
from legoworld.errors import LegoWorldError, UsageError
from legoworld.evaluation.run import read_run
from legoworld.exports.formats import (
    DEFAULT_FORMAT,
    FORMAT_NAMES,
    FORMATS,
    DocumentFormat,
    ExportResult,
    Format,
    find_format,
    writer,
)
from legoworld.exports.view import ExportedView
from legoworld.files import Json, readable_json, write_text
from legoworld.records.coco_file import CocoFile
from legoworld.records.folders.read_run import RUN
from legoworld.scene.blender_process import Limits
from legoworld.scene.folder import BLEND, GLB, Source
from legoworld.tracks.track import Track
from legoworld.workers.removal import remove_folder
from legoworld.workers.scratch import scratch_folder

#: In a folder that was exported: what it is of, and what its format cannot hold.
RECORD: Final = "legoworld.json"
#: The name of the scene of views.
VIEWS: Final = "scene"


class ReaderOptions(TypedDict, total=False):
    """How scenes are read; see `Reader`."""

    source: Source
    cache: Cache
    require_frozen: bool
    time_limit_s: float
    memory_limit_gib: float


@dataclass(kw_only=True)
class _Scenes:
    """The scenes that were read: hashes by name, and the errors of those that could not be."""

    read: dict[str, str] = field(default_factory=dict)
    errors: dict[str, LegoWorldError] = field(default_factory=dict)


@overload
def export(
    run_or_scenes: str | Path | Iterable[SceneView],
    output: str | Path,
    *,
    format: DocumentFormat = ...,
    task: str | None = ...,
    track: Track | str | Path | None = ...,
    size_wh: tuple[int, int] | None = ...,
    overwrite: bool = ...,
    **given: Unpack[ReaderOptions],
) -> CocoFile: ...
@overload
def export(
    run_or_scenes: str | Path | Iterable[SceneView],
    output: str | Path,
    *,
    format: str,
    task: str | None = ...,
    track: Track | str | Path | None = ...,
    size_wh: tuple[int, int] | None = ...,
    overwrite: bool = ...,
    **given: Unpack[ReaderOptions],
) -> ExportResult | CocoFile: ...
@check_arguments
def export(
    run_or_scenes: str | Path | Iterable[SceneView],
    output: str | Path,
    *,
    format: str = DEFAULT_FORMAT,  # noqa: A002  as the command calls it
    task: str | None = None,
    track: Track | str | Path | None = None,
    size_wh: tuple[int, int] | None = None,
    overwrite: bool = False,
    **given: Unpack[ReaderOptions],
) -> ExportResult | CocoFile:
    """Write a run, what the cameras of scenes see, or views of one scene in a format of others.

    Gives what was written; the document of the formats that are one COCO JSON.

    run_or_scenes: a run's folder; a scene folder, or a folder of them, written by name; or views,
    which are taken one by one. track: source of a run's category names if they are not the
    dataset's own. Of scenes: task, track and size_wh as in `Scene.view`, the rest as in `Reader`.

    A scene that cannot be read is in `errors`, and raised where there is no other one. Raises
    UsageError for a format that is not written from this, an existing output, or a camera that the
    format cannot hold; RunUnusableError or PredictionsInvalidError for a damaged run. Nothing is
    written then.
    """
    if format not in FORMAT_NAMES:
        raise UsageError(f"unknown format {format!r}"[:100], expected=", ".join(FORMAT_NAMES))
    row, of, place = find_format(format), _Scenes(), Path(output)
    source = Path(run_or_scenes) if isinstance(run_or_scenes, str | Path) else None
    if row.document and (source is None or is_run(source)):
        write = writer(row.document)
        document = write(run_or_scenes, output, format=format, track=track, overwrite=overwrite)
        return cast("CocoFile", document)
    if source is None:
        write = _writer(row, "views", "views")
        given_views = cast("Iterable[SceneView]", run_or_scenes)
        made = (_exported_view(view, VIEWS, None, Limits(), of) for view in given_views)
        return _write_output(place, format, overwrite, lambda folder: write(made, folder), of)
    if is_run(source):
        write = _writer(row, "run", f"the run {source.name}")
        return _write_output(
            place, format, overwrite, lambda path: write(source, path, track=track), of
        )
    if row.views is None:
        read_run(source)  # says what the folder is instead
    write, folders = _writer(row, "views", f"{source.name}, no run"), _scene_folders(source)
    with Reader(task=task, track=track, workers=1, **given) as reader:
        views = _views(reader.read(folders, size_wh=size_wh), of, given)
        return _write_output(place, format, overwrite, lambda folder: write(views, folder), of)


def is_run(folder: Path) -> bool:
    """Whether a folder is a run; any other is one of scenes."""
    return (folder / RUN).is_file()


def _views(
    readings: Iterator[Reading], of: _Scenes, options: ReaderOptions
) -> Iterator[ExportedView]:
    limits = make_limits(
        options.get("time_limit_s", TIME_LIMIT_S), options.get("memory_limit_gib", MEMORY_LIMIT_GIB)
    )
    for reading in readings:
        folder = reading.scene.resolve()
        if reading.view is None:
            assert reading.error is not None
            of.errors[folder.name] = reading.error
        else:
            yield _exported_view(reading.view, folder.name, folder, limits, of)
    if of.errors and not of.read:
        raise next(iter(of.errors.values()))


def _exported_view(
    view: SceneView, scene: str, folder: Path | None, limits: Limits, of: _Scenes
) -> ExportedView:
    inspection = view._inspection
    of.read[scene] = inspection.scene.snapshot_sha256
    return ExportedView(
        scene=scene,
        folder=folder,
        snapshot=inspection.scene.snapshot,
        grouping=inspection.grouping,
        view=inspection.view,
        limits=limits,
    )


def _write_output(
    output: Path, form: str, overwrite: bool, write: Callable[[Path], ExportResult], of: _Scenes
) -> ExportResult:
    """Write beside the output, and move it there when it is whole."""
    if output.exists() and not overwrite:
        raise UsageError(
            f"{output.name} already exists",
            expected="a new file or folder",
            next_step="choose another -o, or pass --overwrite",
        )
    if output.is_dir() and not (output / RECORD).is_file():
        raise UsageError(
            f"the folder {output.name} was not written by `legoworld export`",
            found=f"no {RECORD} in it",
            next_step="choose another -o: --overwrite deletes earlier exports only",
        )
    output.parent.mkdir(parents=True, exist_ok=True)
    with scratch_folder(".exporting-", output.parent) as scratch:
        made = scratch / output.name
        written = write(made)
        if made.is_dir():
            record: Json = {"format": form, "not_held": written.losses, "scenes": of.read}
            write_text(made / RECORD, readable_json(record))
        if output.is_dir():
            remove_folder(output)
        elif made.is_dir():
            output.unlink(missing_ok=True)
        made.rename(output)
    return replace(written, failed=of.errors)


def _scene_folders(scenes: Path) -> list[Path]:
    """The folder itself, or the scene folders in it, by name. UsageError where there is none."""
    if any((scenes / name).exists() for name in (BLEND, GLB)):
        return [scenes]
    below = sorted({path.parent for name in (BLEND, GLB) for path in scenes.glob(f"*/{name}")})
    if not below:
        raise UsageError(
            f"{scenes.name} is neither a run nor a folder of scenes",
            found=f"no {RUN}, {BLEND} or {GLB} in it or one level below",
            expected="a run, a scene folder, or a folder of scene folders",
        )
    return below


def _writer(row: Format, kind: Literal["run", "views"], found: str) -> Callable[..., ExportResult]:
    """What writes a format from a run, or from views. UsageError where nothing does."""
    name: str | None = getattr(row, kind)
    if name is not None:
        return writer(name)
    others = ", ".join(one.name for one in FORMATS if getattr(one, kind) or one.document)
    wanted = {"run": "the scenes that it was read from", "views": "a run of `legoworld readout`"}
    raise UsageError(
        f"{row.name} is not written from such an input",
        found=found,
        expected=wanted[kind],
        next_step=f"from such an input: {others}",
    )
