"""The node hierarchy of the shown scene, and the world matrix of each node.

glTF 2.0 specification, 3.5. World matrices are in glTF's own axes (y up) here; `BLENDER_FROM_GLTF`
turns them into Blender's, (x, y, z) -> (x, -z, y), as Blender's importer does.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from legoworld.conventions import CATEGORY_KEY
from legoworld.errors import NonFiniteGeometryError
from legoworld.files import Json
from legoworld.scene.gltf.fields import Fields
from legoworld.scene.gltf.verdicts import UnreadableGltfError, unreadable

BLENDER_FROM_GLTF: Final = np.array(
    [[1.0, 0.0, 0.0, 0.0], [0.0, 0.0, -1.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]]
)

#: Matrices beyond this are not a place: the kernel multiplies three such numbers.
_LARGEST: Final = 1e20


@dataclass(frozen=True, kw_only=True)
class Node:
    """One node of the scene. parent: index of a node, -1 for none; mesh, skin, camera likewise."""

    index: int
    name: str
    parent: int
    mesh: int
    skin: int
    camera: int
    visible: bool
    properties: dict[str, str]  # extras that are labels, as text
    fields: Fields

    @property
    def type(self) -> str:
        """The object type that Blender's importer creates."""
        if self.mesh >= 0:
            return "MESH"
        if self.camera >= 0:
            return "CAMERA"
        return "EMPTY" if self.fields.extension("KHR_lights_punctual") is None else "LIGHT"


@dataclass(frozen=True, kw_only=True)
class Tree:
    """The shown scene: its nodes, parents before children, in the file's order.

    world_from_node: (N, 4, 4) float64 by node index, also of nodes outside the scene.
    """

    scene_name: str
    nodes: tuple[Node, ...]
    world_from_node: NDArray[np.float64]
    warnings: tuple[str, ...]


def node_tree(document: Fields) -> Tree:
    """Read the hierarchy. Raises UnreadableGltfError for cycles and nodes with two parents.

    NonFiniteGeometryError if a node's world matrix is not finite.
    """
    fields = document.children("nodes")
    children = [f.indices("children", len(fields)) for f in fields]
    parent = _parents(fields, children)
    levels = _levels(parent, children)
    world = _world_matrices(fields, parent, levels)
    scene_name, roots, warnings = _roots(document, parent)
    nodes = []
    stack = [(root, True) for root in reversed(roots)]
    while stack:
        index, visible = stack.pop()
        node = _node(document, fields[index], index, parent[index], visible=visible)
        nodes.append(node)
        stack += [(child, node.visible) for child in reversed(children[index])]
    for node in nodes:
        if not (np.abs(world[node.index]) <= _LARGEST).all():
            raise NonFiniteGeometryError(
                f"node {node.name!r} stands nowhere",
                found="its world matrix holds NaN, infinity or a number beyond 1e20",
                expected="finite numbers",
                next_step="correct its translation, rotation, scale or matrix",
            )
    return Tree(scene_name=scene_name, nodes=tuple(nodes), world_from_node=world, warnings=warnings)


def transforms(
    translation: NDArray[np.float64], rotation: NDArray[np.float64], scale: NDArray[np.float64]
) -> NDArray[np.float64]:
    """(N, 4, 4) matrices T * R * S; rotation (N, 4) are quaternions x, y, z, w of any length > 0.

    A quaternion of length 0 gives NaN.
    """
    with np.errstate(all="ignore"):
        x, y, z, w = (rotation / np.linalg.norm(rotation, axis=1, keepdims=True)).T
        matrix = np.zeros((len(translation), 4, 4))
        matrix[:, 0, 0] = 1 - 2 * (y * y + z * z)
        matrix[:, 0, 1] = 2 * (x * y - z * w)
        matrix[:, 0, 2] = 2 * (x * z + y * w)
        matrix[:, 1, 0] = 2 * (x * y + z * w)
        matrix[:, 1, 1] = 1 - 2 * (x * x + z * z)
        matrix[:, 1, 2] = 2 * (y * z - x * w)
        matrix[:, 2, 0] = 2 * (x * z - y * w)
        matrix[:, 2, 1] = 2 * (y * z + x * w)
        matrix[:, 2, 2] = 1 - 2 * (x * x + y * y)
        matrix[:, :3, :3] *= scale[:, None, :]
    matrix[:, :3, 3] = translation
    matrix[:, 3, 3] = 1.0
    return matrix


