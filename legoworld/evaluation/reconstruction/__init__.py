"""Scoring reconstructed scenes against reference scenes (docs/protocols/bench.md)."""
