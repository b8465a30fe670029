"""A reference scene to the cases of one family, written into a dataset's two halves."""

from __future__ import annotations

import math
import shutil
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

from msgspec.structs import replace as with_fields

from legoworld.bench.case import CaseRefusedError, SeenCase, noise_floor, reference_joints, see_case
from legoworld.bench.halves import PUBLIC, Halves
from legoworld.bench.x_case import XCase, see_x
from legoworld.cards import load_card
from legoworld.errors import LegoWorldError
from legoworld.files import Json, sha256_of_text
from legoworld.readouts.joints import scene_joints
from legoworld.readouts.probing import second_stand
from legoworld.readouts.surface import pose_m
from legoworld.records.base import UNSET
from legoworld.records.bench_dataset import (
    BenchCamera,
    BenchTruth,
    NoiseFloor,
    PictureCard,
    ReferenceJoint,
    Tier,
)
from legoworld.records.render_card import RenderCard
from legoworld.records.scene_folder import LabelsFile
from legoworld.records.second_card import XTruth
from legoworld.records.track import Probe
from legoworld.running.error_boundary import classify_error
from legoworld.running.submission import card_render, card_size
from legoworld.scene.blender_process import BlenderProcess, Limits
from legoworld.scene.cache import SnapshotCache
from legoworld.scene.folder import BLEND, GLB, LABELS, PICTURE, SceneFolder
from legoworld.scene.freeze import (
    FrozenFiles,
    checked_artefacts,
    hashed_dependencies,
)
from legoworld.scene.gltf.buffers import external_files
from legoworld.scene.gltf.container import parse_glb
from legoworld.scene.instances import Grouping, group
from legoworld.scene.labels import labels_in, resolve_labels
from legoworld.scene.open_scene import CardRender, OpenedScene, retry_once
from legoworld.scene.read_scene import read_hashed_side_file, read_scene
from legoworld.scene.requests import DeclaredCases, Request
from legoworld.scene.snapshot import Snapshot
from legoworld.tasks.shipped import BENCH_X
from legoworld.workers.engines import machine_lost

#: Path samples a second that a render is allowed to need: a tenth of what one slow core does.
_SLOWEST_SAMPLES_PER_S: Final = 50_000


@dataclass(frozen=True, kw_only=True)
class MakeOptions:
    """Options shared by all families.

    noise_seeds: renders by the card of which A's spread is measured, 0 for none. scenes: where each
    case is kept as a scene folder, the reference submitted as itself; None where it is not. notice:
    called with a line before every render, where the families are made in this process.
    """

    output: Path
    size_wh: tuple[int, int]
    picture: PictureCard
    card: RenderCard
    delta: int
    noise_seeds: int
    scenes: Path | None
    cache: SnapshotCache | None
    require_frozen: bool
    threads: int
    notice: Callable[[str], None] | None = None

    @property
    def picture_render(self) -> CardRender:
        """How the pictures are rendered."""
        return CardRender(
            size_wh=self.size_wh,
            samples=self.picture.samples,
            seed=self.picture.seed,
            denoise=self.picture.denoised,
            threads=self.threads,
        )

    @property
    def render_s(self) -> float:
        """Seconds that the largest render may take beyond what reading a scene may."""
        card_wh = card_size(self.size_wh, self.card.longest_side_px)
        n_samples = max(
            math.prod(self.size_wh) * self.picture.samples,
            math.prod(card_wh) * self.card.samples if self.noise_seeds else 0,
        )
        return n_samples / _SLOWEST_SAMPLES_PER_S


@dataclass(frozen=True, kw_only=True)
class MadeCase:
    """A finished case: its public and its private half, and those of the second card."""

    file_name: str
    hfov_deg: float
    tier: Tier | None
    view: int
    truth: BenchTruth
    probe: Probe
    x: XTruth


@dataclass(frozen=True, kw_only=True)
class MadeFamily:
    """All cases of a reference scene; or none, with the reason, if one is refused."""

    family: str
    environment: str | None
    theme: str | None
    split: str | None
    cases: tuple[MadeCase, ...]
    status: str
    reason: str | None


class FamilyMaker:
    """Makes families one after another in its own Blender process."""

    def __init__(self, options: MakeOptions, limits: Limits) -> None:
        self._options = options
        self._blender = BlenderProcess(replace(limits, time_s=limits.time_s + options.render_s))

    def do(self, folder: SceneFolder) -> MadeFamily:
        """The cases of one reference scene, or why there are none."""
        try:
            return _Family(folder, self._options, self._blender).make()
        except Exception as error:  # noqa: BLE001  a verdict of this scene, or raised again
            written = [p for p in (self._options.output, self._options.scenes) if p]
            written += [self._options.cache.folder] if self._options.cache else []
            return _refused_family(folder, classify_error(error, written))

    def abort(self) -> None:
        """End the Blender process under a running `do`."""
        self._blender.abort()

    def close(self) -> None:
        """End the Blender process."""
        self._blender.close()


def lost_family(folder: SceneFolder, what: str) -> MadeFamily:
    """The family of a scene whose machine was lost each time it was tried."""
    return _refused_family(folder, machine_lost(what))


