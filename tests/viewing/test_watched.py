"""What is seen of a folder while runs and trials go on below it."""

from __future__ import annotations

import json
import os
import threading
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from pathlib import Path

import pytest
from trajectories.pages import record_trial

from legoworld.records.base import readable
from legoworld.records.folders.run_journal import append, journal
from legoworld.records.run_file import Configuration, ImageRecord
from legoworld.records.run_rows import RunRow
from legoworld.viewing import watched
from legoworld.viewing.watched import Watch

PNG = b"\x89PNG\r\n\x1a\n"


def begin_run(folder: Path, images: int = 12) -> None:
    folder.mkdir(parents=True)
    text = readable(Configuration(task="coco", attempted=images))
    (folder / "configuration.json").write_text(text, encoding="utf-8")


def add_rows(folder: Path, *statuses: str, first: int = 1) -> None:
    with journal(folder) as stream:
        for number, status in enumerate(statuses, first):
            reason = None if status == "ok" else f"{status}\nhere"
            row = RunRow(image_id=number, file_name=f"{number}.jpg", status=status, reason=reason)
            append(stream, ImageRecord(row=row))


def begin_trial(folder: Path, scene: str = "two") -> None:
    (folder / "workspace").mkdir(parents=True)
    (folder / "made" / "trial").mkdir(parents=True)
    begun = {"scene": scene, "agent": "program", "card_sha256": "0", "prompt_sha256": "0"}
    begun |= {"time_limit_s": 600.0, "parts": [0]}
    (folder / "begun.json").write_text(json.dumps(begun), encoding="utf-8")


def only(watch: Watch):
    (source,) = watch.look().sources
    return source


def test_rows_of_a_run_as_they_come(tmp_path):
    watch = Watch(tmp_path)
    assert watch.look().sources == ()
    begin_run(tmp_path / "runs" / "coco")
    source = only(watch)
    assert (source.name, source.kind, source.task) == ("runs/coco", "run", "coco")
    assert (source.done, source.of, source.finished, source.page) == (0, 12, False, False)
    add_rows(tmp_path / "runs" / "coco", "ok", "missing")
    assert only(watch).statuses == {"missing": 1, "ok": 1}
    add_rows(tmp_path / "runs" / "coco", "ok", first=3)
    source = only(watch)
    assert (source.done, dict(source.statuses)) == (3, {"missing": 1, "ok": 2})
    assert [row.name for row in source.rows] == ["3.jpg", "2.jpg", "1.jpg"]
    assert source.rows[1].note == "missing here"


def test_a_line_that_is_not_whole_yet_is_read_when_it_is(tmp_path):
    folder = tmp_path / "run"
    begin_run(folder)
    add_rows(folder, "ok", "ok")
    whole = (folder / "journal.jsonl").read_bytes()
    (folder / "journal.jsonl").write_bytes(whole[:-5])
    watch = Watch(tmp_path)
    assert only(watch).done == 1
    (folder / "journal.jsonl").write_bytes(whole)
    assert only(watch).done == 2


def test_two_looks_at_once_count_a_row_once(tmp_path, monkeypatch):
    begin_run(tmp_path / "run")
    add_rows(tmp_path / "run", "ok", "ok")
    both, read = threading.Barrier(2), watched.rows_after

    def read_together(folder, at):
        found = read(folder, at)
        with suppress(threading.BrokenBarrierError):
            both.wait(0.3)
        return found

    monkeypatch.setattr(watched, "rows_after", read_together)
    watch = Watch(tmp_path)
    with ThreadPoolExecutor(2) as pool:
        list(pool.map(lambda _: watch.look(), range(2)))
    assert only(watch).done == 2


def test_a_run_that_is_begun_again(tmp_path):
    folder = tmp_path / "run"
    begin_run(folder)
    add_rows(folder, "ok", "ok", "ok")
    watch = Watch(tmp_path)
    assert only(watch).done == 3
    (folder / "journal.jsonl").unlink()
    assert only(watch).done == 0
    add_rows(folder, "missing")
    assert only(watch).statuses == {"missing": 1}
    (folder / "journal.jsonl").write_bytes(b"")  # and grown past what was read before the next look
    add_rows(folder, "timeout", "ok", "ok")
    assert only(watch).statuses == {"ok": 2, "timeout": 1}


