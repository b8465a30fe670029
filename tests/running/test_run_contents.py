"""Every value of a small run whose pixels can be counted by hand, without Blender."""

from __future__ import annotations

import calendar
import hashlib
import json
import platform
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from running.run_folders import readout, tree
from scene.gltf.documents import Document

import legoworld
from legoworld import cli
from legoworld.conventions import SCHEMA_VERSION
from legoworld.files import canonical_json
from legoworld.readouts.family import protocol
from legoworld.shipped import catalog

IMAGES = [(30, "rich"), (2, "plain"), (11, "broken"), (7, "absent"), (5, "wide")]


def rich() -> bytes:
    """A unit is a pixel of a 64x64 picture; (x, y) is a square's lower left corner, y upwards."""
    made = Document()
    made.quad("Wall", -30, -30, 20)
    made.quad("Hidden", -25, -25, 4, z=-5, extras={"category": "dog"})
    made.quad("Beside", 100, 0, 8, extras={"category": "cat"})
    made.quad("Chair", 0, 0, 8, extras={"category": "chair"})
    table = made.quad("Table", 16, 0, 8, extras={"category": "Dining_Table"})
    cup = made.quad("Cup", 10, 20, 4, extras={"category": "cup"}, root=False)
    made.json["nodes"][table]["children"] = [cup]
    made.quad("Odd", 0, 16, 4, extras={"category": "zebrra"})
    made.quad("Odd2", 6, 16, 4, extras={"category": "zebrra"})
    made.quad("Box", -20, 10, 6)
    made.node(name="Ghost", extras={"category": "BIRD"})
    return made.glb()


def plain() -> bytes:
    made = Document()
    made.quad("Cat", 0, 0, 8, extras={"category": "cat"})
    return made.glb()


def beside() -> bytes:
    made = Document()
    made.quad("Beside", 100, 0)
    return made.glb()


