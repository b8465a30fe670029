"""Relations on a page: the main metrics above the tables."""

from __future__ import annotations

from typing import Final

from legoworld.report.family import PageFamily

PAGE: Final = PageFamily(
    forest={
        "accuracy.answers": "accuracy",
        "count_exact.answers": "counts",
        "mra.answers": "metres",
        "refer_50.answers": "referred boxes",
    }
)
