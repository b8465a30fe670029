"""One image of a run: from its scene folder to a record, or to a status with a reason."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

from legoworld.errors import LegoWorldError
from legoworld.readouts.protocol import Protocol
from legoworld.records.folders.prediction_files import has_its_results
from legoworld.records.labels import LabelsFile
from legoworld.records.provenance import ProvenanceFile
from legoworld.records.run_file import ImageRecord, ImageSource
from legoworld.remote import PlaceError, child, fetch_folder
from legoworld.running.bench_image import Submission, read_submission
from legoworld.running.image_record import (
    ImageOptions,
    SceneOfImage,
    failed_record,
    record_of,
    sha256_by_name,
    verdict_instead,
)
from legoworld.running.wall import judged
from legoworld.scene.blender_process import BlenderProcess, Limits
from legoworld.scene.cache import files_in
from legoworld.scene.folder import BLEND, GLB, LABELS, PROVENANCE, SIMULATIONS, SceneFolder
from legoworld.scene.freeze import FrozenFiles, Hashes, hashed_dependencies
from legoworld.scene.labels import Labels, labels_in, resolve_labels
from legoworld.scene.outside import leaves_scenes
from legoworld.scene.reading import ReadScene, checked_scene, read_hashed_side_file, read_scene
from legoworld.tracks.track import TrackImage
from legoworld.workers.engines import machine_lost
from legoworld.workers.scratch import scratch_folder


class FileNotSharedError(LegoWorldError):
    """A file of an image was written to a folder that is not the run folder here."""

    code = "run_folder_not_shared"


class SceneReader:
    """Reads images with its own Blender process.

    started: processes that are already running; one of them is used, and closed by its owner.
    """

    def __init__(
        self, options: ImageOptions, limits: Limits, started: list[BlenderProcess] | None = None
    ) -> None:
        self._options = options
        self._lent = bool(started)
        self._blender = started.pop() if started else BlenderProcess(limits)

    def do(self, image: TrackImage) -> ImageRecord:
        """The record of one image; see `read_image`."""
        try:
            with _at_hand(image, self._options) as options:
                return read_image(image, options, self._blender)
        except PlaceError as error:
            return failed_record(image, error)

    def abort(self) -> None:
        """End the Blender process during a running `do`."""
        self._blender.abort()

    def close(self) -> None:
        """End the Blender process. The owner of a borrowed process waits for its end."""
        if self._lent:
            self._blender.abort()
        else:
            self._blender.close()


def read_image(image: TrackImage, options: ImageOptions, blender: BlenderProcess) -> ImageRecord:
    """Read one image out. Failures of its scene become the row's status and reason.

    Raises the errors of this machine; see `judged`.
    """
    try:
        folder, files = _checked(image, options)
        if options.bench is not None:
            submission = Submission(image=image, folder=folder, files=files)
            return read_submission(submission, options, options.bench, blender)
        scene = read_scene(
            folder, source=options.source, blender=blender, cache=options.cache, files=files
        )
        return record_of(image, _with_side_files(folder, scene, options.protocol), options)
    except Exception as error:  # noqa: BLE001  a verdict of this scene, or raised again
        written = [options.run, *([options.cache.folder] if options.cache else [])]
        return failed_record(image, judged(error, written))


def lost_record(image: TrackImage, what: str) -> ImageRecord:
    """The record of an image whose machine was lost at every attempt."""
    return failed_record(image, machine_lost(what))


def arrived(record: ImageRecord, options: ImageOptions) -> ImageRecord:
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


def still_valid(record: ImageRecord, image: TrackImage, options: ImageOptions) -> bool:
    """Whether reading the image again would give the stored record."""
    if record.row.status != "ok" or record.scene is None:
        return False
    try:
        with _at_hand(image, options) as local:
            return _unchanged(record.scene, image, local) and has_its_results(record, local.run)
    except (LegoWorldError, OSError, ValueError):
        return False  # reading it again tells what is wrong


def _unchanged(scene: ImageSource, image: TrackImage, options: ImageOptions) -> bool:
    """Whether the scene's files are those that it was read from."""
    folder, now = _checked(image, options)
    if sha256_by_name(now.artefacts) != scene.files or now.frozen != scene.frozen:
        return False
    recorded = scene.dependencies or {}
    return sha256_by_name(_dependencies_now(folder, now, recorded, options)) == recorded


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
        names = sorted({*recorded, *files_in(folder.path, [SIMULATIONS])})
    return hashed_dependencies(folder, names, now, read_by=read_by).dependencies


@contextmanager
def _at_hand(image: TrackImage, options: ImageOptions) -> Iterator[ImageOptions]:
    """The options with the image's scene folder on this machine, fetched if it is at a URL."""
    if isinstance(options.scenes, Path):
        yield options
        return
    with scratch_folder("legoworld-scene-") as folder:
        scenes = folder / "scenes"
        fetch_folder(child(options.scenes, image.scene), scenes / image.scene)
        yield replace(options, scenes=scenes)


def _checked(image: TrackImage, options: ImageOptions) -> tuple[SceneFolder, FrozenFiles]:
    assert isinstance(options.scenes, Path)
    return checked_scene(options.scenes, image.scene, require_frozen=options.require_frozen)


def _with_side_files(folder: SceneFolder, scene: ReadScene, protocol: Protocol) -> SceneOfImage:
    """A scene with its labels under a protocol. Raises what is wrong with its side files."""
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
    )
