"""Two evaluations side by side: paired images, shared draws, tables."""
