"""A BOP folder and a file of results, read and checked."""

from __future__ import annotations

import csv
import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Final

import cv2
import numpy as np
from numpy.typing import NDArray

from legoworld.errors import LegoWorldError, cause
from legoworld.evaluation.pose.errors import Floats, Model, Photo, symmetries

COLUMNS: Final = ("scene_id", "im_id", "obj_id", "score", "R", "t")
_PLY_TYPES: Final = {
    "char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4",
    "float": "f4", "double": "f8", "int8": "i1", "uint8": "u1", "int32": "i4", "uint32": "u4",
    "float32": "f4", "float64": "f8",
}  # fmt: skip


class PoseInputError(LegoWorldError):
    """A BOP folder or a file of poses cannot be scored."""

    code = "pose_input"


@dataclass(frozen=True, kw_only=True)
class Estimate:
    """A line of results: a pose (3, 4) of an object in an image."""

    scene_id: int
    im_id: int
    obj_id: int
    score: float
    pose: Floats


@dataclass(frozen=True, kw_only=True)
class TruePose:
    """An annotated instance. visible: its visib_fract."""

    obj_id: int
    pose: Floats
    visible: float


@dataclass(frozen=True)
class BopFolder:
    """models/ and the scenes of one split, such as test/."""

    folder: Path
    split: str = "test"

    def images(self) -> list[tuple[int, int]]:
        """Scene and image ids, ascending. PoseInputError if there is no scene."""
        scenes = sorted(p for p in (self.folder / self.split).glob("[0-9]*") if p.is_dir())
        if not scenes:
            raise PoseInputError(
                f"{self.folder} is no BOP dataset",
                found=f"no {self.split}/000001 in it",
                expected="models/ and test/<scene>/ with scene_camera.json and scene_gt.json",
            )
        return [
            (int(p.name), image)
            for p in scenes
            for image in sorted(map(int, _json(p / "scene_gt.json")))
        ]

    def photo(self, scene_id: int, im_id: int) -> Photo:
        """Camera and depth of an image. PoseInputError for a depth that cannot be read."""
        scene = self._scene(scene_id)
        camera = _of_image(scene / "scene_camera.json", im_id)
        path = scene / "depth" / f"{im_id:06}.png"
        depth = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
        if depth is None:
            raise PoseInputError(f"{path} cannot be read", expected="a 16-bit PNG of depth")
        scale = float(camera.get("depth_scale", 1.0))
        k = np.array(camera["cam_K"], np.float64).reshape(3, 3)
        return Photo(intrinsics=k, depth_mm=depth.astype(np.float64) * scale)

    def truths(self, scene_id: int, im_id: int) -> list[TruePose]:
        """The annotated poses of an image, in the file's order."""
        scene = self._scene(scene_id)
        info = _of_image(scene / "scene_gt_info.json", im_id)
        given = _of_image(scene / "scene_gt.json", im_id)
        return [
            TruePose(
                obj_id=int(one["obj_id"]),
                pose=_pose(one["cam_R_m2c"], one["cam_t_m2c"]),
                visible=float(about["visib_fract"]),
            )
            for one, about in zip(given, info, strict=True)
        ]

    def model(self, obj_id: int) -> Model:
        """A model with its symmetries. PoseInputError for an unknown object."""
        info = self._models_info.get(str(obj_id))
        if info is None:
            raise PoseInputError(f"models_info.json has no object {obj_id}")
        vertices, triangles = read_ply(self.folder / "models" / f"obj_{obj_id:06}.ply")
        return Model(
            vertices=vertices,
            triangles=triangles,
            diameter=float(info["diameter"]),
            symmetries=symmetries(info),
        )

    def _scene(self, scene_id: int) -> Path:
        return self.folder / self.split / f"{scene_id:06}"

    @cached_property
    def _models_info(self) -> Mapping[str, Any]:
        found: Mapping[str, Any] = _json(self.folder / "models" / "models_info.json")
        return found


def read_results(path: Path) -> Iterator[Estimate]:
    """The lines of a BOP19 results file. PoseInputError names the first that is none."""
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, ValueError) as error:
        raise PoseInputError(f"{path} cannot be read", found=cause(error)) from error
    for number, row in enumerate(csv.DictReader(text.splitlines()), start=2):
        try:
            pose = _pose(*([float(v) for v in row[key].split()] for key in ("R", "t")))
            turn = pose[:, :3]
            if np.abs(turn @ turn.T - np.eye(3)).max() > 1e-3 or np.linalg.det(turn) < 0:
                raise ValueError("R is no rotation")
            ids = (int(row[key]) for key in COLUMNS[:3])
            scene_id, im_id, obj_id = ids
            score = float(row["score"])
        except (KeyError, ValueError, AttributeError, TypeError) as error:
            raise PoseInputError(
                f"line {number} of {path.name} cannot be scored",
                found=cause(error),
                expected=f"{', '.join(COLUMNS)}: nine numbers of R by rows, t in millimetres",
            ) from error
        yield Estimate(scene_id=scene_id, im_id=im_id, obj_id=obj_id, score=score, pose=pose)


def read_ply(path: Path) -> tuple[NDArray[np.float32], NDArray[np.int32]]:
    """(V, 3) vertices and (F, 3) triangles of a PLY, text or little-endian. PoseInputError."""
    try:
        head, _, body = path.read_bytes().partition(b"end_header\n")
        lines = [line.split() for line in head.decode("ascii").splitlines()]
        text = ["format", "ascii", "1.0"] in lines
        counts = {line[1]: int(line[2]) for line in lines if line[0] == "element"}
        names = [line[2] for line in lines if line[0] == "property" and line[1] != "list"]
        types = [line[1] for line in lines if line[0] == "property" and line[1] != "list"]
        if text:
            values = body.split()
            wide = len(names)
            rows = np.array(values[: counts["vertex"] * wide], np.float64).reshape(-1, wide)
            vertices = rows[:, [names.index(axis) for axis in "xyz"]]
            faces = np.array(values[counts["vertex"] * wide :], np.int64).reshape(-1, 4)[:, 1:]
        else:
            kind = np.dtype([(n, "<" + _PLY_TYPES[t]) for n, t in zip(names, types, strict=True)])
            table = np.frombuffer(body, kind, counts["vertex"])
            vertices = np.stack([table[axis] for axis in "xyz"], axis=1)
            face = np.dtype([("n", "u1"), ("v", "<i4", 3)])
            faces = np.frombuffer(body, face, counts["face"], table.nbytes)["v"]
    except (OSError, ValueError, KeyError, IndexError) as error:
        raise PoseInputError(
            f"{path.name} cannot be read",
            found=cause(error),
            expected="a PLY of triangles, ascii or binary_little_endian",
        ) from error
    return np.ascontiguousarray(vertices, np.float32), np.ascontiguousarray(faces, np.int32)


def _pose(rotation: Sequence[float], translation: Sequence[float]) -> Floats:
    turn = np.array(rotation, np.float64).reshape(3, 3)
    return np.column_stack([turn, np.array(translation, np.float64).reshape(3)])


def _of_image(path: Path, im_id: int) -> Any:
    entry = _json(path).get(str(im_id))
    if entry is None:
        raise PoseInputError(f"{path} has no entry", found=f"no image {im_id}")
    return entry


def _json(path: Path) -> Any:
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise PoseInputError(f"{path} cannot be read", found=cause(error)) from error
