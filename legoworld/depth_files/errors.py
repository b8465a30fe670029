"""The error of a depth file."""

from __future__ import annotations

from legoworld.errors import LegoWorldError


class DepthFileError(LegoWorldError):
    """A depth file cannot be read as the format it claims to be."""

    code = "depth_file"
    status = "invalid"
