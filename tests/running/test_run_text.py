"""What readout prints: a line for each kind of trouble, near names, and the rest with -v."""

from __future__ import annotations

import io
import json
import re
import sys
from pathlib import Path

import pytest
from scene.gltf.documents import Document

from legoworld import cli
from legoworld.commands import progress
from legoworld.commands.run_text import failure_lines, stranger_lines, warning_lines
from legoworld.records.run_rows import RunRow
from legoworld.tracks.scene_names import Stranger, lower_top, strangers


def row(number, status="ok", reason=None, warnings=()):
    return RunRow(
        image_id=number,
        file_name=f"{number}.jpg",
        status=status,
        reason=reason,
        warnings=tuple(warnings),
    )


def test_failures_of_one_kind_are_one_line_and_all_with_v():
    rows = [
        row(1, "missing", "there is no scene folder '1'; next: a"),
        row(2, "invalid", "the scene has no active camera; next: b"),
        row(3, "missing", "there is no scene folder '3'; next: a"),
        row(4, "missing", "the scene folder '4' holds no scene; next: c"),
        row(5),
    ]
    assert failure_lines(rows, verbose=False) == [
        "missing: 1.jpg (image 1) and 1 more: there is no scene folder '1'; next: a",
        "invalid: 2.jpg (image 2): the scene has no active camera; next: b",
        "missing: 4.jpg (image 4): the scene folder '4' holds no scene; next: c",
    ]
    assert len(failure_lines(rows, verbose=True)) == 4


def test_the_first_warning_of_each_kind_is_shown_with_their_number():
    rows = [
        row(1, warnings=["image 'a.png' is missing", "image 'b.png' is missing"]),
        row(2, warnings=["the scene's own picture is 640x480, the image 64x48"]),
        row(3, warnings=["image 'c.png' is missing"]),
    ]
    assert warning_lines(rows, verbose=False) == [
        "warning: 1.jpg: image 'a.png' is missing (3 like it in 2 images)",
        "warning: 2.jpg: the scene's own picture is 640x480, the image 64x48",
    ]
    assert len(warning_lines(rows, verbose=True)) == 4


@pytest.mark.parametrize(
    ("folder", "meant"),
    [
        ("Coffee", "coffee"),
        ("coffee.png", "coffee"),
        ("coffee.jpg", "coffee"),
        ("coffee_scene", "coffee"),
        ("coffee_v2", "coffee"),
        ("139", "000000000139"),
        ("000139.jpg", "000000000139"),
        ("COCO_val2017_000000000139", "000000000139"),
        ("image_139", "000000000139"),
        ("run1/coffee", "coffee"),
        ("cofee", "coffee"),
        ("dsc_0286", "courtyard/DSC_0286"),
        ("notes", None),
        ("140", None),
        ("000000000138", None),  # another number is another photo
    ],
)
def test_what_a_folder_is_near(folder, meant):
    absent = ["coffee", "000000000139", "courtyard/DSC_0286"]
    assert strangers([folder, "chelsea"], [*absent, "chelsea"], absent) == [
        Stranger(folder=folder, meant=meant)
    ]


def test_a_name_that_two_photos_are_near_is_nobodys():
    absent = ["a/DSC_1", "b/DSC_1"]
    assert strangers(["dsc_1"], absent, absent)[0].meant is None


def test_a_scene_that_is_there_is_not_what_another_folder_means():
    assert strangers(["coffee", "Coffee"], ["coffee"], [])[0].meant is None


def test_scenes_that_lie_one_level_lower():
    absent = ["a", "b"]
    found = strangers(["run/a", "run/b"], absent, absent)
    assert lower_top(found) == "run"
    assert stranger_lines(found, verbose=False) == [
        "2 folders match no image of the track; did you mean SCENES/run?"
    ]
    assert lower_top(strangers(["x/a", "y/b"], absent, absent)) is None


def test_folders_that_match_nothing_are_counted_and_the_nearest_named_first():
    absent = ["coffee"]
    found = strangers([f"n{i}" for i in range(9)] + ["Coffee"], absent, absent)
    (line,) = stranger_lines(found, verbose=False)
    assert line.startswith("10 folders match no image of the track: 'Coffee' (did you mean 'coff")
    assert line.endswith(" and 7 more")
    (whole,) = stranger_lines(found, verbose=True)
    assert "'n8'" in whole
    assert stranger_lines([], verbose=True) == []
    (own,) = stranger_lines([Stranger(folder=".", meant=None)], verbose=False)
    assert own.startswith("SCENES is itself a scene folder")


def write_track(path: Path, names: list[str]) -> Path:
    images = [
        {"id": i, "file_name": name, "width": 64, "height": 48} for i, name in enumerate(names, 1)
    ]
    path.write_text(json.dumps({"info": {}, "images": images, "categories": []}))
    return path


def test_readout_names_near_folders_and_the_source_that_can_be_read(tmp_path, capsys):
    for name, file in (("Coffee", "scene.glb"), ("tea", "scene.glb"), ("x", "scene.blend")):
        (tmp_path / "scenes" / name).mkdir(parents=True)
        (tmp_path / "scenes" / name / file).write_bytes(b"")
    track = write_track(tmp_path / "t.json", ["coffee.png", "tea.png"])
    arguments = [str(tmp_path / "scenes"), "--task", "coco", "--track", str(track)]
    assert cli.run(["readout", *arguments, "-o", str(tmp_path / "run")]) == 1
    shown = capsys.readouterr().out
    assert "2 folders match no image of the track: 'Coffee' (did you mean 'coffee'?), 'x'" in shown
    assert "next: pass --source glb to `legoworld readout` or `inspect`" in shown
    assert len(shown.splitlines()) <= 6
    assert cli.run(["readout", *arguments, "-o", str(tmp_path / "run"), "--json"]) == 1
    document = json.loads(capsys.readouterr().out)
    assert document["unmatched_folders"] == [
        {"folder": "Coffee", "meant": "coffee"}, {"folder": "x", "meant": None},
    ]  # fmt: skip