@pytest.fixture(scope="module")
def scenes(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("contents") / "scenes"
    for name, content in (
        ("rich", rich()),
        ("plain", plain()),
        ("wide", beside()),
        ("broken", b"glTF"),
    ):
        (folder / name).mkdir(parents=True)
        (folder / name / "scene.glb").write_bytes(content)
    (folder / "rich" / "provenance.json").write_text('{"agent": "a hand"}')
    sizes = {"wide": (64, 32)}
    images = [
        {"id": i, "file_name": f"{name}.jpg", "width": w, "height": h}
        for i, name in IMAGES
        for w, h in [sizes.get(name, (64, 64))]
    ]
    (folder.parent / "track.json").write_text(json.dumps({"images": images}))
    return folder


def run(scenes: Path, output: Path, *more: object, task: str = "coco") -> int:
    track = scenes.parent / "track.json"
    fixed = ("--source", "glb", "--no-cache", "--workers", 1, "--track", track)
    return readout(scenes, output, *fixed, *more, task=task)


@pytest.fixture(scope="module")
def done(scenes: Path) -> Path:
    output = scenes.parent / "run"
    assert run(scenes, output) == 1
    return output


def rows_of(output: Path) -> list[dict[str, Any]]:
    return [json.loads(line) for line in (output / "per_image.jsonl").read_text().splitlines()]


def document(output: Path, name: str) -> Any:
    return json.loads((output / name).read_text())


def sha256(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()


def test_rows_ascend_and_say_what_was_asked_for(done):
    rows = rows_of(done)
    assert [(row["image_id"], row["scene"], row["status"]) for row in rows] == [
        (2, "plain", "ok"),
        (5, "wide", "ok"),
        (7, "absent", "missing"),
        (11, "broken", "invalid"),
        (30, "rich", "ok"),
    ]
    assert [row["file_name"] for row in rows] == [f"{row['scene']}.jpg" for row in rows]
    absent = rows[2]
    assert set(absent) == {
        "image_id", "file_name", "scene", "size_wh", "status", "code", "reason", "warnings"
    }  # fmt: skip
    assert (absent["size_wh"], absent["warnings"]) == ([64, 64], [])


def test_the_row_of_a_scene(done, scenes):
    row = rows_of(done)[-1]
    files = {
        n: sha256((scenes / "rich" / n).read_bytes()) for n in ("scene.glb", "provenance.json")
    }
    for key in ("files_sha256", "snapshot_sha256", "predictions_sha256"):
        assert len(row.pop(key)) == 64
    assert row == {
        "image_id": 30,
        "file_name": "rich.jpg",
        "scene": "rich",
        "status": "ok",
        "code": "ok",
        "reason": None,
        "size_wh": [64, 64],
        "rendered_wh": [64, 64],
        "scene_size_wh": [1080, 1080],
        "aspect_differs": False,
        "frozen": "at_readout",
        "geometry_px": 20 * 20 + 2 * 8 * 8 + 3 * 4 * 4 + 6 * 6,
        "n_predictions": 3,
        "exported": [
            {"name": "Cup", "category": "cup", "objects": ["Cup"]},
            {"name": "Chair", "category": "chair", "objects": ["Chair"]},
            {"name": "Table", "category": "dining table", "objects": ["Table"]},
        ],
        "instances": {
            "total": 9, "labelled": 5, "visible_labelled": 3, "visible_unlabelled": 4,
        },
        "unlabelled": [
            {"name": "Wall", "area_px": 400},
            {"name": "Box", "area_px": 36},
            {"name": "Odd", "area_px": 16},
            {"name": "Odd2", "area_px": 16},
        ],
        "unlabelled_px": 468,
        "nested": {"instances": 1, "px": 16},
        "matched": {"Dining_Table": "dining table"},
        "unmatched": [{"label": "zebrra", "count": 2, "nearest": ["zebra"]}],
        "unexported": [
            {"name": "Beside", "category": "cat", "reason": "outside_view"},
            {"name": "Ghost", "category": "bird", "reason": "not_rendered"},
            {"name": "Hidden", "category": "dog", "reason": "hidden"},
        ],
        "warnings": [
            "scene.glb records no picture size, only the aspect 1: 1080x1080 where none is "
            "asked for"
        ],
    }  # fmt: skip
    scene = document(done, "run.json")["scenes"]["30"]
    assert scene["files"] == files
    assert scene["provenance"] == {"agent": "a hand"}
    assert (scene["scene"], scene["frozen"], scene["dependencies"]) == ("rich", "at_readout", {})
    assert scene["snapshot_sha256"] == rows_of(done)[-1]["snapshot_sha256"]
    assert scene["camera"]["ortho_scale"] == 64
    assert scene["render"]["unit_scale"] == 1.0
    assert scene["projection"] == {
        "orthographic": True, "fx": 1.0, "fy": 1.0, "cx": 32.0, "cy": 32.0, "z_near": 0.1,
        "z_far": 100.0,
    }  # fmt: skip


def test_what_the_camera_sees_nothing_of_is_said(done):
    wide = rows_of(done)[1]
    assert (wide["aspect_differs"], wide["geometry_px"], wide["size_wh"]) == (True, 0, [64, 32])
    assert wide["warnings"][-2:] == [
        "the scene's own picture is 1080x1080, the image 64x32: another aspect, so the view is "
        "fitted by Blender's sensor rule",
        "the camera sees nothing: every pixel is without geometry",
    ]


def test_predictions_and_their_hash(done):
    predictions = document(done, "predictions.json")
    ids = {c.name: c.id for c in protocol("coco", None).vocabulary.categories}
    # The top left corner is (0, 0); a square's lower left corner (x, y) lies at (32 + x, 32 - y).
    expected = [
        (2, "cat", [32, 24, 8, 8]),
        (30, "cup", [42, 8, 4, 4]),
        (30, "chair", [32, 24, 8, 8]),
        (30, "dining table", [48, 24, 8, 8]),
    ]
    assert predictions == [
        {"image_id": i, "category_id": ids[name], "bbox": box, "score": 1.0}
        for i, name, box in expected
    ]
    row = rows_of(done)[0]
    nameless = [{k: v for k, v in predictions[0].items() if k != "image_id"}]
    assert row["predictions_sha256"] == sha256(canonical_json(nameless).encode())


def test_the_summary_counts_the_rows(done):
    summary = document(done, "summary.json")
    assert summary == {
        "schema_version": 1,
        "task": "coco",
        "partial": False,
        "coverage": {
            "attempted": 5,
            "ok": 3,
            "ok_empty": 1,
            "by_status": {"invalid": 1, "missing": 1, "ok": 3},
        },
        "warnings": sum(len(row["warnings"]) for row in rows_of(done)),
        "predictions": 4,
        "unmatched_labels": {"zebrra": 2},
        "unexported_instances": {"hidden": 1, "not_rendered": 1, "outside_view": 1},
        "nested_instances": 1,
    }


def test_run_json_says_what_made_the_run(done, scenes):
    made = document(done, "run.json")
    now = time.time()
    finished = calendar.timegm(time.strptime(made["finished_at"], "%Y-%m-%dT%H:%M:%SZ"))
    assert now - 3600 < finished <= now
    assert (
        made["versions"].items()
        >= {
            "legoworld": legoworld.__version__,
            "numpy": np.__version__,
            "python": platform.python_version(),
        }.items()
    )
    assert list(made["scenes"]) == ["2", "30", "5"]  # of images that were read, sorted as text
    configuration = made["configuration"]
    described = [[i, f"{name}.jpg", [64, 32 if name == "wide" else 64]] for i, name in IMAGES]
    described.sort()
    assert (
        configuration.items()
        >= {
            "kind": "scene",
            "task": "coco",
            "images_sha256": sha256(canonical_json(described).encode()),
            "attempted": 5,
            "partial": False,
            "shard": None,
            "source": "glb",
            "require_frozen": False,
            "max_side": None,
            "legoworld": legoworld.__version__,
            "bpy": made["versions"]["bpy"],
        }.items()
    )
    assert set(configuration) == {
        "schema_version", "kind", "task", "card_version", "card_sha256", "vocabulary_sha256",
        "track_sha256", "images_sha256", "attempted", "partial", "shard", "source",
        "require_frozen", "max_side", "legoworld", "bpy", "snapshot_schema", "row_schema",
    }  # fmt: skip
    card = catalog.folder("readouts") / "coco.toml"
    assert configuration["card_sha256"] == sha256(card.read_bytes())
    assert configuration["schema_version"] == SCHEMA_VERSION


def test_a_shard_says_which_it_is_of_which_run(scenes, tmp_path):
    run(scenes, tmp_path / "shard", "--shard", "2/2", "--limit", 4)
    configuration = document(tmp_path / "shard", "run.json")["configuration"]
    assert [row["image_id"] for row in rows_of(tmp_path / "shard")] == [5, 11]
    whole = {"attempted": 4, "partial": True}
    assert configuration["shard"] == {"index": 2, "of": 2, "whole": whole}
    assert (configuration["attempted"], configuration["partial"]) == (2, True)


def test_depth_rows_name_their_file(scenes, tmp_path, capsys):
    output = tmp_path / "depth"
    assert run(scenes, output, task="eth3d") == 1
    row = rows_of(output)[-1]
    content = (output / row["depth"]["file"]).read_bytes()
    assert row["depth"] == {
        "file": "depth/rich.npz",
        "space": "depth",
        "unit": "m",
        "bytes": len(content),
        "sha256": sha256(content),
        "finite_px": 612,
    }
    assert not {"n_predictions", "exported", "instances", "predictions_sha256"} & set(row)
    summary = document(output, "summary.json")
    assert summary["depth_bytes"] == sum(
        path.stat().st_size for path in (output / "depth").rglob("*.npz")
    )
    assert not {"predictions", "unmatched_labels", "nested_instances"} & set(summary)
    assert not (output / "predictions.json").exists()


def test_a_chosen_image_that_is_not_in_the_track_is_named(scenes, tmp_path, capsys):
    assert run(scenes, tmp_path / "run", "--image-id", 31) == 2
    error = capsys.readouterr().err
    assert "--image-id 31" in error
    assert "one of 5 ids, such as 2" in error
    assert run(scenes, tmp_path / "run", "--image-id", 30, "--image-id", 2) == 0
    assert [row["image_id"] for row in rows_of(tmp_path / "run")] == [2, 30]


def test_a_run_that_ended_early_is_named_when_it_is_resumed(scenes, tmp_path, capsys, monkeypatch):
    track = scenes.parent / "track.json"
    arguments = ["readout", str(scenes), "--task", "coco", "-o", str(tmp_path / "run"), "--source",
                 "glb", "--no-cache", "--workers", "1", "--track", str(track)]  # fmt: skip

    def ended(*_arguments: object, **_named: object) -> None:
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr("legoworld.records.folders.run_folder.finish", ended)
        assert cli.run(arguments) == 130
    words = "the last run into this folder ended before it was finished"
    assert words not in "".join(capsys.readouterr())
    assert cli.run(arguments) == 1
    assert words in "".join(capsys.readouterr())
    assert cli.run(arguments) == 1
    assert words not in "".join(capsys.readouterr())


def test_resuming_reads_only_what_has_no_result(scenes, done, tmp_path, capsys):
    track = scenes.parent / "track.json"
    output = tmp_path / "run"
    arguments = ["readout", str(scenes), "--task", "coco", "-o", str(output), "--source", "glb",
                 "--no-cache", "--workers", "1", "--track", str(track)]  # fmt: skip
    assert cli.run([*arguments, "--fail-fast"]) == 1
    assert [row["image_id"] for row in rows_of(output)] == [2, 5, 7]
    assert document(output, "summary.json")["partial"] is True
    capsys.readouterr()
    assert cli.run(arguments) == 1
    assert "2 of 5 images have a valid result already" in "".join(capsys.readouterr())
    assert tree(output) == tree(done)


@pytest.mark.parametrize(
    ("more", "said"),
    [
        (("--require-frozen",), "require_frozen: false -> true"),
        (("--limit", 3), "attempted: 5 -> 3"),
        (("--shard", "1/2"), "shard.whole.partial: null -> false"),
        (("--images-per-file", 2), "images_per_file: null -> 2"),
    ],
)
def test_what_differs_from_an_earlier_run_is_shown(more, said, scenes, done, capsys):
    before = tree(done)
    assert run(scenes, done, *more) == 2
    error = capsys.readouterr().err
    assert said in error
    assert "task" not in error.split("found:")[1].split("expected:")[0]
    assert tree(done) == before


def test_what_is_hidden_has_an_amodal_result_and_is_not_missed(scenes, tmp_path):
    outputs = [tmp_path / "one", tmp_path / "two"]
    for workers, output in enumerate(outputs, start=1):
        assert run(scenes, output, "--workers", workers, task="amodal") == 1
    first, second = (output / "predictions.json" for output in outputs)
    assert first.read_bytes() == second.read_bytes()
    row = rows_of(outputs[0])[-1]
    assert [u["name"] for u in row["unexported"]] == ["Beside", "Ghost"]
    assert sorted(e["name"] for e in row["exported"]) == ["Chair", "Cup", "Hidden", "Table"]
    hidden = next(p for p in json.loads(first.read_text()) if not p["visible_of_in_frame"])
    assert hidden["bbox"] == [7, 53, 4, 4]
    assert hidden["occluded_by"] == [[None, 16]]
    assert hidden["in_frame_of_whole"] == 1
