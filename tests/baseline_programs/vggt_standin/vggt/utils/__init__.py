"""What the nine numbers of a pose mean."""
