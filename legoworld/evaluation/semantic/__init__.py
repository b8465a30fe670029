"""Semantic maps: one confusion matrix over all pixels of all images."""
