"""A bench on a page: the score and its three parts, and the section with its cases."""

from __future__ import annotations

from typing import Final

from legoworld.report.family import PageFamily
from legoworld.report.reconstruction_section import bench_section

PAGE: Final = PageFamily(
    forest={name: name for name in ("S", "V", "R", "A")}, fill=bench_section, by_folder=True
)
