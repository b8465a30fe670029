"""Readouts: buffers to boxes, masks and depth, in the exact export formats."""
