"""Panoptic segments: true positives by IoU, counted as panopticapi counts them."""
