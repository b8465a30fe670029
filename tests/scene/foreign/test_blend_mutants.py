"""Damaged files: each ends in a verdict within its limits, and the run lives on."""

from __future__ import annotations

from pathlib import Path

import pytest
from scene.foreign.mutants import KINDS, mutant
from scene.foreign.sandbox import Outcome, Planned, faults, lay_out, read_out
from scene.foreign.sources import PROGRAM, sources

SEED = 20
COUNT = 40
#: Most damage goes where blocks can be reached: with these turns every kind is done at least once.
TURNS = ("plain", "plain", "zstd", "plain", "gzip")

pytestmark = pytest.mark.blender


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory, build_scenes) -> dict[str, bytes]:
    folder = tmp_path_factory.mktemp("sources")
    build_scenes(PROGRAM, folder)
    return sources(folder, None)


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("mutants")


@pytest.fixture(scope="module")
def planned(files: dict[str, bytes], place: Path) -> list[Planned]:
    return lay_out(place, files, turns=TURNS, seed=SEED, count=COUNT, control="plain")


@pytest.fixture(scope="module")
def outcome(planned: list[Planned], place: Path) -> Outcome:
    return read_out(place, "run", time_limit_s=300)


def test_every_kind_of_damage_is_done(planned: list[Planned]):
    assert {p.kind for p in planned if p.source == "plain" and p.kind} == set(KINDS)
    assert sum(p.kind is not None for p in planned) == COUNT


def test_the_same_seed_gives_the_same_bytes(files: dict[str, bytes]):
    one = [mutant(files["plain"], seed=SEED, number=i) for i in range(len(KINDS))]
    two = [mutant(files["plain"], seed=SEED, number=i) for i in range(len(KINDS))]
    assert one == two
    assert all(m.data != files["plain"] for m in one)
    assert len({m.data for m in one}) == len(one)


def test_each_mutant_is_a_verdict_and_leaves_nothing_behind(
    planned: list[Planned], outcome: Outcome, place: Path
):
    assert faults(planned, outcome, place) == []
    assert outcome.returncode == 1


def test_damage_that_no_reader_can_miss_is_never_ok(planned: list[Planned], outcome: Outcome):
    lost = {"truncated", "cut at a block", "cut in a block header", "block length extreme"}
    seen = [p for p in planned if p.kind in lost and p.source == "plain"]
    assert len({p.kind for p in seen}) == len(lost)
    assert {outcome.rows[p.name]["status"] for p in seen} == {"invalid"}


def test_the_main_process_stays_small(outcome: Outcome):
    assert len(outcome.samples) >= 2  # a busy machine's watcher looks seldom
    first, last = outcome.samples[1 if len(outcome.samples) > 2 else 0], outcome.samples[-1]
    assert last.resident - first.resident < 20 * 2**20
    assert last.open_files <= first.open_files + 4
