"""Readouts: buffers to boxes, masks, depth and normals, in the exact export formats."""
