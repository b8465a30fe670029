"""What a run records of one image: its per_image row, its predictions, its scene."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from legoworld.errors import LegoWorldError
from legoworld.files import as_unicode, canonical_json, sha256_of_file, sha256_of_text
from legoworld.readouts.depth import depth_file, resampled_size, write_depth
from legoworld.readouts.tasks import Protocol
from legoworld.records.labels import LabelsFile
from legoworld.records.provenance import ProvenanceFile
from legoworld.remote import Place
from legoworld.running.submission import BenchRules
from legoworld.scene.cache import SnapshotCache
from legoworld.scene.folder import LABELS, SceneFolder, Source
from legoworld.scene.freeze import Hashes
from legoworld.scene.instances import Grouping, Instance, group
from legoworld.scene.labels import Labels, labels_in, resolve_labels
from legoworld.scene.reading import ReadScene, read_hashed_side_file
from legoworld.tracks.track import TrackImage
from legoworld.visibility.camera import aspect_differs
from legoworld.visibility.projection import Projection
from legoworld.visibility.view import View, unseen_reasons, view

#: Version of the rows of a readout; 2: `exported` names what each prediction is of.
ROW_SCHEMA: Final = 2
_UNLABELLED_SHOWN: Final = 20

Record = dict[str, Any]
"""One image's {"row": per_image row, "predictions": list, "scene": run.json entry or None}."""


@dataclass(frozen=True, kw_only=True)
class ImageOptions:
    """What every image of a run is read with. bench: of that task alone."""

    scenes: Place
    run: Path
    protocol: Protocol
    source: Source
    cache: SnapshotCache | None
    require_frozen: bool
    max_side: int | None
    threads: int
    bench: BenchRules | None = None


def row_of(image: TrackImage) -> dict[str, Any]:
    """What every row says of its image."""
    return {
        "image_id": image.id,
        "file_name": as_unicode(image.file_name),
        "scene": as_unicode(image.scene),
        "size_wh": list(image.size_wh) if image.size_wh else None,
    }


def verdict(row: dict[str, Any], error: LegoWorldError) -> Record:
    """The record of an image that was not read: `row_of` it, and why.

    `trace` is in it where the error has one: to be said, not to be kept.
    """
    row |= {"status": error.status, "code": error.code, "reason": str(error), "warnings": []}
    traced = {"trace": error.trace} if error.trace else {}
    return {"row": row, "predictions": [], "scene": None, **traced}


def verdict_instead(record: Record, error: LegoWorldError) -> Record:
    """A verdict in the place of a record that was made."""
    kept = ("image_id", "file_name", "scene", "size_wh")
    return verdict({key: record["row"][key] for key in kept}, error)


def predictions_sha256(predictions: list[dict[str, Any]]) -> str:
    """Hash of what was read, whatever number the image has in a track."""
    named = [{k: v for k, v in p.items() if k != "image_id"} for p in predictions]
    return sha256_of_text(canonical_json(named))


def labels_of(folder: SceneFolder, scene: ReadScene, protocol: Protocol) -> Labels:
    """The labels of a scene under a protocol. Raises LabelsInvalidError."""
    if protocol.vocabulary is None:
        return Labels(objects={}, collections={}, warnings=())
    found = read_hashed_side_file(folder, LABELS, LabelsFile, scene.files)
    return resolve_labels(
        scene.snapshot,
        labels_in(found),
        protocol.vocabulary,
        protocol.override_property,
    )


def record_of(
    row: dict[str, Any],
    image: TrackImage,
    folder: SceneFolder,
    scene: ReadScene,
    labels: Labels,
    provenance: ProvenanceFile | None,
    options: ImageOptions,
) -> Record:
    """The record of a scene that was read, into `row`; a depth file is written on the way."""
    snapshot = scene.snapshot
    grouping = group(snapshot, labels)
    full_size = image.size_wh or snapshot.render.size_wh
    size_wh = resampled_size(full_size, options.max_side)
    seen = view(snapshot, grouping, size_wh, threads=options.threads)
    warnings = [*scene.files.warnings, *snapshot.warnings, *labels.warnings, *grouping.warnings]
    if aspect_differs(snapshot.render, full_size):
        w, h = snapshot.render.size_wh
        warnings.append(
            f"the scene's own picture is {w}x{h}, the image {full_size[0]}x{full_size[1]}: "
            "another aspect, so the view is fitted by Blender's sensor rule"
        )
    hit = int(seen.area_px.sum())
    if not hit:
        warnings.append("the camera sees nothing: every pixel is without geometry")
    row |= {
        "status": "ok",
        "code": "ok",
        "reason": None,
        "size_wh": list(full_size),
        "rendered_wh": list(size_wh),
        "scene_size_wh": list(snapshot.render.size_wh),
        "aspect_differs": aspect_differs(snapshot.render, full_size),
        "frozen": scene.files.frozen,
        "files_sha256": scene.files.sha256,
        "snapshot_sha256": scene.snapshot_sha256,
        "geometry_px": hit,
    }
    predictions: list[dict[str, Any]] = []
    if options.protocol.task.predict is None:
        row["depth"] = _write_depth_file(image, seen, options)
    else:
        exports = options.protocol.task.predict(image.id, grouping.instances, seen)
        predictions = [prediction for prediction, _ in exports]
        row["n_predictions"] = len(predictions)
        row["exported"] = [_exported(instance) for _, instance in exports]
        row["predictions_sha256"] = predictions_sha256(predictions)
        row |= _instance_report(scene, grouping, seen, options)
    row["warnings"] = warnings
    return {
        "row": row,
        "predictions": predictions,
        "scene": scene_entry(folder, scene, seen.projection, provenance),
    }


