"""What `export` takes, refuses and leaves behind; each format's content has a test of its own."""

from __future__ import annotations

import json
import shutil

import pytest
from checkout import CHECKOUT
from evaluation.detection_runs import random_predictions, random_truth, write_run

from legoworld import evaluate, readout
from legoworld.api.exporting import RECORD, export, is_run
from legoworld.api.scenes import open_scene
from legoworld.errors import SceneInvalidError, UsageError
from legoworld.evaluation.run import RunUnusableError
from legoworld.exports.formats import FORMATS, Format, find_format, writer

SCENE = CHECKOUT / "examples" / "astronaut"
SMALL = {"size_wh": (48, 48), "source": "glb", "cache": False}


@pytest.fixture
def run(tmp_path):
    truth = random_truth("coco", seed=1)
    return write_run(tmp_path / "run", "coco", truth, random_predictions("coco", truth, seed=2))


@pytest.mark.parametrize("form", FORMATS, ids=lambda form: form.name)
def test_every_row_names_functions_that_are_there(form: Format):
    assert form.run or form.views or form.document
    for name in (form.run, form.views, form.document):
        assert name is None or callable(writer(name))
    assert find_format(form.name) is form


def test_a_folder_is_written_whole_with_what_it_is_of(tmp_path):
    scenes = tmp_path / "scenes"
    shutil.copytree(SCENE, scenes / "b")
    shutil.copytree(SCENE, scenes / "a")
    (scenes / "broken").mkdir()
    (scenes / "broken" / "scene.glb").write_bytes(b"glTF")
    output = tmp_path / "new" / "out"
    written = export(scenes, output, format="bop", task="coco", **SMALL)
    assert list(written.failed) == ["broken"]
    assert written.images == 2
    record = json.loads((output / RECORD).read_text())
    assert list(record["scenes"]) == ["a", "b"]
    assert record["format"] == "bop"
    assert tuple(record["not_held"]) == written.losses
    assert sorted(p.name for p in (output / "test").iterdir()) == ["000001", "000002"]
    assert [p.name for p in output.parent.iterdir()] == ["out"]  # nothing else is left
    before = sorted(output.rglob("*"))
    with pytest.raises(UsageError, match="already exists"):
        export(scenes / "a", output, format="bop", **SMALL)
    assert sorted(output.rglob("*")) == before
    export(scenes / "a", output, format="replicator", overwrite=True, **SMALL)
    assert not (output / "test").exists()
    file = tmp_path / "file"
    file.write_text("of another export")
    export(scenes / "a", file, format="replicator", overwrite=True, **SMALL)
    assert (file / RECORD).is_file()
    (output / RECORD).unlink()
    with pytest.raises(UsageError, match="was not written by `legoworld export`"):
        export(scenes / "a", output, format="replicator", overwrite=True, **SMALL)


def test_scenes_of_which_none_can_be_read_raise(tmp_path):
    (tmp_path / "scene").mkdir()
    document = b'{"asset":{"version":"2.0"},"scenes":[{"nodes":[]}],"scene":0}'
    document += b" " * (-len(document) % 4)
    header = b"glTF" + (2).to_bytes(4, "little") + (20 + len(document)).to_bytes(4, "little")
    chunk = len(document).to_bytes(4, "little") + b"JSON"
    (tmp_path / "scene" / "scene.glb").write_bytes(header + chunk + document)
    with pytest.raises(SceneInvalidError):
        export(tmp_path / "scene", tmp_path / "out", format="bop", **SMALL)
    assert not (tmp_path / "out").exists()
    with pytest.raises(UsageError, match="neither a run nor a folder of scenes"):
        export(CHECKOUT / "docs", tmp_path / "out", format="usd")


def test_views_in_a_program_are_images_of_one_scene(tmp_path):
    scene = open_scene(SCENE, source="glb", cache=False)
    views = [scene.view(task="coco", size_wh=size) for size in ((48, 48), (64, 64))]
    written = export(views, tmp_path / "out", format="bop")
    assert written.images == 2
    camera = tmp_path / "out" / "test" / "000001" / "scene_camera.json"
    assert list(json.loads(camera.read_text())) == ["0", "1"]
    views[0].save_bop(tmp_path / "one")
    with pytest.raises(UsageError, match="one already exists"):
        views[0].save_bop(tmp_path / "one")
    with pytest.raises(UsageError, match="omni3d is not written"):
        export(views, tmp_path / "omni3d", format="omni3d")


def test_what_a_format_is_not_written_from_is_refused(run, tmp_path):
    assert is_run(run)
    assert not is_run(SCENE)
    with pytest.raises(UsageError, match=r"bop is not written from such an input.*coco, kins"):
        export(run, tmp_path / "out", format="bop")
    with pytest.raises(RunUnusableError, match=r"is a scene folder, not a run"):
        export(SCENE, tmp_path / "out", format="coco")
    with pytest.raises(UsageError, match="a run of coco has no boxes in space"):
        export(run, tmp_path / "out", format="kitti")
    with pytest.raises(UsageError, match="a run of coco has no amodal masks"):
        export(run, tmp_path / "out", format="kins")
    with pytest.raises(UsageError, match=r"unknown format 'yolo'.*coco, kins"):
        export(run, tmp_path / "out", format="yolo")
    assert not (tmp_path / "out").exists()


def test_a_run_with_another_task_s_vocabulary_is_truth_with_all_of_its_categories(tmp_path):
    options = {"task": "amodal", "source": "glb", "cache": False, "workers": 1}
    scene = CHECKOUT / "examples" / "coffee"
    readout(scene, tmp_path / "run", vocabulary="lvis", **options)
    made = export(tmp_path / "run", tmp_path / "truth.json", format="kins")
    names = {category.id: category.name for category in made.categories}
    assert len(names) == 1203
    assert {"coffee_table", "cup", "spoon"} & {names[one.category_id] for one in made.annotations}
    scored = evaluate(tmp_path / "run", tmp_path / "eval", truth=tmp_path / "truth.json", draws=10)
    assert scored.metrics["AP"] == pytest.approx(1.0)
    with pytest.raises(UsageError, match="has no categories"):
        readout(SCENE, tmp_path / "none", vocabulary="eth3d", **options)
    with pytest.raises(UsageError, match="--vocabulary is for boxes and masks alone"):
        readout(SCENE, tmp_path / "x", vocabulary="lvis", **{**options, "task": "eth3d"})
