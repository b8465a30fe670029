"""Boxes and masks: official evaluators, ties, matched IoU, intervals."""
