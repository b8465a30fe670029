"""Comparisons of several tasks as one table, and what was recorded of how scenes were made."""

from __future__ import annotations

import json
from types import SimpleNamespace

import pytest
from comparison.evaluations import (
    bad,
    compare,
    depth_scene_and_baseline,
    evaluate,
    forge,
    scene_and_baseline,
)
from evaluation.detection_runs import random_predictions, random_truth

from legoworld import cli
from legoworld.comparison.make_comparison import _common_images, join_folders
from legoworld.comparison.verification import verify_comparison
from legoworld.errors import LegoWorldError, UsageError


@pytest.fixture(scope="module")
def three(tmp_path_factory):
    """Comparison folders of eth3d, lvis and coco, in this order."""
    folder = tmp_path_factory.mktemp("three")
    compare(depth_scene_and_baseline(folder / "e"), folder / "eth3d", draws=20)
    for task in ("lvis", "coco"):
        compare(scene_and_baseline(folder / task[0], task), folder / task, draws=20)
    return [folder / task for task in ("eth3d", "lvis", "coco")]


def test_one_table_of_three_tasks(three, tmp_path, capsys):
    out = tmp_path / "out"
    assert cli.run(["compare", "--join", *map(str, three), "-o", str(out), "-v"]) == 0
    shown = capsys.readouterr().out
    *blocks, coverage = shown.split("\n\n")[:8]
    tasks = [
        b.split(",")[0] for b in blocks for line in b.splitlines() if "↑" in line or "↓" in line
    ]
    assert list(dict.fromkeys(tasks)) == ["coco", "lvis", "eth3d"]
    assert [tasks.count(t) for t in ("coco", "lvis", "eth3d")] == [8, 8, 11]
    assert [line.split()[0] for line in coverage.splitlines()[2:5]] == ["coco", "lvis", "eth3d"]
    sentence = "The 3 tracks hold different images (coco 12, lvis 12, eth3d 5; 0 in all of them)"
    assert sentence in shown
    for suffix in ("md", "tex"):
        assert sentence in (out / f"table.{suffix}").read_text()
    document = json.loads((out / "comparison.json").read_text())
    assert document["kind"] == "joined_comparison"
    for one, folder in zip(document["comparisons"], three[::-1], strict=True):
        assert one == json.loads((folder / "comparison.json").read_text())


def test_the_order_of_the_arguments_does_not_matter(three, tmp_path):
    join_folders(three, tmp_path / "out")
    join_folders(three[::-1], tmp_path / "back")
    for name in ("comparison.json", "table.md", "table.csv", "evidence.json"):
        assert (tmp_path / "out" / name).read_bytes() == (tmp_path / "back" / name).read_bytes()


def test_tracks_of_the_same_photos_are_not_called_different(tmp_path):
    """coco and lvis of one set of photos: same ids, same names."""
    folders = []
    for task in ("coco", "lvis"):
        compare(scene_and_baseline(tmp_path / task[0], task), tmp_path / task, draws=5)
        folders.append(tmp_path / task)
    document = join_folders(folders, tmp_path / "out")
    assert document.common_images == 12
    assert document.notes[0] == "The 2 tracks hold the same 12 images."


def test_a_joined_comparison_is_verified(three, tmp_path):
    out = tmp_path / "out"
    join_folders(three, out)
    assert not bad(verify_comparison(out, None))
    assert cli.run(["evidence", "verify", str(out)]) == 0
    text = (out / "comparison.json").read_text()
    forge(
        out,
        "comparison.json",
        lambda p: p.write_text(text.replace('"task": "coco"', '"task": "c"')),
    )
    assert "numbers from the comparisons" in [c.what for c in bad(verify_comparison(out, None))]


def test_another_joined_comparison_is_replaced_only_when_asked(three, tmp_path):
    join_folders(three[:2], tmp_path / "out")
    join_folders(three[:2], tmp_path / "out")
    with pytest.raises(LegoWorldError, match="contains a different comparison"):
        join_folders(three[1:], tmp_path / "out")
    join_folders(three[1:], tmp_path / "out", overwrite=True)
    document = json.loads((tmp_path / "out" / "comparison.json").read_text())
    assert [one["task"] for one in document["comparisons"]] == ["coco", "lvis"]


