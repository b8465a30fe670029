"""Commands that certify or score give no verdict and no number where they could not look."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest
from checkout import CHECKOUT

from legoworld import cli, exit_codes

TRUTH = CHECKOUT / "datasets" / "skimage_examples" / "truth_coco.json"

#: Each command, with `HERE` for the folder that holds nothing to look at.
COMMANDS = [
    "bench reward HERE -o reward.json",
    "bench judges HERE",
    "bench judges HERE/per_image.jsonl HERE HERE -o judges.json",
    "bench table HERE -o table",
    "bench serve HERE --no-render",
    "bench make HERE -o made",
    "plugin replay HERE",
    "track check HERE --photos HERE",
    "freeze HERE",
    "evidence verify HERE",
    "inspect HERE",
    "inspect HERE --compare-sources",
    "trajectory show HERE",
    "trajectory score HERE --truth HERE -o scores",
    "trajectory report HERE -o page.html",
    "compare HERE HERE -o comparison --fail-below AP=0",
    f"evaluate HERE --truth {TRUTH} -o evaluation",
    "export HERE --format coco -o exported.json",
    "merge HERE -o merged",
    "report HERE -o page.html",
]
#: Neither done (0), nor finished with a bad result (1, 3), nor blamed on the machine (4).
COULD_NOT_LOOK = (exit_codes.UNUSABLE, exit_codes.NOT_ASSESSED)
ROWS = {"row": '{"broken\n', "row of another kind": '{"image_id": 1, "status": "ok"}\n'}


@pytest.fixture(params=["missing", "empty", "subfolders", *ROWS])
def here(request, tmp_path, monkeypatch) -> Path:
    monkeypatch.chdir(tmp_path)
    folder = tmp_path / "here"
    if request.param != "missing":
        folder.mkdir()
    if request.param == "subfolders":
        (folder / "a" / "b").mkdir(parents=True)
    if request.param in ROWS:
        for name in ("per_image.jsonl", "ledger.jsonl", "summary.json", "evidence.json"):
            (folder / name).write_text(ROWS[request.param], encoding="utf-8")
    return folder


@pytest.mark.parametrize("command", COMMANDS)
def test_nothing_to_look_at_is_neither_a_verdict_nor_a_number(command, here, capsys):
    code = cli.run(command.replace("HERE", here.name).split())
    printed = capsys.readouterr()
    assert code in COULD_NOT_LOOK, printed
    assert printed.out.strip() == ""
    assert re.search(r"found: |Error: ", printed.err)
    assert "Errno" not in printed.err
    made = {p.name for p in Path().iterdir()} - {"here"}
    assert made <= {"scores", "evaluation", "merged", "made", "table", "comparison"}
    assert not [p for p in Path().rglob("*") if p.name in ("reward.json", "summary.json")
                and here not in p.absolute().parents]  # fmt: skip


ROW = {
    "image_id": 1, "file_name": "den__easy__view_00.png", "status": "missing", "code": "missing",
    "reason": "no scene", "run_status": "missing", "warnings": [], "family": "den",
    "environment": None, "theme": None, "split": None, "tier": "easy", "view": 0, "valid": False,
    "validity": None, "R": 0.0, "A": 0.0, "S": 0.0, "R_at": {}, "objects": [],
    "fov_error_deg": None, "camera": None, "diagnostics": None, "appearance": None, "flags": [],
}  # fmt: skip


def write_rows(folder: Path, *rows: dict) -> list[str]:
    folder.mkdir()
    text = "".join(json.dumps(row) + "\n" for row in rows)
    (folder / "per_image.jsonl").write_text(text, encoding="utf-8")
    return ["bench", "reward", str(folder), "-o", str(folder / "reward.json")]


def test_a_submission_that_is_missing_is_a_reward_of_0(tmp_path):
    assert cli.run(write_rows(tmp_path / "one", ROW)) == exit_codes.DONE
    assert json.loads((tmp_path / "one" / "reward.json").read_text())["reward"] == 0


@pytest.mark.parametrize(
    "rows", [[], [ROW, ROW], [ROW | {"status": "evaluator_error"}], [ROW | {"R": None, "S": None}]]
)
def test_no_reward_where_nothing_was_scored_and_an_earlier_one_goes(rows, tmp_path, capsys):
    command = write_rows(tmp_path / "one", *rows)
    earlier = tmp_path / "one" / "reward.json"
    earlier.write_text("{}", encoding="utf-8")
    assert cli.run(command) == exit_codes.UNUSABLE
    assert "already exists" in capsys.readouterr().err
    assert earlier.read_text("utf-8") == "{}"
    assert cli.run([*command, "--overwrite"]) == exit_codes.NOT_ASSESSED
    assert "gives no reward; found: " in capsys.readouterr().err
    assert not (tmp_path / "one" / "reward.json").exists()


def test_an_empty_ledger_is_not_certified(tmp_path, capsys):
    assert cli.run(["plugin", "replay", str(tmp_path)]) == exit_codes.NOT_ASSESSED
    (tmp_path / "ledger.jsonl").touch()
    assert cli.run(["plugin", "replay", str(tmp_path)]) == exit_codes.NOT_ASSESSED
    assert capsys.readouterr().out == ""


def test_freeze_says_no_check_passed_where_one_failed(tmp_path, capsys):
    (tmp_path / "bad").mkdir()
    (tmp_path / "bad" / "scene.blend").write_bytes(b"no scene")
    assert cli.run(["freeze", str(tmp_path), "--no-cache"]) == exit_codes.INCOMPLETE
    said = capsys.readouterr().out
    assert "0 of 1 scene frozen, 1 scene fails a check" in said
    assert "all checks passed" not in said
