"""What every baseline's process needs to be run by legoworld: numpy and Pillow, nothing else.

A baseline's run.py is a `load`, a `predict` and a call of `serve`; see `protocol.serve`.
"""

from __future__ import annotations

from legoworld_baseline.depth import write_depth
from legoworld_baseline.labels import match_labels
from legoworld_baseline.photos import PhotoError, read_photo
from legoworld_baseline.protocol import Refused, serve
from legoworld_baseline.provenance import hash_files, library_versions

__all__ = [
    "PhotoError",
    "Refused",
    "hash_files",
    "library_versions",
    "match_labels",
    "read_photo",
    "serve",
    "write_depth",
]
