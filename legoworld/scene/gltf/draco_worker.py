"""The process that decodes Draco data: a script, so that it imports nothing but the decoder.

Standard input: one line of JSON, {"limit_bytes", "payloads": [[length, [attribute ids]]]}, and the
payloads. Standard output: one line of JSON, per payload a list of [dtype, [rows, columns]] (the
triangles first) or an error text, then the arrays' bytes, concatenated.
"""

from __future__ import annotations

import contextlib
import importlib
import json
import sys
from typing import Any

_TIME_LIMIT_S = 60
_OWN_BYTES = 1 << 30  # the interpreter, numpy and the decoder's work space


def main() -> None:
    """Answer one request."""
    request = json.loads(sys.stdin.buffer.readline())
    _limit_self(request["limit_bytes"] + _OWN_BYTES)
    answers: list[Any] = []
    written: list[bytes] = []
    left = request["limit_bytes"]
    for length, attributes in request["payloads"]:
        try:
            arrays = _decode_mesh(sys.stdin.buffer.read(length), attributes)
        except Exception as error:  # noqa: BLE001  whatever the decoder says is the verdict
            answers.append(f"{type(error).__name__} {error}")
            break
        left -= sum(a.nbytes for a in arrays)
        if left < 0:
            answers.append("larger than a file of this size may be")
            break
        answers.append([[a.dtype.str, list(a.shape)] for a in arrays])
        written += [a.tobytes() for a in arrays]
    answers += ["not decoded"] * (len(request["payloads"]) - len(answers))
    sys.stdout.buffer.write(json.dumps(answers).encode() + b"\n" + b"".join(written))


def _decode_mesh(data: bytes, attributes: list[int]) -> list[Any]:
    import numpy as np

    mesh: Any = importlib.import_module("DracoPy").decode(data)
    faces = getattr(mesh, "faces", None)
    if faces is None:
        raise ValueError("a point cloud")
    arrays = [np.ascontiguousarray(faces, np.uint32).reshape(-1, 3)]
    data_of = {a["unique_id"]: a["data"] for a in mesh.attributes}
    for unique_id in attributes:
        values = np.ascontiguousarray(data_of[unique_id])
        arrays.append(values.reshape(len(values), -1))
    return arrays


def _limit_self(memory_bytes: int) -> None:
    """Cap memory and processor time where the system can; the caller's time limit holds always."""
    try:
        import resource
    except ImportError:  # not on this system
        return
    with contextlib.suppress(ValueError, OSError):
        resource.setrlimit(resource.RLIMIT_AS, (memory_bytes, memory_bytes))
        resource.setrlimit(resource.RLIMIT_CPU, (_TIME_LIMIT_S, _TIME_LIMIT_S))
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))


if __name__ == "__main__":
    main()
