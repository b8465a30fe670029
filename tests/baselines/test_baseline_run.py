"""A baseline's run as its user meets it: whatever the process does, a run folder comes out."""

from __future__ import annotations

import json
import subprocess
from pathlib import Path

import pytest
from baselines.tracks import (
    FAKE_BATCHED,
    call,
    make_photos,
    make_track,
    results,
    rows,
    run_arguments,
    run_document,
)
from running import paused
from waiting import until


@pytest.fixture
def run(track, photos, weights, tmp_path, capfd):
    """Run the fake: (exit code, run folder, standard error)."""

    def go(*options, name="run", **named):
        folder = tmp_path / name
        where = {"track": track, "photos": photos, "weights": weights} | {
            key: named.pop(key) for key in ("track", "photos", "weights") if key in named
        }
        code = call(
            run_arguments(
                where["track"], where["photos"], where["weights"], folder, *options, **named
            )
        )
        return code, folder, capfd.readouterr().err

    return go


def options(how: str, at: int = 3) -> list[str]:
    return ["--option", f"how={how}", "--option", f"at={at}"]


def write_truth(track: Path, path: Path) -> Path:
    document = json.loads(track.read_text())
    box = {"category_id": 18, "bbox": [10, 0, 12, 20], "area": 240, "iscrowd": 0}
    document["annotations"] = [
        {**box, "id": i["id"], "image_id": i["id"]} for i in document["images"]
    ]
    path.write_text(json.dumps(document))
    return path


def test_a_run_is_a_run_folder_like_any_other(run, track, tmp_path):
    code, folder, _ = run()
    assert code == 0
    document = run_document(folder)
    configuration = document["configuration"]
    assert configuration["kind"] == "baseline"
    assert configuration["attempted"] == 6
    assert not configuration["partial"]
    assert configuration["used_truth"] is None
    weights = configuration["provenance"]["weights"]
    assert [(w["name"], w["bytes"], len(w["sha256"])) for w in weights] == [("weights.bin", 7, 64)]
    assert configuration["provenance"]["labels"] == {"Dog": 18, "cat": 17}
    assert len(document["scenes"]["1"]["photo_sha256"]) == 64
    assert str(tmp_path) not in json.dumps(document)  # where things lie is no part of a result
    row = rows(folder)[2]
    assert (row["status"], row["code"], row["reason"]) == ("ok", "ok", None)
    assert (row["n_predictions"], row["counts"], row["warnings"]) == (3, {"considered": 3}, [])
    predictions = json.loads((folder / "predictions.json").read_text())
    assert len(predictions) == 18
    # The model's own order in each image, which here is that of its scores.
    assert predictions == sorted(predictions, key=lambda p: (p["image_id"], -p["score"]))
    truth = write_truth(track, tmp_path / "truth.json")
    evaluated = call(["evaluate", folder, "--truth", truth, "-o", tmp_path / "e", "--draws", "5"])
    assert evaluated == 0
    summary = json.loads((tmp_path / "e" / "summary.json").read_text())
    assert summary["coverage"]["scored"] == 6
    assert summary["kind"] == "baseline"


def test_the_same_command_again_predicts_nothing(run):
    _, folder, _ = run()
    before = results(folder)
    document = run_document(folder)
    code, _, said = run()
    assert code == 0
    assert "6 of 6 images have a valid result already" in said
    assert results(folder) == before
    again = run_document(folder)
    assert (again["configuration"], again["scenes"]) == (
        document["configuration"],
        document["scenes"],
    )


@pytest.mark.parametrize("how", ["print", "child"])
def test_prints_are_no_answers(run, how):
    _, clean, _ = run(name="clean")
    _, folder, _ = run(*options("print"), name="printed")
    assert results(folder) == results(clean)


def test_what_it_prints_is_shown_when_asked_for(run):
    _, _, quiet = run(*options("print"), name="quiet")
    _, _, verbose = run(*options("print"), "-v", name="verbose")
    assert "a library in C" not in quiet
    assert verbose.count("echo from a library in C".removeprefix("echo ")) == 6
    assert "an import that prints" in verbose


