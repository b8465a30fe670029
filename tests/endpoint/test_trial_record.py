"""What a trial's record keeps, and in which order it is asked."""

from __future__ import annotations

from pathlib import Path

import pytest

from legoworld.endpoint.finalisation import _candidates
from legoworld.endpoint.trial_record import TrialRecord


@pytest.fixture
def record(tmp_path: Path) -> TrialRecord:
    """A, B, then A again; a live scene between them."""
    kept = TrialRecord(tmp_path)
    for number, content in enumerate("aba", start=1):
        for kind in ("live", "saved"):
            file = tmp_path / "incoming"
            file.write_text(content)
            kept.take(file, content * 64, kind=kind, call=number, at_s=float(number))  # type: ignore[arg-type]
    return kept


def test_what_was_saved_last_is_submitted_though_it_was_saved_before(record: TrialRecord) -> None:
    """A dict of contents keeps the first place of each: the second scene was submitted."""
    tried = [(c.kind, c.sha256[0], c.call) for c in _candidates(record)]
    assert tried == [("saved", "a", 3), ("saved", "b", 2), ("live", "a", 3), ("live", "b", 2)]


def test_the_newest_of_a_kind_come_first_each_content_once(record: TrialRecord) -> None:
    assert [c.call for c in record.newest("live")] == [3, 2]
    assert record.last("saved") == record.newest("saved")[0]
    assert TrialRecord(record.folder).newest("live") == record.newest("live")
