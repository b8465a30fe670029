"""Which detection matches which ground truth, and the metrics that need no score."""