@pytest.mark.parametrize(
    ("how", "status", "code", "words"),
    [
        ("raise", "failed", "baseline_image", "RuntimeError: out of memory"),
        ("nan", "failed", "baseline_image", "not JSON compliant"),
        ("surrogate", "failed", "baseline_image", "surrogates not allowed"),
        ("deep", "failed", "baseline_answer", "nested beyond"),
        ("too_deep", "failed", "baseline_image", "RecursionError"),
        ("category", "failed", "predictions_invalid", "the vocabulary does not have"),
        ("extent", "failed", "box_format", "at least 0"),
        ("crash", "failed", "baseline_crashed", "SIGKILL; going down"),
        ("child", "failed", "baseline_crashed", "SIGKILL"),
        ("huge", "failed", "baseline_answer", "an integer of more than 64 bits"),
        ("twice", "failed", "baseline_answer", "two answers of image 3, 003.jpg"),
    ],
)
def test_one_bad_image_is_one_bad_row(run, how, status, code, words):
    _, clean, _ = run(name="clean")
    exit_code, folder, _ = run(*options(how), name="bad")
    assert exit_code == 1
    found = rows(folder)
    assert (found[3]["status"], found[3]["code"]) == (status, code)
    assert words in found[3]["reason"]
    good = rows(clean)
    assert all(found[i] == good[i] for i in (1, 2, 4, 5, 6))
    summary = json.loads((folder / "summary.json").read_text())
    assert summary["coverage"] == {
        "attempted": 6, "ok": 5, "ok_empty": 0, "by_status": {"failed": 1, "ok": 5},
    }  # fmt: skip


def wait_for_the_end_of(weights: Path) -> list[str]:
    """The processes the fake wrote down, when all of them have ended."""
    noted = weights.with_suffix(".pids").read_text().split()
    until(lambda: not any(map(is_running, noted)), f"the end of {noted}")
    return noted


def is_running(pid: str) -> bool:
    listed = subprocess.run(
        ["ps", "-o", "stat=", "-p", pid], capture_output=True, text=True, check=False
    )
    return bool(listed.stdout.strip()) and not listed.stdout.startswith("Z")


def test_a_process_that_dies_takes_what_it_started_with_it(run, weights):
    run(*options("child"), "--sandbox", "limits")
    assert len(wait_for_the_end_of(weights)) == 2  # it was tried twice


def test_a_crash_that_does_not_come_again_costs_nothing(run):
    _, clean, _ = run(name="clean")
    code, folder, said = run(*options("crash_once"), "-v", "--sandbox", "limits", name="crashed")
    assert code == 0
    assert "SIGKILL" in said
    assert "003.jpg" in said
    assert results(folder) == results(clean)


def test_an_image_that_hangs_is_a_timeout(run):
    """The fake sleeps for ten minutes; the others' answers take hundredths of a second."""
    for seconds in (3, 30):  # a busy machine may not answer for the others within the first
        code, folder, _ = run(*options("hang"), "--time-limit", str(seconds), name=f"{seconds} s")
        assert code == 1
        found = rows(folder)
        assert found[3]["status"] == "timeout"
        assert f"no answer after {seconds} s" in found[3]["reason"]
        if [row["status"] for row in found.values()].count("timeout") == 1:
            break
    assert [found[i]["status"] for i in (1, 2, 4, 5, 6)] == ["ok"] * 5


def test_a_limit_holds_while_it_loads(run):
    code, folder, said = run(*options("hang_loading"), "--time-limit", "1")
    assert code == 4
    assert "did not load its model in time; found: nothing after 1 s" in said
    assert "next: raise --load-time-limit" in said
    assert [p.name for p in folder.iterdir()] == [".lock"]


@pytest.mark.parametrize(("how", "late"), [("silent", {1, 2, 3, 4, 5, 6}), ("chatter", {3})])
def test_a_limit_is_over_whatever_is_said_instead_of_an_answer(run, how, late):
    """The fake is silent before its first photo, or says each moment that it works on the third."""
    for seconds in (2, 30):
        limits = ["--load-time-limit", "300", "--time-limit", str(seconds)]
        code, folder, _ = run(*options(how), *limits, name=f"{seconds} s")
        assert code == 1
        found = {i for i, row in rows(folder).items() if row["status"] == "timeout"}
        if found == late:
            break
    assert found == late
    assert f"no answer after {seconds} s" in rows(folder)[3]["reason"]


