"""Depth arrays in the file formats of cameras, networks and datasets, sizes checked first."""
