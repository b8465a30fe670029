"""One image of a bench run: a submission's folder to a record, or to the verdict that says why."""

from __future__ import annotations

from msgspec.structs import replace

from legoworld.errors import LegoWorldError
from legoworld.files import as_unicode
from legoworld.pluralize import plural
from legoworld.readouts.filled_view import filled_view
from legoworld.readouts.surface import VisibleSurface
from legoworld.records.run_file import ImageRecord
from legoworld.records.run_rows import RunRow
from legoworld.records.scene_folder import ProvenanceFile
from legoworld.running.image_record import (
    ImageOptions,
    describe_source,
    initial_row,
    record_failure,
)
from legoworld.running.probed_submission import read_probe
from legoworld.running.shared_scene import SharedScene
from legoworld.running.submission import (
    BenchRules,
    artefact_checks,
    blend_checks,
    names_in_common,
    read_render,
    read_surface,
    with_validity,
)
from legoworld.scene.blender_process import BlenderProcess
from legoworld.scene.folder import GLB, PICTURE, PROVENANCE, SceneFolder
from legoworld.scene.open_scene import OpenedScene
from legoworld.scene.read_scene import ReadScene, read_hashed_side_file
from legoworld.tracks.track import TrackImage


def read_submission(
    image: TrackImage,
    asked: SharedScene,
    options: ImageOptions,
    rules: BenchRules,
    blender: BlenderProcess,
) -> ImageRecord:
    """Read one submission out. An error becomes its verdict; what was made before it is kept.

    A scene that loses its Blender process is asked for once more, in a fresh one.
    """
    row, folder = initial_row(image), asked.folder
    checks = artefact_checks(folder)
    try:
        scene = asked.read(attempts=2)
    except LegoWorldError as error:
        return record_failure(with_validity(row, {**checks, **blend_checks(error)}), error)
    row = with_validity(row, {**checks, **blend_checks(None)})
    opened = OpenedScene(folder, scene.files, blender, options.cache)
    assert image.hfov_deg is not None
    try:
        row, surface = read_surface(
            row, scene.snapshot, image.hfov_deg, opened, rules, options.run, options.threads
        )
        if rules.card is not None:
            row = read_render(row, opened, rules.card, rules, options.run, options.threads)
        if rules.has_probes and image.probe is not None:
            row = read_probe(
                row,
                scene.snapshot,
                surface,
                image.hfov_deg,
                image.probe,
                opened,
                rules,
                options.run,
                options.threads,
            )
        provenance = read_hashed_side_file(folder, PROVENANCE, ProvenanceFile, scene.files)
    except LegoWorldError as error:
        return record_failure(row, error)
    row = replace(
        row,
        frozen=scene.files.frozen,
        files_sha256=scene.files.sha256,
        snapshot_sha256=scene.snapshot_sha256,
        warnings=tuple(_warnings(row, folder, scene, surface, options.threads)),
    )
    stored = provenance.value if provenance else None
    source = describe_source(folder, scene, surface.projection, stored)
    return ImageRecord(row=row, scene=source)


def _warnings(
    row: RunRow, folder: SceneFolder, scene: ReadScene, surface: VisibleSurface, threads: int
) -> list[str]:
    warnings = [*scene.files.warnings, *scene.snapshot.warnings, *row.warnings]
    if scene.snapshot.camera.type == "ORTHO":
        warnings.append("the camera is orthographic: R takes its pose and not its projection")
    if not surface.finite_px:
        warnings.append("the camera sees nothing: every pixel is without geometry")
    filled = _filled_view_warning(scene, surface, threads)
    warnings += [filled] if filled else []
    validity = row.validity
    assert validity
    if validity.scene_glb.ok:
        other = names_in_common(folder, scene.snapshot)
        warnings += [other] if other else []
    else:
        warnings.append(f"not valid: {GLB}: {validity.scene_glb.found}")
    if not validity.final_png.ok:
        warnings.append(f"not valid: {PICTURE}: {validity.final_png.found}")
    return warnings


def _filled_view_warning(scene: ReadScene, surface: VisibleSurface, threads: int) -> str | None:
    """A warning where the camera stands inside of something; V and the scores stay as they are."""
    found = filled_view(scene.snapshot, surface, threads=threads)
    if found is None:
        return None
    hidden = plural(found.hidden, "other object", "other objects")
    return (
        f"the camera's view is filled by one object: '{as_unicode(found.object)}' covers "
        f"{100 * found.share:.0f} % of the hits at {found.depth_m:.2g} m and hides {hidden}, "
        f"{found.farther:.1f} times as far: move the camera out of it"
    )
