"""Specialist models beside scenes: run in processes of their own, or imported from files."""
