"""One scene folder of a pass: to the record of each of its images, or a status with a reason."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

from legoworld.errors import LegoWorldError
from legoworld.readouts.family import Protocol
from legoworld.records.folders.prediction_files import has_its_results
from legoworld.records.run_file import ImageRecord, ImageSource
from legoworld.records.scene_folder import LabelsFile, ProvenanceFile
from legoworld.remote import PlaceError, child, fetch_folder
from legoworld.running.error_boundary import classify_error
from legoworld.running.image_record import (
    ImageOptions,
    SceneOfImage,
    failed_record,
    make_record,
    sha256_by_name,
    verdict_instead,
)
from legoworld.running.reconstruction_image import read_submission
from legoworld.running.shared_scene import HashedScene, SharedScene
from legoworld.scene.blender_process import BlenderProcess, Limits
from legoworld.scene.cache import files_in
from legoworld.scene.folder import BLEND, GLB, LABELS, PROVENANCE, SceneFolder, leaves_scenes
from legoworld.scene.freeze import FrozenFiles, Hashes, hashed_dependencies
from legoworld.scene.labels import Labels, labels_in, resolve_labels
from legoworld.scene.read_scene import read_hashed_side_file
from legoworld.tracks.track import TrackImage
from legoworld.visibility.normals import Variant
from legoworld.workers.engines import machine_lost
from legoworld.workers.scratch import scratch_folder


class FileNotSharedError(LegoWorldError):
    """A file of an image was written to a folder that is not the run folder here."""

    code = "run_folder_not_shared"


@dataclass(frozen=True, kw_only=True)
class Question:
    """One image of one run of a pass. run: the run's number in the pass."""

    run: int
    image: TrackImage


#: What is asked of one scene folder.
Questions = tuple[Question, ...]
#: The record of each question, with its run's number, in any order.
Answers = list[tuple[int, ImageRecord]]


class SceneReader:
    """Reads scene folders with its own Blender process.

    options: of each run of the pass; scenes, source, cache, require_frozen and threads are those of
    all. started: processes that are already running; one of them is used, and closed by its owner.
    say: called with what a large scene takes, before it is read out.
    """

    def __init__(
        self,
        options: Sequence[ImageOptions],
        limits: Limits,
        started: list[BlenderProcess] | None = None,
        say: Callable[[str], None] = lambda _text: None,
    ) -> None:
        self._options = tuple(options)
        self._say = say
        self._lent = bool(started)
        self._blender = started.pop() if started else BlenderProcess(limits)

    def do(self, questions: Questions) -> Answers:
        """The records of what is asked of one scene folder; see `read_image`."""
        try:
            with at_hand(questions[0].image.scene, self._options) as options:
                return self._answers(questions, options)
        except PlaceError as error:
            return [(asked.run, failed_record(asked.image, error)) for asked in questions]

    def _answers(self, questions: Questions, options: Sequence[ImageOptions]) -> Answers:
        """A draw that no task needs anew is made for the first that needs its instances."""
        scene = SharedScene(
            questions[0].image.scene,
            options[0],
            self._blender,
            normals=_wanted_normals([options[asked.run] for asked in questions]),
        )
        exact = [options[asked.run].protocol.readout.needs_instances for asked in questions]
        ordered = sorted(zip(questions, exact, strict=True), key=lambda pair: not pair[1])
        return [
            (
                asked.run,
                read_image(asked.image, options[asked.run], self._blender, scene, self._say),
            )
            for asked, _ in ordered
        ]

    def abort(self) -> None:
        """End the Blender process during a running `do`."""
        self._blender.abort()

    def close(self) -> None:
        """End the Blender process. The owner of a borrowed process waits for its end."""
        if self._lent:
            self._blender.abort()
        else:
            self._blender.close()