def _write_depth_file(image: TrackImage, seen: View, options: ImageOptions) -> dict[str, Any]:
    name = depth_file(as_unicode(image.scene if image.scene != "." else image.file_name))
    path = options.run / name
    write_depth(path, seen.buffers.depth_z_m, seen.projection)
    return {
        "file": name,
        "space": "depth",
        "unit": "m",
        "bytes": path.stat().st_size,
        "sha256": sha256_of_file(path),
        "finite_px": int(np.isfinite(seen.buffers.depth_z_m).sum()),
    }


def _instance_report(
    scene: ReadScene, grouping: Grouping, seen: View, options: ImageOptions
) -> dict[str, Any]:
    """What became of every label: exported, unseen and why, or outside the vocabulary."""
    vocabulary = options.protocol.vocabulary
    assert vocabulary is not None
    labelled = [i for i in grouping.instances if i.category is not None]
    unlabelled = [i for i in grouping.instances if i.category is None]
    unexported: list[dict[str, str]] = []
    unseen = [i.id for i in labelled if seen.area_px[i.id] == 0]
    if unseen:
        reasons = unseen_reasons(
            scene.snapshot, grouping, seen, among=unseen, threads=options.threads
        )
        unexported = [
            {"name": i.name, "category": i.category.name, "reason": reasons[i.id]}
            for i in labelled
            if i.category is not None and i.id in reasons
        ]
    for name, text in grouping.unseen_owners:
        match = vocabulary.match(text)
        category = match.name if match else text
        unexported.append({"name": name, "category": category, "reason": "not_rendered"})
    nested = [i for i in grouping.nested if seen.area_px[i] > 0]
    return {
        "instances": {
            "total": len(grouping.instances),
            "labelled": len(labelled),
            "visible_labelled": sum(bool(seen.area_px[i.id]) for i in labelled),
            "visible_unlabelled": sum(bool(seen.area_px[i.id]) for i in unlabelled),
        },
        "unlabelled": _largest_unlabelled(unlabelled, seen),
        "unlabelled_px": int(sum(seen.area_px[i.id] for i in unlabelled)),
        "nested": {"instances": len(nested), "px": int(sum(seen.area_px[i] for i in nested))},
        "matched": _matched_names(labelled),
        "unmatched": [
            {"label": text, "count": count, "nearest": vocabulary.nearest(text)}
            for text, count in grouping.outside_vocabulary.items()
        ],
        "unexported": sorted(unexported, key=lambda u: (u["name"], u["reason"])),
    }


def _exported(instance: Instance) -> dict[str, Any]:
    """What a prediction is of: the label's owner, and the objects whose surfaces it has."""
    assert instance.category is not None
    return {
        "name": instance.name,
        "category": instance.category.name,
        "objects": list(instance.objects),
    }


def _largest_unlabelled(unlabelled: list[Instance], seen: View) -> list[dict[str, Any]]:
    """The visible unlabelled instances by area: what an author may have forgotten to label."""
    visible = [i for i in unlabelled if seen.area_px[i.id] > 0]
    visible.sort(key=lambda i: (-int(seen.area_px[i.id]), i.id))
    return [
        {"name": i.name, "area_px": int(seen.area_px[i.id])} for i in visible[:_UNLABELLED_SHOWN]
    ]


def _matched_names(labelled: list[Instance]) -> dict[str, str]:
    """Labels that are not written as the vocabulary writes them, and what they were taken for."""
    return dict(
        sorted(
            {
                i.label_text: i.category.name
                for i in labelled
                if i.category and i.label_text and i.label_text != i.category.name
            }.items()
        )
    )


def scene_entry(
    folder: SceneFolder,
    scene: ReadScene,
    projection: Projection,
    provenance: ProvenanceFile | None,
) -> dict[str, Any]:
    """What run.json records of a scene. projection: what its buffers were made with."""
    snapshot = scene.snapshot
    return {
        "scene": as_unicode(folder.name),
        "frozen": scene.files.frozen,
        "files": sha256_by_name(scene.files.artefacts),
        "dependencies": sha256_by_name(scene.files.dependencies),
        "snapshot_sha256": scene.snapshot_sha256,
        "camera": dict(vars(snapshot.camera)),
        "projection": dict(vars(projection)),
        "render": dict(vars(snapshot.render)),
        "provenance": "not recorded" if provenance is None else provenance,
    }


def sha256_by_name(files: Hashes) -> dict[str, str | None]:
    """Hashes as run.json records them."""
    return {name: found.sha256 if found else None for name, found in sorted(files.items())}
