"""`legoworld evidence verify`: what was scored can be proved, and tampering is seen."""

from __future__ import annotations

import json
import shutil

import pytest
from evaluation.detection_runs import random_predictions, random_truth, write_run, write_truth
from evaluation.official import evaluate

from legoworld import cli
from legoworld.errors import LegoWorldError
from legoworld.evaluation.evidence import verify
from legoworld.files import sha256_of_file


@pytest.fixture
def evaluated(tmp_path):
    """An evaluation of a run with real scores, beside its inputs."""
    truth = random_truth("lvis", seed=1)
    evaluate(tmp_path, "lvis", truth, random_predictions("lvis", truth, seed=1))
    return tmp_path


def bad(checks):
    return [c for c in checks if c.status != "ok"]


def test_a_fresh_evaluation_holds(evaluated, capsys):
    checks = verify(evaluated / "eval", None)
    assert not bad(checks)
    assert len(checks) >= 18
    assert cli.run(["evidence", "verify", str(evaluated / "eval")]) == 0
    assert f"{len(checks)} of {len(checks)} checks hold" in capsys.readouterr().out


def with_time(run, finished_at):
    document = json.loads((run / "run.json").read_text())
    (run / "run.json").write_text(json.dumps({"finished_at": finished_at, **document}))


def files_of(folder):
    return {p.relative_to(folder): p.read_bytes() for p in folder.rglob("*") if p.is_file()}


def test_runs_that_differ_in_their_time_alone_have_the_same_evaluation_and_comparison(tmp_path):
    truth = random_truth("coco", seed=1)
    predictions = random_predictions("coco", truth, seed=1)
    for name, time in (("early", "2026-01-01T00:00:00Z"), ("late", "2026-11-22T23:59:59.5Z")):
        folder = tmp_path / name
        run = write_run(folder / "run", "coco", truth, predictions)
        with_time(run, time)
        truth_path = write_truth(folder / "truth.json", truth)
        arguments = ["--truth", str(truth_path), "--draws", "5", "-o", str(folder / "eval")]
        assert cli.run(["evaluate", str(run), *arguments]) == 0
        evaluations = [str(folder / "eval")] * 2
        compared = ["compare", *evaluations, "--draws", "5", "-o", str(folder / "comparison")]
        assert cli.run(compared) == 0
        assert not bad(verify(folder / "eval", None))
    for name in ("eval", "comparison"):
        assert files_of(tmp_path / "early" / name) == files_of(tmp_path / "late" / name)


def test_of_run_json_only_the_time_is_left_out(evaluated):
    run = evaluated / "run" / "run.json"
    entry = json.loads((evaluated / "eval" / "evidence.json").read_text())["inputs"][1]
    assert (entry["role"], entry["without"]) == ("run", ["finished_at"])
    with_time(evaluated / "run", "2026-01-01T00:00:00Z")
    assert not bad(verify(evaluated / "eval", None))
    document = json.loads(run.read_text())
    for forged in ({**document, "kind": 1}, {**document, "configuration": {}}, [document]):
        run.write_text(json.dumps(forged))
        assert [c.status for c in bad(verify(evaluated / "eval", None))] == ["CHANGED"]
    run.write_text("no JSON")
    assert [c.status for c in bad(verify(evaluated / "eval", None))] == ["CHANGED"]
    run.unlink()
    assert [c.status for c in bad(verify(evaluated / "eval", None))] == ["MISSING"]


@pytest.mark.parametrize("role", ["truth.json", "run/predictions.json"])
def test_a_changed_input_is_seen(evaluated, role):
    with (evaluated / role).open("a") as stream:
        stream.write(" ")
    assert [c.status for c in bad(verify(evaluated / "eval", None))] == ["CHANGED"]
    (evaluated / role).unlink()
    assert [c.status for c in bad(verify(evaluated / "eval", None))] == ["MISSING"]


@pytest.mark.parametrize(
    "name", ["summary.json", "matches.npz", "per_image.jsonl", "view/predictions.json"]
)
def test_a_changed_file_is_seen(evaluated, name, capsys):
    with (evaluated / "eval" / name).open("ab") as stream:
        stream.write(b" ")
    assert [c.what for c in bad(verify(evaluated / "eval", None))] == [f"file {name}"]
    assert cli.run(["evidence", "verify", str(evaluated / "eval")]) == 1
    assert "CHANGED" in capsys.readouterr().out


def test_an_added_file_is_seen(evaluated):
    (evaluated / "eval" / "view" / "more.json").write_text("1")
    assert [c.status for c in bad(verify(evaluated / "eval", None))] == ["UNLISTED"]


