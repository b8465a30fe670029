"""How many cores a process may use: affinity and quota."""

from __future__ import annotations

import os

import pytest

from legoworld.workers import processors


@pytest.fixture
def eight_cores(monkeypatch):
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: set(range(8)), raising=False)
    monkeypatch.setattr(os, "cpu_count", lambda: 64)


@pytest.mark.parametrize(
    ("quota", "cores"),
    [
        ("max 100000\n", 8),
        ("200000 100000\n", 2),
        ("150000 100000\n", 2),
        ("1000 100000\n", 1),
        ("9900000 100000\n", 8),
        ("5 0\n", 8),
        ("", 8),
        ("\n\n", 8),
    ],
)
def test_the_smaller_of_affinity_and_quota(eight_cores, tmp_path, quota, cores):
    (tmp_path / "cpu.max").write_text(quota)
    assert processors.usable_cores(tmp_path / "cpu.max") == cores


def test_without_a_quota_it_is_the_affinity(eight_cores, tmp_path):
    assert processors.usable_cores(tmp_path / "nothing") == 8


def test_where_there_is_no_affinity_it_is_the_machines_cores(monkeypatch, tmp_path):
    monkeypatch.delattr(os, "sched_getaffinity", raising=False)
    monkeypatch.setattr(os, "cpu_count", lambda: 5)
    assert processors.usable_cores(tmp_path / "nothing") == 5