def test_readout_has_a_row_for_each_image_with_v_and_without_it_three_labels(tmp_path, capsys):
    made = Document()
    labels = ["dog", *(f"no{i}" for i in range(6))]
    for number, label in enumerate(labels):
        made.quad(f"Q{number}", number % 3, number // 3, extras={"category": label})
    (tmp_path / "scenes" / "coffee").mkdir(parents=True)
    (tmp_path / "scenes" / "coffee" / "scene.glb").write_bytes(made.glb())
    track = write_track(tmp_path / "t.json", ["coffee.png", "tea.png"])
    words = ["readout", str(tmp_path / "scenes"), "--task", "coco", "--track", str(track)]
    words += ["--source", "glb", "--no-cache", "--workers", "1", "-q"]
    assert cli.run([*words, "-o", str(tmp_path / "a")]) == 1
    short = capsys.readouterr().out
    assert "... and 3 more labels outside the vocabulary (-v lists them)\n" in short
    assert cli.run([*words, "-o", str(tmp_path / "b"), "-v"]) == 1
    head, _rule, coffee, tea, blank, *rest = capsys.readouterr().out.splitlines()
    assert head.split() == ["image", "photo", "status", "exported", "unexported", "warnings"]
    assert coffee.split()[:5] == ["1", "coffee.png", "ok", "1", "0"]
    assert tea.split() == ["2", "tea.png", "missing", "-", "-", "0"]
    assert blank == ""
    assert all(any(f"'no{i}'" in line for line in rest) for i in range(6))


@pytest.mark.parametrize("shard", ["1", "1/2/3", "a/b", "1/", "-1/2", "0/2", "3/2", "0/0"])
def test_what_is_no_shard_is_refused(shard, tmp_path, capsys):
    words = ["readout", str(tmp_path), "--task", "coco", "-o", str(tmp_path / "run")]
    assert cli.run([*words, "--shard", shard]) == 2
    assert re.search(r"is not a shard such as 1/16|shards are counted", capsys.readouterr().err)


def test_a_broken_installation_is_no_scenes_verdict(tmp_path, monkeypatch, capsys):
    from legoworld.errors import KernelBuildError

    def missing():
        raise KernelBuildError("the visibility kernel was not compiled")

    monkeypatch.setattr("legoworld.running.scene_pass.library", missing)
    track = write_track(tmp_path / "t.json", ["coffee.png"])
    (tmp_path / "scenes").mkdir()
    arguments = [str(tmp_path / "scenes"), "--task", "coco", "--track", str(track)]
    assert cli.run(["readout", *arguments, "-o", str(tmp_path / "run")]) == 4
    assert "the visibility kernel was not compiled" in capsys.readouterr().err
    assert not (tmp_path / "run").exists()


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def test_the_bar_begins_at_what_is_done_and_ends_full(monkeypatch):
    terminal = Terminal()
    monkeypatch.setattr(sys, "stderr", terminal)
    monkeypatch.setattr("tqdm.std.tqdm.monitor_interval", 0)
    with progress.shown_progress("scene", quiet=False) as shown:
        shown.total(10)
        shown.kept(7)
        assert "7/10" in terminal.getvalue()
        for number in (8, 9):
            shown.row(row(number))
        shown.row(row(10, "missing", "no"))
        shown.notice("a notice")
    last = terminal.getvalue()
    assert "10/10" in last
    assert "failed=1" in last
    assert "a notice" in last


def test_without_a_terminal_or_quiet_there_is_no_bar(monkeypatch):
    silent = io.StringIO()
    monkeypatch.setattr(sys, "stderr", silent)
    with progress.shown_progress("scene", quiet=False) as shown:
        shown.kept(1)
        shown.row(row(1))
    assert silent.getvalue() == ""
    monkeypatch.setattr(sys, "stderr", Terminal())
    with progress.shown_progress("scene", quiet=True) as shown:
        shown.row(row(1))
        shown.notice("nothing")
    assert sys.stderr.getvalue() == ""


def test_inspect_of_a_folder_of_scenes_names_one(tmp_path, capsys):
    for name in ("b", "a"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "scene.blend").write_bytes(b"")
    assert cli.run(["inspect", str(tmp_path)]) == 2
    said = capsys.readouterr().err
    assert (
        f"contains 2 scene folders but is not one itself: pass one of them, such as {tmp_path}/a"
        in said
    )


@pytest.mark.parametrize(
    "words",
    [
        ["track", "check", "{here}/t.json", "--photos", "{here}", "--sample", "3"],
        ["track", "check", "{here}/t.json", "--photos", "{here}", "--task", "coco"],
        ["inspect", "{here}", "--compare-sources", "--source", "glb"],
    ],
    ids=lambda words: " ".join(words),
)
def test_no_option_is_silently_ignored(words, tmp_path, capsys):
    write_track(tmp_path / "t.json", ["coffee.png"])
    assert cli.run([word.format(here=tmp_path) for word in words]) == 2
    assert words[-2] in capsys.readouterr().err


@pytest.mark.parametrize("kind", ["tasks", "datasets", "baselines"])
def test_list_leaves_out_what_is_for_another_task(kind, capsys):
    names = {}
    for task in ("coco", "lvis", "eth3d"):
        assert cli.run(["list", kind, "--task", task, "--json"]) == 0
        names[task] = {entry["name"] for entry in json.loads(capsys.readouterr().out)[kind]}
    assert names["eth3d"]
    assert not names["eth3d"] & (names["coco"] | names["lvis"])
