"""One image of a run: its scene folder to a record, or to the verdict that says why not."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from legoworld.errors import LegoWorldError, SceneInvalidError
from legoworld.files import canonical_json, sha256_of_file, sha256_of_text
from legoworld.places import Place, PlaceError, child, fetch_folder
from legoworld.readouts.depth import depth_file, resampled_size, write_depth
from legoworld.readouts.tasks import Protocol
from legoworld.running.engines import machine_lost
from legoworld.scene.blender_process import BlenderProcess, Limits
from legoworld.scene.cache import SnapshotCache
from legoworld.scene.folder import BLEND, LABELS, PROVENANCE, SceneFolder, Source, find_scene
from legoworld.scene.freeze import (
    FrozenFiles,
    Hashes,
    checked_artefacts,
    hash_files,
    hashed_dependencies,
)
from legoworld.scene.instances import Grouping, Instance, group
from legoworld.scene.labels import Labels, labels_in, resolve_labels
from legoworld.scene.outside import leaves_scenes
from legoworld.scene.reading import ReadScene, read_hashed_side_file, read_scene
from legoworld.scene.scratch import scratch_folder
from legoworld.scene.side_files import provenance_in
from legoworld.track import TrackImage
from legoworld.visibility.camera import aspect_differs
from legoworld.visibility.view import View, unseen_reasons, view

_UNLABELLED_SHOWN = 20

Record = dict[str, Any]
"""One image's {"row": per_image row, "predictions": list, "scene": run.json entry or None}."""


class DepthNotSharedError(LegoWorldError):
    """A depth file was written where the run folder is not seen."""

    code = "run_folder_not_shared"


@dataclass(frozen=True, kw_only=True)
class ImageOptions:
    """What every image of a run is read with."""

    scenes: Place
    run: Path
    protocol: Protocol
    source: Source
    cache: SnapshotCache | None
    require_frozen: bool
    max_side: int | None
    threads: int


class SceneReader:
    """Reads image after image with one Blender process of its own."""

    def __init__(self, options: ImageOptions, limits: Limits) -> None:
        self._options = options
        self._blender = BlenderProcess(limits)

    def do(self, image: TrackImage) -> Record:
        """One image's record; see `read_image`."""
        try:
            with _at_hand(image, self._options) as options:
                return read_image(image, options, self._blender)
        except PlaceError as error:
            return failed_record(image, error)

    def abort(self) -> None:
        """End the Blender process under a running `do`."""
        self._blender.abort()

    def close(self) -> None:
        """End the Blender process."""
        self._blender.close()


def read_image(image: TrackImage, options: ImageOptions, blender: BlenderProcess) -> Record:
    """Read one image out. Every LegoWorldError becomes the row's status and reason."""
    row = _row_of(image)
    try:
        folder, files = _found(image, options)
        scene = read_scene(
            folder, source=options.source, blender=blender, cache=options.cache, files=files
        )
        labels = _labels(folder, scene, options.protocol)
        provenance = provenance_in(read_hashed_side_file(folder, PROVENANCE, scene.files))
        return _record(row, image, folder, scene, labels, provenance, options)
    except LegoWorldError as error:
        return _verdict(row, error)


def lost_record(image: TrackImage, what: str) -> Record:
    """The record of an image whose machine was lost each time it was tried."""
    return failed_record(image, machine_lost(what))


def failed_record(image: TrackImage, error: LegoWorldError) -> Record:
    """The record of an image that nothing was read of."""
    return _verdict(_row_of(image), error)


def arrived(record: Record, options: ImageOptions) -> Record:
    """The record, or a verdict where another machine wrote a depth file that is not seen here."""
    row = record["row"]
    if "depth" not in row or (options.run / row["depth"]["file"]).is_file():
        return record
    error = DepthNotSharedError(
        "the depth file is not in the run folder",
        found="the machine that wrote it has another folder under this path",
        expected="a run folder that all machines see",
        next_step="put -o on a shared file system, or divide the track with --shard",
    )
    kept = {key: row[key] for key in ("image_id", "file_name", "scene", "size_wh")}
    return _verdict(kept, error)


def _row_of(image: TrackImage) -> dict[str, Any]:
    return {
        "image_id": image.id,
        "file_name": image.file_name,
        "scene": image.scene,
        "size_wh": list(image.size_wh) if image.size_wh else None,
    }


def _verdict(row: dict[str, Any], error: LegoWorldError) -> Record:
    row |= {"status": error.status, "code": error.code, "reason": str(error), "warnings": []}
    return {"row": row, "predictions": [], "scene": None}


def still_valid(record: Record, image: TrackImage, options: ImageOptions) -> bool:
    """Whether a stored record is what reading the image again would give."""
    if record["row"]["status"] != "ok" or record["scene"] is None:
        return False
    try:
        with _at_hand(image, options) as local:
            return _unchanged(record, image, local)
    except LegoWorldError:
        return False


