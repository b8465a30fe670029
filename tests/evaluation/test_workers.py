"""Whoever works on the images, and on how many at a time: the same bytes, or the same error."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from evaluation.commands import evaluate, files, made, small_pieces
from evaluation.depth.folders import write_run as write_depth_run
from evaluation.detection_runs import (
    random_predictions,
    random_truth,
    write_run,
    write_truth,
)
from waiting import PATIENCE_S, until


@pytest.mark.parametrize("task", ["coco", "lvis", "eth3d"])
def test_same_bytes_for_any_number_of_workers_and_any_size_of_chunks(
    task, tmp_path, monkeypatch, capsys
):
    run, truth = made(tmp_path, task)
    assert evaluate(run, truth, tmp_path / "whole", "--workers", 1) == 0
    shown = capsys.readouterr().out.replace("whole", "")
    for workers, size in ((1, 7), (3, 40)):
        small_pieces(monkeypatch, size)
        output = tmp_path / f"{workers}-{size}"
        assert evaluate(run, truth, output, "--workers", workers) == 0
        assert files(output) == files(tmp_path / "whole")
        assert capsys.readouterr().out.replace(output.name, "") == shown


@pytest.mark.parametrize("workers", [1, 3])
def test_the_first_of_several_unusable_masks_is_named(workers, tmp_path, monkeypatch, capsys):
    """By the order in the file, not by who finds one first."""
    truth = random_truth("lvis", seed=8, images=20)
    predictions = random_predictions("lvis", truth, seed=8)
    for place in (150, 61, 100):
        predictions[place]["segmentation"] = {"size": [90, 120], "counts": "11"}
    run = write_run(tmp_path / "run", "lvis", truth, predictions)
    path = write_truth(tmp_path / "truth.json", truth)
    small_pieces(monkeypatch, 5)
    assert evaluate(run, path, tmp_path / "eval", "--workers", workers) == 2
    error = capsys.readouterr().err
    assert f"a mask of image {predictions[61]['image_id']}, " in error
    assert error.count("\n") == 1
    assert not list((tmp_path / "eval").iterdir())


@pytest.mark.parametrize("workers", [1, 2])
def test_the_first_of_several_broken_depth_truths_is_named(workers, tmp_path, monkeypatch, capsys):
    names = [f"{i}.png" for i in range(6)]
    arrays = {name: np.full((30, 40), 2.0) for name in names}
    run = write_depth_run(tmp_path / "run", arrays)
    truth = tmp_path / "truth"
    truth.mkdir()
    for name in names:  # a distance without intrinsics cannot be turned into depth
        ray = name in ("2.png", "4.png")
        labels = {"space": "ray_distance" if ray else "depth", "unit": "m"}
        np.savez(truth / f"{Path(name).stem}.npz", values=arrays[name], **labels)
    small_pieces(monkeypatch, 1)
    assert evaluate(run, truth, tmp_path / "eval", "--workers", workers) == 2
    error = capsys.readouterr().err
    assert "2.npz" in error
    assert error.count("\n") == 1
    assert not list((tmp_path / "eval").iterdir())


#: The command with images that take long, and their workers' ids in a file.
SLOW = """
import sys
from legoworld import cli
from legoworld.evaluation.detection.matching import matches
from evaluation.commands import slow_chunk
matches._CHUNK_DETECTIONS, matches._FEW = 5, 1
matches.match_chunk = slow_chunk
sys.exit(cli.run(sys.argv[1:]))
"""


def started(run: Path, truth: Path, output: Path, marks: Path) -> subprocess.Popen[str]:
    """The command with two workers, once both are at work."""
    marks.mkdir()
    tests = str(Path(__file__).parents[1])
    environment = {**os.environ, "MARKS": str(marks), "PYTHONPATH": tests}
    arguments = ["evaluate", str(run), "--truth", str(truth), "-o", str(output), "--workers", "2"]
    command = subprocess.Popen(
        [sys.executable, "-c", SLOW, *arguments],
        stderr=subprocess.PIPE,
        text=True,
        env=environment,
    )

    def both_at_work() -> bool:
        assert command.poll() is None, command.stderr and command.stderr.read()
        return len(list(marks.iterdir())) == 2

    until(both_at_work, "work for both")
    return command


def gone(pid: int) -> bool:
    """Whether a process is over."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] == "Z"
    except (FileNotFoundError, ProcessLookupError):
        return True


@pytest.mark.skipif(sys.platform != "linux", reason="looks into /proc")
@pytest.mark.parametrize("blow", ["kill a worker", "Ctrl-C", "kill the command"])
def test_a_blow_ends_in_one_line_and_leaves_nothing(blow, tmp_path):
    run, truth = made(tmp_path, "coco")
    output = tmp_path / "eval"
    command = started(run, truth, output, tmp_path / "marks")
    workers = [int(p.name) for p in (tmp_path / "marks").iterdir()]
    if blow == "kill a worker":
        for worker in workers:
            os.kill(worker, signal.SIGKILL)
    else:
        command.send_signal(signal.SIGINT if blow == "Ctrl-C" else signal.SIGKILL)
    error = command.communicate(timeout=PATIENCE_S)[1]
    expected = {"kill a worker": 4, "Ctrl-C": 130, "kill the command": -signal.SIGKILL}
    assert command.returncode == expected[blow], error
    said = error.strip()  # a line begins anew after ^C
    assert said.count("\n") == 0, error
    assert bool(said) == (blow != "kill the command")
    if blow == "kill a worker":
        assert "a worker process ended unexpectedly; found: signal 9" in said
    if blow == "kill the command":  # workers end with the chunk they have, which here is never
        for worker in workers:
            os.kill(worker, signal.SIGKILL)
    until(lambda: all(map(gone, workers)), "the end of the workers")
    assert not list(output.iterdir())
