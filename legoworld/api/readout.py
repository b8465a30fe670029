"""`readout`: read labels out of scenes into a run folder."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import asdict, dataclass, replace
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING, Any, TypedDict, Unpack, overload

from legoworld.api.arguments import check_arguments
from legoworld.api.by_task import ByTask, refuse_result_at, task_folder
from legoworld.api.folders import note_folders_without_scene, parse_place, written_at
from legoworld.api.listener import SILENT, Listener
from legoworld.api.settings import (
    MEMORY_LIMIT_GIB,
    TIME_LIMIT_S,
    Cache,
    Tracks,
    make_limits,
    snapshot_cache,
    tracks_by_task,
)
from legoworld.errors import CatalogError, UsageError
from legoworld.readouts.family import protocol
from legoworld.records.base import as_json
from legoworld.records.folders.read_run import CONFIGURATION, RUN
from legoworld.records.run_file import RunSummary
from legoworld.records.run_rows import RunRow
from legoworld.remote import Place
from legoworld.running.image_record import ImageOptions
from legoworld.running.readout_run import RunRequest, shard_images
from legoworld.running.scene_pass import PassRequest, read_scenes
from legoworld.scene.blender_process import BlenderProcess
from legoworld.scene.folder import BLEND, GLB, Source, file_source, is_scene_file
from legoworld.tasks.registry import options_by_task
from legoworld.tracks.track import Track, TrackImage, make_folder_track
from legoworld.workers.engines import EngineName, engine_cores

if TYPE_CHECKING:
    from legoworld.tracks.scene_names import Stranger
    from legoworld.visibility.normals import Variant


@dataclass(frozen=True, kw_only=True)
class Run:
    """A finished run folder. rows: those of per_image.jsonl, by image id.

    strangers: scene folders that match no image of the track.
    """

    folder: Place
    rows: tuple[RunRow, ...]
    summary: RunSummary
    strangers: tuple[Stranger, ...]

    @property
    def complete(self) -> bool:
        """Whether every image was read."""
        return all(row.status == "ok" for row in self.rows)

    @property
    def table(self) -> list[dict[str, Any]]:
        """One row of plain values per image: `pandas.DataFrame(run.table)`."""
        keys = ("image_id", "file_name", "scene", "status", "code", "reason", "n_predictions")
        return [{key: row.get(key) for key in keys} for row in map(as_json, self.rows)]

    def _repr_html_(self) -> str:
        """What a notebook shows: how many images ended how."""
        from legoworld.report.notebook import statuses_html

        counts = Counter(str(row["status"]) for row in map(as_json, self.rows))
        return statuses_html(str(self.folder), dict(sorted(counts.items())))

    def to_dict(self) -> dict[str, Any]:
        """The document that `legoworld readout --json` prints."""
        return {
            "run": str(self.folder),
            "summary": as_json(self.summary),
            "rows": as_json(self.rows),
            "unmatched_folders": [asdict(stranger) for stranger in self.strangers],
        }


class ReadoutOptions(TypedDict, total=False):
    """The keyword arguments of `readout` beside the task."""

    track: Tracks
    source: Source
    workers: int | None
    engine: EngineName
    cache: Cache
    require_frozen: bool
    limit: int | None
    image_ids: Sequence[int]
    shard: tuple[int, int] | None
    images_per_file: int | None
    max_side: int | None
    sky: str | None
    vocabulary: str | None
    variant: Variant | None
    render: bool
    render_noise: bool
    overwrite: bool
    fail_fast: bool
    time_limit_s: float
    memory_limit_gib: float
    listener: Listener
    started: BlenderProcess | None


@overload
def readout(
    scenes: str | Path, output: str | Path, *, task: str, **options: Unpack[ReadoutOptions]
) -> Run: ...
@overload
def readout(
    scenes: str | Path,
    output: str | Path,
    *,
    task: list[str] | tuple[str, ...],
    **options: Unpack[ReadoutOptions],
) -> ByTask[Run]: ...
@check_arguments
def readout(
    scenes: str | Path,
    output: str | Path,
    *,
    task: str | list[str] | tuple[str, ...],
    track: Tracks = None,
    source: Source = "blend",
    workers: int | None = None,
    engine: EngineName = "local",
    cache: Cache = True,
    require_frozen: bool = False,
    limit: int | None = None,
    image_ids: Sequence[int] = (),
    shard: tuple[int, int] | None = None,
    images_per_file: int | None = None,
    max_side: int | None = None,
    sky: str | None = None,
    vocabulary: str | None = None,
    variant: Variant | None = None,
    render: bool = True,
    render_noise: bool = False,
    overwrite: bool = False,
    fail_fast: bool = False,
    time_limit_s: float = TIME_LIMIT_S,
    memory_limit_gib: float = MEMORY_LIMIT_GIB,
    listener: Listener = SILENT,
    started: BlenderProcess | None = None,
) -> Run | ByTask[Run]:
    """Read labels out of scenes into a run folder; repeat the call to resume.

    scenes, output: folders or their URLs; scenes may be one .blend or .glb. task: the name of one
    (`legoworld list tasks`), or several: each scene is then read once for all of them, and
    output/<task> is the run of each, byte for byte what its task alone gives. track: the images, of
    several tasks also a folder with a <task>.json of each or a mapping by task; without one every
    scene folder is an image. source: the file of each scene to read. workers: Blender processes,
    None for one per core. limit: read the first images only; image_ids: read these images only;
    shard: (i, n), read every n-th image only, starting at the i-th. images_per_file: divide the
    predictions into files of this many images. max_side: depth and normals only, longest side of
    the rendered image in pixels. variant: normals only, "geometric" (None) or "shading" normals.
    sky: panoptic and semantic only, category of pixels without geometry, None for VOID.
    vocabulary: boxes and masks only, a task such as "lvis" whose categories and label rules are
    taken, None for the task's own. render, render_noise: bench only, whether A's picture is
    rendered, and a second seed of it. overwrite:
    delete the results of an earlier run first. fail_fast: stop at the first scene that cannot be
    read. The limits apply to each Blender process. started: a Blender process already running with
    these limits; the caller closes it. Results do not depend on workers, engine, cache, shard,
    limits or started.

    A scene that cannot be read becomes a row with a status and a reason. Raises UsageError,
    CatalogError, ConfigurationMismatchError (the folder holds a different run), OutputFullError or
    KernelBuildError before anything is read.
    """
    tasks = [task] if isinstance(task, str) else _distinct(task)
    place, top = parse_place(scenes), parse_place(output)
    folders = {name: top if isinstance(task, str) else task_folder(top, name) for name in tasks}
    if not isinstance(task, str):
        refuse_result_at(top, CONFIGURATION, "the runs of several tasks")
    lone = isinstance(place, Path) and is_scene_file(place)
    if isinstance(place, Path):
        source = file_source(place, source)
    every = track
    if every is None:
        every = _track_of_file(Path(place)) if lone else make_folder_track(place)
    tracks = tracks_by_task(tasks, every)
    if lone:
        tracks = {name: _of_file(one) for name, one in tracks.items()}
    given = options_by_task(
        tasks,
        max_side=max_side,
        sky=sky,
        vocabulary=vocabulary,
        variant=variant,
        images_per_file=images_per_file,
        render=None if render else False,
        render_noise=render_noise or None,
    )
    for folder in folders.values():
        _refuse_output_in_a_scene(folder, place)
    if track is None and shard is None and isinstance(place, Path):
        note_folders_without_scene(place, listener)
    stored = snapshot_cache(cache)
    with ExitStack() as written:
        runs = []
        for name in tasks:
            labels_of = given[name].get("vocabulary")
            reading = protocol(name, tracks[name].vocabulary, labels_of)
            rules = reading.readout.rules
            here = written.enter_context(written_at(folders[name], last=RUN))
            options = ImageOptions(
                scenes=place if isinstance(place, str) else place.absolute(),
                run=here.absolute(),
                protocol=reading,
                source=source,
                cache=stored,
                require_frozen=require_frozen,
                max_side=given[name].get("max_side"),
                threads=1,
                sky=reading.category(given[name]["sky"], "--sky") if "sky" in given[name] else None,
                normals=(given[name].get("variant") or "geometric")
                if reading.readout.normals
                else None,
                bench=rules(reading.card, tracks[name], source, given[name]) if rules else None,
            )
            runs.append(
                RunRequest(
                    image_options=options,
                    track=tracks[name],
                    overwrite=overwrite,
                    limit=limit,
                    image_ids=tuple(image_ids),
                    shard=shard,
                    images_per_file=given[name].get("images_per_file"),
                )
            )
        listener.total(sum(len(shard_images(one)) for one in runs))
        results = read_scenes(
            PassRequest(
                runs=tuple(runs),
                engine=engine,
                workers=workers or engine_cores(engine),
                limits=make_limits(time_limit_s, memory_limit_gib),
                fail_fast=fail_fast,
                started=started,
            ),
            progress=listener.row,
            notice=listener.notice,
            kept=listener.kept,
            trace=listener.trace,
        )
    named = track is not None and shard is None
    found = {
        name: Run(
            folder=folders[name],
            rows=result.rows,
            summary=result.summary,
            strangers=tuple(_strangers(place, tracks[name]) if named else ()),
        )
        for name, result in zip(tasks, results, strict=True)
    }
    return found[task] if isinstance(task, str) else ByTask(folder=top, results=found)


def _track_of_file(scene: Path) -> Track:
    image = TrackImage(id=1, file_name=scene.stem, size_wh=None, scene=".")
    return Track(images=(image,), vocabulary=None, sha256=None, made_for=None)


def _of_file(track: Track) -> Track:
    """The track of one scene file. UsageError for a track of several images."""
    if len(track.images) != 1:
        raise UsageError(
            "a scene file is one image",
            found=f"a track of {len(track.images)} images",
            expected="a folder of scenes, or a track of one image",
        )
    return replace(track, images=(replace(track.images[0], scene="."),))


def _distinct(tasks: Sequence[str]) -> list[str]:
    """The tasks. UsageError for none, or one that is named twice."""
    if not tasks or len(set(tasks)) < len(tasks):
        raise UsageError(
            "the tasks of one pass must be different",
            found=", ".join(tasks) or "none",
            expected="one or more tasks, each once",
        )
    return list(tasks)


def _strangers(scenes: Place, track: Track) -> list[Stranger]:
    """Scene folders that match no image of a track; for local SCENES only."""
    from legoworld.tracks.scene_names import strangers

    if not isinstance(scenes, Path):
        return []
    try:
        folders = {image.scene for image in make_folder_track(scenes).images}
    except CatalogError:
        return []  # no scene at all: every row of the run reports it
    known = [image.scene for image in track.images]
    return strangers(folders, known, [name for name in known if name not in folders])


def _refuse_output_in_a_scene(output: Place, scenes: Place) -> None:
    """Raise UsageError for a folder that is, or is inside, a scene folder of SCENES."""
    if not isinstance(output, Path) or not isinstance(scenes, Path):
        return
    top, below = scenes.resolve(), output.resolve()
    top = top.parent if top.is_file() else top
    around = [p for p in (below, *below.parents) if p.is_relative_to(top)]
    if any((p / name).is_file() for p in around for name in (BLEND, GLB)):
        raise UsageError(f"-o {output} is inside a scene folder; readout never writes there")


def default_output(scenes: str | Path, task: str | None = None) -> Path:
    """The run folder of a command without -o: legoworld-runs/<name of SCENES>-<task>.

    task: None for the folder of several runs, which has the name of SCENES alone.
    """
    place = parse_place(scenes)
    name = place.resolve().name if isinstance(place, Path) else PurePosixPath(place).name
    return Path("legoworld-runs") / "-".join([name or "scenes", *([task] if task else [])])
