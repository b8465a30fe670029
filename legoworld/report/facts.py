"""A run's record of one scene: camera, files, unlabelled objects, unmatched labels."""

from __future__ import annotations

from legoworld.records.base import UNSET
from legoworld.records.report_page import FactTable
from legoworld.records.run_file import CameraOfScene, ImageSource
from legoworld.records.run_rows import RunRow

Pairs = list[tuple[str, str]]


def run_facts(row: RunRow, source: ImageSource | None) -> Pairs:
    """Verdict, camera and hashes as name and text."""
    facts: Pairs = [("verdict", row.status)]
    if row.code not in ("", row.status):
        facts.append(("code", row.code))
    if row.instances:
        n = row.instances
        facts.append(
            (
                "objects",
                f"{n.total}: {n.visible_labelled} of {n.labelled} with a category are "
                f"visible, {n.visible_unlabelled} without one",
            )
        )
    if row.rendered_wh:
        w, h = row.rendered_wh
        hit = row.geometry_px
        share = f", geometry in {hit / (w * h):.1%}" if isinstance(hit, int) else ""
        facts.append(("view", f"{w}x{h}{share}"))
    if row.scene_size_wh:
        w, h = row.scene_size_wh
        differs = " (another aspect than the photo)" if row.aspect_differs else ""
        facts.append(("the scene's own picture", f"{w}x{h}{differs}"))
    if source is not None:
        facts += _camera(source) + _files(source)
    return facts


def run_tables(row: RunRow) -> list[FactTable]:
    """Objects without a category, labels outside the vocabulary, labels without a pixel."""
    tables = []
    area = row.rendered_wh[0] * row.rendered_wh[1] if row.rendered_wh else 0
    if row.unlabelled:
        listed = [
            [u.name, str(u.area_px), f"{u.area_px / area:.1%}" if area else "-"]
            for u in row.unlabelled
        ]
        title = "Objects without a category, the largest first"
        tables.append(_table(title, ["object", "pixels", "of the view"], listed))
    if row.unmatched:
        listed = [[u.label, str(u.count), ", ".join(u.nearest) or "-"] for u in row.unmatched]
        head = ["label", "objects", "nearest names"]
        tables.append(_table("Labels outside the vocabulary", head, listed))
    if row.unexported:
        listed = [[u.name, u.category, u.reason] for u in row.unexported]
        head = ["object", "category", "reason"]
        tables.append(_table("Labelled objects without a pixel", head, listed))
    if row.matched:
        listed = [[label, name] for label, name in sorted(row.matched.items())]
        head = ["label", "taken for"]
        tables.append(_table("Labels matched by synonym", head, listed))
    return tables


def _table(title: str, head: list[str], rows: list[list[str]]) -> FactTable:
    return FactTable(title=title, head=tuple(head), rows=tuple(map(tuple, rows)))


def _camera(source: ImageSource) -> Pairs:
    facts: Pairs = []
    if source.camera:
        camera = source.camera
        shift = f", shift {camera.shift_x:.3g}, {camera.shift_y:.3g}"
        clip = f", clip {camera.clip_start:.3g} to {camera.clip_end:.4g} m"
        text = f"{camera.name}: {_lens(camera)}, fit {camera.sensor_fit.lower()}{shift}{clip}"
        facts.append(("camera", text))
        origin = ", ".join(f"{row[3]:.3f}" for row in camera.world_from_camera[:3])
        facts.append(("camera at", f"({origin}) m"))
    if source.projection:
        p = source.projection
        text = f"fx {p.fx:.2f}, fy {p.fy:.2f}, cx {p.cx:.2f}, cy {p.cy:.2f}"
        facts.append(("intrinsics, px", text))
    return facts


def _lens(camera: CameraOfScene) -> str:
    if camera.type == "ORTHO":
        return f"orthographic, scale {camera.ortho_scale:g}"
    return f"{camera.lens_mm:.4g} mm on a {camera.sensor_width_mm:g} mm sensor"


def _files(source: ImageSource) -> Pairs:
    provenance = None if source.provenance is UNSET else source.provenance
    scene, frozen = source.scene or None, source.frozen or None
    facts: Pairs = [("scene", str(scene)), ("frozen", str(frozen))]
    for name, sha256 in sorted((source.files or {}).items()):
        facts.append((name, f"sha256 {sha256}" if sha256 else "none"))
    if isinstance(provenance, dict):
        facts += [(f"provenance: {k}", str(v)) for k, v in sorted(provenance.items())]
    elif provenance is not None:
        facts.append(("provenance", provenance))
    return facts
