"""Draco-compressed primitives (KHR_draco_mesh_compression), decoded in a separate process.

A native decoder of untrusted bytes may crash, hang or exhaust memory; in a process with limits each
of these is a verdict on the file. The decoder is Google's, through DracoPy, an optional dependency.
"""

from __future__ import annotations

import importlib.util
import json
import os
import sys
from collections.abc import Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from legoworld import extras
from legoworld.errors import one_line
from legoworld.scene.gltf.verdicts import Budget, UnsupportedGltfError, unreadable
from legoworld.workers.child_process import ChildProcess
from legoworld.workers.environment import ChildKind, child_environment, python_path

EXTENSION: Final = "KHR_draco_mesh_compression"
_WORKER: Final = Path(__file__).with_name("draco_worker.py")
_TIME_LIMIT_S: Final = 60.0
_DTYPES: Final = ("<i1", "|i1", "<u1", "|u1", "<i2", "<u2", "<i4", "<u4", "<f4")


@dataclass(frozen=True, kw_only=True)
class DracoPayload:
    """Compressed bytes and the unique ids of the requested attributes."""

    place: str
    data: bytes
    attributes: tuple[int, ...]


@dataclass(frozen=True, kw_only=True)
class DracoMesh:
    """triangles: (T, 3) uint32; attributes: (V, components) arrays by unique id."""

    triangles: NDArray[np.uint32]
    attributes: dict[int, NDArray[Any]]


def decode(payloads: Sequence[DracoPayload], budget: Budget) -> list[DracoMesh]:
    """Decode all payloads of a file in one process.

    Raises UnsupportedGltfError when no decoder is installed, UnreadableGltfError when the decoder
    refuses the data, crashes, or needs more than the file's budget or a minute.
    """
    if importlib.util.find_spec("DracoPy") is None:
        raise UnsupportedGltfError(
            "scene.glb is Draco-compressed and no decoder is installed",
            found=EXTENSION,
            expected="the optional package DracoPy",
            next_step=f"{extras.install_command('draco')}, export without Draco, or use --source "
            "blend",
        )
    request = {
        "limit_bytes": budget.bytes_left,
        "payloads": [[len(p.data), list(p.attributes)] for p in payloads],
    }
    input_bytes = b"".join([json.dumps(request).encode() + b"\n", *(p.data for p in payloads)])
    answers, body = _run_decoder(input_bytes)
    return _answers(payloads, answers, body, budget)


def _run_decoder(input_bytes: bytes) -> tuple[list[Any], memoryview]:
    """The answers of the decoder's process, and the bytes of the arrays."""
    with closing(ChildProcess([sys.executable, "-P", str(_WORKER)], _environment())) as process:
        try:
            output = process.output_for(input_bytes, _TIME_LIMIT_S)
        except TimeoutError as error:
            limit = f"{_TIME_LIMIT_S:g} s"
            raise unreadable(f"its Draco data did not decode in {limit}") from error
        header, _, body = output.partition(b"\n")
        if (code := process.exit_code()) != 0 or not header:
            words = one_line(process.last_words(), 120)
            raise unreadable(f"the Draco decoder ended with {code}: {words}")
    return json.loads(header), memoryview(body)


def _environment() -> dict[str, str]:
    """Only the location of the caller's packages: the data is untrusted."""
    nowhere = Path(os.devnull)  # it writes no file
    return child_environment(ChildKind.BLENDER, home=nowhere, temporary=nowhere) | {
        "PYTHONPATH": python_path(),
        # numpy's thread pools would count against the memory limit.
        "OPENBLAS_NUM_THREADS": "1",
        "OMP_NUM_THREADS": "1",
    }


def _answers(
    payloads: Sequence[DracoPayload],
    answers: Sequence[str | Sequence[tuple[str, tuple[int, int]]]],
    body: memoryview,
    budget: Budget,
) -> list[DracoMesh]:
    budget.take(len(body), "Draco data")
    meshes, offset = [], 0
    for payload, answer in zip(payloads, answers, strict=True):
        if isinstance(answer, str):
            raise unreadable(
                f"{payload.place}: Draco data does not decode: {one_line(answer, 120)}"
            )
        arrays = []
        for dtype, shape in answer:
            if dtype not in _DTYPES:
                raise unreadable(f"{payload.place}: a Draco attribute of type {dtype}")
            size = np.dtype(dtype).itemsize * shape[0] * shape[1]
            arrays.append(np.frombuffer(body[offset : offset + size], dtype).reshape(shape))
            offset += size
        meshes.append(
            DracoMesh(
                triangles=arrays[0],
                attributes=dict(zip(payload.attributes, arrays[1:], strict=True)),
            )
        )
    return meshes
