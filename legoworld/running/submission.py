"""One submission of the bench: V's checks from the artefacts alone, its surface and its render."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from msgspec.structs import replace

from legoworld.cards import Card
from legoworld.errors import LegoWorldError, SceneInvalidError, UsageError, cause
from legoworld.files import as_unicode, atomic_path, sha256_of_file, sha256_of_text
from legoworld.readouts.family import ReadoutFamily
from legoworld.readouts.filled_view import facing_planes
from legoworld.readouts.joints import scene_joints
from legoworld.readouts.surface import (
    VisibleSurface,
    render_file,
    submitted_camera,
    surface_file,
    visible_surface,
    write_surface,
)
from legoworld.records.base import UNSET, as_json, canonical, to_record
from legoworld.records.render_card import RenderCard
from legoworld.records.run_file import BenchReading, RunSummary, ValidityCounts
from legoworld.records.run_rows import RunRow
from legoworld.records.submission import (
    CameraPlane,
    Check,
    Integrity,
    RenderFile,
    RenderNoise,
    SurfaceFile,
    Validity,
    WrittenFile,
)
from legoworld.scene.artefacts import check_glb, check_picture
from legoworld.scene.folder import BLEND, GLB, PICTURE, SceneFolder
from legoworld.scene.gltf.container import parse_glb
from legoworld.scene.open_scene import CardRender, OpenedScene, SceneFacts
from legoworld.scene.pictures import decoded_picture
from legoworld.scene.snapshot import Snapshot
from legoworld.tracks.track import Track

OK: Final = Check(ok=True)
#: Which check of V an error of reading scene.blend fails; any other one fails `scene_blend`.
_FAILS: Final = {
    "no_mesh": "geometry",
    "non_finite_geometry": "geometry",
    "no_camera": "camera",
    "unsupported_camera": "camera",
}


@dataclass(frozen=True, kw_only=True)
class BenchRules:
    """What a submission is read by.

    card: None without a render; noise: render two seeds; facts: look for what may be a picture;
    has_probes: whether images have private probes; disagreement: share of depth that Cycles'
    surface may be off the kernel's.
    """

    card: RenderCard | None
    noise: bool
    delta: int
    plane_max_tilt_deg: float
    plane_min_share: float
    thumbnail_wh: tuple[int, int]
    facts: bool = True
    has_probes: bool = False
    disagreement: float = 0.0

    def to_record(self) -> BenchReading:
        """What of it a run's configuration has on record."""
        return BenchReading(card=self.card, noise=self.noise)


def bench_rules(card: Card, *, render: bool, noise: bool, facts: bool = True) -> BenchRules:
    """The rules that readouts/bench.toml states; render: whether its render card is used."""
    width, height = card.value("integrity.texture_thumbnail_wh")
    return BenchRules(
        card=to_record(RenderCard, card.value("render")) if render else None,
        noise=noise and render,
        delta=card.value("scoring.delta"),
        plane_max_tilt_deg=card.value("integrity.plane_max_tilt_deg"),
        plane_min_share=card.value("integrity.plane_min_share"),
        thumbnail_wh=(width, height),
        facts=facts,
        has_probes="x" in card.values,
        disagreement=card.value("scoring.tolerance"),
    )


def validity_counts(rows: Sequence[RunRow]) -> ValidityCounts:
    """How many submissions are valid, and how many fail each check."""
    checked = [row.validity for row in rows if row.validity]
    return ValidityCounts(
        valid=sum(row.valid is True for row in rows),
        failed={
            name: sum(not getattr(validity, name).ok for validity in checked)
            for name in Validity.__struct_fields__
        },
    )


def artefact_checks(folder: SceneFolder) -> dict[str, Check]:
    """V's checks of scene.glb and final.png."""
    return {
        "scene_glb": _check_file(folder, GLB, check_glb),
        "final_png": _check_file(folder, PICTURE, check_picture),
    }


def blend_checks(error: LegoWorldError | None) -> dict[str, Check]:
    """V's checks of scene.blend: all passed, or the one that an error of reading it fails.

    A scene that did not open was not asked for the others: they fail with it.
    """
    checks: dict[str, Check] = dict.fromkeys(("scene_blend", "geometry", "camera"), OK)
    if error is not None:
        failed = _FAILS.get(error.code, "scene_blend")
        checks[failed] = failed_check(error)
        if failed == "scene_blend":
            unknown = Check(ok=False, found=f"{BLEND} was not read", expected=f"a {BLEND} to read")
            checks["geometry"] = checks["camera"] = unknown
    return checks


