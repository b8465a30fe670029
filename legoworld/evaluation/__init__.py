"""Scoring: a run and a truth in, an evaluation folder out. Reads files only."""
