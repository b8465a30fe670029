"""Perturbed copies of bench cases: what the bench says of each, and what the plugin says.

A copy is the reference's snapshot with placements or the camera changed, so that hundreds need no
Blender. The two sides never meet: R is of the private half, residuals of evidence alone, which is
outlines as a person draws them (polygons, corners off by a pixel or two) and a relative depth (an
affine disparity, 3 % noise) of the reference picture.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from legoworld.evaluation.reconstruction.dataset import BenchCase, BenchDataset
from legoworld.evaluation.reconstruction.geometry import PointMaps, geometry_score
from legoworld.evaluation.reconstruction.protocol import Choices, bench_protocol
from legoworld.evaluation.reconstruction.reference import Reference, load_reference
from legoworld.evaluation.reconstruction.submission import Surface
from legoworld.plugin.entities import Entities
from legoworld.plugin.evidence import Evidence, read_evidence
from legoworld.plugin.make_evidence import UserEvidence, make_evidence
from legoworld.plugin.measure import measure, surface_view
from legoworld.plugin.state import LiveScene, read_live
from legoworld.readouts.filled_view import with_surfaces
from legoworld.readouts.surface import visible_surface
from legoworld.records import plugin_requirements as kinds
from legoworld.records.plugin_requirements import Report, Requirement
from legoworld.scene.blender_process import BlenderProcess
from legoworld.scene.snapshot import Snapshot

F64 = NDArray[np.float64]
PROTOCOL = bench_protocol()
SMALLEST_PX = 64
#: A residual counts in tolerances, at most this many; what cannot be measured counts as many.
MOST = 10.0


@dataclass(frozen=True, kw_only=True)
class StudyCase:
    """One case. names: its labelled objects that the picture shows."""

    name: str
    case: BenchCase
    dataset: BenchDataset
    reference: Reference
    scene: LiveScene
    evidence: Evidence
    names: tuple[str, ...]
    requirements: tuple[Requirement, ...]

    def surfaces(self, name: str) -> NDArray[np.bool_]:
        """(S,) bool: an object's surfaces."""
        found = Entities(self.scene.snapshot).surfaces(name)
        assert found is not None
        return found

    def middle(self, name: str) -> F64:
        """The middle of an object's world box, scene units."""
        points = Entities(self.scene.snapshot).points_m(name)
        scale = self.scene.snapshot.render.unit_scale
        return np.asarray((points.min(axis=0) + points.max(axis=0)) / 2 / scale)


def read_case(
    dataset: BenchDataset, case: BenchCase, blend: Path, folder: Path, blender: BlenderProcess
) -> StudyCase:
    """Read a case's own scene and make its evidence in an empty folder."""
    scene = read_live(blend, blender)
    seen = surface_view(scene, case.size_wh)
    entities, snapshot = Entities(scene.snapshot), scene.snapshot
    masks: dict[str, NDArray[np.bool_]] = {}
    for item in snapshot.objects:
        surfaces = entities.surfaces(item.name) if item.properties else None
        if surfaces is not None:
            mask = np.asarray(np.append(surfaces, False)[seen.instance], bool)
            if np.count_nonzero(mask) >= SMALLEST_PX:
                masks[item.name] = mask
    random = np.random.default_rng(0)
    outlines = [
        {"name": name, "polygons": polygons}
        for name, mask in sorted(masks.items())
        if (polygons := _drawn(mask, random))
    ]
    folder.mkdir(parents=True)
    (folder / "outlines.json").write_text(json.dumps({"regions": outlines}))
    z = np.asarray(seen.depth_z_m, np.float64)
    noise = cv2.resize(random.normal(0, 0.03, (9, 16)), case.size_wh)
    np.save(folder / "disparity.npy", (3.0 / z + 0.2) * (1 + noise))
    given = UserEvidence(
        photo=dataset.folders.reference(case),
        regions=[folder / "outlines.json"],
        image_id=None,
        vocabulary=None,
        depth=folder / "disparity.npy",
        depth_space="disparity",
        hfov_deg=case.image.hfov_deg,
    )
    make_evidence(given, folder)
    names = tuple(str(outline["name"]) for outline in outlines)
    return StudyCase(
        name=case.stem,
        case=case,
        dataset=dataset,
        reference=load_reference(dataset.folders, case, PROTOCOL.depth_limit_m),
        scene=scene,
        evidence=read_evidence(folder),
        names=names,
        requirements=(
            *required_of_each(names),
            kinds.DepthOrder(matched=tuple((name, name) for name in names)),
        ),
    )


def pictured(study: StudyCase) -> StudyCase:
    """With the requirements of single objects alone."""
    single = tuple(r for r in study.requirements if not isinstance(r, kinds.DepthOrder))
    return replace(study, requirements=single)


