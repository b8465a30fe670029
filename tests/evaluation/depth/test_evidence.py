"""`legoworld evidence verify` of depth: summary from rows, rows from arrays."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from evaluation.depth.folders import Predictions, evaluate_depth, plane, write_arrays, write_run

from legoworld import cli
from legoworld.evaluation.evidence import verify
from legoworld.files import sha256_of_file

SIZE = (32, 20)


@pytest.fixture
def evaluated(tmp_path: Path) -> Path:
    """Eleven images, one of them without output and one inverted, below a folder of their own."""
    z = plane(SIZE)
    noise = np.random.default_rng(0).uniform(0.9, 1.1, (9, *z.shape))
    predictions: Predictions = {f"set/{k:02}.jpg": z * noise[k] for k in range(9)}
    predictions |= {"set/09.jpg": "missing", "set/10.jpg": 1 / z}
    run = write_run(tmp_path / "run", predictions)
    truth = write_arrays(tmp_path / "truth", dict.fromkeys(predictions, z))
    evaluate_depth(run, truth, tmp_path / "eval", draws=40)
    return tmp_path


def bad(folder: Path) -> list[str]:
    return [check.what for check in verify(folder, None) if check.status != "ok"]


def rewrite(folder: Path, name: str, change: Callable[[Any], None]) -> None:
    """Change a file of an evaluation and its hash with it."""
    path = folder / name
    lines = path.read_text().splitlines() if name.endswith("l") else [path.read_text()]
    values = [json.loads(line) for line in lines]
    change(values if name.endswith("l") else values[0])
    path.write_text("".join(json.dumps(v) + "\n" for v in values))
    evidence = json.loads((folder / "evidence.json").read_text())
    evidence["files"][name] = sha256_of_file(path)
    (folder / "evidence.json").write_text(json.dumps(evidence))


def test_a_fresh_evaluation_holds(evaluated: Path) -> None:
    checks = verify(evaluated / "eval", None)
    assert {check.status for check in checks} == {"ok"}
    assert sum(check.what.startswith("row of image") for check in checks) == 6
    assert cli.run(["evidence", "verify", str(evaluated / "eval")]) == 0


CHANGES: dict[str, tuple[str, Callable[[Any], None], str]] = {
    "a mean": ("summary.json", lambda s: s["metrics"]["delta1"].update(far=0.99), "metrics"),
    "an interval": (
        "summary.json",
        lambda s: s["intervals"]["abs_rel"]["error_1"].update(low=0.0),
        "intervals",
    ),
    "a count": ("summary.json", lambda s: s.update(worse_than_constant=7), "worse_than_constant"),
    "a list": ("summary.json", lambda s: s["not_scored"].clear(), "not_scored"),
    "an addition": ("summary.json", lambda s: s.update(better=1), "better"),
}


@pytest.mark.parametrize("name", CHANGES)
def test_an_altered_summary_is_seen_even_with_its_hash(evaluated: Path, name: str) -> None:
    file, change, what = CHANGES[name]
    rewrite(evaluated / "eval", file, change)
    assert f"{what} from the rows" in bad(evaluated / "eval")


def test_an_altered_row_is_seen_from_the_arrays(evaluated: Path) -> None:
    def change(rows: Any) -> None:
        rows[0]["s"] *= 1.0 + 1e-6  # no mean depends on it

    rewrite(evaluated / "eval", "per_image.jsonl", change)
    assert bad(evaluated / "eval") == ["row of image 1"]


def test_rows_are_not_scored_again_from_other_inputs(evaluated: Path) -> None:
    next((evaluated / "truth").rglob("00.*")).unlink()
    checks = verify(evaluated / "eval", None)
    assert [c.status for c in checks if c.status != "ok"] == ["MISSING"]
    assert not any(c.what.startswith("row of image") for c in checks)
