"""Seeded damage to a .glb: what an interrupted copy, a bad disk or an exporter's bug leaves."""

from __future__ import annotations

import json
import struct
import time
from pathlib import Path

import numpy as np
from scene.gltf.documents import Document, glb_of, png_of_alpha

from legoworld.errors import LegoWorldError
from legoworld.scene.gltf.container import parse_glb
from legoworld.scene.gltf.snapshot import read_glb_snapshot
from legoworld.scene.instances import group
from legoworld.scene.labels import resolve_labels
from legoworld.visibility.view import view

KINDS = ("truncation", "bits", "bytes", "lengths", "numbers", "deletion", "swap", "duplication")


def rich_glb() -> bytes:
    """A file that uses everything the reader reads, Draco aside."""
    made = Document()
    made.json["extensionsUsed"] = ["KHR_mesh_quantization"]
    card = [(0, 1), (1, 1), (1, 0), (0, 0)]
    info = {"index": made.texture(np.arange(64).reshape(8, 8) * 4, wrapS=33071, wrapT=33648)}
    info["extensions"] = {"KHR_texture_transform": {"offset": [0.1, 0], "rotation": 0.3}}
    color = {"baseColorTexture": info}
    material = {"alphaMode": "MASK", "alphaCutoff": 0.4, "pbrMetallicRoughness": color}
    made.textured_quad(material, card, side=16)
    leaf = made.quad("Leaf", -8, 0, root=False, extras={"category": "leaf"})
    made.node(name="Plant", children=[leaf], rotation=[0, 0, 0.5, 0.8], scale=[-1, 2, 1])
    spread = {"TRANSLATION": made.accessor([(0, 0, 0), (9, 0, 0), (0, 9, 0)])}
    made.quad("Crowd", -30, -30, extensions={"EXT_mesh_gpu_instancing": {"attributes": spread}})
    target = made.accessor(np.tile([3.0, 0, 0], (4, 1)))
    joints = {
        "JOINTS_0": made.accessor([[0, 1, 0, 0]] * 4, "u1"),
        "WEIGHTS_0": made.accessor([[0.5, 0.5, 0, 0]] * 4),
    }
    corners = [(0, -9, 0), (8, -9, 0), (8, -1, 0), (0, -1, 0)]
    posed = made.mesh(corners, [0, 1, 3, 2], mode=5, attributes=joints,
                      targets=[{"POSITION": target}])  # fmt: skip
    made.json["meshes"][posed]["weights"] = [0.5]
    bones = [made.node(name=f"Bone{i}", translation=[i, 0, 0]) for i in range(2)]
    bind = made.accessor(np.tile(np.eye(4).reshape(1, 16), (2, 1)))
    made.add("skins", joints=bones, inverseBindMatrices=bind)
    made.node(name="Posed", mesh=posed, skin=0)
    sparse = {
        "count": 1,
        "indices": {"bufferView": made.view(struct.pack("<H", 2)), "componentType": 5123},
        "values": {"bufferView": made.view(struct.pack("<3f", 20, 28, 0))},
    }
    moved = made.accessor([(12, 20, 0), (20, 20, 0), (0, 0, 0), (12, 28, 0)], sparse=sparse)
    primitive = {"attributes": {"POSITION": moved}, "mode": 6}
    made.node(name="Sparse", mesh=made.add("meshes", primitives=[primitive]))
    made.picture(png_of_alpha([[1, 2]]), "image/png")
    return made.glb()


def mutant(whole: bytes, seed: int) -> tuple[str, bytes]:
    """The kind of damage and the damaged file; the same for the same seed."""
    rng = np.random.default_rng(seed)
    kind = KINDS[seed % len(KINDS)]
    data = bytearray(whole)
    n = len(data)
    # Half of the damage goes to the arrays alone: one wrong byte of JSON is soon found out.
    first = 28 + struct.unpack_from("<I", data, 12)[0] if rng.random() < 0.5 else 0
    if kind == "truncation":
        data = data[: int(rng.integers(0, n))]
        if rng.random() < 0.5 and len(data) >= 12:  # with a header that says so
            data[8:12] = struct.pack("<I", len(data))
    elif kind == "bits":
        for _ in range(int(rng.integers(1, 30))):
            data[int(rng.integers(first, n))] ^= 1 << int(rng.integers(0, 8))
    elif kind == "bytes":
        start = int(rng.integers(first, n))
        data[start : start + 16] = rng.bytes(len(data[start : start + 16]))
    elif kind == "lengths":
        json_length = struct.unpack_from("<I", data, 12)[0]
        places = [8, 12, 20 + json_length]
        a, b = rng.choice(places, 2)
        data[a : a + 4], data[b : b + 4] = data[b : b + 4], data[a : a + 4]
        if a == b:
            data[a : a + 4] = rng.bytes(4)
    else:
        return kind, _json_mutant(whole, kind, rng)
    return kind, bytes(data)


def _json_mutant(whole: bytes, kind: str, rng: np.random.Generator) -> bytes:
    """Damage inside the JSON: a sound container around a document that lies."""
    length = struct.unpack_from("<I", whole, 12)[0]
    document = json.loads(whole[20 : 20 + length])
    for _ in range(1 if kind == "duplication" else int(rng.integers(1, 4))):
        places = list(_places(document))
        holder, key = places[int(rng.integers(0, len(places)))]
        if kind == "numbers":
            holder[key] = _ODD[int(rng.integers(0, len(_ODD)))]
        elif kind == "deletion":
            del holder[key]
        elif kind == "swap":
            other, name = places[int(rng.integers(0, len(places)))]
            holder[key], other[name] = other[name], holder[key]
            try:
                json.dumps(document)
            except ValueError:  # it now holds itself
                holder[key], other[name] = 0, 0
        else:
            room = (1 << 20) // len(json.dumps(holder[key]))
            holder[key] = [holder[key]] * int(rng.integers(2, max(3, min(2000, room))))
    return glb_of(json.dumps(document).encode(), whole[28 + length :])


_ODD = (0, -1, 1, 2, 255, 2**31, 2**32, 2**53, 2**63, 10**30, 0.5, -0.0, 1e-300, 1e308, None,
        True, "", "x", [], {}, [0], [[]], {"a": 1})  # fmt: skip


def _places(value):
    if isinstance(value, dict):
        for key in list(value):
            yield value, key
            yield from _places(value[key])
    elif isinstance(value, list):
        for i in range(len(value)):
            yield value, i
            yield from _places(value[i])


def outcome(data: bytes, folder: Path) -> tuple[str, float]:
    """("ok" or the verdict's code, CPU seconds) of reading a file and looking at it once.

    A verdict of more than one line is a code of its own, which no test expects.
    """
    started = time.thread_time()
    try:
        snapshot = read_glb_snapshot(parse_glb(data), folder)
        snapshot.content_sha256()
        grouping = group(snapshot, resolve_labels(snapshot, (), None, None))
        seen = view(snapshot, grouping, (64, 64), threads=1)
        assert seen.buffers.instance.shape == (64, 64)
        code = "ok"
    except LegoWorldError as verdict:
        code = verdict.code if "\n" not in str(verdict) else "several lines"
    return code, time.thread_time() - started