def failed_check(error: LegoWorldError) -> Check:
    """An error as a check that did not pass."""
    found = f"{error.what}: {error.found}" if error.found else error.what
    return Check(
        ok=False, found=found, expected=error.expected or None, next_step=error.next_step or None
    )


def with_validity(row: RunRow, checks: Mapping[str, Check]) -> RunRow:
    """The row with what V is decided by."""
    validity = Validity(**checks)
    return replace(row, valid=validity.valid, validity=validity)


def _check_file(folder: SceneFolder, name: str, check: Callable[[Path], None]) -> Check:
    path = folder.file(name)
    try:
        if not path.is_file():
            raise SceneInvalidError(
                f"the scene folder holds no {name}",
                found="no such file",
                expected=name,
                next_step=f"deliver {name} beside {BLEND}",
            )
        check(path)
    except LegoWorldError as error:
        return failed_check(error)
    except OSError as error:
        return Check(ok=False, found=cause(error), expected=f"a readable {name}")
    return OK


def read_surface(
    row: RunRow,
    snapshot: Snapshot,
    hfov_deg: float,
    scene: OpenedScene,
    rules: BenchRules,
    run: Path,
    threads: int,
) -> tuple[RunRow, VisibleSurface]:
    """Write the surface file; the row with camera, surface, integrity and joints.

    Raises the verdicts of a Blender process.
    """
    size_wh = row.size_wh
    assert size_wh is not None
    surface = visible_surface(snapshot, size_wh, hfov_deg, threads=threads)
    row = replace(row, camera=submitted_camera(snapshot, size_wh))
    name = surface_file(row.scene)
    if not rules.facts:
        write_surface(run / name, surface)
        return replace(row, surface=_surface_entry(run, name, surface)), surface
    facts = scene.facts(rules.thumbnail_wh)
    planes, plane = facing_planes(
        snapshot, surface, max_tilt_deg=rules.plane_max_tilt_deg, min_share=rules.plane_min_share
    )
    write_surface(run / name, surface, plane, facts.textures)
    images_of = facts.values["images_of"]
    shown = [
        CameraPlane(
            object=as_unicode(p.object),
            tilt_deg=p.tilt_deg,
            share=p.share,
            images=tuple(images_of.get(p.object, ())),
        )
        for p in planes
    ]
    joints, warnings = scene_joints(scene.folder, snapshot, facts.values["joints"])
    made = replace(
        row,
        surface=_surface_entry(run, name, surface),
        integrity=_integrity(facts, shown),
        joints=joints or UNSET,
        warnings=(*row.warnings, *warnings, *_unreadable_images(facts)),
    )
    return made, surface


def _surface_entry(run: Path, name: str, surface: VisibleSurface) -> SurfaceFile:
    return SurfaceFile(
        **field_values(describe_file(run, name)),
        raster_wh=surface.raster_wh,
        finite_px=surface.finite_px,
    )


def _unreadable_images(facts: SceneFacts) -> list[str]:
    """What a scene loses where it is opened: images that were not delivered with it."""
    return [
        f"image {image['name']!r} cannot be read and renders magenta: "
        f"{as_unicode(image['path'])}{', an absolute path' if image['absolute_path'] else ''}; "
        f"pack it into {BLEND}"
        for image in facts.values["images"]
        if image["size_wh"] == [0, 0] and image["users"] and not image["generated"]
    ]


def _integrity(facts: SceneFacts, planes: list[CameraPlane]) -> Integrity:
    values = {k: v for k, v in facts.values.items() if k != "images_of"}
    return to_record(Integrity, {**values, "planes": as_json(planes)})


def card_size(size_wh: tuple[int, int], longest_side_px: int) -> tuple[int, int]:
    """The render's size: the longer side is the card's, the other one rounded, at least 1."""
    scale = longest_side_px / max(size_wh)
    width, height = (max(1, round(side * scale)) for side in size_wh)
    return width, height


