"""A readout run as its user meets it: odd scenes, resume, the same bytes every time."""

from __future__ import annotations

import json
import os
import signal
from pathlib import Path

import pytest
from running import paused
from running.run_folders import results_alone as results
from waiting import PATIENCE_S

from legoworld import cli

pytestmark = pytest.mark.blender

SCENES = """
for i in range(6):
    fresh(); camera()
    quad("Dog", x=i - 3, category="dog")
    quad("Wall", z=-2, half=9)
    save(f"good{i}")
fresh(); camera(); quad("Thing", category="unicorn"); quad("Lap", x=2, category="lap_top")
save("odd_label")
fresh(); quad("Dog", category="dog"); save("no_camera")
fresh(); camera(); save("no_mesh")
"""


@pytest.fixture(scope="module")
def scenes(tmp_path_factory: pytest.TempPathFactory, build_scenes) -> Path:
    folder = tmp_path_factory.mktemp("scenes")
    build_scenes(SCENES, folder)
    (folder / "text").mkdir()
    (folder / "text" / "scene.blend").write_text("this is not a blend file")
    (folder / "truncated").mkdir()
    whole = (folder / "good0" / "scene.blend").read_bytes()
    (folder / "truncated" / "scene.blend").write_bytes(whole[: len(whole) // 2])
    (folder / "bad_labels").mkdir()
    (folder / "bad_labels" / "scene.blend").write_bytes(whole)
    (folder / "bad_labels" / "labels.json").write_text('{"version": 1, "labels": [{')
    return folder


@pytest.fixture(scope="module")
def track(scenes: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    names = [f"good{i}" for i in range(6)]
    names += ["odd_label", "no_camera", "no_mesh", "text", "truncated", "bad_labels", "absent"]
    images = [
        {"id": 10 + i, "file_name": f"{name}.jpg", "width": 64, "height": 48}
        for i, name in enumerate(names)
    ]
    return write_track(tmp_path_factory.mktemp("tracks") / "track.json", images)


def write_track(path: Path, images: list[dict]) -> Path:
    path.write_text(json.dumps({"info": {}, "images": images, "categories": []}))
    return path


def rows(run: Path) -> dict[str, dict]:
    lines = (run / "per_image.jsonl").read_text().splitlines()
    return {row["scene"]: row for row in map(json.loads, lines)}


def readout(*arguments: object) -> int:
    return cli.run(["readout", "-q", *map(str, arguments)])


@pytest.fixture(scope="module")
def run(scenes: Path, track: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    output = tmp_path_factory.mktemp("run") / "one"
    code = readout(scenes, "--task", "coco", "--track", track, "-o", output, "--workers", 1)
    assert code == 1
    return output


def test_every_odd_scene_is_a_named_verdict_and_the_rest_is_read(run: Path):
    found = {scene: (row["status"], row["code"]) for scene, row in rows(run).items()}
    assert found == {
        **{f"good{i}": ("ok", "ok") for i in range(6)},
        "odd_label": ("ok", "ok"),
        "no_camera": ("invalid", "no_camera"),
        "no_mesh": ("invalid", "no_mesh"),
        "text": ("invalid", "unreadable_blend"),
        "truncated": ("invalid", "unreadable_blend"),
        "bad_labels": ("invalid", "invalid_labels"),
        "absent": ("missing", "missing_scene"),
    }
    for row in rows(run).values():
        if row["status"] != "ok":
            assert "found: " in row["reason"]
            assert "expected: " in row["reason"]
            assert "next: " in row["reason"]
            assert "\n" not in row["reason"]


def test_boxes_are_exact(run: Path):
    # 64 px wide, lens = sensor: fx = 64, so at 10 units a quad of side 2 is 12.8 px wide.
    predictions = json.loads((run / "predictions.json").read_text())
    by_image = {p["image_id"]: p for p in predictions}
    # good3: the quad spans x = 32 +- 6.4, y = 24 +- 6.4: pixel centres 26 .. 37 and 18 .. 29.
    assert by_image[13] == {
        "image_id": 13, "category_id": 18, "bbox": [26, 18, 12, 12], "score": 1.0
    }  # fmt: skip


def test_labels_outside_the_vocabulary_are_counted_with_the_nearest_names(run: Path):
    row = rows(run)["odd_label"]
    assert row["n_predictions"] == 0
    assert [u["label"] for u in row["unmatched"]] == ["lap_top", "unicorn"]
    assert "laptop" in row["unmatched"][0]["nearest"]
    summary = json.loads((run / "summary.json").read_text())
    assert summary["unmatched_labels"] == {"lap_top": 1, "unicorn": 1}
    assert summary["coverage"]["attempted"] == 13
    assert summary["coverage"]["ok"] == 7
    assert summary["coverage"]["ok_empty"] == 1


@pytest.mark.parametrize("task", ["coco", "coco-masks", "lvis", "eth3d"])
def test_same_bytes_for_any_worker_count_order_and_cache(task, scenes, track, tmp_path: Path):
    document = json.loads(track.read_text())
    shuffled = write_track(tmp_path / "shuffled.json", document["images"][::-1])
    one, two, three = tmp_path / "1", tmp_path / "2", tmp_path / "3"
    readout(scenes, "--task", task, "--track", track, "-o", one, "--workers", 1, "--no-cache")
    readout(scenes, "--task", task, "--track", track, "-o", two, "--workers", 2)
    readout(scenes, "--task", task, "--track", shuffled, "-o", three, "--workers", 2)
    assert results(one) == results(two) == results(three)
    assert len(results(one)) > 1


def test_a_killed_run_goes_on_and_ends_in_the_same_bytes(scenes, track, run, tmp_path: Path):
    output = tmp_path / "killed"
    arguments = [
        "readout", str(scenes), "--task", "coco", "-q",
        "--track", str(track), "-o", str(output), "--workers", "1", "--no-cache",
    ]  # fmt: skip
    process = paused.start_paused(arguments, "row", 3)
    process.kill()
    process.communicate()
    journal = output / "journal.jsonl"
    assert journal.read_bytes().count(b"\n") == 3
    journal.write_bytes(journal.read_bytes() + b'{"row": {"image_id"')
    assert cli.run(arguments) == 1
    assert results(output) == results(run)


def test_a_finished_run_is_not_read_again(scenes, track, run, monkeypatch):
    from legoworld.scene.blender_process import BlenderProcess

    before = results(run)
    asked = []
    original = BlenderProcess.request
    monkeypatch.setattr(
        BlenderProcess, "request", lambda self, m: asked.append(m["blend"]) or original(self, m)
    )
    readout(scenes, "--task", "coco", "--track", track, "-o", run)
    assert sorted(Path(p).parent.name for p in asked) == [
        "no_camera", "no_mesh", "text", "truncated",
    ]  # fmt: skip
    assert results(run) == before


def test_the_second_task_does_not_start_blender(scenes, run, tmp_path: Path, monkeypatch):
    from legoworld.scene.blender_process import BlenderProcess

    def refuse(self) -> None:
        raise AssertionError("Blender was started")

    images = [{"id": 1, "file_name": "good0.jpg", "width": 64, "height": 48}]
    track = write_track(tmp_path / "t.json", images)
    monkeypatch.setattr(BlenderProcess, "start", refuse)
    for task in ("lvis", "eth3d"):
        assert readout(scenes, "--task", task, "--track", track, "-o", tmp_path / task) == 0


def test_another_configuration_is_refused_by_name(scenes, track, run, capsys):
    code = readout(scenes, "--task", "lvis", "--track", track, "-o", run)
    assert code == 2
    message = capsys.readouterr().err
    assert 'task: "coco" -> "lvis"' in message
    assert "--overwrite" in message


def test_partial_runs_are_marked(scenes, track, tmp_path: Path):
    output = tmp_path / "part"
    assert readout(scenes, "--task", "coco", "--track", track, "-o", output, "--limit", 2) == 0
    summary = json.loads((output / "summary.json").read_text())
    assert summary["partial"] is True
    assert summary["coverage"]["attempted"] == 2


@pytest.mark.own_blender
def test_a_scene_over_its_time_or_memory_is_its_own_verdict(scenes, tmp_path: Path, monkeypatch):
    from legoworld.scene.blender_process import BlenderProcess

    start = BlenderProcess.start

    def never_answers(self) -> None:
        start(self)
        os.kill(self._process.pid, signal.SIGSTOP)

    images = [{"id": 1, "file_name": "good0.jpg", "width": 64, "height": 48}]
    track = write_track(tmp_path / "t.json", images)
    common = [scenes, "--task", "coco", "--track", track, "--no-cache"]
    with monkeypatch.context() as patch:
        patch.setattr(BlenderProcess, "start", never_answers)
        assert readout(*common, "-o", tmp_path / "slow", "--time-limit", 0.5) == 1
    assert rows(tmp_path / "slow")["good0"]["status"] == "timeout"
    assert readout(*common, "-o", tmp_path / "fat", "--memory-limit", 0.1) == 1
    row = rows(tmp_path / "fat")["good0"]
    assert (row["status"], row["code"]) == ("failed", "worker_memory")


def test_two_runs_into_one_folder_are_refused(scenes, track, tmp_path: Path, capsys):
    from legoworld.records.folders import run_folder

    with run_folder.lock_run(tmp_path):
        assert readout(scenes, "--task", "coco", "--track", track, "-o", tmp_path) == 2
    assert "another process" in capsys.readouterr().err


def test_frozen_scenes_are_checked_before_every_use(scenes, tmp_path: Path):
    import shutil

    frozen = tmp_path / "scenes"
    shutil.copytree(scenes / "good0", frozen / "good0")
    common = [frozen, "--task", "coco"]
    assert readout(*common, "-o", tmp_path / "a", "--require-frozen") == 1
    assert rows(tmp_path / "a")["good0"]["code"] == "not_frozen"
    assert cli.run(["freeze", str(frozen), "-q"]) == 0
    assert readout(*common, "-o", tmp_path / "b", "--require-frozen") == 0
    (frozen / "good0" / "labels.json").write_text('{"version": 1, "labels": []}')
    assert readout(*common, "-o", tmp_path / "c") == 1
    assert rows(tmp_path / "c")["good0"]["status"] == "changed"
    (frozen / "good0" / "labels.json").unlink()
    with (frozen / "good0" / "scene.blend").open("ab") as stream:
        stream.write(b"x")
    assert readout(*common, "-o", tmp_path / "d") == 1
    assert rows(tmp_path / "d")["good0"]["status"] == "changed"


def test_edited_labels_are_read_without_blender(scenes, tmp_path: Path, monkeypatch):
    import shutil

    folder = tmp_path / "scenes"
    shutil.copytree(scenes / "good3", folder / "good3")
    labels = {"version": 1, "labels": [{"object": "Wall", "category": "bed"}]}
    (folder / "good3" / "labels.json").write_text(json.dumps(labels))
    assert readout(folder, "--task", "coco", "-o", tmp_path / "run") == 0
    predictions = json.loads((tmp_path / "run" / "predictions.json").read_text())
    assert [p["category_id"] for p in predictions] == [18, 65]


def test_ctrl_c_keeps_what_is_done_and_leaves_no_blender_behind(scenes, track, tmp_path: Path):
    output = tmp_path / "stopped"
    arguments = [
        "readout", str(scenes), "--task", "coco", "-q",
        "--track", str(track), "-o", str(output), "--workers", "2", "--no-cache",
    ]  # fmt: skip
    process = paused.start_paused(arguments, "row", 2)
    process.send_signal(signal.SIGINT)
    paused.resume(process)
    _, error = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 130
    assert "finished images are kept; run the same command again to resume" in error
    assert (output / "journal.jsonl").read_bytes().count(b"\n") >= 2
    with pytest.raises(ProcessLookupError):
        os.killpg(process.pid, 0)


def test_fail_fast_stops_and_the_rest_is_still_to_do(scenes, track, tmp_path: Path):
    output = tmp_path / "fast"
    code = readout(
        scenes, "--task", "coco", "--track", track, "-o", output, "--fail-fast", "--workers", 1
    )
    assert code == 1
    summary = json.loads((output / "summary.json").read_text())
    assert summary["coverage"]["attempted"] == 13
    assert summary["partial"] is True
    assert 0 < len(rows(output)) < 13


def test_max_side_is_for_depth_only(scenes, track, tmp_path: Path, capsys):
    common = [scenes, "--track", track, "--max-side", 16, "-o", tmp_path / "small"]
    assert readout(*common, "--task", "coco") == 2
    assert "--max-side is for depth" in capsys.readouterr().err
    readout(*common, "--task", "eth3d")
    row = rows(tmp_path / "small")["good0"]
    assert (row["size_wh"], row["rendered_wh"]) == ([64, 48], [16, 12])


def test_a_damaged_cache_entry_is_made_again(scenes, tmp_path: Path):
    images = [{"id": 1, "file_name": "good0.jpg", "width": 64, "height": 48}]
    track = write_track(tmp_path / "t.json", images)
    cache = tmp_path / "cache"
    common = [scenes, "--task", "coco", "--track", track, "--cache", cache]
    assert readout(*common, "-o", tmp_path / "a") == 0
    (entry,) = cache.rglob("*.snapshot")
    whole = entry.read_bytes()
    entry.write_bytes(whole[:1000])
    assert readout(*common, "-o", tmp_path / "b") == 0
    assert results(tmp_path / "a") == results(tmp_path / "b")
    assert entry.read_bytes() == whole


def test_a_label_for_an_object_that_is_not_there_is_a_warning_of_the_row(scenes, tmp_path: Path):
    import shutil

    shutil.copytree(scenes / "good0", tmp_path / "scenes" / "good0")
    labels = {"version": 1, "labels": [{"object": "Nobody", "category": "bed"}]}
    (tmp_path / "scenes" / "good0" / "labels.json").write_text(json.dumps(labels))
    readout(tmp_path / "scenes", "--task", "coco", "-o", tmp_path / "run")
    assert any("Nobody" in w for w in rows(tmp_path / "run")["good0"]["warnings"])


def test_a_run_whose_predictions_were_lost_is_read_again(scenes, track, run, tmp_path: Path):
    import shutil

    copy = tmp_path / "run"
    shutil.copytree(run, copy)
    (copy / "predictions.json").unlink()
    readout(scenes, "--task", "coco", "--track", track, "-o", copy)
    assert results(copy) == results(run)


def test_a_folder_of_other_things_is_left_as_it_is(scenes, track, tmp_path: Path, capsys):
    for name in ("summary.json", ".keep.tmp", "notes.txt"):
        (tmp_path / name).write_text("mine")
    (tmp_path / "run.json").write_text('{"x": 1}')
    before = sorted(p.name for p in tmp_path.iterdir())
    for extra in ([], ["--overwrite"]):
        assert readout(scenes, "--task", "coco", "--track", track, "-o", tmp_path, *extra) == 2
    assert "not of a run" in capsys.readouterr().err
    assert sorted(p.name for p in tmp_path.iterdir()) == before


def test_a_readout_never_writes_into_the_scenes(scenes, track, capsys):
    assert readout(scenes, "--task", "coco", "--track", track, "-o", scenes / "good0") == 2
    assert "readout never writes there" in capsys.readouterr().err


def test_one_name_that_cannot_be_looked_at_does_not_end_the_run(scenes, tmp_path: Path):
    images = [
        {"id": 1, "file_name": "x" * 300 + ".jpg", "width": 64, "height": 48},
        {"id": 2, "file_name": "good0.jpg", "width": 64, "height": 48},
    ]
    track = write_track(tmp_path / "t.json", images)
    assert readout(scenes, "--task", "coco", "--track", track, "-o", tmp_path / "run") == 1
    found = rows(tmp_path / "run")
    assert found["good0"]["status"] == "ok"
    assert found["x" * 300]["status"] == "invalid"
