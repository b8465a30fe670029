"""The Python API against the commands, and what it says of mistakes."""

from __future__ import annotations

import json
import subprocess
import sys
import threading
from itertools import repeat
from pathlib import Path

import numpy as np
import pytest
from pycocotools import mask as coco_mask

import legoworld
from legoworld import cli
from legoworld.errors import ConfigurationMismatchError, SceneMissingError, UsageError
from legoworld.readouts.pictures import read_photo

ROOT = Path(__file__).parents[2]
SCENES = ROOT / "examples"
DATA = ROOT / "datasets" / "skimage_examples"
COFFEE = SCENES / "coffee"


@pytest.fixture(scope="module")
def view():
    return legoworld.open_scene(COFFEE).view(task="lvis", size_wh=(150, 100))


def test_importing_imports_nothing_and_names_everything():
    code = (
        "import sys, legoworld\n"
        "assert not {'numpy', 'msgspec', 'click'} & set(sys.modules), sys.modules.keys()\n"
        "assert set(legoworld.__all__) <= set(dir(legoworld))\n"
        "assert all(getattr(legoworld, name) is not None for name in legoworld.__all__)\n"
        "assert 'bpy' not in sys.modules and 'torch' not in sys.modules\n"
    )
    subprocess.run([sys.executable, "-c", code], check=True)
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        legoworld.nothing  # noqa: B018


def test_a_view_is_what_the_kernel_saw(view):
    assert view.instance.shape == view.depth_z_m.shape == (100, 150)
    assert (view.instance.dtype, view.depth_z_m.dtype) == (np.int32, np.float32)
    assert (np.isinf(view.depth_z_m) == (view.instance == -1)).all()
    with pytest.raises(UsageError, match="shading=True"):
        view.normals("shading")
    normals = view.normals()
    assert (normals.dtype, normals.shape) == (np.float32, (100, 150, 3))
    assert (np.isnan(normals).all(axis=2) == (view.instance == -1)).all()
    masks = view.masks()
    assert masks.sum(axis=0).max() == 1
    for mask, row, box in zip(masks, view.labelled, view.boxes_xywh_px(), strict=True):
        assert (mask == view.mask(row.id)).all()
        assert mask.sum() == row.area_px > 0
        assert box.tolist() == list(row.bbox_xywh_px)
        y, x = np.nonzero(mask)
        extent = [x.min(), y.min(), x.max() - x.min() + 1, y.max() - y.min() + 1]
        assert box.tolist() == extent
    assert len(view.table) == len(view.instances)


def test_predictions_are_the_runs_own(view, tmp_path):
    predictions = view.predictions(image_id=7)
    drawn = {coco_mask.decode(p["segmentation"]).astype(bool).tobytes() for p in predictions}
    assert drawn == {mask.tobytes() for mask in view.masks()}
    assert {p["image_id"] for p in predictions} == {7}
    run = legoworld.readout(
        SCENES, tmp_path / "run", task="coco", track=DATA / "track_coco.json", workers=1
    )
    for row in run.rows:
        folder, size = SCENES / row.scene, row.size_wh
        seen = legoworld.open_scene(folder).view(task="coco", size_wh=size)
        stored = json.loads((tmp_path / "run" / "predictions.json").read_text())
        own = seen.predictions(row.image_id)
        assert sorted(own, key=str) == sorted(
            (p for p in stored if p["image_id"] == row.image_id), key=str
        )
        assert [p["category_id"] for p in own] == seen.category_ids().tolist()
        assert [p["bbox"] for p in own] == seen.boxes_xywh_px().tolist()


def test_the_command_prints_to_dict(view, capsys):
    assert cli.run(["inspect", str(COFFEE), "--task", "lvis", "--size", "150x100", "--json"]) == 0
    printed = json.loads(capsys.readouterr().out)
    del printed["schema_version"]
    assert printed == json.loads(json.dumps(view.to_dict()))


def test_a_run_is_the_commands_run(tmp_path, capsys):
    track = str(DATA / "track_coco.json")
    run = legoworld.readout(SCENES, tmp_path / "a", task="coco", track=track, workers=2)
    assert (
        cli.run(
            ["readout", str(SCENES), "--task", "coco", "--track", track, "-o", str(tmp_path / "b")]
        )
        == 0
    )
    capsys.readouterr()
    for name in ("predictions.json", "per_image.jsonl", "summary.json"):
        assert (tmp_path / "a" / name).read_bytes() == (tmp_path / "b" / name).read_bytes()
    assert run.complete
    assert [row["status"] for row in run.table] == ["ok"] * len(run.rows)
    again = legoworld.Evaluation.open(
        legoworld.evaluate(
            run.folder, tmp_path / "e", truth=DATA / "truth_coco.json", draws=20
        ).folder
    )
    by_metric = {row["metric"]: row for row in again.table}
    assert by_metric["AP"]["value"] == again.metrics["AP"]
    assert by_metric["AP"]["low"] <= by_metric["AP"]["value"] <= by_metric["AP"]["high"]
    assert len(again.per_image()) == again.coverage.attempted == by_metric["AP"]["attempted"]


