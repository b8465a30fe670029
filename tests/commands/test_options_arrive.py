"""What is typed reaches the call that does the work, also where the work would be too long."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any, Final
from unittest.mock import MagicMock

import pytest
from checkout import CHECKOUT

from legoworld import cli

TRUTH: Final = CHECKOUT / "datasets" / "skimage_examples" / "truth_coco.json"
TRACK: Final = CHECKOUT / "datasets" / "skimage_examples" / "track_coco.json"
PYTHON: Final = (
    "--weights x.txt --python x.txt --device cpu --dtype float16 --sandbox limits -o out"
)
PLUGIN: Final = f"reconstruct {TRACK} --photos . --agent program --programs d -o out"
EXPORT: Final = (
    "bench export . --harbor -o out --agent-image a:1 --verifier-image v:1 --agent-timeout 11 "
    "--verifier-timeout 12 --cpus 3 --memory-mb 512"
)

#: The command, the function that does its work, and the values among its arguments.
CASES: Final[list[tuple[str, str, dict[str, Any]]]] = [
    ("plugin serve --ledger out --require-transaction", "legoworld.plugin.serve.serve_plugin",
     {"require_transaction": True}),
    ("plugin serve --ledger out --rounds 7 --rollbacks 3", "legoworld.plugin.serve.serve_plugin",
     {"limits.rounds": 7, "limits.rollbacks": 3, "require_transaction": False}),
    ("plugin hook --dialect codex --require-transaction", "legoworld.plugin.hooks.hook_answer",
     {"0.require_transaction": True, "0.dialect": "codex"}),
    ("plugin install --for codex --blender h:9 --ledger out --require-transaction",
     "legoworld.plugin.install.install",
     {"0.require_transaction": True, "0.serve.1": "h:9", "0.serve.-1": "--require-transaction"}),
    ("blender serve --port 4321 --workspace w --call-time-limit 9 --network --sandbox limits",
     "legoworld.endpoint.serve.serve_endpoint",
     {"0.port": 4321, "0.workspace": Path("w"), "0.call_time_s": 9.0}),
    ("evaluate . --truth x.txt -o out --reference-sampling random:3 --no-diagnostics",
     "legoworld.api.evaluation.evaluate",
     {"reference_sampling": "random:3", "diagnostics": False}),
    ("evaluate . --truth x.txt -o out", "legoworld.api.evaluation.evaluate",
     {"reference_sampling": None, "diagnostics": True}),
    ("compare . . -o out --allow-truth-prompts", "legoworld.api.comparison.compare",
     {"allow_truth_prompts": True}),
    ("baseline install dino --torch-index URL --with a==1 --with b",
     "legoworld.baselines.environments.install",
     {"torch_index": "URL", "extra": ("a==1", "b")}),
    ("bench make . -o out --no-denoise --require-frozen", "legoworld.api.bench.make_dataset",
     {"0.options.picture.denoised": False, "0.options.require_frozen": True}),
    ("bench make . -o out", "legoworld.api.bench.make_dataset",
     {"0.options.picture.denoised": True, "0.options.require_frozen": False}),
    (f"track make --task coco --truth {TRUTH} -o out --images ids.txt",
     "legoworld.api.tracks.make_track", {"chosen": ["5", "7"]}),
    (f"{PLUGIN} --model m-1 --plugin --regions d --depth d --prices x.txt",
     "legoworld.agents.campaign.plan_run",
     {"model": "m-1", "prices": Path("x.txt"), "plugin.depth": Path("d")}),
    (f"{PLUGIN} --repeat 3 --workers 2", "legoworld.agents.campaign.make_trials",
     {"repeat": 3, "workers": 2}),
    (EXPORT, "legoworld.api.bench.export_harbor",
     {"2.agent_image": "a:1", "2.verifier_image": "v:1", "2.agent_timeout_s": 11.0,
      "2.verifier_timeout_s": 12.0, "2.cpus": 3, "2.memory_mb": 512}),
    ("bench serve . --diagnostics --no-render --workers 2", "legoworld.api.bench.ScoreServer",
     {"0.diagnostics": True, "1": 2}),
    ("bench serve . --second-card --no-render", "legoworld.api.bench._serving",
     {"second_card": True, "render": False}),
    ("bench serve . --http --host h --port 9 --token-file token --queue 3 --body-limit 2 "
     "--unpacked-limit 4 --step 0.5 --per-object --root . --no-render",
     "legoworld.api.bench.serve_bench_http",
     {"0": Path(), "1.host": "h", "1.port": 9, "1.token": 4 * "secret", "1.queue": 3,
      "1.body_bytes": 2 << 20, "1.unpacked_bytes": 4 << 20, "1.step": 0.5, "1.per_object": True,
      "root": Path(), "render": False, "second_card": False}),
    ("trajectory score . --truth . -o out --sandbox limits --workers 3",
     "legoworld.trajectories.api.score_trajectories",
     {"1.limits.time_s": 600.0, "1.limits.memory_bytes": 8 << 30, "1.protections.bubblewrap": None,
      "1.workers": 3}),
    ("trajectory pick . --by last -o out --sandbox limits", "legoworld.trajectories.api.pick",
     {"2.by": "last", "2.limits.time_s": 600.0, "2.limits.memory_bytes": 8 << 30,
      "2.protections.bubblewrap": None}),
    (f"readout . --task coco --track {TRACK} -o out --source glb --workers 3 --engine ray "
     "--cache c --require-frozen --limit 4 --image-id 5 --image-id 6 --shard 2/3 "
     "--images-per-file 7 --max-side 64 --no-render --render-noise --overwrite --fail-fast "
     "--time-limit 9 --memory-limit 2", "legoworld.api.readout.readout",
     {"0": Path(), "1": Path("out"), "task": "coco", "track": TRACK, "source": "glb", "workers": 3,
      "engine": "ray", "cache": Path("c"), "require_frozen": True, "limit": 4, "image_ids": (5, 6),
      "shard": (2, 3), "images_per_file": 7, "max_side": 64, "render": False, "render_noise": True,
      "overwrite": True, "fail_fast": True, "time_limit_s": 9.0, "memory_limit_gib": 2.0,
      "started": None}),
    ("readout . --task coco --cache c", "legoworld.api.readout.readout",
     {"track": None, "source": "blend", "workers": None, "engine": "local", "limit": None,
      "image_ids": (), "shard": None, "require_frozen": False, "images_per_file": None,
      "max_side": None, "render": True, "render_noise": False, "overwrite": False,
      "fail_fast": False, "time_limit_s": 120.0, "memory_limit_gib": 8.0, "started": None}),
    ("blender mcp --workspace w --memory-limit 3 --sandbox limits",
     "legoworld.agents.mcp_endpoint.serve_mcp",
     {"0.workspace": Path("w"), "0.port": 0, "0.scene": None, "0.limits.memory_bytes": 3 << 30,
      "0.protections.bubblewrap": None, "notice.__name__": "notice"}),
    ("freeze . --workers 3 --engine local --no-cache --time-limit 9 --memory-limit 2",
     "legoworld.api.scene_folders.freeze_scenes",
     {"0": Path(), "engine": "local", "workers": 3, "cache": None, "limits.time_s": 9.0,
      "limits.memory_bytes": 2 << 30}),
    ("execute x.txt -o out --no-picture --input d --sandbox limits --time-limit 9 "
     "--memory-limit 2", "legoworld.api.scene_folders.execute_program",
     {"0": Path("x.txt"), "1": Path("out"), "picture": False, "inputs": [Path("d")],
      "sandbox": "limits", "limits.time_s": 9.0, "limits.memory_bytes": 2 << 30}),
    ("execute x.txt -o out --sandbox limits", "legoworld.api.scene_folders.execute_program",
     {"picture": True, "inputs": []}),
    ("inspect d --source glb --allow-changed --cache c --time-limit 9 --memory-limit 2",
     "legoworld.api.scenes.open_scene",
     {"0": Path("d"), "source": "glb", "allow_changed": True, "cache": Path("c"),
      "time_limit_s": 9.0, "memory_limit_gib": 2.0}),
    ("inspect d --compare-sources --no-cache", "legoworld.api.scenes.open_scene",
     {"source": "blend", "allow_changed": False, "cache": False}),
    ("score d --photo x.txt --truth ids.txt --task lvis --image 7 --source glb --no-cache "
     "--time-limit 9 --memory-limit 2 -o out", "legoworld.api.one_photo.score_photo",
     {"0.program_or_scene": Path("d"), "0.photo": Path("x.txt"), "0.truth": Path("ids.txt"),
      "0.task": "lvis", "0.image": "7", "0.source": "glb", "0.limits.time_s": 9.0,
      "0.limits.memory_bytes": 2 << 30, "1": Path("out")}),
    ("evaluate . --truth x.txt -o out --evaluator fast --camera-model dataset --draws 9 --seed 8 "
     "--workers 3 --engine ray --overwrite", "legoworld.api.evaluation.evaluate",
     {"0": Path(), "1": Path("out"), "truth": Path("x.txt"), "evaluator": "fast",
      "camera_model": "dataset", "draws": 9, "seed": 8, "workers": 3, "engine": "ray",
      "overwrite": True}),
    ("compare . d -o out --draws 9 --seed 8 --fail-below AP=0.1 --overwrite",
     "legoworld.api.comparison.compare",
     {"0": [Path(), Path("d")], "1": Path("out"), "draws": 9, "seed": 8,
      "fail_below": ("AP=0.1",), "overwrite": True}),
    ("compare . d -o out", "legoworld.api.comparison.compare",
     {"draws": 2000, "seed": 0, "fail_below": (), "allow_truth_prompts": False,
      "overwrite": False}),
    ("compare --join . d -o out --overwrite", "legoworld.comparison.make_comparison.join_folders",
     {"0": (Path(), Path("d")), "1": Path("out"), "overwrite": True}),
    (f"export . -o out --format bop --task lvis --track {TRACK} --size 40x30 --source glb "
     "--require-frozen --overwrite --no-cache --time-limit 9 --memory-limit 2",
     "legoworld.api.exporting.export",
     {"0": Path(), "1": Path("out"), "format": "bop", "task": "lvis", "track": TRACK,
      "size_wh": (40, 30), "source": "glb", "require_frozen": True, "overwrite": True,
      "cache": False, "time_limit_s": 9.0, "memory_limit_gib": 2.0}),
    (f"import {TRACK} -o out --overwrite --time-limit 9 --memory-limit 2",
     "legoworld.api.scene_folders.import_usd",
     {"0": TRACK, "1": Path("out"), "overwrite": True, "time_limit_s": 9.0,
      "memory_limit_gib": 2.0}),
    ("merge . d -o out --images-per-file 7 --overwrite",
     "legoworld.api.merging.merge_shards",
     {"0": [Path(), Path("d")], "images_per_file": 7, "overwrite": True}),
    ("report . d --photos d --scenes . --scenes d -o out.html",
     "legoworld.api.report_page.page_document",
     {"1": Path("d"), "2": [Path(), Path("d")]}),
    (f"baseline run dino --task coco --track {TRACK} --photos . {PYTHON} --pass-env A --pass-env B",
     "legoworld.api.baselines.run_baseline",
     {"0.pass_variables": ("A", "B"), "0.dtype": "float16"}),
    (f"plugin evidence --photo x.txt --provider vggt {PYTHON}",
     "legoworld.api.plugin_evidence._ask", {"0.dtype": "float16"}),
]  # fmt: skip


#: What stands before the work: it would need a dataset, an environment or an agent.
STUBS: Final = (
    "legoworld.api.bench.read_dataset",
    "legoworld.agents.campaign.plan_run",
    "legoworld.api.report_page.read_sources",
    "legoworld.baselines.request.chosen_python",
)


class ReceivedError(BaseException):
    """The arguments of a call; no command catches it."""


def value(received: ReceivedError, name: str) -> Any:
    args, kwargs = received.args
    first, *rest = name.split(".")
    found = kwargs[first] if first in kwargs else args[int(first)]
    for part in rest:
        found = found[int(part)] if part.lstrip("-").isdigit() else getattr(found, part)
    return found


@pytest.mark.parametrize(("command", "target", "expected"), CASES, ids=[c[0] for c in CASES])
def test_what_is_typed_arrives(command, target, expected, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "x.txt").touch()
    (tmp_path / "d").mkdir()
    (tmp_path / "ids.txt").write_text("5\n7\n")
    (tmp_path / "token").write_text("secret" * 4)

    monkeypatch.setattr("sys.stdin", io.TextIOWrapper(io.BytesIO(b"{}")))

    def receive(*args, **kwargs):
        raise ReceivedError(args, kwargs)

    for stub in STUBS:
        monkeypatch.setattr(stub, MagicMock())
    monkeypatch.setattr(target, receive)
    with pytest.raises(ReceivedError) as caught:
        cli.run(command.split())
    assert {name: value(caught.value, name) for name in expected} == expected


#: The environment variables of docs/commands.md's options, and the argument each one sets.
VARIABLES: Final[list[tuple[str, str, str, str, Any]]] = [
    ("LEGOWORLD_TIME_LIMIT", "9", "legoworld.api.readout.readout", "time_limit_s", 9.0),
    ("LEGOWORLD_MEMORY_LIMIT", "2", "legoworld.api.readout.readout", "memory_limit_gib", 2.0),
    ("LEGOWORLD_ENGINE", "ray", "legoworld.api.readout.readout", "engine", "ray"),
    ("LEGOWORLD_CACHE", "kept", "legoworld.api.readout.readout", "cache", Path("kept")),
]


@pytest.mark.parametrize(("variable", "text", "target", "name", "expected"), VARIABLES)
def test_a_variable_stands_for_its_option(
    variable, text, target, name, expected, tmp_path, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv(variable, text)

    def receive(*args, **kwargs):
        raise ReceivedError(args, kwargs)

    monkeypatch.setattr(target, receive)
    with pytest.raises(ReceivedError) as caught:
        cli.run(["readout", ".", "--task", "coco"])
    assert value(caught.value, name) == expected


@pytest.mark.parametrize(
    ("words", "wanted"),
    [
        ("--no-cache", True),
        ("--cache c", False),
        ("--no-cache --source glb", False),
        ("--no-cache --engine ray", False),
        ("--no-cache --source blend --engine local", True),
    ],
)
def test_blender_is_started_ahead_where_a_scene_needs_it(words, wanted, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)

    started = []

    class Process:
        close = staticmethod(lambda: None)

        def __init__(self, limits):
            started.append(limits.time_s)

        def start(self):
            pass

    def receive(*args, **kwargs):
        raise ReceivedError(args, kwargs)

    monkeypatch.setattr("legoworld.scene.blender_process.BlenderProcess", Process)
    monkeypatch.setattr("legoworld.api.readout.readout", receive)
    with pytest.raises(ReceivedError):
        cli.run(["readout", ".", "--task", "coco", "--time-limit", "9", *words.split()])
    assert started == ([9.0] if wanted else [])
