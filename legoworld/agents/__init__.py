"""Coding agents that rebuild a photo in Blender: cards, workspaces, trials, and what they leave."""
