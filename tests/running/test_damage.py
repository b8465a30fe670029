"""Run folders that a disk or a hand has changed: one line, never a traceback; or they heal."""

from __future__ import annotations

import itertools
import os
import shutil
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest
from evaluation.detection_runs import random_predictions, random_truth, write_run, write_truth
from hypothesis import given, settings
from hypothesis import strategies as st
from running.run_folders import tree
from scene.gltf.scenes import scene_at
from strategies import Damage, damages, with_fixed_damage

from legoworld import cli
from legoworld.records.folders import run_folder
from legoworld.running import scene_pass

NAMES = ("a", "b", "c")


@pytest.fixture(scope="module")
def scenes(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("damage") / "scenes"
    for name in NAMES:
        scene_at(folder / name)
    return folder


def command(scenes: Path, output: Path, *more: str, task: str = "coco") -> list[str]:
    return ["readout", str(scenes), "--task", task, "--source", "glb", "-o", str(output), "-q",
            "--no-cache", "--workers", "1", *more]  # fmt: skip


@pytest.fixture(scope="module")
def whole(scenes: Path) -> Path:
    output = scenes.parent / "whole"
    assert cli.run(command(scenes, output)) == 0
    return output


@pytest.fixture(scope="module")
def stopped(scenes: Path) -> Path:
    """A run that was stopped when all images were in the journal."""
    output = scenes.parent / "stopped"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(scene_pass.run_folder, "finish", _interrupt)
        assert cli.run(command(scenes, output)) == 130
    assert (output / "journal.jsonl").read_bytes().count(b"\n") == len(NAMES)
    return output


def _interrupt(*_arguments: object, **_named: object) -> None:
    raise KeyboardInterrupt


def one_line_or_none(capsys: pytest.CaptureFixture[str]) -> str:
    error = capsys.readouterr().err
    assert "Traceback" not in error
    lines = [line for line in error.splitlines() if line.startswith("legoworld: ")]
    assert len(lines) <= 1, error
    return "".join(lines)


@pytest.fixture
def another(tmp_path: Path) -> Iterator[Path]:
    """Folders that are not there yet, one after the other."""
    return (tmp_path / str(number) for number in itertools.count())


@dataclass(frozen=True)
class SomeLines:
    """A journal that was stopped early, or written by several runs."""

    numbers: tuple[int, ...]

    def of(self, data: bytes) -> bytes:
        lines = data.splitlines(keepends=True)
        return b"".join(lines[number] for number in self.numbers)


SOME_LINES = st.builds(SomeLines, st.lists(st.integers(0, len(NAMES) - 1), max_size=4).map(tuple))


@settings(max_examples=16)
@given(damage=damages() | SOME_LINES)
@with_fixed_damage
def test_a_damaged_journal_heals(scenes, whole, stopped, another, capsys, damage):
    output = next(another)
    shutil.copytree(stopped, output)
    journal = output / "journal.jsonl"
    journal.write_bytes(damage.of(journal.read_bytes()))
    assert cli.run(command(scenes, output)) == 0
    assert one_line_or_none(capsys) == ""
    assert tree(output) == tree(whole)


def test_a_damaged_journal_is_said(scenes, stopped, tmp_path, capsys):
    output = tmp_path / "run"
    shutil.copytree(stopped, output)
    lines = (output / "journal.jsonl").read_bytes().splitlines(keepends=True)
    (output / "journal.jsonl").write_bytes(lines[0] + lines[1].replace(b'"ok"', b'"OK"') + lines[2])
    loud = [argument for argument in command(scenes, output) if argument != "-q"]
    assert cli.run(loud) == 0
    assert "journal.jsonl is damaged: what 1 of its lines held is done again" in (
        "".join(capsys.readouterr())
    )


@pytest.mark.parametrize("name", ["configuration.json", "run.json", "per_image.jsonl",
                                  "summary.json", "predictions.json"])  # fmt: skip
@settings(max_examples=6)
@given(damage=damages())
@with_fixed_damage
def test_any_damaged_file_is_one_line_and_overwrite_works(
    name, scenes, whole, stopped, another, capsys, damage
):
    output = next(another)
    shutil.copytree(stopped if name == "configuration.json" else whole, output)
    (output / name).write_bytes(damage.of((output / name).read_bytes()))
    code = cli.run(command(scenes, output))
    said = one_line_or_none(capsys)
    assert code in ((0, 1) if not said else (2,)), (code, said)
    assert cli.run(command(scenes, output, "--overwrite")) == 0
    assert tree(output) == tree(whole)


def test_overwrite_leaves_a_folder_that_is_not_a_runs(scenes, tmp_path, capsys):
    output = tmp_path / "theirs"
    output.mkdir()
    (output / "configuration.json").write_text("[[[[[")
    (output / "run.json").write_text("not a run")
    (output / ".lock").write_text("")
    (output / "thesis.tex").write_text("years of work")
    before = tree_of(output)
    assert cli.run(command(scenes, output, "--overwrite")) == 2
    assert "is not of a run" in one_line_or_none(capsys)
    assert tree_of(output) == before


def tree_of(folder: Path) -> dict[str, bytes]:
    return {p.name: p.read_bytes() for p in folder.iterdir()}


def copy_with_damage(source: Path, name: str, damage: Damage, output: Path) -> Path:
    shutil.copytree(source, output)
    (output / name).write_bytes(damage.of((source / name).read_bytes()))
    return output


@pytest.mark.parametrize("name", ["run.json", "per_image.jsonl", "summary.json",
                                  "predictions.json"])  # fmt: skip
@settings(max_examples=6)
@given(damage=damages())
@with_fixed_damage
def test_merge_says_it_in_one_line(name, whole, another, capsys, damage):
    run = copy_with_damage(whole, name, damage, next(another))
    code = cli.run(["merge", str(run), "-o", str(next(another))])
    assert code in (0, 1, 2)
    assert bool(one_line_or_none(capsys)) == (code == 2)


@pytest.fixture(scope="module")
def scored(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """A run that can be scored, and its truth."""
    folder = tmp_path_factory.mktemp("scored")
    truth = random_truth("coco", seed=1, images=3)
    found = random_predictions("coco", truth, seed=2)
    return write_run(folder / "run", "coco", truth, found), write_truth(folder / "t.json", truth)


@pytest.mark.parametrize("name", ["run.json", "per_image.jsonl", "predictions.json"])
@settings(max_examples=6)
@given(damage=damages())
@with_fixed_damage
def test_evaluate_says_it_in_one_line(name, scored, another, capsys, damage):
    run, truth = copy_with_damage(scored[0], name, damage, next(another)), str(scored[1])
    arguments = ["evaluate", "-q", str(run), "--truth", truth, "--draws", "3"]
    code = cli.run([*arguments, "-o", str(next(another))])
    assert code in (0, 1, 2)
    assert bool(one_line_or_none(capsys)) == (code == 2)


# What is on disk before the journal goes.


def synced(monkeypatch: pytest.MonkeyPatch) -> list[tuple[str, str]]:
    """Names of what is synced, replaced and removed, as it happens."""
    events: list[tuple[str, str]] = []

    def watched(kind: str, owner: object, name: str, path: Callable[..., object]) -> None:
        original = getattr(owner, name)

        def noted(*arguments: object, **named: object) -> object:
            events.append((kind, Path(str(path(*arguments))).name))
            return original(*arguments, **named)

        monkeypatch.setattr(owner, name, noted)

    watched("sync", os, "fsync", lambda fd: Path(f"/proc/self/fd/{fd}").readlink())
    watched("write", Path, "replace", lambda _path, target: target)
    watched("remove", Path, "unlink", lambda path, **_named: path)
    return events


@pytest.mark.parametrize(
    ("task", "more"), [("coco", []), ("coco", ["--images-per-file", "1"]), ("eth3d", [])]
)
def test_every_result_is_on_disk_before_the_journal_goes(task, more, scenes, tmp_path, monkeypatch):
    output = tmp_path / "run"
    events = synced(monkeypatch)
    assert cli.run(command(scenes, output, *more, task=task)) == 0
    gone = events.index(("remove", "journal.jsonl"))
    results = [p for p in output.rglob("*") if p.name != ".lock"]
    assert len(results) >= 4
    for path in results:
        sync = max(i for i, e in enumerate(events[:gone]) if e == ("sync", path.name))
        if path.is_file():
            written = max(i for i, e in enumerate(events) if e == ("write", path.name))
            assert written < sync, path
    last_write = max(i for i, e in enumerate(events[:gone]) if e[0] == "write")
    assert max(i for i, e in enumerate(events[:gone]) if e == ("sync", "run")) > last_write


def test_the_configuration_is_on_disk_before_the_first_record(scenes, tmp_path, monkeypatch):
    events = synced(monkeypatch)
    assert cli.run(command(scenes, tmp_path / "run")) == 0
    first = events.index(("sync", "journal.jsonl"))
    assert events.index(("sync", "configuration.json")) < events.index(("sync", "run")) < first


def test_the_journal_is_no_longer_than_it_has_to_be(stopped):
    records, damaged = run_folder.journal_records(stopped)
    assert (len(records), damaged) == (len(NAMES), 0)
    assert sorted(record.row.scene for record in records) == sorted(NAMES)
