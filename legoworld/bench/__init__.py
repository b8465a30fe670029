"""LEGO-Bench around the evaluation: making cases, serving scores, exporting tasks."""
