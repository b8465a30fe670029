"""The oracle: every pair of points in float64, the first in raster order where distances tie."""

from __future__ import annotations

import numpy as np

from legoworld.evaluation.reconstruction.points import finite_points, points_m


def nearest(a_depth, b_depth, label, raster):
    """(H, W) squared distance and raster index of each a's nearest b with its label."""
    a, b = (points_m(depth, raster).reshape(-1, 3) for depth in (a_depth, b_depth))
    labels = label.ravel()
    in_a, in_b = (finite_points(d).ravel() & (labels >= 0) for d in (a_depth, b_depth))
    squared = np.full(labels.shape, np.inf)
    index = np.full(labels.shape, -1, np.int32)
    for k in range(int(labels.max(initial=-1)) + 1):
        targets = np.flatnonzero(in_b & (labels == k))
        if not len(targets):
            continue
        for place in np.flatnonzero(in_a & (labels == k)):
            d = a[place] - b[targets]
            every = d[:, 0] * d[:, 0] + d[:, 1] * d[:, 1] + d[:, 2] * d[:, 2]
            squared[place] = every.min()
            index[place] = targets[every.argmin()]
    return squared.reshape(label.shape), index.reshape(label.shape)


def score(reference_z, submitted_z, label, raster, tolerance):
    """(precision, recall, F) of label 0, straight from the definition."""
    g, q = (points_m(d, raster) for d in (reference_z, submitted_z))
    g = g[finite_points(reference_z) & (label == 0)]
    q = q[finite_points(submitted_z) & (label == 0)]
    if not len(g) or not len(q):
        return 0.0, 0.0, 0.0
    apart = np.sqrt(((g[:, None] - q[None]) ** 2).sum(axis=-1))
    tau = tolerance.tau_m(g[:, 2])
    recall = float(np.mean(apart.min(axis=1) <= tau))
    own = apart.argmin(axis=0)
    precision = float(np.mean(apart[own, np.arange(len(q))] <= tau[own]))
    both = precision + recall
    return precision, recall, 2 * precision * recall / both if both else 0.0
