"""Depth scoring: a run's depth files against measured depth, affine-invariant in disparity."""
