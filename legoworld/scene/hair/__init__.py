"""Strands and points as the triangles Cycles draws them with."""