def forge(folder, change):
    """Change summary.json and put its new hash on record: only the numbers can tell."""
    summary = json.loads((folder / "summary.json").read_text())
    evidence = json.loads((folder / "evidence.json").read_text())
    change(summary, evidence)
    (folder / "summary.json").write_text(json.dumps(summary))
    evidence["files"]["summary.json"] = sha256_of_file(folder / "summary.json")
    (folder / "evidence.json").write_text(json.dumps(evidence))


def better_ap(summary, evidence):
    summary["official"][0] += 0.01
    evidence["raw"]["official"][0] += 0.01


def better_iou(summary, _evidence):
    summary["matched"]["class_aware"]["miou_gt_micro"] += 0.01


def better_coverage(summary, _evidence):
    summary["coverage"]["attempted"] -= 1


def other_ties(_summary, evidence):
    evidence["equal_confidence"]["official"][0] += 0.01


@pytest.mark.parametrize(
    ("change", "what"),
    [
        (better_ap, "metrics from matches, own scores"),
        (better_iou, "matched IoU, class_aware"),
        (better_coverage, "images attempted"),
        (other_ties, "metrics from matches, equal confidence"),
    ],
)
def test_forged_numbers_do_not_follow_from_the_matches(evaluated, change, what):
    forge(evaluated / "eval", change)
    assert what in [c.what for c in bad(verify(evaluated / "eval", None))]


def test_inputs_that_moved_are_found_below_a_root(evaluated, tmp_path):
    moved = tmp_path / "elsewhere" / "deep"
    moved.mkdir(parents=True)
    shutil.move(evaluated / "run", moved / "run")
    shutil.move(evaluated / "truth.json", moved / "truth.json")
    assert {c.status for c in bad(verify(evaluated / "eval", None))} == {"MISSING"}
    assert not bad(verify(evaluated / "eval", moved))


def test_a_folder_that_is_no_evaluation(tmp_path):
    with pytest.raises(LegoWorldError, match=r"evidence\.json"):
        verify(tmp_path, None)
    (tmp_path / "evidence.json").write_text('{"kind": "something"}')
    with pytest.raises(LegoWorldError, match="another kind"):
        verify(tmp_path, None)


def altered(folder, alter):
    path = folder / "evidence.json"
    evidence = json.loads(path.read_text())
    alter(evidence)
    path.write_text(json.dumps(evidence))


@pytest.mark.parametrize(
    ("role", "without"),
    [
        ("run", ["configuration"]),
        ("run", ["finished_at", "configuration"]),
        ("truth", ["annotations"]),
        ("truth", ["finished_at"]),
    ],
)
def test_evidence_that_leaves_out_more_than_the_time_proves_nothing(evaluated, role, without):
    """A forger who may choose what the hash leaves out changes the rest and hashes again."""

    def alter(evidence):
        for entry in evidence["inputs"]:
            if entry["role"] == role:
                entry["without"] = without

    altered(evaluated / "eval", alter)
    [wrong] = bad(verify(evaluated / "eval", None))
    assert wrong.status == "DIFFERS"
    assert wrong.what.startswith(f"input {role} ")
    assert wrong.found.endswith("may: finished_at" if role == "run" else "may: nothing")


def test_evidence_of_before_the_time_was_left_out_holds(evaluated):
    def alter(evidence):
        [entry] = [e for e in evidence["inputs"] if e["role"] == "run"]
        entry["sha256"] = sha256_of_file(evaluated / "run" / "run.json")
        del entry["without"]

    altered(evaluated / "eval", alter)
    assert not bad(verify(evaluated / "eval", None))


@pytest.mark.parametrize(
    "damage",
    [
        {"files": None},
        {"files": {"summary.json": 3}},
        {"inputs": {}},
        {"inputs": [[]]},
        {"inputs": [{"role": "run", "path": 1, "sha256": "0"}]},
        {"inputs": [{"role": "run", "path": "r", "sha256": "0", "without": "finished_at"}]},
        {"inputs": [{"role": "run", "path": "r", "sha256": "0", "without": [None]}]},
    ],
)
def test_damaged_evidence_is_one_line(evaluated, capsys, damage):
    altered(evaluated / "eval", lambda evidence: evidence.update(damage))
    assert cli.run(["evidence", "verify", str(evaluated / "eval")]) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert "eval/evidence.json is damaged" in said


@pytest.mark.parametrize("key", ["raw", "equal_confidence"])
def test_evidence_without_its_numbers_differs(evaluated, key):
    altered(evaluated / "eval", lambda evidence: evidence.update({key: [1]}))
    assert [c.status for c in bad(verify(evaluated / "eval", None))] == ["DIFFERS"]
