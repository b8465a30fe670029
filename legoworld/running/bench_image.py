"""One image of a bench run: a submission's folder to a record, or to the verdict that says why."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from legoworld.errors import LegoWorldError
from legoworld.readouts.surface import VisibleSurface
from legoworld.records.provenance import ProvenanceFile
from legoworld.running.image_record import ImageOptions, Record, row_of, scene_entry, verdict
from legoworld.running.submission import (
    BenchRules,
    artefact_checks,
    blend_checks,
    names_in_common,
    read_render,
    read_surface,
    validity_of,
)
from legoworld.scene.blender_process import BlenderProcess
from legoworld.scene.folder import GLB, PROVENANCE, SceneFolder
from legoworld.scene.freeze import FrozenFiles
from legoworld.scene.opened import OpenedScene, twice
from legoworld.scene.reading import ReadScene, read_hashed_side_file, read_scene
from legoworld.tracks.track import TrackImage


@dataclass(frozen=True, kw_only=True)
class Submission:
    """A submission's folder and the hashes of its files."""

    image: TrackImage
    folder: SceneFolder
    files: FrozenFiles


def read_submission(
    submission: Submission, options: ImageOptions, blender: BlenderProcess
) -> Record:
    """Read one submission out. An error becomes its verdict; what was made before it is kept.

    A scene that loses its Blender process is asked for once more, in a fresh one.
    """
    rules = options.bench
    assert rules is not None
    row = row_of(submission.image)
    checks = artefact_checks(submission.folder)
    try:
        scene = twice(lambda: _read(submission, options, blender))
    except LegoWorldError as error:
        return _judged(row, error, validity_of({**checks, **blend_checks(error)}))
    made: dict[str, Any] = validity_of({**checks, **blend_checks(None)})
    opened = OpenedScene(submission.folder, scene.files, blender, options.cache)
    known = row | made
    try:
        surface = _surface(known, submission.image, scene, opened, rules, options)
        if rules.card is not None:
            read_render(known, opened, rules.card, rules, options.run, options.threads)
        provenance = read_hashed_side_file(
            submission.folder, PROVENANCE, ProvenanceFile, scene.files
        )
    except LegoWorldError as error:
        return _judged(row, error, {k: v for k, v in known.items() if k not in row})
    known |= {
        "status": "ok",
        "code": "ok",
        "reason": None,
        "frozen": scene.files.frozen,
        "files_sha256": scene.files.sha256,
        "snapshot_sha256": scene.snapshot_sha256,
        "warnings": _warnings(known, submission.folder, scene, surface),
    }
    stored = provenance.value if provenance else None
    entry = scene_entry(submission.folder, scene, surface.projection, stored)
    return {"row": known, "predictions": [], "scene": entry}


def _read(submission: Submission, options: ImageOptions, blender: BlenderProcess) -> ReadScene:
    return read_scene(
        submission.folder,
        source=options.source,
        blender=blender,
        cache=options.cache,
        files=submission.files,
    )


def _surface(
    row: dict[str, Any],
    image: TrackImage,
    scene: ReadScene,
    opened: OpenedScene,
    rules: BenchRules,
    options: ImageOptions,
) -> VisibleSurface:
    assert image.hfov_deg is not None
    return read_surface(
        row, scene.snapshot, image.hfov_deg, opened, rules, options.run, options.threads
    )


def _judged(row: dict[str, Any], error: LegoWorldError, made: dict[str, Any]) -> Record:
    """The verdict of a submission, with what was found and made of it before."""
    record = verdict(dict(row), error)
    record["row"] |= made
    return record


def _warnings(
    row: dict[str, Any], folder: SceneFolder, scene: ReadScene, surface: VisibleSurface
) -> list[str]:
    warnings = [*scene.files.warnings, *scene.snapshot.warnings]
    if scene.snapshot.camera.type == "ORTHO":
        warnings.append("the camera is orthographic: R takes its pose and not its projection")
    if not surface.finite_px:
        warnings.append("the camera sees nothing: every pixel is without geometry")
    if row["validity"]["scene_glb"]["ok"]:
        other = names_in_common(folder, scene.snapshot)
        warnings += [other] if other else []
    else:
        warnings.append(f"not valid: {GLB}: {row['validity']['scene_glb']['found']}")
    if not row["validity"]["final_png"]["ok"]:
        warnings.append(f"not valid: final.png: {row['validity']['final_png']['found']}")
    return warnings
