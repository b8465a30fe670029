"""One pass over the scenes for several tasks: each run as its task alone writes it."""

from __future__ import annotations

import io
import json
import re
import shutil
from pathlib import Path

import numpy as np
import pytest
from running.run_folders import results, tree

import legoworld
from legoworld import cli
from legoworld.errors import ConfigurationMismatchError, UsageError, WorkerCrashedError
from legoworld.readouts.family import protocol
from legoworld.running import scene_pass, scene_views, shared_scene
from legoworld.running.image_record import ImageOptions
from legoworld.running.scene_pass import OutputFullError
from legoworld.running.shared_scene import HashedScene, SharedScene
from legoworld.scene.blender_process import BlenderProcess, Limits
from legoworld.shipped import catalog
from legoworld.visibility import normals, view

TASKS = ["eth3d", "coco", "lvis", "coco-masks", "amodal", "boxes3d", "normals", "relations"]
TASKS += ["coco-panoptic", "voc-semantic"]


@pytest.fixture(scope="module")
def scenes(tmp_path_factory) -> Path:
    """Four scenes: two good ones, one with labels that are no JSON, one whose file is broken."""
    folder = tmp_path_factory.mktemp("scenes")
    examples = catalog.folder("examples")
    for name in ("astronaut", "chelsea"):
        shutil.copytree(examples / name, folder / name)
    shutil.copytree(examples / "chelsea", folder / "odd-labels")
    (folder / "odd-labels" / "frozen.json").unlink(missing_ok=True)
    (folder / "odd-labels" / "labels.json").write_text("{")
    (folder / "broken").mkdir()
    (folder / "broken" / "scene.blend").write_bytes(b"BLENDER-v500 and nothing more")
    return folder


@pytest.fixture(scope="module")
def cache(tmp_path_factory) -> Path:
    return tmp_path_factory.mktemp("cache")


@pytest.fixture(scope="module")
def alone(scenes, cache, tmp_path_factory) -> dict[str, dict[str, bytes]]:
    """The files of each task's run on its own."""
    folder = tmp_path_factory.mktemp("alone")
    return {
        task: results(Path(legoworld.readout(scenes, folder / task, task=task, cache=cache).folder))
        for task in TASKS
    }


@pytest.mark.blender
@pytest.mark.parametrize("workers", [1, 2])
def test_each_run_has_the_bytes_of_its_task_alone(alone, scenes, cache, tmp_path, workers):
    runs = legoworld.readout(scenes, tmp_path, task=TASKS, cache=cache, workers=workers)
    assert list(runs) == TASKS
    assert {task: results(tmp_path / task) for task in TASKS} == alone
    assert {p.name for p in tmp_path.iterdir()} == set(TASKS)
    statuses = {row.scene: row.status for row in runs["coco"].rows}
    good = {"astronaut": "ok", "chelsea": "ok"}
    assert statuses == good | {"broken": "invalid", "odd-labels": "invalid"}
    assert {row.scene for row in runs["eth3d"].rows if row.status == "ok"} == {*good, "odd-labels"}
    assert runs.table[0]["task"] == "eth3d"
    assert set(runs.to_dict()["tasks"]) == set(TASKS)


@pytest.mark.blender
def test_a_pass_that_was_stopped_is_resumed_to_the_same_bytes(
    alone, scenes, cache, tmp_path, monkeypatch
):
    stored = 0
    original = scene_pass.append

    def stops(stream, record):
        nonlocal stored
        stored += 1
        if stored == 6:
            raise KeyboardInterrupt
        return original(stream, record)

    with monkeypatch.context() as patch:
        patch.setattr(scene_pass, "append", stops)
        with pytest.raises(KeyboardInterrupt):
            legoworld.readout(scenes, tmp_path, task=TASKS, cache=cache, workers=1)
    assert any((tmp_path / task / "run.json").exists() for task in TASKS) is False
    said: list[str] = []
    legoworld.readout(
        scenes, tmp_path, task=TASKS, cache=cache, listener=legoworld.Listener(notice=said.append)
    )
    assert {task: results(tmp_path / task) for task in TASKS} == alone
    assert any(text.startswith(("coco: ", "eth3d: ")) and "valid result" in text for text in said)


@pytest.mark.blender
def test_what_a_scene_of_many_instances_takes_is_said_before_it_is_read_out(tmp_path, monkeypatch):
    monkeypatch.setattr("legoworld.running.image_record.MANY", 2)
    said: list[str] = []
    listener = legoworld.Listener(notice=said.append, row=lambda row: said.append(row.scene))
    options = {"source": "glb", "cache": False, "listener": listener, "workers": 1}
    scene = catalog.folder("examples") / "coffee"
    legoworld.readout(scene, tmp_path, task=["amodal", "relations", "coco"], **options)
    told = [text for text in said if "instances drawn as if alone" in text or " pairs" in text]
    assert len(told) == 2, said
    assert re.search(r"coffee: 5 instances .* at most [0-9,]+ pixels, [0-9]+ MB", told[0])
    assert "relations of 3 of 3 visible objects: 3 pairs" in told[1]


