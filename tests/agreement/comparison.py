"""Two pictures of one scene, ours and Cycles', compared by source object and by depth."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

#: What counts as agreement, and what is asked for; shares of pixels.
DEPTH_TOLERANCE: Final = 1e-4
TIE: Final = 1e-5
LEAST_SAME: Final = 0.99
LEAST_SAME_INSIDE: Final = 0.999
LEAST_DEPTH: Final = 0.999
NORMAL_TOLERANCE_DEG: Final = 0.1
CREASE_DEG: Final = 10.0
LEAST_NORMAL: Final = 0.999


@dataclass(frozen=True, kw_only=True)
class ObjectPicture:
    """Which object and how far, at each pixel.

    instance: (H, W) int32, -1 = nothing; names: "name|library" of each instance's object, so that
    several instances may carry one name; depth_z_m: (H, W) float32, +inf = nothing; normal_world:
    (H, W, 3) float32, shading normals towards the camera.
    """

    instance: NDArray[np.int32]
    names: tuple[str, ...]
    depth_z_m: NDArray[np.float32]
    normal_world: NDArray[np.float32] | None = None

    def named(self, all_names: dict[str, int]) -> NDArray[np.int32]:
        """(H, W) int32: the picture with each instance replaced by its name's number."""
        table = np.array([all_names[name] for name in self.names] + [-1], np.int32)
        return table[self.instance]

    def areas(self) -> dict[str, int]:
        """Pixels of each object that has any."""
        ids, counts = np.unique(self.instance[self.instance >= 0], return_counts=True)
        areas: dict[str, int] = {}
        for i, n in zip(ids.tolist(), counts.tolist(), strict=True):
            areas[self.names[i]] = areas.get(self.names[i], 0) + n
        return areas


@dataclass(frozen=True, kw_only=True)
class Agreement:
    """How far two pictures agree; shares are of the pixels counted beside them."""

    pixels: int  # judged
    inside: int  # pixels that no silhouette of either picture touches
    shared: int  # of those, the ones where both see the same object
    hit: float  # share of all pixels where Cycles sees anything
    same: float  # share of judged pixels
    same_inside: float
    tied: int  # judged pixels of two objects at one depth, within TIE: either answer is right
    depth: float  # share of shared within DEPTH_TOLERANCE
    depth_median: float
    depth_worst: float
    differing: tuple[tuple[str, str, int], ...]  # ours, Cycles', pixels inside; most first

    @property
    def verdict(self) -> str:
        """ "ok", or which targets are missed."""
        missed = [
            name
            for name, value, least in (
                ("same", self.same, LEAST_SAME),
                ("same_inside", self.same_inside, LEAST_SAME_INSIDE),
                ("depth", self.depth, LEAST_DEPTH),
            )
            if not value >= least
        ]
        return "ok" if not missed else "below: " + ", ".join(missed)


def read_judgement(path: Path) -> ObjectPicture:
    """The picture the judge wrote, depth in metres."""
    with np.load(path, allow_pickle=False) as stored:
        return ObjectPicture(
            instance=stored["object_index"],
            names=tuple(stored["names"].tolist()),
            depth_z_m=(stored["depth_z"] * float(stored["unit_scale"])).astype(np.float32),
            normal_world=stored["normal_world"],
        )


def compare(
    ours: ObjectPicture, cycles: ObjectPicture, left_out: Collection[str] = ()
) -> Agreement:
    """Shares of pixels that agree; both pictures are of one size.

    left_out: names whose pixels, in either picture, are not judged.
    """
    if ours.instance.shape != cycles.instance.shape:
        raise ValueError(f"{ours.instance.shape} against {cycles.instance.shape}")
    order = {n: i for i, n in enumerate(sorted({*ours.names, *cycles.names}))}
    mine, theirs = ours.named(order), cycles.named(order)
    judged = ~np.isin([mine, theirs], [order[n] for n in left_out if n in order]).any(axis=0)
    inside = judged & ~silhouette(ours.instance) & ~silhouette(theirs)
    same = mine == theirs
    shared = same & inside & (mine >= 0)
    z, true_z = (p.depth_z_m[shared].astype(np.float64) for p in (ours, cycles))
    relative = np.abs(z - true_z) / true_z
    return Agreement(
        pixels=int(judged.sum()),
        inside=int(inside.sum()),
        shared=int(shared.sum()),
        hit=float((theirs >= 0).mean()),
        same=float(same[judged].mean()) if judged.any() else float("nan"),
        same_inside=float(same[inside].mean()) if inside.any() else float("nan"),
        tied=int((judged & ~same & _tied(ours.depth_z_m, cycles.depth_z_m)).sum()),
        depth=float((relative < DEPTH_TOLERANCE).mean()) if len(z) else float("nan"),
        depth_median=float(np.median(relative)) if len(z) else float("nan"),
        depth_worst=float(relative.max()) if len(z) else float("nan"),
        differing=_differing(mine, theirs, inside & ~same, list(order)),
    )


