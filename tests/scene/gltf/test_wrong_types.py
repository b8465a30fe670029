"""A member of another JSON type than glTF gives it: the verdict names its place, if it is read."""

from __future__ import annotations

import copy
import json
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from scene.gltf.documents import Document, glb_of, read

from legoworld.scene.gltf.verdicts import UnreadableGltfError

Path = tuple[str | int, ...]


def rich() -> Document:
    """A picture with a transform, a sparse accessor, instances, a group, two cameras, labels."""
    made = Document()
    number = made.texture(np.full((2, 2), 255))
    info = {"index": number, "texCoord": 0,
            "extensions": {"KHR_texture_transform": {"offset": [0, 0], "scale": [1, 1],
                                                     "rotation": 0, "texCoord": 0}}}  # fmt: skip
    color = {"baseColorTexture": info, "baseColorFactor": [1, 1, 1, 1]}
    material = {"alphaMode": "MASK", "alphaCutoff": 0.5, "pbrMetallicRoughness": color,
                "doubleSided": True}  # fmt: skip
    card = made.textured_quad(material, [(0, 1), (1, 1), (1, 0), (0, 0)])
    made.json["nodes"][card]["extras"] = {"category": "cat"}
    thing = made.quad("Many", -20, -20)
    accessor = made.json["accessors"][
        made.json["meshes"][1]["primitives"][0]["attributes"]["POSITION"]
    ]
    accessor["sparse"] = {
        "count": 1,
        "indices": {"bufferView": made.view(b"\0\0"), "componentType": 5123, "byteOffset": 0},
        "values": {"bufferView": made.view(np.float32([-20, -20, 0]).tobytes()), "byteOffset": 0},
    }
    places = {"TRANSLATION": made.accessor([[0, 0, 0], [10, 0, 0]])}
    made.json["nodes"][thing]["extensions"] = {"EXT_mesh_gpu_instancing": {"attributes": places}}
    group = made.node(name="Group", children=[], rotation=[0, 0, 0, 1], scale=[1, 1, 1])
    child = made.quad("Child", 20, 20)
    made.json["scenes"][0]["nodes"].remove(child)
    made.json["nodes"][group]["children"] = [child]
    made.json["nodes"][child]["matrix"] = np.eye(4).ravel().tolist()
    made.json["extensionsUsed"] = ["KHR_texture_transform", "EXT_mesh_gpu_instancing"]
    made.json["extensionsRequired"] = ["EXT_mesh_gpu_instancing"]
    made.json["buffers"] = [{"byteLength": len(made.binary)}]
    return made


def members(value: Any, path: Path = ()) -> Iterator[Path]:
    pairs = value.items() if isinstance(value, dict) else enumerate(value)
    for key, inner in pairs:
        yield (*path, key)
        if isinstance(inner, dict | list):
            yield from members(inner, (*path, key))


def change_value(document: dict[str, Any], path: Path, value: Any) -> dict[str, Any]:
    whole = copy.deepcopy(document)
    holder: Any = whole
    for key in path[:-1]:
        holder = holder[key]
    holder[path[-1]] = value
    return whole


def path_words(path: Path) -> str:
    words = (f"[{key}]" if isinstance(key, int) else f".{key}" for key in path)
    return "".join(words).removeprefix(".")


MADE = rich()
MEMBERS = [*members(MADE.json)]
#: Labels are looked at where they are texts; a picture tells its format itself.
UNREAD = {
    "nodes[1].extras", "nodes[1].extras.category", "images[0].mimeType", "materials[0].doubleSided"
}  # fmt: skip


def test_the_document_itself_is_read():
    assert len(read(MADE.glb()).surface_mesh) == 4


@pytest.mark.parametrize("path", MEMBERS, ids=path_words)
def test_a_member_of_another_type(path):
    value: Any = MADE.json
    for key in path:
        value = value[key]
    others = [v for v in (3, "text", [], {}, None) if type(v) is not type(value)]
    if isinstance(value, int | float):
        others = [v for v in others if not isinstance(v, int)]
    refused = []
    for other in others:
        text = json.dumps(change_value(MADE.json, path, other)).encode()
        try:
            read(glb_of(text, bytes(MADE.binary)))
        except UnreadableGltfError as error:
            refused.append(str(error))
    if path_words(path) in UNREAD:
        assert refused == []
        return
    assert len(refused) == len(others)
    name = [str(key) for key in path if isinstance(key, str)][-1]
    if len(path) == 1:  # without a list of these, a node's index leads nowhere
        name = {"cameras": "nodes[0].camera", "meshes": "nodes[1].mesh"}.get(name, name)
    assert f"{name} is " in refused[0]