def read_render(
    row: RunRow, scene: OpenedScene, card: RenderCard, rules: BenchRules, run: Path, threads: int
) -> RunRow:
    """Write the render; the row with it. Raises the verdicts of a Blender process."""
    assert row.size_wh is not None
    size_wh = card_size(row.size_wh, card.longest_side_px)
    seeds = (card.seed, card.seed + 1)[: 2 if rules.noise else 1]
    pictures = [scene.render(card_render(card, size_wh, seed, threads)) for seed in seeds]
    file = write_render(run, render_file(row.scene), pictures[0], size_wh, card)
    noise = _noise(pictures, card, rules.delta) if rules.noise else None
    return replace(row, render=replace(file, noise=noise))


def write_render(
    run: Path, name: str, png: bytes, size_wh: tuple[int, int], card: RenderCard
) -> RenderFile:
    """Write a picture by the card into the run folder; how a row describes it."""
    with atomic_path(run / name) as temporary:
        temporary.write_bytes(png)
    return RenderFile(
        **field_values(describe_file(run, name)),
        size_wh=size_wh,
        card_sha256=sha256_of_text(canonical(card)),
        noise=None,
    )


def card_render(
    card: RenderCard, size_wh: tuple[int, int], seed: int, threads: int
) -> CardRender:  # fmt: skip
    """What Blender is asked for by a render card."""
    return CardRender(
        size_wh=size_wh, samples=card.samples, seed=seed, denoise=False, threads=threads
    )


def _noise(pictures: list[bytes], card: RenderCard, delta: int) -> RenderNoise:
    first, second = (decoded_picture(png, color=True) for png in pictures)
    assert first is not None
    assert second is not None
    largest = np.abs(first.astype(np.int16) - second.astype(np.int16)).max(axis=2)
    return RenderNoise(
        seeds=(card.seed, card.seed + 1),
        share_over_delta=float((largest > delta).mean()),
        mean_largest_difference=float(largest.mean()),
    )


def describe_file(run: Path, name: str) -> WrittenFile:
    """A file of the run folder as a row describes it."""
    path = run / name
    return WrittenFile(file=name, sha256=sha256_of_file(path), bytes=path.stat().st_size)


def field_values(record: WrittenFile) -> dict[str, Any]:
    """A record's fields, as arguments of a record that extends it."""
    return {name: getattr(record, name) for name in record.__struct_fields__}


def names_in_common(folder: SceneFolder, snapshot: Snapshot) -> str | None:
    """A warning where scene.glb has no object of scene.blend: it may be of another scene."""
    path = folder.file(GLB)
    nodes = parse_glb(path.read_bytes()).document.children("nodes")
    names = {node.text("name") for node in nodes if "mesh" in node}
    objects = {thing.name for thing in snapshot.objects}
    if not names or names & objects:
        return None
    return (
        f"{GLB} has none of the {len(objects)} object names of {BLEND} on its "
        f"{len(names)} meshes: it may be of another scene"
    )


def _sum_up(summary: RunSummary, rows: Sequence[RunRow], _ok: Sequence[RunRow]) -> RunSummary:
    return replace(summary, validity=validity_counts(rows))


def _rules(card: Card, track: Track, source: str, given: Mapping[str, bool]) -> BenchRules:
    _refuse_what_a_bench_lacks(track, source)
    render, noise = given.get("render", True), given.get("render_noise", False)
    rules = bench_rules(card, render=render, noise=noise)
    if rules.has_probes and any(image.probe is None for image in track.images):
        raise UsageError(
            "the track has no private probes",
            found="a public track",
            expected="DATASET/private/x.json",
            next_step="pass it with --track; `legoworld bench make` writes it",
        )
    return rules


def _refuse_what_a_bench_lacks(images: Track, source: str) -> None:
    """UsageError for a track without fields of view, and for another scene file."""
    blind = [image.file_name for image in images.images if image.hfov_deg is None]
    if blind:
        raise UsageError(
            "the images are no bench's: they have no field of view",
            found=f"{blind[0]} without hfov_deg",
            expected="DATASET/public/track.json",
            next_step="pass it with --track; `legoworld bench make` writes it",
        )
    if source != "blend":
        raise UsageError("a submission's surface is read from scene.blend: leave --source out")


READOUT: Final = ReadoutFamily(sum_up=_sum_up, rules=_rules)