def _refused_family(folder: SceneFolder, error: LegoWorldError) -> MadeFamily:
    return MadeFamily(
        family=family_name(folder.name),
        environment=None,
        theme=None,
        split=None,
        cases=(),
        status=error.status,
        reason=str(error),
    )


def family_name(scene: str) -> str:
    """A family is called after its scene folder, its path below SCENES in one word."""
    return scene.replace("/", "-")


@dataclass(frozen=True, kw_only=True)
class _CaseRequest:
    """One case to make. camera, other: names of the view's camera and of the next view's.

    other_stem: the next view's case; both None in a family of one view.
    """

    stem: str
    tier: Tier | None
    view: int
    camera: str
    other: str | None
    other_stem: str | None


class _Family:
    """One reference scene while its cases are made."""

    def __init__(self, folder: SceneFolder, options: MakeOptions, blender: BlenderProcess) -> None:
        self._folder, self._options, self._blender = folder, options, blender
        self._blend = str(folder.path.resolve() / BLEND)
        self._halves = Halves(options.output)
        self._read = BLEND if BLEND in folder.artefacts() else GLB

    def make(self) -> MadeFamily:
        files = checked_artefacts(self._folder, require_frozen=self._options.require_frozen)
        outside = None
        if self._read == GLB:
            self._blend, outside = self._import_glb()
        answer = retry_once(lambda: self._blender.request({"kind": "cases", "blend": self._blend}))
        names = answer["dependencies"] if outside is None else outside
        files = hashed_dependencies(self._folder, names, files, read_by=self._read)
        said: DeclaredCases = answer["cases"]
        cases = [self._case(files, said, wanted) for wanted in self._list_requests(said)]
        return MadeFamily(
            family=family_name(self._folder.name),
            environment=said["environment"],
            theme=said["theme"],
            split=said["split"],
            cases=tuple(_with_second_pictures(cases, self._list_requests(said))),
            status="ok",
            reason=None,
        )

    def _import_glb(self) -> tuple[str, list[str]]:
        """scene.glb as a .blend in the process's workspace, and the files that it reads."""
        glb = self._folder.file(GLB).resolve()
        made = self._blender.workspace("legoworld-glb-") / BLEND
        outside = external_files(parse_glb(glb.read_bytes()).document, glb.parent)
        request: Request = {"kind": "import_glb", "glb": str(glb), "output": str(made)}
        retry_once(lambda: self._blender.request(request))
        return str(made), outside

    def _list_requests(self, declared_cases: DeclaredCases) -> Iterator[_CaseRequest]:
        family, cameras = family_name(self._folder.name), declared_cases["views"]
        for tier in declared_cases["tiers"]:
            stems = [
                "__".join([family, *([tier] if tier else []), f"view_{view:02d}"])
                for view in range(len(cameras))
            ]
            for view, camera in enumerate(cameras):
                after = (view + 1) % len(cameras)
                yield _CaseRequest(
                    stem=stems[view],
                    tier=tier,
                    view=view,
                    camera=camera,
                    other=cameras[after] if after != view else None,
                    other_stem=stems[after] if after != view else None,
                )

    def _case(
        self, files: FrozenFiles, declared_cases: DeclaredCases, wanted: _CaseRequest
    ) -> MadeCase:
        """Save the case as a scene of its own, and read it as any submission is read."""
        options = self._options
        folder = SceneFolder(
            path=self._blender.workspace("legoworld-case-") / wanted.stem, name=wanted.stem
        )
        folder.path.mkdir()
        try:
            request: Request = {
                "kind": "case",
                "blend": self._blend,
                "output": str(folder.path),
                "case": {
                    "tier": wanted.tier,
                    "view": wanted.camera,
                    "size_wh": options.size_wh,
                    "glb": options.scenes is not None,
                },
            }
            retry_once(lambda: self._blender.request(request))
            case = {"tier": wanted.tier, "view": wanted.camera, "size_wh": options.size_wh}
            content = {**_content(files, self._read), "case": case}
            return self._write_case(folder, files, declared_cases, wanted, content)
        finally:
            shutil.rmtree(folder.path, ignore_errors=True)

    def _write_case(
        self,
        folder: SceneFolder,
        files: FrozenFiles,
        declared_cases: DeclaredCases,
        request: _CaseRequest,
        content: Mapping[str, Json],
    ) -> MadeCase:
        options = self._options
        own = checked_artefacts(folder, require_frozen=False)
        scene = read_scene(folder, source="blend", blender=self._blender, cache=None, files=own)
        snapshot = scene.snapshot
        grouping = self._grouping(snapshot, files)
        seen, joints = self._see_case(snapshot, grouping, declared_cases)
        opened = OpenedScene(folder, scene.files, self._blender, options.cache, content=content)
        self._say(f"{request.stem}: picture, {options.picture.samples} samples")
        picture = opened.render(options.picture_render)
        noise = self._noise(opened, picture)
        hashes = self._halves.write(request.stem, picture, seen)
        secret = int(sha256_of_text(f"{hashes.raster} {scene.snapshot_sha256}"), 16)
        others = [camera for camera in snapshot.cameras if camera.name == request.other]
        seen_x = see_x(
            snapshot,
            grouping,
            options.size_wh,
            seen,
            others[0] if others else None,
            secret,
            load_card(BENCH_X),
            threads=options.threads,
        )
        if options.scenes is not None:
            _keep(folder, self._folder, options.scenes / request.stem, picture)
        return MadeCase(
            file_name=f"{request.stem}.png",
            hfov_deg=seen.hfov_deg,
            tier=request.tier,
            view=request.view,
            probe=seen_x.probe,
            x=self._write_x(request.stem, opened, snapshot, seen, seen_x),
            truth=BenchTruth(
                camera=_camera(snapshot, seen),
                sha256=hashes,
                scored=seen.scored_objects,
                raster_wh=seen.raster_wh,
                snapshot_sha256=scene.snapshot_sha256,
                noise_floor=noise,
                joints=joints or UNSET,
            ),
        )

    def _say(self, text: str) -> None:
        if self._options.notice is not None:
            self._options.notice(text)

    def _write_x(
        self, stem: str, scene: OpenedScene, snapshot: Snapshot, seen_case: SeenCase, x: XCase
    ) -> XTruth:
        """Write the second card's half of a case; a private view is rendered as the picture is."""
        picture = None
        if x.private_view and x.probe.view is not None:
            self._say(f"{stem}: picture of a private view")
            wanted = replace(
                self._options.picture_render,
                stand=second_stand(snapshot, x.probe.view, seen_case.hfov_deg),
            )
            picture = scene.render(wanted)
        return with_fields(self._halves.write_x(stem, x.arrays, picture), R_empty=x.R_empty)

    def _grouping(self, snapshot: Snapshot, files: FrozenFiles) -> Grouping:
        outside = labels_in(read_hashed_side_file(self._folder, LABELS, LabelsFile, files))
        return group(snapshot, resolve_labels(snapshot, outside, None, None))

    def _see_case(
        self, snapshot: Snapshot, grouping: Grouping, declared_cases: DeclaredCases
    ) -> tuple[SeenCase, tuple[ReferenceJoint, ...]]:
        size_wh, unscored = self._options.size_wh, frozenset(declared_cases["unscored"])
        seen = see_case(snapshot, grouping, size_wh, unscored, threads=self._options.threads)
        joints, complaints = scene_joints(self._folder, snapshot, declared_cases["joints"])
        if complaints:
            raise CaseRefusedError(
                "a joint of the reference cannot be used",
                found=complaints[0],
                expected="joints that can be read",
                next_step="correct the property or the URDF file, or delete it",
            )
        return seen, reference_joints(snapshot, grouping, seen.scored_objects, joints)

    def _noise(self, scene: OpenedScene, picture: bytes) -> NoiseFloor | None:
        options = self._options
        seeds = range(options.card.seed, options.card.seed + options.noise_seeds)
        size_wh = card_size(options.size_wh, options.card.longest_side_px)
        renders = []
        for number, seed in enumerate(seeds, start=1):
            self._say(f"{scene.folder.name}: render {number} of {len(seeds)} for A's noise floor")
            renders.append(scene.render(card_render(options.card, size_wh, seed, options.threads)))
        return noise_floor(tuple(seeds), renders, picture, options.delta) if renders else None