def test_each_scene_is_hashed_read_and_drawn_once(scenes, cache, tmp_path, monkeypatch):
    counts = {"hashed": 0, "read": 0, "drawn": 0}

    def counted(name, original):
        def call(*args, **kwargs):
            counts[name] += 1
            return original(*args, **kwargs)

        return call

    monkeypatch.setattr(shared_scene, "check_scene", counted("hashed", shared_scene.check_scene))
    monkeypatch.setattr(shared_scene, "read_scene", counted("read", shared_scene.read_scene))
    monkeypatch.setattr(scene_views, "view", counted("drawn", scene_views.view))
    legoworld.readout(scenes, tmp_path, task=TASKS, cache=cache, workers=1)
    # The astronaut's parts are instances of LVIS and none of COCO; depth uses either.
    assert counts == {"hashed": 4, "read": 4, "drawn": 2 + 1 + 1}
    legoworld.readout(scenes, tmp_path, task=TASKS, cache=cache, workers=1)
    assert counts["hashed"] == 4 + 3 + 2, "three hold a result, two are read again for some task"


@pytest.mark.blender
def test_shading_normals_are_read_where_they_are_asked_for(alone, scenes, cache, tmp_path):
    both, one = tmp_path / "both", tmp_path / "one"
    shading = {"variant": "shading", "cache": cache}
    legoworld.readout(scenes, both, task=["coco", "normals"], **shading)
    legoworld.readout(scenes, one, task="normals", **shading)
    assert results(both / "coco") == alone["coco"]
    assert results(both / "normals") == results(one)
    with np.load(one / "normals/astronaut.npz") as smooth:
        assert str(smooth["variant"]) == "shading"
        facets = np.load(io.BytesIO(alone["normals"]["normals/astronaut.npz"]))["normal_cam"]
        assert (smooth["normal_cam"] * facets).sum(axis=-1).min() >= 0
        assert (smooth["normal_cam"] != facets).any(axis=-1).mean() > 0.5
    with pytest.raises(ConfigurationMismatchError):
        legoworld.readout(scenes, one, task="normals", cache=cache)
    with pytest.raises(UsageError, match="--variant is for normals alone"):
        legoworld.readout(scenes, tmp_path / "other", task="eth3d", **shading)


@pytest.mark.blender
@pytest.mark.parametrize("task", ["normals", ["eth3d", "normals"]])
def test_normals_are_drawn_along_with_depth(scenes, cache, tmp_path, monkeypatch, task):
    drawn = []
    original = normals.render_into
    monkeypatch.setattr(normals, "render_into", lambda *a: drawn.append("normals") or original(*a))
    monkeypatch.setattr(view, "render", lambda *_a, **_k: drawn.append("plain"))
    legoworld.readout(scenes, tmp_path, task=task, cache=cache, workers=1)
    assert drawn == ["normals"] * 3


@pytest.mark.blender
def test_views_of_other_instances_or_sizes_are_drawn_anew():
    scene = legoworld.open_scene(catalog.folder("examples") / "astronaut")
    views = scene_views.SceneViews()
    coco = scene.view_by(protocol("coco", None), None, views=views)
    again = scene.view_by(protocol("coco-masks", None), None, views=views)
    small = scene.view_by(protocol("coco", None), (30, 20), views=views)
    lvis = scene.view_by(protocol("lvis", None), None, views=views)
    assert again.instance is coco.instance
    assert small.instance.shape == (20, 30)
    assert lvis.instance is not coco.instance
    assert len(lvis.instances) != len(coco.instances)
    assert (lvis.depth_z_m == coco.depth_z_m).all()


class Lost:
    """Stands in for reading a scene: its Blender process is lost so many times."""

    def __init__(self, times: int, error: type[Exception] = WorkerCrashedError) -> None:
        self.left, self.error, self.asked = times, error, 0

    def __call__(self, *_args, **_kwargs):
        self.asked += 1
        if self.left:
            self.left -= 1
            raise self.error("lost")
        return "read"


def shared(tmp_path, monkeypatch, reading) -> SharedScene:
    monkeypatch.setattr(shared_scene, "read_scene", reading)
    monkeypatch.setattr(shared_scene, "check_scene", lambda *_a, **_k: ("folder", "files"))
    options = ImageOptions(
        scenes=tmp_path, run=tmp_path, protocol=protocol("coco", None), source="blend", cache=None,
        require_frozen=False, max_side=None, threads=1,
    )  # fmt: skip
    return SharedScene("a", options, BlenderProcess(Limits()))


def test_an_error_is_that_of_every_task_and_the_scene_is_not_read_again(tmp_path, monkeypatch):
    reading = Lost(1)
    scene = shared(tmp_path, monkeypatch, reading)
    for _ in range(3):
        with pytest.raises(WorkerCrashedError):
            scene.read()
    assert reading.asked == 1
    assert scene.read(attempts=2) == "read"  # the bench asks a lost scene once more
    assert scene.read() == "read"
    assert reading.asked == 2


