"""Trajectories scored end to end: built, exported, evaluated; a deliberate regression shows."""

from __future__ import annotations

import json

import pytest
from agents.tracks import plan, run, server_or_skip, steps_file
from bench.quick_renders import few_samples
from evaluation.reconstruction import datasets
from evaluation.reconstruction.datasets import HFOV_DEG, SIZE_WH, write_dataset

from legoworld import cli
from legoworld.trajectories.curves import drops
from legoworld.trajectories.page import read_scores
from legoworld.trajectories.score_checkpoints import ScoringPlan, score_trajectories
from legoworld.workers.protections import protections
from legoworld.workers.sandbox import SandboxLimits

pytestmark = pytest.mark.blender

#: mcp-for-blender's first call asks what the endpoint is: the steps are calls 2, 3, and so on.
#: The fabricated reference (tests/evaluation/reconstruction/datasets.py) in Blender: its camera is
#: OpenCV's identity, its walls are planes in disparity, its balls are drawn by the same numbers.
STAGE = f"""
import bpy, math, numpy as np
bpy.ops.wm.read_factory_settings(use_empty=True)
scene = bpy.context.scene
scene.render.resolution_x, scene.render.resolution_y = {SIZE_WH}
data = bpy.data.cameras.new("Camera")
data.sensor_fit, data.angle = "HORIZONTAL", math.radians({HFOV_DEG})
camera = bpy.data.objects.new("Camera", data)
camera.rotation_euler = (math.pi, 0, 0)
scene.collection.objects.link(camera)
scene.camera = camera
def plane(name, corners):
    mesh = bpy.data.meshes.new(name)
    mesh.from_pydata(corners, [], [(0, 1, 2, 3)])
    scene.collection.objects.link(bpy.data.objects.new(name, mesh))
plane("Back", [(x, y, (1 - 0.05 * x) / 0.18) for x, y in ((-9, -9), (9, -9), (9, 9), (-9, 9))])
plane("Floor", [(x, 1.1, z) for x, z in ((-9, 0.1), (9, 0.1), (9, 9), (-9, 9))])
light = bpy.data.objects.new("Light", bpy.data.lights.new("Light", "POINT"))
light.data.energy = 200
scene.collection.objects.link(light)
"""
BALLS = """
import bpy, numpy as np
random = np.random.default_rng(0)
for k in range(2):
    centre, radius = random.uniform([-0.9, -0.2, 2.2], [0.8, 0.6, 4.0]), random.uniform(0.25, 0.55)
    bpy.ops.mesh.primitive_uv_sphere_add(segments=64, ring_count=32, radius=radius, location=centre)
    bpy.context.object.name = f"Ball {k + 1}"
"""
WORSE = "import bpy\nfor n in (1, 2): bpy.data.objects[f'Ball {n}'].location.x += 1.5"
CAMERA = "import bpy\nbpy.context.scene.camera.location.x = 0.4"
BLIND = "import bpy\nbpy.context.scene.camera = None"
SEEING = "import bpy\nbpy.context.scene.camera = bpy.data.objects['Camera']\n"
LIGHT = "import bpy\nbpy.data.objects['Light'].data.energy = 5"
SAVE = "import bpy, os\nbpy.ops.wm.save_as_mainfile(filepath=os.getcwd() + '/scene.blend')"


