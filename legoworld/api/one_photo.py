"""Score one scene against one photo and its ground truth: every step from program to findings."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

from legoworld.errors import UsageError
from legoworld.evaluation.family import EvaluationRequest, load_evaluation_family
from legoworld.evaluation.run import read_run
from legoworld.readouts.family import Protocol, protocol
from legoworld.readouts.pictures import read_photo
from legoworld.records.evaluation import Summary
from legoworld.records.report_page import Advice
from legoworld.records.run_rows import RunRow
from legoworld.records.scene_folder import ExecutionFile
from legoworld.report.document import page_document
from legoworld.report.page_file import write_page
from legoworld.report.sources import read_sources
from legoworld.running.image_record import ImageOptions
from legoworld.running.inspection import label, look, open_scene, write_inspection
from legoworld.running.readout_run import RunRequest
from legoworld.running.scene_pass import PassRequest, read_scenes
from legoworld.scene.blender_process import BlenderProcess, Limits
from legoworld.scene.cache import SnapshotCache
from legoworld.scene.folder import Source, file_source, scene_at
from legoworld.scene.programs.execution import execute
from legoworld.track_making.family import load_track_family as track_source
from legoworld.track_making.make_track import make_track
from legoworld.tracks.track import Track, load_track, photo_names

Say = Callable[[str], None]
#: Number of tie orders; one image has no bootstrap.
_DRAWS: Final = 200


@dataclass(frozen=True, kw_only=True)
class PhotoRequest:
    """A program (.py) or scene folder to score against a photo's ground truth.

    image: the photo's id or file name in the ground truth; None finds it by the photo's name.
    """

    program_or_scene: Path
    photo: Path
    truth: Path
    task: str
    image: str | None
    source: Source
    cache: SnapshotCache | None
    limits: Limits


@dataclass(frozen=True, kw_only=True)
class PhotoScore:
    """row: per_image row of the readout; summary, advice: None and () if nothing was read.

    execution: how the program ended, None for a scene folder; overlay: None for an unread scene.
    """

    row: RunRow
    summary: Summary | None
    advice: tuple[Advice, ...]
    execution: ExecutionFile | None
    overlay: Path | None


def score_photo(request: PhotoRequest, output: Path, say: Say, trace: Say) -> PhotoScore:
    """Execute a program, read the scene out, evaluate it and list what to fix.

    Below `output`: scene/ (for a program), track.json, run/, eval/, look/ and report.html. Raises
    UsageError for a photo that the ground truth does not list, or the program's own error.
    """
    output.mkdir(parents=True, exist_ok=True)
    track = _track(request, output / "track.json")
    execution, scene = None, request.program_or_scene
    if scene.suffix == ".py":
        say(f"running {scene.name}")
        scene = output / "scene"
        execution = execute(request.program_or_scene, scene, limits=request.limits, picture=False)
    request = replace(request, source=file_source(scene, request.source))
    reading = protocol(request.task, track.vocabulary)
    say("reading the scene")
    row = _read(request, scene, track, reading, output / "run", say, trace)
    if row.status != "ok":
        return PhotoScore(row=row, summary=None, advice=(), execution=execution, overlay=None)
    _look(request, scene, reading, output / "look")
    say("evaluating")
    summary = _evaluate(request, output / "run", output / "eval")
    page = page_document(read_sources([output / "eval"]), request.photo.parent)
    write_page(page, output / "report.html", commands=[])
    return PhotoScore(
        row=row,
        summary=summary,
        advice=page.views[0].sides[0].advice if page.views else (),
        execution=execution,
        overlay=output / "look" / "overlay.png",
    )


def _track(request: PhotoRequest, path: Path) -> Track:
    """The track of the single photo, whose scene folder is SCENES itself."""
    make_track(
        request.task, request.truth, path, sample=None, seed=0, chosen=[_image_name(request)]
    )
    track = load_track(path)
    (image,) = track.images
    height, width = read_photo(request.photo).shape[:2]
    if image.size_wh != (width, height):
        raise UsageError(
            f"{request.photo.name} is not the photo of image {image.id}",
            found=f"{width}x{height}",
            expected="x".join(map(str, image.size_wh or ())),
            next_step="pass the dataset's own photo, or name the image with --image",
        )
    return replace(track, images=(replace(image, scene="."),))


def _image_name(request: PhotoRequest) -> str:
    """The photo's file name in the ground truth, with the folders used there."""
    if request.image is not None:
        return request.image
    images = track_source(request.task).source(request.task, request.truth, {}).images
    parts = request.photo.resolve().parts
    tails = ["/".join(parts[-n:]) for n in range(len(parts), 0, -1)]
    names = {name for image in images for name in photo_names(image)}
    known = next((tail for tail in tails if tail in names), None)
    if known is None:
        raise UsageError(
            "the ground truth lists no photo of this name",
            found=request.photo.name,
            expected=f"one of {len(names)} file names"
            + (f", such as {min(names)}" if names else ""),
            next_step="use the dataset's file name for the photo, or pass --image ID",
        )
    return known


def _read(
    request: PhotoRequest,
    scene: Path,
    track: Track,
    reading: Protocol,
    run: Path,
    say: Say,
    trace: Say,
) -> RunRow:
    (result,) = read_scenes(
        PassRequest(
            runs=(
                RunRequest(
                    image_options=ImageOptions(
                        scenes=scene.absolute(),
                        run=run.absolute(),
                        protocol=reading,
                        source=request.source,
                        cache=request.cache,
                        require_frozen=False,
                        max_side=None,
                        threads=1,
                    ),
                    track=track,
                    overwrite=True,
                    limit=None,
                    image_ids=(),
                    shard=None,
                    images_per_file=None,
                ),
            ),
            engine="local",
            workers=1,
            limits=request.limits,
            fail_fast=False,
        ),
        progress=lambda _row: None,
        notice=say,
        trace=trace,
    )
    return result.rows[0]


def _look(request: PhotoRequest, scene: Path, reading: Protocol, folder: Path) -> None:
    """The outlines over the photo, from the snapshot that the readout cached."""
    height, width = read_photo(request.photo).shape[:2]
    found, source = scene_at(scene, request.source)
    with BlenderProcess(request.limits) as blender:
        opened = open_scene(
            found,
            source=source,
            blender=blender,
            cache=request.cache,
        )
    labelled = label(opened, reading.vocabulary, reading.override_property)
    inspection = look(labelled, size_wh=(width, height))
    write_inspection(inspection, folder, request.photo)


def _evaluate(request: PhotoRequest, run: Path, output: Path) -> Summary:
    return load_evaluation_family(request.task).evaluate(
        EvaluationRequest(
            run=read_run(run), truth=request.truth, output=output, draws=_DRAWS, overwrite=True
        )
    )
