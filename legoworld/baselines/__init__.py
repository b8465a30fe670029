"""Baselines: specialist models run in separate processes, or results imported from files."""
