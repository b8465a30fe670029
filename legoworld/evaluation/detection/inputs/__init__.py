"""Ground truth and predictions: checks, order and columns."""
