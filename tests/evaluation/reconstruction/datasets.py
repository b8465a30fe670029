"""Small benches and runs of them, made of planes and balls, without Blender."""

from __future__ import annotations

import hashlib
import io
import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from legoworld.evaluation.family import EvaluationRequest
from legoworld.evaluation.reconstruction import evaluate
from legoworld.evaluation.reconstruction.points import Raster, picture_raster
from legoworld.evaluation.run import read_run
from legoworld.records.base import UNSET, as_json, readable
from legoworld.records.bench_dataset import (
    BenchCamera,
    BenchHashes,
    BenchImage,
    BenchInfo,
    BenchTrackFile,
    BenchTruth,
    BenchTruthFile,
    NoiseFloor,
    PictureCard,
    ScoredObject,
)
from legoworld.records.render_card import RenderCard
from legoworld.records.second_card import CONTEXT, OWN, BenchXFile, BenchXImage, BenchXInfo, XTruth
from legoworld.records.submission import (
    BenchRow,
    Check,
    Integrity,
    ProbedFile,
    RenderFile,
    SubmittedCamera,
    SurfaceFile,
    Validity,
)
from legoworld.records.track import Probe, SecondView

SIZE_WH = (96, 54)
RASTER_WH = (48, 27)
RENDER_WH = (32, 18)
HFOV_DEG = 50.0
POSE = ((1.0, 0.0, 0.0, 0.0), (0.0, 1.0, 0.0, 0.0), (0.0, 0.0, 1.0, 0.0), (0.0, 0.0, 0.0, 1.0))
OK = Check(ok=True)
VALID = Validity(scene_blend=OK, geometry=OK, camera=OK, scene_glb=OK, final_png=OK)
NOTHING = Integrity(
    images=(), world_nodes=(), compositor_nodes=(), texts=(), drivers=0, planes=(), joints=()
)
RENDER = RenderCard(
    version="1.0.0", engine="CYCLES", device="CPU", samples=32, seed=0, longest_side_px=32,
    adaptive_sampling=False, denoiser=False, compositor=False, sequencer=False, border=False,
    film_transparent=False, resolution_percentage=100,
)  # fmt: skip


def small_raster() -> Raster:
    return picture_raster(SIZE_WH, HFOV_DEG, RASTER_WH)


def scene(raster: Raster, seed: int, balls: int = 4) -> tuple[NDArray[Any], NDArray[Any]]:
    """A room with balls: planar depth (H, W) float32 and instance (H, W) int32, -1 nowhere.

    Instance 0 is the room; the others are balls. What a ray through the back wall's window hits is
    nothing: inf and -1.
    """
    random = np.random.default_rng(seed)
    u = ((np.arange(raster.width) + 0.5 - raster.cx) / raster.fx)[None, :]
    v = ((np.arange(raster.height) + 0.5 - raster.cy) / raster.fy)[:, None]
    disparity = np.maximum(np.maximum(0.18 + 0.05 * u + 0 * v, v / 1.1 + 0 * u), u / 1.9 + 0 * v)
    z = 1.0 / disparity
    instance = np.zeros(z.shape, np.int32)
    window = (np.abs(u + 0.3) < 0.08) & (np.abs(v + 0.15) < 0.05)
    z[window], instance[window] = np.inf, -1
    for k in range(balls):
        c = random.uniform([-0.9, -0.2, 2.2], [0.8, 0.6, 4.0])
        radius = random.uniform(0.25, 0.55)
        a, b = u * u + v * v + 1, u * c[0] + v * c[1] + c[2]
        root = b * b - a * (c @ c - radius * radius)
        near = np.where(root > 0, (b - np.sqrt(np.maximum(root, 0))) / a, np.inf)
        closer = near < z
        z, instance = np.where(closer, near, z), np.where(closer, k + 1, instance)
    return z.astype(np.float32), instance.astype(np.int32)


def picture(instance: NDArray[Any], depth: NDArray[Any], size_wh: tuple[int, int]) -> Image.Image:
    """A picture that shows objects and depth in colours."""
    shade = np.where(np.isfinite(depth), 40 + 30 * np.minimum(depth, 6), 0)
    colours = np.stack([shade, 37 * (instance + 1) % 256, 255 - shade], axis=-1)
    return Image.fromarray(colours.astype(np.uint8)).resize(size_wh, Image.Resampling.NEAREST)


