"""Tracks and vocabularies: the public side of a dataset, and how photos and cameras are named."""
