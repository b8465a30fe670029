"""Depth scoring: depth files against measured depth, affine-invariant in disparity."""