@dataclass(frozen=True, kw_only=True)
class NormalAgreement:
    """How far two pictures' shading normals agree. pixels: judged, creased: left out as creases."""

    pixels: int
    creased: int
    within: float  # share of the judged within NORMAL_TOLERANCE_DEG
    median_deg: float
    worst_deg: float


def compare_normals(ours: ObjectPicture, cycles: ObjectPicture) -> NormalAgreement:
    """Angles where both see the same object, off silhouettes and creases of either picture."""
    order = {n: i for i, n in enumerate(sorted({*ours.names, *cycles.names}))}
    mine, theirs = ours.named(order), cycles.named(order)
    assert ours.normal_world is not None
    assert cycles.normal_world is not None
    shared = (mine == theirs) & (mine >= 0)
    shared &= ~silhouette(ours.instance) & ~silhouette(theirs)
    creases = crease(ours.normal_world) | crease(cycles.normal_world)
    judged = shared & ~creases
    errors = angle_deg(ours.normal_world[judged], cycles.normal_world[judged])
    return NormalAgreement(
        pixels=int(judged.sum()),
        creased=int((shared & creases).sum()),
        within=float((errors <= NORMAL_TOLERANCE_DEG).mean()) if len(errors) else float("nan"),
        median_deg=float(np.median(errors)) if len(errors) else float("nan"),
        worst_deg=float(errors.max()) if len(errors) else float("nan"),
    )


def crease(normals: NDArray[np.float32]) -> NDArray[np.bool_]:
    """(H, W) bool: one of the eight neighbours' normals is CREASE_DEG away or more."""
    padded = np.pad(normals, ((1, 1), (1, 1), (0, 0)), mode="edge")
    height, width = normals.shape[:2]
    found = np.zeros((height, width), bool)
    for row in range(3):
        for column in range(3):
            other = padded[row : row + height, column : column + width]
            found |= ~(angle_deg(normals, other) < CREASE_DEG)
    return found


def angle_deg(one: NDArray[np.float32], other: NDArray[np.float32]) -> NDArray[np.float64]:
    """Angles between vectors, exact for small ones; 180 where one is 0."""
    a, b = one.astype(np.float64), other.astype(np.float64)
    sine, cosine = np.linalg.norm(np.cross(a, b), axis=-1), (a * b).sum(axis=-1)
    return np.where((sine == 0) & (cosine == 0), 180.0, np.degrees(np.arctan2(sine, cosine)))


def _tied(one: NDArray[np.float32], other: NDArray[np.float32]) -> NDArray[np.bool_]:
    both = np.isfinite(one) & np.isfinite(other)
    a, b = np.where(both, one, 0.0), np.where(both, other, 1.0)
    return np.asarray(np.abs(a - b) < TIE * b)


def silhouette(ids: NDArray[np.int32]) -> NDArray[np.bool_]:
    """(H, W) bool: one of the eight neighbours carries another id."""
    padded = np.pad(ids, 1, mode="edge")
    height, width = ids.shape
    edge = np.zeros(ids.shape, bool)
    for row in range(3):
        for column in range(3):
            edge |= padded[row : row + height, column : column + width] != ids
    return edge


def _differing(
    mine: NDArray[np.int32], theirs: NDArray[np.int32], where: NDArray[np.bool_], names: list[str]
) -> tuple[tuple[str, str, int], ...]:
    pairs, counts = np.unique(
        np.stack([mine[where], theirs[where]], axis=-1).reshape(-1, 2), axis=0, return_counts=True
    )
    named = [*names, "-"]
    rows = [
        (named[a], named[b], n) for (a, b), n in zip(pairs.tolist(), counts.tolist(), strict=True)
    ]
    return tuple(sorted(rows, key=lambda row: -row[2]))