def _drawn(mask: NDArray[np.bool_], random: np.random.Generator) -> list[Any]:
    """A mask's outer outlines as coarse polygons, each corner off by about 1.5 px."""
    found, _ = cv2.findContours(mask.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    polygons = []
    for contour in found:
        corners = cv2.approxPolyDP(contour, 2.0, True)[:, 0].astype(np.float64) + 0.5
        if len(corners) >= 3 and cv2.contourArea(contour) >= SMALLEST_PX / 4:
            polygons.append((corners + random.normal(0, 1.5, corners.shape)).tolist())
    return polygons


def required_of_each(names: Sequence[str]) -> list[Requirement]:
    """The five requirements of the picture of each object, whose region has its name."""
    matched = tuple((name, name) for name in names)
    made: list[Requirement] = []
    for name in names:
        made += [
            kinds.Centroid(entity=name, region=name),
            kinds.Extent(entity=name, region=name),
            kinds.Overlap(entity=name, region=name),
            kinds.Boundary(entity=name, region=name),
            kinds.Depth(entity=name, matched=matched),
        ]
    return made


def r_of(study: StudyCase, snapshot: Snapshot) -> float:
    """R of a copy, as `evaluate` computes it."""
    image = study.case.image
    shown = visible_surface(snapshot, study.case.size_wh, image.hfov_deg, own_intrinsics=False)
    surface = Surface(
        depth_z_m=shown.depth_z_m,
        own_depth_z_m=None,
        own_raster=None,
        plane=None,
        textures=np.zeros((0, 1, 1, 3), np.uint8),
    )
    score = geometry_score(
        study.dataset.folders,
        study.case,
        study.reference,
        surface,
        PointMaps(reference=study.reference, surface=surface),
        PROTOCOL,
        Choices(diagnostics=False),
    )
    return score.r


def report_of(study: StudyCase, snapshot: Snapshot) -> Report:
    """What the plugin says of a copy."""
    scene = LiveScene(reading=snapshot, state=study.scene.state)
    return measure(scene, study.requirements, study.evidence)


def in_tolerances(report: Report) -> dict[str, float]:
    """Mean residual of each requirement kind in tolerances, and of all of them as "all"."""
    by_kind: dict[str, list[float]] = {}
    for result in report.results:
        kind = type(result.requirement).__name__
        residual = MOST
        if result.residual is not None:
            # The order of depth has a tolerance of 0: a tenth of the pairs stands for one.
            residual = min(result.residual / (result.tolerance or 0.1), MOST)
        by_kind.setdefault(kind, []).append(residual)
    means = {kind: float(np.mean(values)) for kind, values in by_kind.items()}
    return {**means, "all": float(np.mean([v for values in by_kind.values() for v in values]))}


def moved(snapshot: Snapshot, surfaces: NDArray[np.bool_], motion: F64) -> Snapshot:
    """A copy with some surfaces moved. motion: (4, 4), of the world."""
    placed = snapshot.world_from_mesh.copy()
    placed[surfaces, :, :3] = motion[:3, :3] @ placed[surfaces][:, :, :3]
    placed[surfaces, :, 3] = placed[surfaces][:, :, 3] @ motion[:3, :3].T + motion[:3, 3]
    return replace(snapshot, world_from_mesh=placed)


def without(snapshot: Snapshot, surfaces: NDArray[np.bool_]) -> Snapshot:
    """A copy that lacks some surfaces."""
    return with_surfaces(snapshot, np.flatnonzero(~surfaces))


def seen_from(snapshot: Snapshot, motion: F64) -> Snapshot:
    """A copy whose camera stands elsewhere. motion: (4, 4), of the camera in its own axes."""
    pose = np.vstack([np.array(snapshot.camera.world_from_camera), [0, 0, 0, 1]]) @ motion
    rows: Any = tuple(tuple(float(v) for v in row) for row in pose[:3])
    return replace(snapshot, camera=replace(snapshot.camera, world_from_camera=rows))


def about(point: F64, linear: F64) -> F64:
    """The (4, 4) motion that applies a (3, 3) map about a point."""
    motion = np.eye(4)
    motion[:3, :3], motion[:3, 3] = linear, point - linear @ point
    return motion


def shift(offset: F64) -> F64:
    """The (4, 4) motion by an offset."""
    motion = np.eye(4)
    motion[:3, 3] = offset
    return motion


def turn(axis: int, degrees: float) -> F64:
    """The (3, 3) rotation about one axis."""
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    first, second = (axis + 1) % 3, (axis + 2) % 3
    made = np.eye(3)
    made[first, first] = made[second, second] = c
    made[first, second], made[second, first] = -s, s
    return made
