"""How deep two triangle meshes reach into each other. Metres, float64."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

Points = NDArray[np.float64]
Triangles = NDArray[np.float64]

#: Corners of one hull times corners of the other, up to which their Minkowski difference is built.
_MOST_DIFFERENCES: Final = 40_000
#: A corner this close to its part's hull, over the hull's size, lies on it: float32's resolution.
_ON_HULL: Final = 1e-6


def penetration_m(first: Triangles, second: Triangles) -> float:
    """The shortest way that separates two triangle meshes, (T, 3, 3) metres.

    0 where their surfaces do not meet or only touch, also where one lies inside the other:
    `share_inside` tells. Each connected part is taken for itself, and the deepest pair counts.
    Of two convex parts (boxes, flat polygons) it is exact: the distance of the origin to the
    surface of their Minkowski difference (van den Bergen, Collision Detection in Interactive 3D
    Environments, 2003, section 2.4). Of curved ones with many corners it is the least over the
    normals of their faces, an upper bound. Where a part is not convex, it is FCL's deepest contact
    between triangles, an estimate, and never more than the parts' hulls need.
    """
    if not _contacts(first, second, 1):
        return 0.0
    deepest = 0.0
    others = list(_parts(second))
    for part in _parts(first):
        for other in others:
            apart = (part.min((0, 1)) > other.max((0, 1))) | (other.min((0, 1)) > part.max((0, 1)))
            if not apart.any() and _contacts(part, other, 1):
                deepest = max(deepest, _part_penetration(part, other))
    return deepest


def _part_penetration(part: Triangles, other: Triangles) -> float:
    hulls = _hull_penetration(_corners(part), _corners(other))
    if _is_convex(part) and _is_convex(other):
        return hulls
    return min(hulls, max(_contacts(part, other, 10_000), default=0.0))


def _parts(triangles: Triangles) -> Iterator[Triangles]:
    """The connected parts of a mesh: corners at equal coordinates are one."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    corners = np.ascontiguousarray(triangles.reshape(-1, 3) + 0.0)  # -0 is 0
    rows = corners.view([("", np.float64)] * 3).ravel()
    index = np.unique(rows, return_inverse=True)[1].reshape(-1, 3)
    a, b, c = index.T
    ends = (np.concatenate([a, b]), np.concatenate([b, c]))
    links = coo_array((np.ones(len(ends[0]), np.int8), ends), shape=(index.max() + 1,) * 2)
    n, label = connected_components(links, directed=False)
    own = label[a]
    order = np.argsort(own, kind="stable")
    starts: list[int] = np.searchsorted(own[order], np.arange(1, n)).tolist()
    yield from np.split(triangles[order], starts)


def _corners(part: Triangles) -> Points:
    """The corners of a part's convex hull; all of its points where they are flat."""
    from scipy.spatial import ConvexHull, QhullError

    points = np.unique(part.reshape(-1, 3), axis=0)
    try:
        return np.asarray(points[ConvexHull(points).vertices], np.float64)
    except (QhullError, ValueError):
        return np.asarray(points)


def _is_convex(part: Triangles) -> bool:
    """Whether a part is its own convex hull's surface, or a flat convex polygon."""
    from scipy.spatial import ConvexHull, QhullError

    points = part.reshape(-1, 3)
    area = np.linalg.norm(np.cross(part[:, 1] - part[:, 0], part[:, 2] - part[:, 0]), axis=1).sum()
    try:
        hull = ConvexHull(points)
    except (QhullError, ValueError):
        plane = _in_plane(points)
        try:
            return bool(area / 2 >= (1 - 1e-6) * ConvexHull(plane).volume)
        except (QhullError, ValueError):
            return True  # a line: its hull is itself
    size = float(np.ptp(points, axis=0).max())
    inside = (part.mean(axis=1) @ hull.equations[:, :3].T + hull.equations[:, 3]).max(axis=1)
    return bool(inside.min() >= -_ON_HULL * size and area / 2 >= (1 - 1e-3) * hull.area)


def _in_plane(points: Points) -> Points:
    """(N, 2): flat points in the two directions of their largest spread."""
    centred = points - points.mean(axis=0)
    return np.asarray(centred @ np.linalg.svd(centred, full_matrices=False)[2][:2].T)


def _hull_penetration(first: Points, second: Points) -> float:
    """The shortest way that separates the convex hulls of two point sets; 0 if they are apart."""
    from scipy.spatial import ConvexHull, QhullError

    if len(first) * len(second) <= _MOST_DIFFERENCES:
        try:
            hull = ConvexHull((first[:, None] - second[None]).reshape(-1, 3))
        except (QhullError, ValueError):  # all in one plane: they slide apart within no depth
            return 0.0
        return max(0.0, -float(hull.equations[:, 3].max()))
    normals = np.concatenate([ConvexHull(p).equations[:, :3] for p in (first, second)])
    normals = np.unique(np.concatenate([normals, -normals]), axis=0)
    reach = (first @ normals.T).max(axis=0) - (second @ normals.T).min(axis=0)
    return max(0.0, float(reach.min()))


def _contacts(first: Triangles, second: Triangles, most: int) -> list[float]:
    """Depths of up to `most` contacts that FCL reports between the triangles of two meshes."""
    import fcl

    request = fcl.CollisionRequest(num_max_contacts=most, enable_contact=True)
    result = fcl.CollisionResult()
    fcl.collide(triangle_soup(first), triangle_soup(second), request, result)
    return [abs(float(contact.penetration_depth)) for contact in result.contacts]


def triangle_soup(triangles: Triangles) -> Any:
    """(n, 3, 3) triangles as FCL has them."""
    return collision_model(triangles.reshape(-1, 3), np.arange(3 * len(triangles)).reshape(-1, 3))


def collision_model(points: Points, triangles: NDArray[np.int64]) -> Any:
    """(n, 3) points and the (m, 3) triangles between them as FCL has them."""
    import fcl

    model = fcl.BVHModel()
    model.beginModel(len(points), len(triangles))
    model.addSubModel(points, triangles)
    model.endModel()
    return fcl.CollisionObject(model)
