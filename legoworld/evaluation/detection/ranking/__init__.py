"""Precision and recall along the confidence ranking, its ties and its samples."""