def test_an_answer_that_was_not_asked_for_names_the_image(run):
    code, folder, said = run(*options("stranger"))
    assert code == 4
    assert "answered for image 99; found: an image that it was not asked for" in said
    assert (folder / "journal.jsonl").read_bytes().count(b"\n") == 2  # nothing is lost


def test_a_failed_image_is_tried_again_and_the_others_are_not(run, photos, tmp_path):
    own = make_photos(tmp_path / "photos", [f"{n:03}.jpg" for n in range(1, 7)])
    whole = (own / "004.jpg").read_bytes()
    (own / "004.jpg").write_bytes(whole[:500])
    code, folder, _ = run(photos=own)
    assert code == 1
    assert "cannot be read" in rows(folder)[4]["reason"]
    (own / "004.jpg").write_bytes(whole)
    code, folder, said = run(photos=own)
    assert code == 0
    assert "5 of 6 images have a valid result already" in said
    _, clean, _ = run(name="clean")
    assert results(folder) == results(clean)


def test_another_photo_under_the_name_is_predicted_again(run, tmp_path):
    own = make_photos(tmp_path / "photos", [f"{n:03}.jpg" for n in range(1, 7)])
    _, folder, _ = run(photos=own)
    before = rows(folder)
    (own / "002.jpg").write_bytes((own / "005.jpg").read_bytes())
    _, folder, said = run(photos=own)
    assert "5 of 6" in said
    after = rows(folder)
    assert after[2]["predictions_sha256"] == before[5]["predictions_sha256"]
    assert all(after[i] == before[i] for i in (1, 3, 4, 5, 6))


def test_photos_that_are_absent_or_of_another_size_are_rows(run, tmp_path):
    names = [f"{n:03}.jpg" for n in range(1, 7)]
    own = make_photos(tmp_path / "photos", names)
    (own / "001.jpg").unlink()
    track = make_track(tmp_path / "t.json", names)
    document = json.loads(track.read_text())
    document["images"][1]["width"] = 65
    track.write_text(json.dumps(document))
    code, folder, _ = run(photos=own, track=track)
    assert code == 1
    found = rows(folder)
    assert (found[1]["status"], found[1]["code"]) == ("missing", "missing_photo")
    assert "64x48, the track says 65x48" in found[2]["reason"]
    assert found[3]["status"] == "ok"


def test_no_photo_at_all_is_a_wrong_folder(run, tmp_path):
    (tmp_path / "empty").mkdir()
    code, folder, said = run(photos=tmp_path / "empty")
    assert code == 2
    assert "none of the track's photos" in said
    assert not folder.exists()


def test_a_refusal_leaves_nothing_behind(run):
    code, folder, said = run(*options("refuse"))
    assert code == 2
    assert "the checkpoint is another model's; found: resnet; expected: fake" in said
    assert [p.name for p in folder.iterdir()] == [".lock"]
    code, _, _ = run()  # other options, the same folder: there is no run in it yet
    assert code == 0


def test_batches_are_refused_where_photos_go_one_by_one(run):
    code, folder, said = run("--batch-size", "2")
    assert code == 2
    assert "found: batch size 2" in said
    assert [p.name for p in folder.iterdir()] == [".lock"]


def test_a_refusal_keeps_an_earlier_run_even_with_overwrite(run):
    _, folder, _ = run()
    before = results(folder)
    code, _, _ = run(*options("refuse"), "--overwrite")
    assert code == 2
    assert results(folder) == before


def test_resume_is_what_happens_anyway_and_contradicts_overwrite(run):
    _, folder, _ = run()
    before = results(folder)
    code, _, _ = run("--resume")
    assert code == 0
    assert results(folder) == before
    code, _, said = run("--resume", "--overwrite")
    assert code == 2
    assert "pass one" in said


def test_a_process_that_ends_before_it_begins(run):
    code, folder, said = run(*options("die_loading"))
    assert code == 4
    assert "exit code 1; no module named nothing" in said
    assert [p.name for p in folder.iterdir()] == [".lock"]


def test_a_process_that_dies_after_its_last_answer_costs_nothing(run):
    _, clean, _ = run(name="clean")
    code, folder, _ = run(*options("die_at_the_end"), name="died")
    assert code == 0
    assert results(folder) == results(clean)


def test_other_weights_are_another_run(run, weights):
    _, folder, _ = run()
    before = results(folder)
    weights.write_bytes(b"others")
    code, _, said = run()
    assert code == 2
    assert "provenance.weights" in said
    assert results(folder) == before
    code, _, _ = run("--overwrite")
    assert code == 0
    assert run_document(folder)["configuration"]["provenance"]["weights"][0]["bytes"] == 6


