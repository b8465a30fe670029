"""Counts on a page: one line of the plot and in a sentence, and tables; no pictures of its own."""

from legoworld.report.family import PageFamily

PAGE = PageFamily(forest={"mae": "mean absolute error"})