def _with_second_pictures(
    cases: Sequence[MadeCase], requests: Iterable[_CaseRequest]
) -> Iterator[MadeCase]:
    """The cases, each with the picture of the next view where that is its second one."""
    pictures = {case.file_name: case.truth.sha256.reference for case in cases}
    for case, asked in zip(cases, requests, strict=True):
        if asked.other_stem is None or case.probe.view is None or case.x.picture is not None:
            yield case
            continue
        name = f"{asked.other_stem}.png"
        seen = with_fields(case.x, picture=f"{PUBLIC}/images/{name}", picture_sha256=pictures[name])
        yield replace(case, x=seen)


def _content(files: FrozenFiles, read: str) -> dict[str, Any]:
    """Identity of a reference; the .blend's own bytes differ each time it is saved."""
    hashes = {**files.dependencies, read: files.artefacts.get(read)}
    return {"reference": {name: found and found.sha256 for name, found in hashes.items()}}


def _camera(snapshot: Snapshot, seen_case: SeenCase) -> BenchCamera:
    p = seen_case.projection
    return BenchCamera(
        fx=p.fx,
        fy=p.fy,
        cx=p.cx,
        cy=p.cy,
        world_from_cam=pose_m(snapshot.camera, snapshot.render.unit_scale),
    )


def _keep(folder: SceneFolder, reference: SceneFolder, target: Path, picture: bytes) -> None:
    """The case as a submission: its scene, glTF and joints, and its picture as final.png."""
    target.mkdir(parents=True, exist_ok=True)
    for name in (BLEND, GLB):
        if folder.file(name).is_file():
            shutil.copyfile(folder.file(name), target / name)
    (target / PICTURE).write_bytes(picture)
    for name in reference.urdf_files():
        shutil.copyfile(reference.file(name), target / name)