@dataclass(kw_only=True)
class Case:
    """What the fabricator knows of one case."""

    image: BenchImage
    depth_z_m: NDArray[Any]
    instance: NDArray[Any]
    render: NDArray[Any]
    second: dict[str, NDArray[Any]] = field(default_factory=dict)


@dataclass(kw_only=True)
class Dataset:
    """A bench in a folder. cases: by image id."""

    root: Path
    cases: dict[int, Case] = field(default_factory=dict)

    @property
    def private(self) -> Path:
        return self.root / "private"

    @property
    def track_sha256(self) -> str:
        return sha256(self.root / "public" / "track.json")


@dataclass(kw_only=True)
class Submission:
    """What a run has of a case; None for the reference's own."""

    depth_z_m: NDArray[Any] | None = None
    render: NDArray[Any] | None = None
    no_render: bool = False
    hfov_deg: float = HFOV_DEG
    pose: Any = POSE
    validity: Validity = VALID
    integrity: Integrity = NOTHING
    status: str = "ok"
    extra: dict[str, NDArray[Any]] = field(default_factory=dict)
    probed: dict[str, NDArray[Any]] = field(default_factory=dict)
    second_render: NDArray[Any] | None = None
    surface_differs: float = 0.0


def sha256(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


def write_dataset(
    root: Path,
    *,
    families: int = 2,
    tiers: tuple[str | None, ...] = ("easy", "hard"),
    views: int = 1,
    raster_kept: bool = True,
    seed: int = 0,
) -> Dataset:
    """DATASET/public and DATASET/private below root."""
    dataset = Dataset(root=root)
    images, truths = [], {}
    image_id = 0
    for family in range(families):
        for view in range(views):
            for place, tier in enumerate(tiers):
                image_id += 1
                name = f"room{family}__{tier}__view_{view:02}.png" if tier else f"room{family}.png"
                image = BenchImage(
                    id=image_id, file_name=name, width=SIZE_WH[0], height=SIZE_WH[1],
                    hfov_deg=HFOV_DEG, family=f"room{family}",
                    environment="outdoor" if family % 2 else "indoor", theme=None,
                    split="test", tier=tier, view=view,  # type: ignore[arg-type]
                )  # fmt: skip
                images.append(image)
                made = 100 * seed + 10 * family + view
                truths[str(image_id)] = _case(dataset, image, made, 2 + 2 * place, raster_kept)
    track = BenchTrackFile(
        info=BenchInfo(
            description="made for a test", task="bench", card_version="1.0.0",
            picture=PictureCard(engine="CYCLES", device="CPU", samples=1, seed=0, denoised=True),
        ),
        images=tuple(images),
        categories=(),
    )  # fmt: skip
    (root / "public").mkdir(parents=True, exist_ok=True)
    (root / "public" / "track.json").write_text(readable(track))
    truth = BenchTruthFile(
        schema_version=1, task="bench", card_version="1.0.0", track_sha256=dataset.track_sha256,
        point_cap=100_000, card=RENDER, images=truths,
    )  # fmt: skip
    (root / "private" / "truth.json").write_text(readable(truth))
    return dataset


def _case(
    dataset: Dataset, image: BenchImage, seed: int, balls: int, raster_kept: bool
) -> BenchTruth:
    stem = str(image.file_name).removesuffix(".png")
    full = picture_raster(SIZE_WH, HFOV_DEG, SIZE_WH)
    raster = small_raster()
    whole_depth, whole_instance = scene(full, seed, balls)
    depth, instance = scene(raster, seed, balls)
    private = dataset.private
    arrays = {
        "depth": {"depth_z_m": whole_depth},
        "instances": {"instance": whole_instance},
        "raster": {"depth_z_m": depth, "instance": instance},
    }
    hashes: dict[str, str | None] = {"raster": None}
    for kind, values in arrays.items():
        if kind == "raster" and not raster_kept:
            continue
        path = private / kind / f"{stem}.npz"
        path.parent.mkdir(parents=True, exist_ok=True)
        np.savez(path, **values)
        hashes[kind] = sha256(path)
    shown = dataset.root / "public" / "images" / str(image.file_name)
    shown.parent.mkdir(parents=True, exist_ok=True)
    seen = picture(whole_instance, whole_depth, SIZE_WH)
    seen.save(shown)
    render = np.asarray(seen.resize(RENDER_WH, Image.Resampling.LANCZOS))
    dataset.cases[image.id] = Case(image=image, depth_z_m=depth, instance=instance, render=render)
    ids = sorted({int(i) for i in np.unique(instance)} - {-1, 0})
    return BenchTruth(
        camera=BenchCamera(fx=full.fx, fy=full.fy, cx=full.cx, cy=full.cy, world_from_cam=POSE),
        sha256=BenchHashes(reference=sha256(shown), **hashes),  # type: ignore[arg-type]
        scored=tuple(ScoredObject(id=i, name=f"Ball {i}", category="ball") for i in ids),
        raster_wh=RASTER_WH,
        snapshot_sha256="0" * 64,
        noise_floor=NoiseFloor(seeds=(0, 1), a_self=(0.99, 0.98), sd=0.00707),
    )


OFFSET_PX = (0.3, -0.2)
#: An object's points, and what is around it; metres.
POINTS = np.array([0, 0, 3]) + np.stack(np.meshgrid(*[np.linspace(0, 1, 12)] * 3), axis=-1).reshape(
    -1, 3
)


def write_second_card(dataset: Dataset) -> Path:
    """DATASET/private/x.json and its arrays; the second view is another made-up scene."""
    images = []
    raster = small_raster()
    moved = replace(raster, cx=raster.cx - OFFSET_PX[0], cy=raster.cy - OFFSET_PX[1])
    for number, case in dataset.cases.items():
        stem = str(case.image.file_name).removesuffix(".png")
        ids = sorted({int(i) for i in np.unique(case.instance)} - {-1, 0})
        balls = int(case.instance.max())
        arrays: dict[str, NDArray[Any]] = {}
        for name, seen, seed in (("offset", moved, number), ("view", raster, 50 + number)):
            depth, instance = scene(seen, seed, balls)
            arrays |= {f"{name}_depth_z_m": depth, f"{name}_instance": instance}
        arrays["points_m"] = np.concatenate([POINTS] * len(ids)).astype(np.float32)
        arrays["point_object"] = np.repeat(np.arange(len(ids), dtype=np.int32), len(POINTS))
        arrays["point_kind"] = np.tile(np.where(POINTS[:, 2] > 3.2, OWN, CONTEXT), len(ids))
        case.second = arrays
        path = dataset.private / "x" / f"{stem}.npz"
        path.parent.mkdir(parents=True, exist_ok=True)
        np.savez(path, **arrays)
        shown = dataset.root / "public" / "images" / str(case.image.file_name)
        images.append(
            BenchXImage(
                **as_json(case.image),
                probe=Probe(
                    offset_px=OFFSET_PX,
                    view=SecondView(cam_from_view=POSE, hfov_deg=HFOV_DEG),
                    boxes_m=(((0, 0, 3), (1, 1, 4)),) * len(ids),
                    spacings_m=(0.05,) * len(ids),
                ),
                x=XTruth(
                    R_empty=0.25,
                    arrays_sha256=sha256(path),
                    picture=str(shown.relative_to(dataset.root)),
                    picture_sha256=sha256(shown),
                ),
            )
        )
    info = BenchXInfo(
        description="made for a test", task="bench-x", card_version="0.1.0",
        track_sha256=dataset.track_sha256,
    )  # fmt: skip
    path = dataset.private / "x.json"
    path.write_text(readable(BenchXFile(info=info, images=tuple(images), categories=())))
    return path


def evaluate_bench(run: Path, truth: Path, output: Path, **given: Any) -> Any:
    """The product's own, by its request; few draws unless they are given."""
    settings = {"draws": 10, **given}
    request = EvaluationRequest(run=read_run(run), truth=truth, output=output, **settings)
    return evaluate.evaluate_bench(request)


def write_run(
    folder: Path,
    dataset: Dataset,
    submissions: Mapping[int, Submission] | None = None,
    *,
    task: str = "bench",
    track_sha256: str | None = None,
    agent: dict[str, Any] | None = None,
) -> Path:
    """A finished run over all cases; those not named submit the reference as itself."""
    rows, scenes = [], {}
    for image_id, case in dataset.cases.items():
        submission = (submissions or {}).get(image_id, Submission())
        rows.append(_row(folder, case, submission))
        scenes[str(image_id)] = {"provenance": agent} if agent else {}
    configuration = {
        "task": task, "kind": "scene", "attempted": len(rows), "partial": False,
        "track_sha256": track_sha256 or dataset.track_sha256, "vocabulary_sha256": None,
    }  # fmt: skip
    document = {"configuration": configuration, "versions": {}, "scenes": scenes}
    (folder / "run.json").write_text(json.dumps(document))
    (folder / "per_image.jsonl").write_text("".join(f"{json.dumps(as_json(r))}\n" for r in rows))
    return folder


def _row(folder: Path, case: Case, submission: Submission) -> BenchRow:
    stem = str(case.image.file_name).removesuffix(".png")
    folder.mkdir(parents=True, exist_ok=True)
    if submission.status != "ok":
        return BenchRow(
            image_id=case.image.id, file_name=str(case.image.file_name), scene=stem,
            size_wh=SIZE_WH, status=submission.status, code=submission.status,
            reason=f"it was {submission.status}", warnings=(), valid=False,
        )  # fmt: skip
    depth = case.depth_z_m if submission.depth_z_m is None else submission.depth_z_m
    surface, size = io.BytesIO(), 2 * math.tan(math.radians(submission.hfov_deg) / 2)
    raster = small_raster()
    arrays = {
        "depth_z_m": depth.astype(np.float32),
        "intrinsics_px": np.array([raster.fx, raster.fy, raster.cx, raster.cy]),
        "plane": np.full(depth.shape, -1, np.int16),
        "textures": np.zeros((0, 36, 64, 3), np.uint8),
    }
    np.savez(surface, **(arrays | submission.extra))
    shown, focal = io.BytesIO(), SIZE_WH[0] / size
    render = case.render if submission.render is None else submission.render
    Image.fromarray(render).save(shown, format="PNG")
    return BenchRow(
        image_id=case.image.id, file_name=str(case.image.file_name), scene=stem, size_wh=SIZE_WH,
        status="ok", code="ok", reason=None, warnings=(), valid=submission.validity.valid,
        validity=submission.validity,
        camera=SubmittedCamera(
            type="PERSP", hfov_deg=submission.hfov_deg, fx=focal, fy=focal, cx=SIZE_WH[0] / 2,
            cy=SIZE_WH[1] / 2, clip_start_m=0.1, clip_end_m=100.0, world_from_cam=submission.pose,
        ),
        surface=SurfaceFile(
            **_written(folder, f"surface/{stem}.npz", surface.getvalue()),
            raster_wh=RASTER_WH, finite_px=int(np.isfinite(depth).sum()),
        ),
        render=UNSET if submission.no_render else RenderFile(
            **_written(folder, f"render/{stem}.png", shown.getvalue()),
            size_wh=(render.shape[1], render.shape[0]), card_sha256="0" * 64, noise=None,
        ),
        integrity=submission.integrity,
        probe=_probe(folder, case, submission, stem) if case.second else UNSET,
    )  # fmt: skip


def _probe(folder: Path, case: Case, submission: Submission, stem: str) -> ProbedFile:
    names = ("offset_depth_z_m", "view_depth_z_m", "points_m", "point_object")
    data, shown = io.BytesIO(), io.BytesIO()
    np.savez(data, **({name: case.second[name] for name in names} | submission.probed))
    render = case.render if submission.second_render is None else submission.second_render
    Image.fromarray(render).save(shown, format="PNG")
    return ProbedFile(
        **_written(folder, f"probe/{stem}.npz", data.getvalue()),
        render=None if submission.no_render else RenderFile(
            **_written(folder, f"probe/{stem}.png", shown.getvalue()),
            size_wh=(render.shape[1], render.shape[0]), card_sha256="0" * 64, noise=None,
        ),
        surface_differs=submission.surface_differs,
        unreadable_alpha=0,
    )  # fmt: skip


def _written(folder: Path, name: str, data: bytes) -> dict[str, Any]:
    path = folder / name
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(data)
    return {"file": name, "sha256": hashlib.sha256(data).hexdigest(), "bytes": len(data)}
