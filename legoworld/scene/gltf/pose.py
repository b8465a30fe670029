"""Morph targets and skins, applied in the pose the file stores.

glTF 2.0 specification, 3.7.2.2 and 3.7.3. Animations are not played: a joint has its node's
matrix, a morph target the node's or the mesh's default weight.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from legoworld.scene.gltf.accessors import Accessors, as_float32
from legoworld.scene.gltf.fields import Fields
from legoworld.scene.gltf.verdicts import Budget, unreadable

_CHUNK: Final = 65536  # vertices whose matrices are blended at once: 6 MB


def default_weights(node: Fields, mesh: Fields) -> tuple[float, ...]:
    """The morph weights of a mesh on a node: the node's own, else the mesh's, else none."""
    return node.numbers("weights") or mesh.numbers("weights")


def apply_morphs(
    name: str,
    values: NDArray[np.float32],
    primitive: Fields,
    weights: tuple[float, ...],
    accessors: Accessors,
) -> NDArray[np.float32]:
    """A (V, n) attribute ("POSITION") plus the weighted changes of the morph targets with any."""
    targets = primitive.children("targets")
    if len(weights) > len(targets):
        raise unreadable(f"{primitive.place} has {len(targets)} targets for {len(weights)} weights")
    for weight, target in zip(weights, targets, strict=False):
        if weight == 0 or name not in target:
            continue
        stored = accessors.read(target.index(name, len(accessors)))
        if stored.values.shape != values.shape:
            raise unreadable(f"{target.at(name)} has another shape than the positions")
        with np.errstate(all="ignore"):
            values = values + np.float32(weight) * as_float32(stored)
    return values


def joint_matrices(
    skin: Fields, world_from_node: NDArray[np.float64], accessors: Accessors
) -> NDArray[np.float64]:
    """(J, 3, 4) float64 world-from-mesh matrices of a skin's joints."""
    joints = skin.indices("joints", len(world_from_node))
    matrices = world_from_node[list(joints)]
    if "inverseBindMatrices" in skin:
        stored = accessors.read(skin.index("inverseBindMatrices", len(accessors)))
        if stored.values.dtype.kind != "f" or stored.values.shape[1] != 16:
            raise unreadable(f"{skin.at('inverseBindMatrices')} is not MAT4 of float")
        if len(stored.values) < len(joints):
            raise unreadable(
                f"{skin.place}: {len(stored.values)} matrices for {len(joints)} joints"
            )
        inverse_bind = stored.values[: len(joints)].reshape(-1, 4, 4).transpose(0, 2, 1)
        with np.errstate(all="ignore"):
            matrices = matrices @ inverse_bind.astype(np.float64)
    return np.ascontiguousarray(matrices[:, :3])


def apply_skin(
    positions: NDArray[np.float32],
    normals: NDArray[np.float32] | None,
    influences: list[tuple[NDArray[np.int64], NDArray[np.float32]]],
    matrices: NDArray[np.float64],
    budget: Budget,
) -> tuple[NDArray[np.float32], NDArray[np.float32] | None]:
    """(V, 3) positions and normals in the world, by joints and weights (V, 4) of each JOINTS_n.

    Weights are normalised to a sum of 1, as exporters round them; a vertex without any follows the
    first joint.
    """
    joints = np.concatenate([j for j, _ in influences], axis=1)
    weights = np.concatenate([w for _, w in influences], axis=1).astype(np.float64)
    if joints.size and int(joints.max()) >= len(matrices):
        raise unreadable(f"a vertex follows joint {int(joints.max())} of {len(matrices)}")
    budget.take(positions.shape[0] * 12, "skinned positions")
    total = weights.sum(axis=1)
    weights[total == 0, 0] = 1.0
    joints[total == 0] = 0
    placed = np.empty(positions.shape, np.float32)
    turned = None if normals is None else np.empty(normals.shape, np.float32)
    with np.errstate(all="ignore"):
        weights /= weights.sum(axis=1, keepdims=True)
        for start in range(0, len(positions), _CHUNK):
            part = slice(start, start + _CHUNK)
            blended = np.einsum("vk,vkij->vij", weights[part], matrices[joints[part]])
            placed[part] = (
                np.einsum("vij,vj->vi", blended[:, :, :3], positions[part]) + blended[:, :, 3]
            )
            if turned is not None and normals is not None:
                a, b, c = blended[:, 0, :3], blended[:, 1, :3], blended[:, 2, :3]
                # The inverse transpose times the determinant.
                cofactors = np.stack([np.cross(b, c), np.cross(c, a), np.cross(a, b)], axis=1)
                turned[part] = np.einsum("vij,vj->vi", cofactors, normals[part])
    return placed, turned
