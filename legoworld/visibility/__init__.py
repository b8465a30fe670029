"""Visibility: camera and kernel; a snapshot to instance and depth buffers."""
