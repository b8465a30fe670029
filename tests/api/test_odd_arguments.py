"""The Python API with values that no caller should pass: always a LegoWorldError."""

from __future__ import annotations

import inspect
import math
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, Final

import numpy as np
import pytest

import legoworld
from legoworld.api.arguments import CHECKS
from legoworld.errors import LegoWorldError, UsageError

SCENES = Path(__file__).parents[2] / "examples"
COFFEE = SCENES / "coffee"
NAN, INF = math.nan, math.inf
NO_PATHS: Final = ("", "a\0b", "\ud800", "n" * 5000, "d/" * 3000, 7, None, b"x", ["x"], NAN)
NO_COUNTS: Final = (0, -1, True, 1.5, "2", NAN, INF, 10**400, [1], np.float64(2))
NO_NUMBERS: Final = (0, -1.0, True, "2", NAN, INF, None, 10**400)
NO_SIZES: Final = (640, (640,), (640, 0), (640, -1), (640.0, 480.0), "640x480", (True, 1),
                   (1, 1, 1), (9000, 1), {1, 2}, np.zeros((2, 2)), (NAN, 1))  # fmt: skip
#: Values for each argument that no function can use.
ODD: Final[dict[str, tuple[Any, ...]]] = {
    **dict.fromkeys(("scenes", "output", "folder", "run", "truth"), NO_PATHS),
    "track": tuple(v for v in NO_PATHS if v is not None),
    "cache": (*(v for v in NO_PATHS if v is not None), np.True_),
    "photo": ("a\0b", 7, np.zeros((2, 2, 3)), np.zeros((2, 2), np.uint8), np.zeros(0, np.uint8)),
    "evaluations": (7, "one", ["a\0b"], [7], {"a": 1}, None),
    "task": (7, "no such task", "coco\0", "\ud800", [], b"coco"),
    "source": ("usd", None, 7, []),
    "engine": ("slurm", None, 7),
    "evaluator": ("mine", 7),
    "camera_model": ("pinhole", 7),
    "reference_sampling": (7, []),
    "sky": (7, []),
    "vocabulary": (7, [], "no such vocabulary"),
    "variant": ("smooth", 7, []),
    "size_wh": NO_SIZES,
    "shard": ((0, 1), (2, 1), 1, (1,), (1.0, 2), ("1", "2"), (True, 2), "1/2"),
    "image_ids": ((-1,), ("1",), (1.5,), (NAN,), 3, "12", (None,), (10**400,)),
    "image_id": (-1, 1.5, "1", None, NAN, 10**400),
    "instance_id": (-1, 10**9, 1.5, "1", None, NAN, 10**400),
    "n": NO_COUNTS,
    "form": ("coco", 7, None),
    "arrays": ("jax", 7, None),
    "radius": tuple(v for v in NO_NUMBERS if v is not None),
    "ortho_scale": tuple(v for v in NO_NUMBERS if v is not None),
    "fov_deg": (0, 180, -1, NAN, True, "50", 10**400),
    "elevation_deg": (-90, 90, NAN, True, "20", None),
    "clip": (1, (1,), (2, 1), (0, 1), (-1, 1), (1, INF), (NAN, 1), "12", (True, 2)),
    "camera": (7, "no such camera", b"Camera", ("Camera",), NAN),
    "fail_below": ("AP=0", 7, [7], ["AP"], ["AP=x"], ["no=1"]),
    **dict.fromkeys(("workers", "limit", "images_per_file", "max_side", "draws"), NO_COUNTS),
    "seed": (-1, True, 1.5, "2", None, NAN),
    **dict.fromkeys(("time_limit_s", "memory_limit_gib"), NO_NUMBERS),
}
#: Methods of a view that take arguments.
METHODS: Final = (
    "normals", "mask", "panoptic", "semantic", "predictions", "targets", "overlay", "save",
)  # fmt: skip
#: What each public function is called with besides.
CALLS: Final[dict[str, tuple[Callable[..., Any], dict[str, Any]]]] = {
    "open_scene": (legoworld.open_scene, {"folder": COFFEE}),
    "Reader": (legoworld.Reader, {}),
    "readout": (legoworld.readout, {"scenes": SCENES, "output": "run", "task": "coco"}),
    "evaluate": (legoworld.evaluate, {"run": "run", "output": "out", "truth": "truth.json"}),
    "compare": (legoworld.compare, {"evaluations": ["a", "b"], "output": "out"}),
    "Evaluation.open": (legoworld.Evaluation.open, {"folder": "none"}),
    "orbit": (legoworld.orbit, {"centre": (0, 0, 0), "radius": 1, "n": 2}),
    "read_cameras": (legoworld.read_cameras, {"path": "none"}),
}


