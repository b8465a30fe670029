"""Measurements of solids in the world: what touches, carries, contains or enters another."""
