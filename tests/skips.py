"""Which skips the gate accepts: `pytest --fail-on-skip` fails on any other.

A machine without bubblewrap, Chromium, mcp-for-blender or lvis skips their tests, and all that
they hold is untested there: fine for a first look at the project, not for its gate.
"""

from __future__ import annotations

import re
from typing import Final

import pytest

#: A pattern of the skip's reason, and why the gate cannot do without that skip.
ACCEPTED: Final = {
    r"real scenes and photos are not here|are not among the real data here": "no part of the repo",
    r"LEGOWORLD_KAYKIT names no folder": "no part of the repo",
    r"no Blender with a window here|Blender opens no window here|Xvfb does not start": (
        "a whole desktop; tests/plugin/windowed.py says which"
    ),
    r"Blender .* is newer than the reader": "Blender is the distribution's",
    r"Blender's Python lacks what the add-on imports": "Blender is the distribution's",
    r"make no control group that counts tasks": "needs a delegated cgroup",
    r"no mount namespaces here": "needs a user namespace",
    r"only bubblewrap holds this": "the test runs once for each confinement",
    r"bpy 5\.2's wheel lacks": "bpy of Python 3.13",
    r"examples/motorcycle has no scene\.blend": "its photos come from a store",
    r"scikit-image's motorcycle is not here": "its photos come from a store",
    r"models of ATIF are not installed": "Harbor's package needs Python 3.12: make test-harbor",
    r"an adapter's package is not installed": "tools of others, each with a NumPy of its own",
    r"could not import 'torch'|torch": "make test-baselines runs them in an environment of its own",
    r"could not import '(ray|s3fs|moto)": "make test-cluster runs them",
    r"could not import '(mypy|pyright)": "make check runs them",
    r"no openat2, or a filter": "an older kernel; the other path is tested everywhere",
    r"there is no lock for|made from other versions than the lock's": "another Python",
}


class SkipAudit:
    """Collects the reasons of skipped tests; the run fails when one is not accepted."""

    def __init__(self) -> None:
        self.reasons: dict[str, int] = {}

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        """Note a skipped test."""
        self._note(report)

    def pytest_collectreport(self, report: pytest.CollectReport) -> None:
        """Note a skipped module."""
        self._note(report)

    def _note(self, report: pytest.TestReport | pytest.CollectReport) -> None:
        if report.skipped and not hasattr(report, "wasxfail"):
            reason = report.longrepr[2] if isinstance(report.longrepr, tuple) else report.longrepr
            reason = str(reason).removeprefix("Skipped: ")
            self.reasons[reason] = self.reasons.get(reason, 0) + 1

    def refused(self) -> list[str]:
        """The reasons that the gate does not accept."""
        return sorted(r for r in self.reasons if not any(re.search(p, r) for p in ACCEPTED))

    def pytest_sessionfinish(self, session: pytest.Session) -> None:
        """Fail a run that passed, but not whole."""
        if self.refused() and session.exitstatus == pytest.ExitCode.OK:
            session.exitstatus = pytest.ExitCode.TESTS_FAILED

    def pytest_terminal_summary(self, terminalreporter: pytest.TerminalReporter) -> None:
        """One line for each reason that is refused."""
        for reason in self.refused():
            terminalreporter.write_line(
                f"FAILED --fail-on-skip: {self.reasons[reason]} skipped: {reason}", red=True
            )