@pytest.mark.parametrize(
    ("given", "key"),
    [
        (["--option", "at=9"], "options.at: 0 -> 9"),
        (["--dtype", "float16"], "dtype"),
        (["--device", "cuda:1"], 'device: "cpu" -> "cuda"'),
        (["--limit", "2"], "attempted: 6 -> 2"),
        (["--batch-size", "2"], "batch_size"),
    ],
)
def test_what_changes_numbers_is_compared(run, given, key):
    run()
    code, _, said = run(*given)
    assert code == 2
    assert key in said


def test_a_partial_run_says_so(run):
    _, folder, _ = run("--limit", "2")
    assert run_document(folder)["configuration"]["partial"]
    assert sorted(rows(folder)) == [1, 2]
    _, folder, _ = run("--image-id", "5", name="one")
    assert sorted(rows(folder)) == [5]


def start_and_kill(
    arguments: list[str], *, after: int, there: Path | None = None
) -> subprocess.Popen[str]:
    """Kill the command with -9 when its journal has some lines and the file `there` is there."""
    process = paused.start_paused([*arguments, "-q"], "row", after)
    until(lambda: there is None or there.is_file(), f"{there}")
    process.kill()
    process.communicate()
    return process


def test_kill_9_and_the_same_command_again_lose_nothing(track, photos, weights, tmp_path):
    assert call(run_arguments(track, photos, weights, tmp_path / "clean")) == 0
    arguments = run_arguments(track, photos, weights, tmp_path / "run")
    start_and_kill(arguments, after=2)
    assert (tmp_path / "run" / "journal.jsonl").read_bytes().count(b"\n") == 2
    with (tmp_path / "run" / "journal.jsonl").open("ab") as journal:
        journal.write(b'{"row": {"image_id": 6, "sta')  # as a write cut short leaves it
    assert call(arguments) == 0
    assert results(tmp_path / "run") == results(tmp_path / "clean")
    documents = [run_document(tmp_path / name) for name in ("run", "clean")]
    assert documents[0]["configuration"] == documents[1]["configuration"]
    assert documents[0]["scenes"] == documents[1]["scenes"]


def test_no_model_outlives_a_killed_legoworld(track, photos, weights, tmp_path):
    how = [*options("hang", at=2), "--sandbox", "limits"]
    arguments = run_arguments(track, photos, weights, tmp_path / "run", *how)
    process = start_and_kill(arguments, after=1, there=weights.with_suffix(".pids"))
    assert not is_running(str(process.pid))
    assert len(wait_for_the_end_of(weights)) == 1


def test_a_batch_is_always_of_the_same_images(track, photos, weights, tmp_path):
    batched = {"baseline": FAKE_BATCHED}
    given = ["--batch-size", "4"]
    clean = run_arguments(track, photos, weights, tmp_path / "clean", *given, **batched)
    assert call(clean) == 0
    predictions = json.loads((tmp_path / "clean" / "predictions.json").read_text())
    shared = [round(p["score"] * 2**20) for p in predictions]
    assert shared == [30, 30, 30, 30, 96, 96]
    # The journal of a run killed within the first batch's answers.
    arguments = run_arguments(track, photos, weights, tmp_path / "run", *given, **batched)
    start_and_kill(arguments, after=1)
    journal = tmp_path / "run" / "journal.jsonl"
    journal.write_bytes(journal.read_bytes().split(b"\n")[0] + b"\n")
    assert call(arguments) == 0
    assert results(tmp_path / "run") == results(tmp_path / "clean")


def test_one_of_a_batch_may_fail_alone(weights, tmp_path):
    names = ["bad/001.jpg", "002.jpg", "003.jpg"]
    photos = make_photos(tmp_path / "photos", names)
    track = make_track(tmp_path / "t.json", names)
    arguments = run_arguments(
        track, photos, weights, tmp_path / "run", "--batch-size", "3", baseline=FAKE_BATCHED
    )
    assert call(arguments) == 1
    found = rows(tmp_path / "run")
    assert [found[i]["status"] for i in (1, 2, 3)] == ["failed", "ok", "ok"]
    assert found[1]["reason"] == "a bad one"
