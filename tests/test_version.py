"""The version is one: the package's, the installed distribution's, and CHANGELOG's first entry."""

from __future__ import annotations

from importlib import metadata

from checkout import CHECKOUT

import legoworld
from legoworld.version import __version__


def test_there_is_one_version():
    assert legoworld.__version__ == __version__ == metadata.version("legoworld")
    heading = next(
        line
        for line in (CHECKOUT / "CHANGELOG.md").read_text(encoding="utf-8").splitlines()
        if line.startswith("## ")
    )
    assert heading.startswith(f"## {__version__}")