def test_no_more_rows_than_a_page_can_show(tmp_path):
    begin_run(tmp_path / "run", images=100)
    add_rows(tmp_path / "run", *["ok"] * 100)
    source = only(Watch(tmp_path))
    assert (source.done, len(source.rows), source.rows[0].name) == (100, 60, "100.jpg")


def test_a_trial_that_goes_on_and_its_last_picture(tmp_path):
    trial = tmp_path / "scenes" / ".unfinished-7"
    begin_trial(trial)
    (trial / "made" / "trial" / "calls.jsonl").write_text("{}\n{}\n", encoding="utf-8")
    source = only(Watch(tmp_path))
    assert (source.kind, source.name, source.finished, source.page) == (
        "trials", "scenes", False, False,
    )  # fmt: skip
    (row,) = source.rows
    assert (row.name, row.status, row.note) == ("two", "running", "program, calls so far: 2")
    assert row.picture is None
    workspace = trial / "workspace"
    for age, name in enumerate(["reference.png", "late.jpg", "early.png", "scene.blend"]):
        (workspace / name).write_bytes(PNG)
        os.utime(workspace / name, (1000 - age, 1000 - age))
    assert only(Watch(tmp_path)).rows[0].picture == "scenes/.unfinished-7/workspace/late.jpg"


def test_a_workspace_that_is_a_link_shows_nothing_of_where_it_leads(tmp_path):
    trial = tmp_path / "scenes" / ".unfinished-7"
    begin_trial(trial)
    outside = tmp_path / ".outside"
    outside.mkdir()
    (outside / "secret.png").write_bytes(PNG)
    (trial / "workspace").rmdir()
    (trial / "workspace").symlink_to(outside)
    assert only(Watch(tmp_path)).rows[0].picture is None


@pytest.mark.parametrize(
    ("names", "kind"),
    [
        (("run.json", "summary.json"), "run"),
        (("run.json", "comparison.json"), "comparison"),
        (("evidence.json", "summary.json"), "evaluation"),
    ],
)
def test_a_damaged_result_says_so_and_hides_no_other(tmp_path, names, kind):
    (tmp_path / "bad").mkdir()
    for file in names:
        (tmp_path / "bad" / file).write_text("{", encoding="utf-8")
    begin_run(tmp_path / "good")
    bad, good = Watch(tmp_path).look().sources
    assert (bad.kind, bool(bad.problem)) == (kind, True)
    assert good.problem is None
    assert not bad.page


def test_folders_too_deep_hidden_or_many_are_left_out(tmp_path, monkeypatch):
    begin_run(tmp_path / "a" / "b" / "c" / "d" / "e" / "f")
    begin_run(tmp_path / ".hidden" / "run")
    assert Watch(tmp_path).look().sources == ()
    monkeypatch.setattr("legoworld.viewing.watched._MOST_FOLDERS", 3)
    state = Watch(tmp_path).look()
    assert state.left_out
    assert not Watch(tmp_path / ".hidden").look().left_out


def test_the_newest_of_many_ended_trials_are_shown(tmp_path):
    record = json.loads(readable(record_trial(tmp_path / ".made").about))
    for number in range(65):
        folder = tmp_path / "scenes" / f"{number:02}"
        folder.mkdir(parents=True)
        file = folder / "reconstruction.json"
        file.write_text(json.dumps(record | {"scene": f"{number:02}"}), encoding="utf-8")
        os.utime(file, (1000 + number * 7 % 65, 1000 + number * 7 % 65))
    watch = Watch(tmp_path)
    source = only(watch)
    expected = sorted(range(65), key=lambda number: number * 7 % 65, reverse=True)[:60]
    assert [row.name for row in source.rows] == [f"{number:02}" for number in expected]
    (tmp_path / "scenes" / "09" / "reconstruction.json").write_text("{", encoding="utf-8")
    assert only(watch).statuses == {"ok": 64, "unreadable": 1}