def _unchanged(record: Record, image: TrackImage, options: ImageOptions) -> bool:
    row, scene = record["row"], record["scene"]
    folder, now = _found(image, options)
    if _hashes(now.artefacts) != scene["files"] or now.frozen != scene["frozen"]:
        return False
    if _hashes(_dependencies_now(folder, now, scene, options)) != scene["dependencies"]:
        return False
    if "depth" not in row:
        return bool(row["predictions_sha256"] == _predictions_sha256(record["predictions"]))
    path: Path = options.run / row["depth"]["file"]
    return path.is_file() and sha256_of_file(path) == row["depth"]["sha256"]


def _dependencies_now(
    folder: SceneFolder, now: FrozenFiles, scene: dict[str, Any], options: ImageOptions
) -> Hashes:
    """The content now of what a scene was read with; empty where it is not known where that is."""
    if not any(leaves_scenes(name, folder) for name in scene["dependencies"]):
        return hash_files(folder.path, scene["dependencies"])
    blend = now.artefacts.get(BLEND)
    names = options.cache.dependencies(blend.sha256) if options.cache and blend else None
    return hashed_dependencies(folder, names or (), now, read_by=BLEND).dependencies


@contextmanager
def _at_hand(image: TrackImage, options: ImageOptions) -> Iterator[ImageOptions]:
    """The options with the image's scene folder on this machine, fetched when it is at a URL."""
    if isinstance(options.scenes, Path):
        yield options
        return
    with scratch_folder("legoworld-scene-") as folder:
        scenes = folder / "scenes"
        fetch_folder(child(options.scenes, image.scene), scenes / image.scene)
        yield replace(options, scenes=scenes)


def _found(image: TrackImage, options: ImageOptions) -> tuple[SceneFolder, FrozenFiles]:
    """An image's scene folder and its files; one that cannot be looked at is its own verdict."""
    assert isinstance(options.scenes, Path)
    try:
        folder = find_scene(options.scenes, image.scene)
        return folder, checked_artefacts(folder, require_frozen=options.require_frozen)
    except OSError as error:
        raise SceneInvalidError(
            f"the scene folder {image.scene!r} cannot be looked at",
            found=error.strerror or type(error).__name__,
            expected="a folder and files that may be read",
            next_step="correct its name or its permissions",
        ) from error


def _predictions_sha256(predictions: list[dict[str, Any]]) -> str:
    """Hash of what was read, whatever number the image has in a track."""
    named = [{k: v for k, v in p.items() if k != "image_id"} for p in predictions]
    return sha256_of_text(canonical_json(named))


def _labels(folder: SceneFolder, scene: ReadScene, protocol: Protocol) -> Labels:
    if protocol.vocabulary is None:
        return Labels(objects={}, collections={}, warnings=())
    document = read_hashed_side_file(folder, LABELS, scene.files)
    return resolve_labels(
        scene.snapshot,
        labels_in(document.value) if document else (),
        protocol.vocabulary,
        protocol.override_property,
    )


def _record(
    row: dict[str, Any],
    image: TrackImage,
    folder: SceneFolder,
    scene: ReadScene,
    labels: Labels,
    provenance: Any,
    options: ImageOptions,
) -> Record:
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
        predictions = options.protocol.task.predict(image.id, grouping.instances, seen)
        row["n_predictions"] = len(predictions)
        row["predictions_sha256"] = _predictions_sha256(predictions)
        row |= _instance_report(scene, grouping, seen, options)
    row["warnings"] = warnings
    return {
        "row": row,
        "predictions": predictions,
        "scene": _scene_entry(folder, scene, seen, provenance),
    }


def _write_depth_file(image: TrackImage, seen: View, options: ImageOptions) -> dict[str, Any]:
    name = depth_file(image.scene if image.scene != "." else image.file_name)
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


def _scene_entry(
    folder: SceneFolder, scene: ReadScene, seen: View, provenance: Any
) -> dict[str, Any]:
    """What run.json records of a scene."""
    snapshot = scene.snapshot
    return {
        "scene": folder.name,
        "frozen": scene.files.frozen,
        "files": _hashes(scene.files.artefacts),
        "dependencies": _hashes(scene.files.dependencies),
        "snapshot_sha256": scene.snapshot_sha256,
        "camera": dict(vars(snapshot.camera)),
        "projection": dict(vars(seen.projection)),
        "render": dict(vars(snapshot.render)),
        "provenance": provenance,
    }


def _hashes(files: Any) -> dict[str, str | None]:
    return {name: found.sha256 if found else None for name, found in sorted(files.items())}