@pytest.fixture(scope="module")
def scored(tmp_path_factory):
    server_or_skip()
    folder = tmp_path_factory.mktemp("scored")
    with pytest.MonkeyPatch.context() as patch:  # the sizes of the bench's own card
        patch.setattr(datasets, "RASTER_WH", (421, 237))
        patch.setattr(datasets, "RENDER_WH", (512, 288))
        dataset = write_dataset(folder / "bench", families=2, tiers=("easy",))
    names = [str(case.image.file_name).removesuffix(".png") for case in dataset.cases.values()]
    (folder / "track.json").write_bytes((folder / "bench/public/track.json").read_bytes())
    (folder / "photos").symlink_to(folder / "bench/public/images")
    steps_file(
        folder / "programs" / f"{names[0]}.steps.jsonl",
        [STAGE + BALLS, BLIND, SEEING + WORSE, CAMERA, LIGHT, SAVE],
    )  # fmt: skip
    steps_file(folder / "programs" / f"{names[1]}.steps.jsonl", ["print('nothing')"])
    run(plan(folder), folder / "scenes")
    scoring = ScoringPlan(
        private=folder / "bench" / "private",
        output=folder / "scores",
        limits=SandboxLimits(time_s=300.0, memory_bytes=3 << 30),
        protections=protections("auto"),
        workers=1,
        draws=200,
        seed=0,
        notice=lambda _: None,
    )
    with pytest.MonkeyPatch.context() as patch:
        few_samples(patch)
        yield folder, scoring, score_trajectories([folder / "scenes"], scoring), names


def test_the_regression_is_found_at_its_call_with_its_cause(scored):
    made = scored[2].trials[0]
    qs = {scene.call: scene.Q for scene in made.scenes[:-1]}
    assert qs[2] == max(q for q in qs.values() if q is not None)
    worst = drops(made)[0]
    calls = {edit.call: edit for edit in made.edits}
    assert calls[4].d_r < -0.2
    assert calls[4].cause["geometry"] < -0.1
    assert worst.call == 4
    assert calls[5].cause["camera"] == pytest.approx(calls[5].d_q)
    assert calls[6].d_r == 0
    assert calls[6].cause["appearance"] == pytest.approx(calls[6].d_q)
    assert made.regret == pytest.approx(qs[2] - made.final_q)
    assert sum(made.regret_split.values()) == pytest.approx(made.regret)


def test_a_scene_without_a_camera_is_ineligible_and_counted_between(scored):
    made = scored[2].trials[0]
    blind = next(scene for scene in made.scenes if scene.call == 3)
    assert blind.Q is None
    assert "camera" in blind.reason
    assert next(edit for edit in made.edits if edit.call == 4).skipped == 1


def test_a_trial_without_a_scene_is_there_with_zero(scored):
    made = scored[2].trials[1]
    assert (made.first, made.final_q, made.final_valid) == (None, 0.0, False)
    (table,) = scored[2].agents
    assert (table.n_trials, table.n_evaluable) == (2, 1)


def test_again_it_is_the_same_to_the_byte(scored):
    path = scored[0] / "scores" / "trajectories.json"
    before = path.read_bytes()
    score_trajectories([scored[0] / "scenes"], scored[1])
    assert path.read_bytes() == before
    assert read_scores(scored[0] / "scores") == scored[2]


def test_show_report_and_pick_say_it(scored, capsys):
    folder, _, document, names = scored
    scene = folder / "scenes" / names[0]
    assert cli.run(["trajectory", "show", str(scene), "--scores", str(folder / "scores")]) == 0
    shown = capsys.readouterr().out
    assert f"{document.trials[0].final_q:.4f}" in shown
    page = folder / "page.html"
    report = ["trajectory", "report", str(folder / "scenes"), "-o", str(page)]
    report += ["--photos", str(folder / "photos"), "--scores", str(folder / "scores")]
    assert cli.run(report) == 0
    text = page.read_text()
    assert text.count("data:image/webp") >= 6
    assert "lowers Q" in text
    picked = ["trajectory", "pick", str(folder / "scenes"), "--by", "residuals"]
    requirements = [{"kind": "existence", "id": "a", "entity": "Ball 1", "hard": True}]
    for name in names:
        (folder / "evidence" / name).mkdir(parents=True)
        (folder / "evidence" / name / "requirements.json").write_text(json.dumps(requirements))
    capsys.readouterr()
    picked += ["--evidence", str(folder / "evidence"), "-o", str(folder / "picked"), "--json"]
    assert cli.run([*picked, "--scores", str(folder / "scores")]) == 0
    said = json.loads(capsys.readouterr().out)
    assert [p["ordinal"] is None for p in said["picks"]] == [False, True]
    assert (folder / "picked" / names[0] / "frozen.json").is_file()
