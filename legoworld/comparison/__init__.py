"""Comparison of evaluations: paired images, shared draws, tables."""