def cases(calls: dict[str, tuple[Callable[..., Any], dict[str, Any]]]) -> Iterator[Any]:
    for name, (call, given) in calls.items():
        for argument in inspect.signature(call).parameters:
            for odd in ODD.get(argument, ()):
                yield pytest.param(call, {**given, argument: odd}, id=f"{name} {argument}")


@pytest.fixture(scope="module")
def scene() -> legoworld.Scene:
    return legoworld.open_scene(COFFEE)


@pytest.fixture(scope="module")
def view(scene: legoworld.Scene) -> legoworld.SceneView:
    return scene.view(task="coco", size_wh=(30, 20))


@pytest.mark.parametrize(("call", "arguments"), list(cases(CALLS)))
def test_an_odd_value_is_an_error_of_ours(
    call: Callable[..., Any],
    arguments: dict[str, Any],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(LegoWorldError) as caught:
        call(**arguments)
    assert len(str(caught.value)) < 1000
    assert list(tmp_path.iterdir()) == [], "nothing is written before"


@pytest.mark.parametrize("name", ["view", *METHODS])
def test_an_odd_value_of_a_method(
    name: str, scene: legoworld.Scene, view: legoworld.SceneView, tmp_path: Path
) -> None:
    call = getattr(scene if name == "view" else view, name)
    arguments = [a for a in inspect.signature(call).parameters if a in ODD]
    assert arguments
    for argument in arguments:
        given = {"folder": tmp_path / "out"} if name == "save" else {}
        for odd in ODD[argument]:
            with pytest.raises(LegoWorldError):
                call(**{**given, argument: odd})


def test_a_reader_refuses_odd_scenes_and_sizes() -> None:
    with legoworld.Reader(workers=1) as reader:
        for odd in (*NO_PATHS[1:], "ab"):
            with pytest.raises(UsageError):
                list(reader.read(odd if odd == "ab" else [odd]))  # type: ignore[arg-type,list-item]
        for size in NO_SIZES:
            with pytest.raises(UsageError, match="size_wh"):
                list(reader.read([COFFEE], size_wh=size))  # type: ignore[arg-type]


def test_every_argument_of_the_api_is_checked_or_a_switch() -> None:
    functions = [call for call, _ in CALLS.values()]
    functions += [legoworld.Scene.view, legoworld.Reader.read]
    functions += [getattr(legoworld.SceneView, name) for name in METHODS]
    names = {p.name: p for f in functions for p in inspect.signature(f).parameters.values()}
    switches = {n for n, p in names.items() if p.default is True or p.default is False}
    unchecked = set(names) - set(CHECKS) - switches
    unchecked -= {"self", "listener", "started"}  # not a caller's to get wrong
    unchecked -= {"camera", "centre", "path"}  # checked where they are used
    assert not unchecked
    assert set(CHECKS) <= set(ODD)


def test_numbers_of_numpy_are_numbers(scene: legoworld.Scene) -> None:
    view = scene.view(task="coco", size_wh=(np.int64(30), np.int32(20)))  # type: ignore[arg-type]
    assert view.size_wh == (30, 20)
    assert view.mask(np.int64(0)).shape == (20, 30)  # type: ignore[arg-type]
