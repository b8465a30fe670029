"""Tracks and vocabularies: the public part of a dataset, and the names of photos and cameras."""
