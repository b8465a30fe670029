"""A run's record of one image: its per_image row, its predictions, its scene."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Set
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from msgspec.structs import replace

from legoworld.errors import LegoWorldError
from legoworld.files import Json, as_unicode
from legoworld.readouts.family import MANY, AnsweredImage, Protocol
from legoworld.records.base import UNSET
from legoworld.records.folders.prediction_files import predictions_sha256
from legoworld.records.predictions import Prediction
from legoworld.records.run_file import (
    CameraOfScene,
    ImageRecord,
    ImageSource,
    ProjectionOfView,
    RenderOfScene,
)
from legoworld.records.run_rows import (
    Exported,
    InstanceCounts,
    Nested,
    RunRow,
    Unexported,
    Unlabelled,
    Unmatched,
)
from legoworld.remote import Place
from legoworld.running.scene_views import SceneViews
from legoworld.running.submission import BenchRules
from legoworld.scene.cache import SnapshotCache
from legoworld.scene.folder import SceneFolder, Source
from legoworld.scene.freeze import Hashes
from legoworld.scene.instances import Grouping, Instance, group
from legoworld.scene.labels import Labels
from legoworld.scene.read_scene import ReadScene
from legoworld.tracks.track import TrackImage
from legoworld.tracks.vocabulary import Category, Vocabulary
from legoworld.visibility.camera import aspect_differs
from legoworld.visibility.normals import Variant
from legoworld.visibility.projection import Projection
from legoworld.visibility.view import View, unseen_reasons

#: Version of the rows of a readout; 2: `exported` names the instance of each prediction.
ROW_SCHEMA: Final = 2
_UNLABELLED_SHOWN: Final = 20


@dataclass(frozen=True, kw_only=True)
class ImageOptions:
    """What every image of a run is read with.

    normals: drawn too; bench: of that task alone; sky: of label maps.
    """

    scenes: Place
    run: Path
    protocol: Protocol
    source: Source
    cache: SnapshotCache | None
    require_frozen: bool
    max_side: int | None
    threads: int
    normals: Variant | None = None
    bench: BenchRules | None = None
    sky: Category | None = None

    def rendered_size(self, size_wh: tuple[int, int]) -> tuple[int, int]:
        """The size to render at: `size_wh`, reduced so that no side exceeds `max_side`."""
        longest = max(size_wh)
        if self.max_side is None or longest <= self.max_side:
            return size_wh
        width, height = (max(1, round(side * self.max_side / longest)) for side in size_wh)
        return width, height


@dataclass(frozen=True, kw_only=True)
class SceneOfImage:
    """An image's scene as it was read, with its side files.

    labels: under the run's protocol; views: what was drawn of the scene so far.
    """

    folder: SceneFolder
    scene: ReadScene
    labels: Labels
    provenance: Mapping[str, Json] | None
    views: SceneViews


def failed_record(image: TrackImage, error: LegoWorldError) -> ImageRecord:
    """The record of an image without a result, and why it has none."""
    return record_failure(initial_row(image), error)


def verdict_instead(record: ImageRecord, error: LegoWorldError) -> ImageRecord:
    """A failure in place of an existing record."""
    row = record.row
    kept = RunRow(
        image_id=row.image_id,
        file_name=row.file_name,
        scene=row.scene,
        size_wh=row.size_wh,
        status=row.status,
    )
    return record_failure(kept, error)


def initial_row(image: TrackImage) -> RunRow:
    """The row of an image before anything is known of its result."""
    return RunRow(
        image_id=image.id,
        file_name=as_unicode(image.file_name),
        scene=as_unicode(image.scene),
        size_wh=image.size_wh,
        status="ok",
        code="ok",
    )


def record_failure(row: RunRow, error: LegoWorldError) -> ImageRecord:
    """The record of an image without a result, with what its row says of it besides."""
    verdict = replace(row, status=error.status, code=error.code, reason=str(error))
    return ImageRecord(row=verdict, trace=error.trace or UNSET)


def make_record(
    image: TrackImage,
    of_image: SceneOfImage,
    options: ImageOptions,
    say: Callable[[str], None] = lambda _text: None,
) -> ImageRecord:
    """The record of a scene that was read; a depth file is written on the way.

    say: called with what a large scene takes, before its answer is made.
    """
    scene, labels = of_image.scene, of_image.labels
    snapshot = scene.snapshot
    grouping = group(snapshot, labels)
    full_size = image.size_wh or snapshot.render.size_wh
    rendered_wh = options.rendered_size(full_size)
    readout, vocabulary = options.protocol.readout, options.protocol.vocabulary
    seen = of_image.views.view(
        snapshot, grouping, rendered_wh, exact=readout.needs_instances, threads=options.threads
    )
    row = replace(
        initial_row(image),
        size_wh=full_size,
        rendered_wh=rendered_wh,
        scene_size_wh=snapshot.render.size_wh,
        aspect_differs=aspect_differs(snapshot.render, full_size),
        frozen=scene.files.frozen,
        files_sha256=scene.files.sha256,
        snapshot_sha256=scene.snapshot_sha256,
        geometry_px=int(seen.area_px.sum()),
        warnings=(
            *scene.files.warnings,
            *snapshot.warnings,
            *labels.warnings,
            *grouping.warnings,
            *_view_warnings(scene, full_size, seen),
        ),
    )
    predictions: tuple[Prediction, ...] = ()
    answered = AnsweredImage(
        image_id=image.id,
        name=as_unicode(image.scene if image.scene != "." else image.file_name),
        run=options.run,
        instances=grouping.instances,
        view=seen,
        normals=options.normals,
        threads=options.threads,
        vocabulary=vocabulary,
        sky=options.sky,
    )
    if readout.cost is not None and len(grouping.instances) >= MANY:
        expected = readout.cost(options.protocol.card.reads, answered)
        if expected is not None:
            say(f"{answered.name}: {expected}")
    exports = []
    if readout.exports is not None:
        exports = readout.exports(options.protocol.card.reads, answered)
    if vocabulary is not None:
        answers = {instance.id for _, instance in exports}
        row = _instance_report(row, scene, grouping, seen, vocabulary, answers, options.threads)
    if readout.exports is not None:
        predictions = tuple(prediction for prediction, _ in exports)
        row = replace(
            row,
            n_predictions=len(predictions),
            exported=tuple(_export_row(instance) for _, instance in exports),
            predictions_sha256=predictions_sha256(predictions),
        )
    if readout.write is not None:
        row = readout.write(row, answered)
    source = describe_source(of_image.folder, scene, seen.projection, of_image.provenance)
    return ImageRecord(row=row, predictions=predictions, scene=source)


def _view_warnings(scene: ReadScene, full_size: tuple[int, int], view: View) -> list[str]:
    render, warnings = scene.snapshot.render, []
    if aspect_differs(render, full_size):
        w, h = render.size_wh
        warnings.append(
            f"the scene's own picture is {w}x{h}, the image {full_size[0]}x{full_size[1]}: "
            "another aspect, so the view is fitted by Blender's sensor rule"
        )
    if not view.area_px.any():
        warnings.append("the camera sees nothing: every pixel is without geometry")
    return warnings


def _instance_report(
    row: RunRow,
    scene: ReadScene,
    grouping: Grouping,
    view: View,
    vocabulary: Vocabulary,
    answers: Set[int],
    threads: int,
) -> RunRow:
    """The row with the outcome of every label: exported, unseen and why, or outside.

    answers: the ids of the instances that have an answer; hidden ones may be among them.
    """
    labelled = [i for i in grouping.instances if i.category is not None]
    unlabelled = [i for i in grouping.instances if i.category is None]
    nested = [i for i in grouping.enclosing_instance if view.area_px[i] > 0]
    return replace(
        row,
        instances=InstanceCounts(
            total=len(grouping.instances),
            labelled=len(labelled),
            visible_labelled=sum(bool(view.area_px[i.id]) for i in labelled),
            visible_unlabelled=sum(bool(view.area_px[i.id]) for i in unlabelled),
        ),
        unlabelled=_largest_unlabelled(unlabelled, view),
        unlabelled_px=int(sum(view.area_px[i.id] for i in unlabelled)),
        nested=Nested(instances=len(nested), px=int(sum(view.area_px[i] for i in nested))),
        matched=_matched_names(labelled),
        unmatched=tuple(
            Unmatched(label=text, count=count, nearest=tuple(vocabulary.nearest(text)))
            for text, count in grouping.outside_vocabulary.items()
        ),
        unexported=_list_unexported(
            scene, grouping, [i for i in labelled if i.id not in answers], view, vocabulary, threads
        ),
    )


def _list_unexported(
    scene: ReadScene,
    grouping: Grouping,
    labelled: list[Instance],
    view: View,
    vocabulary: Vocabulary,
    threads: int,
) -> tuple[Unexported, ...]:
    """Those of the labelled instances that have no pixel, by name."""
    unexported: list[Unexported] = []
    unseen = [i.id for i in labelled if view.area_px[i.id] == 0]
    if unseen:
        reasons = unseen_reasons(scene.snapshot, grouping, view, among=unseen, threads=threads)
        unexported = [
            Unexported(name=i.name, category=i.category.name, reason=reasons[i.id])
            for i in labelled
            if i.category is not None and i.id in reasons
        ]
    for name, text in grouping.unseen_owners:
        match = vocabulary.match(text)
        category = match.name if match else text
        unexported.append(Unexported(name=name, category=category, reason="not_rendered"))
    return tuple(sorted(unexported, key=lambda u: (u.name, u.reason)))


def _export_row(instance: Instance) -> Exported:
    assert instance.category is not None
    return Exported(
        name=instance.name, category=instance.category.name, objects=tuple(instance.objects)
    )


def _largest_unlabelled(unlabelled: list[Instance], view: View) -> tuple[Unlabelled, ...]:
    """The largest visible unlabelled instances: candidates for missing labels."""
    visible = [i for i in unlabelled if view.area_px[i.id] > 0]
    visible.sort(key=lambda i: (-int(view.area_px[i.id]), i.id))
    return tuple(
        Unlabelled(name=i.name, area_px=int(view.area_px[i.id]))
        for i in visible[:_UNLABELLED_SHOWN]
    )


def _matched_names(labelled: list[Instance]) -> dict[str, str]:
    """Labels spelled differently from the vocabulary, with the matched categories."""
    return {
        i.label_text: i.category.name
        for i in labelled
        if i.category and i.label_text and i.label_text != i.category.name
    }


def describe_source(
    folder: SceneFolder,
    scene: ReadScene,
    projection: Projection,
    provenance: Mapping[str, Json] | None,
) -> ImageSource:
    """A scene's entry in run.json. projection: that of its buffers."""
    snapshot = scene.snapshot
    return ImageSource(
        scene=as_unicode(folder.name),
        frozen=scene.files.frozen,
        files=sha256_by_name(scene.files.artefacts),
        dependencies=sha256_by_name(scene.files.dependencies),
        snapshot_sha256=scene.snapshot_sha256,
        camera=CameraOfScene(**vars(snapshot.camera)),
        projection=ProjectionOfView(**vars(projection)),
        render=RenderOfScene(**vars(snapshot.render)),
        provenance="not recorded" if provenance is None else dict(provenance),
    )


def sha256_by_name(files: Hashes) -> dict[str, str | None]:
    """Hashes as run.json records them."""
    return {name: hashed.sha256 if hashed else None for name, hashed in files.items()}
