"""The published lvis package is used as it is, and touches nothing else."""

from __future__ import annotations

import subprocess
import sys

import pytest
from evaluation.detection_runs import random_predictions, random_truth, write_run, write_truth

from legoworld import cli
from legoworld.errors import LegoWorldError
from legoworld.evaluation.detection import lvis_package

PROGRAM = """
import logging, sys
import numpy
from legoworld.evaluation.detection import lvis_package
before = dict(vars(numpy)), logging.root.level, list(logging.root.handlers), logging.basicConfig
package = lvis_package.load()
assert lvis_package.load() is package
assert not {"cv2", "matplotlib", "lvis.vis"} & set(sys.modules), "drawing was imported"
assert logging.root.level == before[1] and logging.root.handlers == before[2]
assert logging.basicConfig is before[3]
assert all(getattr(numpy, name) is value for name, value in before[0].items())
new = set(vars(numpy)) - set(before[0])
assert all(name in sys.modules or "numpy." + name in sys.modules for name in new), new
assert not hasattr(numpy, "float")
import lvis.eval
assert lvis.eval.np.float is float and lvis.eval.np.zeros is numpy.zeros
"""


def test_import_leaves_nothing_behind():
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", PROGRAM], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr


def test_without_the_package_lvis_is_scored_by_hotcoco_and_said_so(tmp_path, monkeypatch, capsys):
    truth = random_truth("lvis", seed=1)
    run = write_run(tmp_path / "run", "lvis", truth, random_predictions("lvis", truth, seed=1))
    path = write_truth(tmp_path / "truth.json", truth)
    arguments = ["evaluate", str(run), "--truth", str(path), "--draws", "5", "-v", "-o"]
    assert cli.run([*arguments, str(tmp_path / "official")]) == 0
    official = capsys.readouterr().out
    monkeypatch.setattr(lvis_package, "is_installed", lambda: False)
    assert cli.run([*arguments, str(tmp_path / "fast")]) == 0
    fast = capsys.readouterr()
    assert "pip install --no-deps lvis==0.5.3" in fast.err
    assert fast.out.startswith("hotcoco 1.3.0")
    assert official.startswith("lvis 0.5.3")
    # The last two lines name the folder.
    assert official.splitlines()[1:-2] == fast.out.splitlines()[1:-2]
    assert cli.run([*arguments, str(tmp_path / "none"), "--evaluator", "official"]) == 4
    assert "no package lvis" in capsys.readouterr().err


def test_a_missing_package_is_an_error(monkeypatch):
    monkeypatch.setattr(lvis_package, "is_installed", lambda: False)
    with pytest.raises(LegoWorldError, match="--evaluator fast"):
        lvis_package.load()
