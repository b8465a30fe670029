"""Boxes in space for tests, and what SciPy and plain Python make of them."""

from __future__ import annotations

import numpy as np
from scipy.optimize import linprog
from scipy.spatial import ConvexHull, HalfspaceIntersection

CORNERS = (
    np.array(
        [[-1, -1, -1], [1, -1, -1], [1, 1, -1], [-1, 1, -1],
         [-1, -1, 1], [1, -1, 1], [1, 1, 1], [-1, 1, 1]], np.float64,
    )
    / 2
)  # fmt: skip


def box(center=(0, 0, 0), size=(1, 1, 1), rotation=None) -> np.ndarray:
    """(8, 3) corners; size along the box's own axes."""
    turned = np.eye(3) if rotation is None else np.asarray(rotation)
    return CORNERS * np.asarray(size, np.float64) @ turned.T + np.asarray(center, np.float64)


def about_y(degrees: float) -> np.ndarray:
    a = np.radians(degrees)
    return np.array([[np.cos(a), 0, np.sin(a)], [0, 1, 0], [-np.sin(a), 0, np.cos(a)]])


def rotation(random: np.random.Generator, mirrored: bool = False) -> np.ndarray:
    """A random rotation, or one that mirrors."""
    q, r = np.linalg.qr(random.normal(size=(3, 3)))
    q *= np.sign(np.diag(r))
    if (np.linalg.det(q) < 0) != mirrored:
        q[:, 0] *= -1
    return q


def scipy_iou(one: np.ndarray, other: np.ndarray) -> float:
    """Of convex hulls, by the intersection of their half-spaces."""
    hulls = ConvexHull(one), ConvexHull(other)
    planes = np.vstack([hull.equations for hull in hulls])
    norms = np.linalg.norm(planes[:, :3], axis=1, keepdims=True)
    inside = linprog(
        [0, 0, 0, -1],
        A_ub=np.hstack([planes[:, :3], norms]),
        b_ub=-planes[:, 3],
        bounds=[(None, None)] * 3 + [(0, None)],
    )
    if inside.status != 0 or inside.x[3] < 1e-9:
        return 0.0
    common = ConvexHull(HalfspaceIntersection(planes, inside.x[:3]).intersections).volume
    return common / (hulls[0].volume + hulls[1].volume - common)


def ap3d(truths, detections, iou, thresholds, depths=(0.0, 1e5), most=100) -> dict:
    """AP and AR of one category by Omni3D's rules, in plain Python.

    truths: (image, depth, ignored) each; detections: (image, depth, score), as they were given;
    iou(d, t): of their numbers.
    """
    n_counted = sum(not i and depths[0] <= z <= depths[1] for _, z, i in truths)
    by_image = {}
    for d, (image, _, score) in enumerate(detections):
        by_image.setdefault(image, []).append((-score, d))
    kept = [d for image in sorted(by_image) for _, d in sorted(by_image[image])[:most]]
    precisions, recalls = [], []
    for threshold in thresholds:
        outcome = {}
        for image in sorted({i for i, _, _ in truths} | set(by_image)):
            mine = [d for d in kept if detections[d][0] == image]
            out = {t: truths[t][2] or not depths[0] <= truths[t][1] <= depths[1]
                   for t, row in enumerate(truths) if row[0] == image}  # fmt: skip
            free = sorted(out, key=lambda t: out[t])
            for d in mine:
                best, found = min(threshold, 1 - 1e-10), None
                for t in free:
                    if found is not None and not out[found] and out[t]:
                        break
                    if iou(d, t) >= best:
                        best, found = iou(d, t), t
                if found is None:
                    outside = not depths[0] <= detections[d][1] <= depths[1]
                    outcome[d] = None if outside else False
                else:
                    free.remove(found)
                    outcome[d] = None if out[found] else True
        ranked = sorted(kept, key=lambda d: -detections[d][2])
        hits = [outcome[d] for d in ranked if outcome.get(d) is not None]
        true = np.cumsum(hits) if hits else np.zeros(0)
        precision = list(true / (np.arange(1, len(hits) + 1) + np.spacing(1)))
        for k in range(len(hits) - 1, 0, -1):
            precision[k - 1] = max(precision[k - 1], precision[k])
        recall = true / n_counted if n_counted else true
        at = np.searchsorted(recall, np.linspace(0, 1, 101), side="left")
        precisions.append([precision[k] if k < len(hits) else 0.0 for k in at])
        recalls.append(recall[-1] if len(recall) else 0.0)
    return {"n": n_counted, "precision": np.array(precisions), "recall": np.array(recalls)}