def test_a_reader_reads_what_comes_and_keeps_its_workers(tmp_path):
    folders = [COFFEE, tmp_path / "nothing", SCENES / "chelsea", COFFEE]
    with legoworld.Reader(task="coco", workers=2, cache=tmp_path / "cache") as reader:
        readings = list(reader.read(folders, size_wh=(60, 40)))
        processes = {b._process.pid for b in reader._blenders if b._process}
        assert sorted(r.status for r in readings) == ["missing", "ok", "ok", "ok"]
        (missing,) = (r for r in readings if not r.ok)
        assert isinstance(missing.error, SceneMissingError)
        assert missing.view is None
        coffees = [r.view for r in readings if r.ok and r.scene == COFFEE]
        assert (coffees[0].instance == coffees[1].instance).all()
        endless = reader.read(repeat(COFFEE), size_wh=(60, 40))
        assert [next(endless).ok for _ in range(5)] == [True] * 5
        endless.close()
        assert list(reader.read([])) == []
        assert processes == {b._process.pid for b in reader._blenders if b._process}
    assert all(b._process is None for b in reader._blenders)
    with pytest.raises(UsageError, match="the reader is closed"):
        next(reader.read([COFFEE]))
    reader.close()


def test_a_reader_closed_from_another_thread_ends_what_it_does(tmp_path, monkeypatch):
    started, go = threading.Event(), threading.Event()
    monkeypatch.setattr(
        "legoworld.api.reader.scene_at", lambda *_: (started.set(), go.wait(300), "blend")[1:]
    )
    reader = legoworld.Reader(workers=1, cache=False)
    readings: list[legoworld.Reading] = []
    thread = threading.Thread(target=lambda: readings.extend(reader.read([COFFEE])))
    thread.start()
    started.wait(300)
    go.set()
    reader.close()
    thread.join(300)
    assert not thread.is_alive()


@pytest.mark.parametrize(
    ("call", "error", "text"),
    [
        (lambda: legoworld.open_scene("no/such"), SceneMissingError, "no such folder"),
        (lambda: legoworld.open_scene(SCENES), SceneMissingError, "holds no scene"),
        (lambda: legoworld.Reader(task="nothing"), UsageError, "unknown task"),
        (lambda: legoworld.Reader(workers=0), UsageError, "argument workers"),
        (lambda: legoworld.Reader(time_limit_s=0), UsageError, "finite number above 0"),
        (
            lambda: legoworld.readout(SCENES, "x", task="coco", max_side=3),
            UsageError,
            "--max-side is for depth",
        ),
    ],
)
def test_mistakes(call, error, text, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(error, match=text):
        call()
    assert list(tmp_path.iterdir()) == []


def test_mistakes_with_a_view(view):
    with pytest.raises(UsageError, match="no such instance"):
        view.mask(len(view.instances))
    with pytest.raises(UsageError, match=r"found: 3x2; expected: 150x100"):
        view.overlay(np.zeros((2, 3, 3), np.uint8))
    with pytest.raises(UsageError, match="has predictions"):
        legoworld.open_scene(COFFEE).view().predictions()


def test_another_run_in_the_folder_is_refused(tmp_path):
    track = DATA / "track_coco.json"
    legoworld.readout(SCENES, tmp_path, task="coco", track=track, limit=1, workers=1)
    with pytest.raises(ConfigurationMismatchError, match="--overwrite"):
        legoworld.readout(SCENES, tmp_path, task="coco", track=track, limit=2, workers=1)


def test_amodal_masks_contain_what_is_visible_and_hidden_pixels_add_up(view):
    amodal, visible = view.amodal_masks(), view.masks()
    assert amodal.shape == visible.shape
    assert (amodal | ~visible).all()
    share = view.visible_of_in_frame()
    assert share == pytest.approx(visible.sum((1, 2)) / amodal.sum((1, 2)), abs=1e-15)
    assert 0 < share.min() < 1, "the spoon hides a part of the saucer"
    in_frame = view.in_frame_of_whole()
    assert view.visible_of_whole() == pytest.approx(share * in_frame, nan_ok=True)
    assert 0 < np.nanmin(in_frame) <= np.nanmax(in_frame) == 1
    hidden_by = view.occluders()
    for row, mask in zip(view.labelled, amodal, strict=True):
        assert sum(hidden_by.get(row.id, {}).values()) == mask.sum() - row.area_px
        for other, pixels in hidden_by.get(row.id, {}).items():
            assert pixels == (mask & (view.instance == other)).sum()


def test_a_view_of_amodal_masks_is_saved_with_what_is_hidden(tmp_path):
    view = legoworld.open_scene(COFFEE).view(task="amodal", size_wh=(150, 100))
    rows = {row[1]: row for row in view.task_table.rows}
    assert rows.keys() == {i.name for i in view.labelled}
    cup, spoon = (next(i.id for i in view.labelled if i.name == name) for name in ("Cup", "Spoon"))
    assert rows["Spoon"][-1].startswith(f"{cup} (")
    assert len(view.to_dict()["table"]) == len(rows)
    view.save(tmp_path)
    picture = read_photo(tmp_path / "amodal.png")
    hidden = view.amodal.layers.mask(spoon) & ~view.mask(spoon)
    assert (picture != view.overlay())[hidden].any(), "hatched over the cup"
    assert legoworld.open_scene(COFFEE).view(task="coco").task_table is None
