"""One self-contained HTML page of evaluations and comparisons."""
