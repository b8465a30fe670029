"""A ledger's lines on the disk."""

from __future__ import annotations

import os
from pathlib import Path

from legoworld.plugin.ledger import LEDGER, Ledger


def test_an_entry_is_on_the_disk_before_its_call_is_answered(tmp_path, monkeypatch):
    """Whatever else is synced: the ledger itself, with the line in it."""
    synced = []

    def record(descriptor):
        there = str(Path(f"/proc/self/fd/{descriptor}").readlink())
        synced.append((there, os.fstat(descriptor).st_size))

    monkeypatch.setattr(os, "fsync", record)
    ledger = Ledger(tmp_path)
    for number in (1, 2):
        ledger.append(
            tool="measure", request={}, answer={}, error=None, phase="idle", transaction=None,
            signatures=(None, None), base_sha256=None,
        )  # fmt: skip
        path = tmp_path / LEDGER
        assert synced[-1] == (str(path), path.stat().st_size)
        assert len(synced) == number
