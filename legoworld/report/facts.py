"""What a run recorded of one scene: camera, files, objects without a category, foreign labels."""

from __future__ import annotations

from typing import Any

from legoworld.records.folders.evaluation_reading import Row
from legoworld.records.report_page import FactTable

Pairs = list[tuple[str, str]]


def run_facts(row: Row, scene: dict[str, Any] | None) -> Pairs:
    """Verdict, camera and hashes as name and text."""
    found: Pairs = [("verdict", str(row["status"]))]
    if row.get("code") not in (None, row["status"]):
        found.append(("code", str(row["code"])))
    if "instances" in row:
        n = row["instances"]
        found.append(
            (
                "objects",
                f"{n['total']}: {n['visible_labelled']} of {n['labelled']} with a category are "
                f"visible, {n['visible_unlabelled']} without one",
            )
        )
    if row.get("rendered_wh"):
        w, h = row["rendered_wh"]
        share = f", geometry in {row['geometry_px'] / (w * h):.1%}" if "geometry_px" in row else ""
        found.append(("view", f"{w}x{h}{share}"))
    if row.get("scene_size_wh"):
        w, h = row["scene_size_wh"]
        differs = " (another aspect than the photo)" if row.get("aspect_differs") else ""
        found.append(("the scene's own picture", f"{w}x{h}{differs}"))
    if scene is not None:
        found += _camera(scene) + _files(scene)
    return found


def run_tables(row: Row) -> list[FactTable]:
    """Objects without a category, labels outside the vocabulary, labels without a pixel."""
    tables = []
    area = _area(row)
    if row.get("unlabelled"):
        listed = [
            [u["name"], str(u["area_px"]), f"{u['area_px'] / area:.1%}" if area else "-"]
            for u in row["unlabelled"]
        ]
        title = "Objects without a category, the largest first"
        tables.append(_table(title, ["object", "pixels", "of the view"], listed))
    if row.get("unmatched"):
        listed = [
            [u["label"], str(u["count"]), ", ".join(u.get("nearest") or ()) or "-"]
            for u in row["unmatched"]
        ]
        head = ["label", "objects", "nearest names"]
        tables.append(_table("Labels outside the vocabulary", head, listed))
    if row.get("unexported"):
        listed = [[u["name"], u["category"], u["reason"]] for u in row["unexported"]]
        head = ["object", "category", "reason"]
        tables.append(_table("Labelled objects without a pixel", head, listed))
    if row.get("matched"):
        listed = [[label, name] for label, name in sorted(row["matched"].items())]
        head = ["label", "taken for"]
        tables.append(_table("Labels matched by synonym", head, listed))
    return tables


def _table(title: str, head: list[str], rows: list[list[str]]) -> FactTable:
    return FactTable(title=title, head=tuple(head), rows=tuple(map(tuple, rows)))


def _camera(scene: dict[str, Any]) -> Pairs:
    camera, projection = scene.get("camera"), scene.get("projection")
    found: Pairs = []
    if camera:
        lens = (
            f"orthographic, scale {camera['ortho_scale']:g}"
            if camera["type"] == "ORTHO"
            else f"{camera['lens_mm']:.4g} mm on a {camera['sensor_width_mm']:g} mm sensor"
        )
        shift = f", shift {camera['shift_x']:.3g}, {camera['shift_y']:.3g}"
        clip = f", clip {camera['clip_start']:.3g} to {camera['clip_end']:.4g} m"
        text = f"{camera['name']}: {lens}, fit {camera['sensor_fit'].lower()}{shift}{clip}"
        found.append(("camera", text))
        origin = ", ".join(f"{row[3]:.3f}" for row in camera["world_from_camera"][:3])
        found.append(("camera at", f"({origin}) m"))
    if projection:
        keys = ("fx", "fy", "cx", "cy")
        text = ", ".join(f"{key} {projection[key]:.2f}" for key in keys)
        found.append(("intrinsics, px", text))
    return found


def _files(scene: dict[str, Any]) -> Pairs:
    found: Pairs = [("scene", str(scene.get("scene"))), ("frozen", str(scene.get("frozen")))]
    for name, sha256 in sorted((scene.get("files") or {}).items()):
        found.append((name, f"sha256 {sha256}" if sha256 else "none"))
    provenance = scene.get("provenance")
    if isinstance(provenance, dict):
        found += [(f"provenance: {k}", str(v)) for k, v in sorted(provenance.items())]
    else:
        found.append(("provenance", str(provenance)))
    return found


def _area(row: Row) -> int:
    size = row.get("rendered_wh")
    return int(size[0]) * int(size[1]) if size else 0