def read_image(
    image: TrackImage,
    options: ImageOptions,
    blender: BlenderProcess,
    shared: SharedScene | None = None,
    say: Callable[[str], None] = lambda _text: None,
) -> ImageRecord:
    """Read one image out. Failures of its scene become the row's status and reason.

    shared: its scene folder, where other images were read of it; say: see `make_record`. Raises the
    errors of this machine; see `classify_error`.
    """
    scene = shared or SharedScene(image.scene, options, blender, normals=options.normals)
    try:
        if options.bench is not None:
            return read_submission(image, scene, options, options.bench, blender)
        return make_record(image, _with_side_files(scene, options.protocol), options, say)
    except Exception as error:  # noqa: BLE001  a verdict of this scene, or raised again
        written = [options.run, *([options.cache.folder] if options.cache else [])]
        return failed_record(image, classify_error(error, written))


def lost_records(questions: Questions, what: str) -> Answers:
    """The records of a scene folder whose machine was lost at every attempt."""
    return [(asked.run, failed_record(asked.image, machine_lost(what))) for asked in questions]


def check_arrived(record: ImageRecord, options: ImageOptions) -> ImageRecord:
    """The record, or a verdict where another machine wrote a depth file that is not seen here."""
    if all((options.run / file.file).is_file() for file in record.row.files):
        return record
    error = FileNotSharedError(
        "a file of the image is not in the run folder",
        found="the machine that wrote it has another folder under this path",
        expected="a run folder that all machines see",
        next_step="put -o on a shared file system, or divide the track with --shard",
    )
    return verdict_instead(record, error)


def still_valid(record: ImageRecord, scene: HashedScene, options: ImageOptions) -> bool:
    """Whether reading the image again would give the stored record."""
    if record.row.status != "ok" or record.scene is None:
        return False
    try:
        return _is_unchanged(record.scene, scene, options) and has_its_results(record, options.run)
    except (LegoWorldError, OSError, ValueError):
        return False  # reading it again tells what is wrong


def _is_unchanged(source: ImageSource, scene: HashedScene, options: ImageOptions) -> bool:
    """Whether the scene's files are those that it was read from."""
    if sha256_by_name(scene.files.artefacts) != source.files or scene.files.frozen != source.frozen:
        return False
    recorded = source.dependencies or {}
    now = _dependencies_now(scene.folder, scene.files, recorded, options)
    return sha256_by_name(now) == recorded


def _dependencies_now(
    folder: SceneFolder, now: FrozenFiles, recorded: Collection[str], options: ImageOptions
) -> Hashes:
    """Current hashes of the files a scene was read with; empty if their location is unknown."""
    read_by = BLEND if options.source == "blend" else GLB
    file = now.artefacts.get(read_by)
    names = options.cache.dependencies(file.sha256, folder.path) if options.cache and file else None
    if names is None:
        if any(leaves_scenes(name, folder) for name in recorded):
            return {}
        names = sorted({*recorded, *files_in(folder.path, [folder.simulations])})
    return hashed_dependencies(folder, names, now, read_by=read_by).dependencies


@contextmanager
def at_hand(scene: str, options: Sequence[ImageOptions]) -> Iterator[Sequence[ImageOptions]]:
    """The options with a scene folder on this machine, fetched if it is at a URL."""
    scenes = options[0].scenes
    if isinstance(scenes, Path):
        yield options
        return
    with scratch_folder("legoworld-scene-") as folder:
        fetch_folder(child(scenes, scene), folder / "scenes" / scene)
        yield [replace(one, scenes=folder / "scenes") for one in options]


def _with_side_files(asked: SharedScene, protocol: Protocol) -> SceneOfImage:
    """A scene with its labels under a protocol. Raises what is wrong with it or its side files."""
    folder, scene = asked.folder, asked.read()
    labels = Labels(objects={}, collections={}, warnings=())
    if protocol.vocabulary is not None:
        outside = labels_in(read_hashed_side_file(folder, LABELS, LabelsFile, scene.files))
        labels = resolve_labels(
            scene.snapshot, outside, protocol.vocabulary, protocol.override_property
        )
    provenance = read_hashed_side_file(folder, PROVENANCE, ProvenanceFile, scene.files)
    return SceneOfImage(
        folder=folder,
        scene=scene,
        labels=labels,
        provenance=provenance.value if provenance else None,
        views=asked.views,
    )


def _wanted_normals(options: Sequence[ImageOptions]) -> Variant | None:
    """Those that a task of the pass asks for; None where none does."""
    for one in options:
        if one.normals is not None:
            return one.normals
    return None
