"""Scoring: from a run and ground truth to an evaluation folder. Only reads files."""