def _parents(fields: tuple[Fields, ...], children: list[tuple[int, ...]]) -> list[int]:
    parent = [-1] * len(fields)
    for index, below in enumerate(children):
        for child in below:
            if parent[child] >= 0:
                raise _not_a_tree(f"nodes[{child}] has two parents: {parent[child]} and {index}")
            parent[child] = index
    return parent


def _levels(parent: list[int], children: list[tuple[int, ...]]) -> list[list[int]]:
    """Nodes by their depth. A cycle hangs below no root, so its nodes are never met."""
    level = [i for i, above in enumerate(parent) if above < 0]
    levels, met = [], 0
    while level:
        levels.append(level)
        met += len(level)
        level = [child for index in level for child in children[index]]
    if met != len(parent):
        raise _not_a_tree(f"{len(parent) - met} nodes are their own ancestors")
    return levels


def _not_a_tree(found: str) -> UnreadableGltfError:
    return unreadable(found, "nodes that form trees")


def _world_matrices(
    fields: tuple[Fields, ...], parent: list[int], levels: list[list[int]]
) -> NDArray[np.float64]:
    count = len(fields)
    translation, scale = np.zeros((count, 3)), np.ones((count, 3))
    rotation = np.tile([0.0, 0.0, 0.0, 1.0], (count, 1))
    given: list[int] = []
    matrices: list[tuple[float, ...]] = []
    for i, node in enumerate(fields):
        if "matrix" in node:
            given.append(i)
            matrices.append(node.numbers("matrix", 16))
            continue
        for name, rows, size in (
            ("translation", translation, 3), ("rotation", rotation, 4), ("scale", scale, 3)
        ):  # fmt: skip
            if name in node:
                rows[i] = node.numbers(name, size)
    world = transforms(translation, rotation, scale)
    if given:
        world[given] = np.array(matrices).reshape(-1, 4, 4).transpose(0, 2, 1)
        for i in given:
            if world[i, 3].tolist() != [0.0, 0.0, 0.0, 1.0]:
                raise fields[i].wrong("matrix", "an affine matrix, column by column")
    above = np.array(parent)
    with np.errstate(all="ignore"):
        for level in levels[1:]:
            world[level] = world[above[level]] @ world[level]
    return world


def _roots(document: Fields, parent: list[int]) -> tuple[str, tuple[int, ...], tuple[str, ...]]:
    """The default scene's name and root nodes; without `scene` the first one, as Blender takes."""
    scenes = document.children("scenes")
    if not scenes:
        roots = tuple(i for i, above in enumerate(parent) if above < 0)
        return "", roots, ("scene.glb holds no scene: all its nodes were read",)
    chosen = max(document.index("scene", len(scenes)), 0)
    roots = scenes[chosen].indices("nodes", len(parent))
    inner = [i for i in roots if parent[i] >= 0]
    if inner:
        raise _not_a_tree(f"{scenes[chosen].place} lists nodes[{inner[0]}], which has a parent")
    warnings: tuple[str, ...] = ()
    name = scenes[chosen].text("name")
    if len(scenes) > 1:
        warnings = (f"scene.glb holds {len(scenes)} scenes; read: {name!r}",)
    return name, roots, warnings


def _node(document: Fields, fields: Fields, index: int, parent: int, *, visible: bool) -> Node:
    mesh = fields.index("mesh", _count(document, "meshes"))
    name = fields.text("name")
    if not name and mesh >= 0:
        name = Fields(document.values["meshes"][mesh]).text("name")
    shown = fields.extension("KHR_node_visibility")
    return Node(
        index=index,
        name=name or f"node {index}",
        parent=parent,
        mesh=mesh,
        skin=fields.index("skin", _count(document, "skins")),
        camera=fields.index("camera", _count(document, "cameras")),
        visible=visible and (shown is None or shown.flag("visible", default=True)),
        properties=_labels(fields.values.get("extras")),
        fields=fields,
    )


def _count(document: Fields, name: str) -> int:
    value = document.values.get(name, [])
    return len(value) if isinstance(value, list) else 0


def _labels(extras: Json) -> dict[str, str]:
    """The extras that are labels, as `scene.blender.tree` reads custom properties."""
    if not isinstance(extras, dict):
        return {}
    return {
        key: str(value).encode("utf-8", "replace").decode("utf-8")
        for key, value in sorted(extras.items())
        if (key == CATEGORY_KEY or key.endswith("_" + CATEGORY_KEY))
        and isinstance(value, str | int | float)
    }