def test_only_a_lost_process_is_tried_again(tmp_path, monkeypatch):
    reading = Lost(5, UsageError)
    scene = shared(tmp_path, monkeypatch, reading)
    for _ in range(2):
        with pytest.raises(UsageError):
            scene.read(attempts=2)
    assert reading.asked == 1
    lost = Lost(5)
    scene = shared(tmp_path, monkeypatch, lost)
    with pytest.raises(WorkerCrashedError):
        scene.read(attempts=2)
    assert lost.asked == 2


def test_a_missing_scene_is_looked_for_once(tmp_path, monkeypatch):
    calls = []

    def missing(*_args, **_kwargs):
        calls.append(1)
        raise UsageError("missing")

    monkeypatch.setattr(shared_scene, "check_scene", missing)
    scene = HashedScene("a", shared(tmp_path, monkeypatch, Lost(0))._options)
    monkeypatch.setattr(shared_scene, "check_scene", missing)
    for _ in range(2):
        with pytest.raises(UsageError):
            _ = scene.folder
    with pytest.raises(UsageError):
        _ = scene.files
    assert len(calls) == 1


def test_what_one_pass_cannot_be(scenes, tmp_path):
    with pytest.raises(UsageError, match="must be different"):
        legoworld.readout(scenes, tmp_path / "a", task=["coco", "coco"])
    with pytest.raises(UsageError, match="must be different"):
        legoworld.readout(scenes, tmp_path / "a", task=[])
    with pytest.raises(UsageError, match="--max-side is for depth and normals alone"):
        legoworld.readout(scenes, tmp_path / "a", task=["coco", "lvis"], max_side=9)
    (tmp_path / "tracks").mkdir()
    with pytest.raises(UsageError, match="no track of coco"):
        legoworld.readout(scenes, tmp_path / "a", task=["coco", "lvis"], track=tmp_path / "tracks")
    with pytest.raises(UsageError, match="no track of lvis"):
        legoworld.readout(scenes, tmp_path / "a", task=["lvis"], track={"coco": tmp_path})
    (tmp_path / "run").mkdir()
    (tmp_path / "run" / "configuration.json").write_text("{}")
    with pytest.raises(UsageError, match="cannot hold the runs of several tasks"):
        legoworld.readout(scenes, tmp_path / "run", task=["coco", "lvis"])
    assert not (tmp_path / "a").exists()


@pytest.mark.blender
def test_an_option_of_one_family_reaches_that_family(scenes, cache, tmp_path):
    runs = legoworld.readout(scenes, tmp_path, task=["coco", "eth3d"], max_side=90, cache=cache)
    longest = {
        task: {max(row.rendered_wh) for row in run.rows if row.status == "ok"}
        for task, run in runs.items()
    }
    assert longest["eth3d"] == {90}
    assert min(longest["coco"]) > 90


@pytest.mark.blender
def test_another_configuration_of_one_run_is_refused_before_anything_is_read(
    scenes, cache, tmp_path
):
    legoworld.readout(scenes, tmp_path / "lvis", task="lvis", cache=cache, limit=1)
    before = tree(tmp_path / "lvis")
    with pytest.raises(ConfigurationMismatchError):
        legoworld.readout(scenes, tmp_path, task=["coco", "lvis"], cache=cache)
    assert tree(tmp_path / "lvis") == before
    assert not (tmp_path / "coco" / "run.json").exists()


def test_files_of_all_runs_must_fit(tmp_path, monkeypatch):
    usage = shutil.disk_usage(tmp_path)._replace(free=1000)
    monkeypatch.setattr(scene_pass.shutil, "disk_usage", lambda _folder: usage)
    said: list[str] = []
    scene_pass.check_disk(tmp_path, [400], said.append, what="depth", next_step="", beside=600)
    with pytest.raises(OutputFullError, match="0 MB free"):
        scene_pass.check_disk(tmp_path, [400], said.append, what="depth", next_step="", beside=601)
    assert len(said) == 2


@pytest.mark.blender
def test_the_command_writes_a_folder_for_each_task_and_says_a_thing_once(
    alone, scenes, cache, tmp_path, capsys
):
    words = ["readout", str(scenes), "-o", str(tmp_path / "runs"), "--cache", str(cache)]
    tasks = [word for task in TASKS for word in ("--task", task)]
    assert cli.run([*words, *tasks]) == 1
    printed = capsys.readouterr().out
    assert {task: results(tmp_path / "runs" / task) for task in TASKS} == alone
    assert printed.count("invalid: broken") == 1
    for task in TASKS:
        assert f"{task}: {3 if task in ('eth3d', 'normals') else 2} of 4 images read" in printed
    assert cli.run([*words, *tasks, "--json"]) == 1
    assert set(json.loads(capsys.readouterr().out)["tasks"]) == set(TASKS)
