"""Ground truth and predictions, checked and put into columns and order."""
