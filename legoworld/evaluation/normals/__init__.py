"""Normals: runs of one unit vector a pixel, scored by angular error."""