def test_what_cannot_be_joined(three, tmp_path):
    with pytest.raises(UsageError, match="different tasks"):
        join_folders([three[0], three[0]], tmp_path / "out")
    with pytest.raises(UsageError, match="different tasks"):
        join_folders(three[:1], tmp_path / "out")
    join_folders(three[:2], tmp_path / "two")
    with pytest.raises(LegoWorldError, match="cannot be joined again"):
        join_folders([tmp_path / "two", three[2]], tmp_path / "out")
    with pytest.raises(LegoWorldError, match="not a finished comparison"):
        join_folders([three[0], tmp_path], tmp_path / "out")
    arguments = ["compare", "--join", str(three[0]), str(three[1]), "-o", str(tmp_path / "out")]
    assert cli.run([*arguments, "--seed", "1"]) == 2
    assert not (tmp_path / "out").exists()


PROVENANCE = {"agent": "a", "model": "m", "prompt_sha256": "p1", "camera_given": None,
              "metric_feedback": False}  # fmt: skip


def comparison_of(folder, provenances):
    """A comparison whose scene run recorded these, image by image."""
    truth = random_truth("coco", seed=1)
    predictions = random_predictions("coco", truth, seed=2, levels=1)
    ids = [str(i["id"]) for i in truth["images"]]
    scenes = {i: {"provenance": p} for i, p in zip(ids, provenances, strict=False)}
    scene = evaluate(folder / "s", "coco", truth, predictions, scenes=scenes)
    other = evaluate(folder / "b", "coco", truth, predictions, kind="baseline", baseline="yolo",
                      provenance={"model": "weights 1"})  # fmt: skip
    return compare((scene, other), folder / "out", draws=5)


def test_how_scenes_were_made_is_listed_where_it_was_recorded(tmp_path):
    with_camera = {**PROVENANCE, "camera_given": {"fx": 3}, "prompt_sha256": "p2"}
    document = comparison_of(tmp_path, [PROVENANCE] * 7 + [with_camera] * 3 + ["not recorded"])
    assert document["provenance"]["prompt_sha256"] == {
        "scene": {"not recorded": 1, "p1": 7, "p2": 3}
    }
    assert document["provenance"]["camera_given"] == {
        "scene": {"not recorded": 1, "null": 7, '{"fx":3}': 3}
    }
    assert "plugin" not in document["provenance"]
    note = "Scenes differ in prompt_sha256 (images): scene not recorded (1), p1 (7), p2 (3)."
    assert note in document["notes"]
    assert document["methods"][0]["provenance"][0] == {"provenance": PROVENANCE, "images": 7}
    baseline = [{"provenance": {"model": "weights 1"}, "images": 12}]
    assert document["methods"][1]["provenance"] == baseline


def test_the_same_provenance_everywhere_is_no_difference(tmp_path):
    document = comparison_of(tmp_path, [PROVENANCE] * 12)
    assert document["provenance"]["agent"] == {"scene": {"a": 12}}
    assert not [n for n in document["notes"] if "Scenes differ" in n or "not recorded" in n]


def test_no_provenance_is_said_to_be_none(tmp_path):
    document = comparison_of(tmp_path, ["not recorded"] * 12)
    assert document["provenance"] == {}
    assert [n for n in document["notes"] if n.startswith("How the scenes were made")]


def test_differences_between_tracks_are_listed_when_they_are_joined(three, tmp_path):
    comparison_of(tmp_path, [PROVENANCE] * 12)
    document = join_folders([tmp_path / "out", three[0]], tmp_path / "joined")
    assert document.provenance["agent"] == {
        "coco scene": {"a": 12},
        "eth3d scene": {"not recorded": 5},
    }
    assert any("coco scene a (12); eth3d scene not recorded (5)" in n for n in document.notes)


def test_photos_are_the_same_by_name_and_id_and_not_by_id_alone():
    def document(task, *images):
        return SimpleNamespace(
            task=task, images=[SimpleNamespace(image_id=i, file_name=n) for i, n in images]
        )

    first = document("coco", (1, "a.jpg"), (2, "b.jpg"), (3, "c.jpg"))
    second = document("lvis", (1, "a.jpg"), (2, "other.jpg"), (9, "c.jpg"))
    assert _common_images([first, second]) == 1
