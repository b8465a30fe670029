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
    ("plugin serve --ledger out --require-transaction", "legoworld.plugin.serving.serve_plugin",
     {"require_transaction": True}),
    ("plugin serve --ledger out --rounds 7 --rollbacks 3", "legoworld.plugin.serving.serve_plugin",
     {"limits.rounds": 7, "limits.rollbacks": 3, "require_transaction": False}),
    ("plugin hook --dialect codex --require-transaction", "legoworld.plugin.hooks.hook_answer",
     {"0.require_transaction": True, "0.dialect": "codex"}),
    ("plugin install --for codex --blender h:9 --ledger out --require-transaction",
     "legoworld.plugin.installing.install",
     {"0.require_transaction": True, "0.serve.1": "h:9", "0.serve.-1": "--require-transaction"}),
    ("blender serve --port 4321 --workspace w --call-time-limit 9 --network --sandbox limits",
     "legoworld.endpoint.serving.serve_endpoint",
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
    ("bench make . -o out --no-denoise --require-frozen", "legoworld.bench.making.make_dataset",
     {"0.options.picture.denoised": False, "0.options.require_frozen": True}),
    ("bench make . -o out", "legoworld.bench.making.make_dataset",
     {"0.options.picture.denoised": True, "0.options.require_frozen": False}),
    (f"track make --task coco --truth {TRUTH} -o out --images ids.txt",
     "legoworld.commands.track_making._make", {"2.chosen": ["5", "7"]}),
    (f"{PLUGIN} --model m-1 --plugin --regions d --depth d --prices x.txt",
     "legoworld.agents.run_plan.plan_run",
     {"model": "m-1", "prices": Path("x.txt"), "plugin.depth": Path("d")}),
    (f"{PLUGIN} --repeat 3 --workers 2", "legoworld.agents.reconstruct.reconstruct",
     {"repeat": 3, "workers": 2}),
    (EXPORT, "legoworld.bench.harbor.export_harbor",
     {"2.agent_image": "a:1", "2.verifier_image": "v:1", "2.agent_timeout_s": 11.0,
      "2.verifier_timeout_s": 12.0, "2.cpus": 3, "2.memory_mb": 512}),
    ("bench serve . --diagnostics --no-render --workers 2", "legoworld.bench.serving.ScoreServer",
     {"0.diagnostics": True, "1": 2}),
    ("trajectory score . --truth . -o out --sandbox limits --workers 3",
     "legoworld.trajectories.scoring.score_trajectories",
     {"1.limits.time_s": 600.0, "1.limits.memory_bytes": 8 << 30, "1.held.bubblewrap": None,
      "1.workers": 3}),
    ("trajectory pick . --by last -o out --sandbox limits", "legoworld.trajectories.picking.pick",
     {"2.by": "last", "2.limits.time_s": 600.0, "2.limits.memory_bytes": 8 << 30,
      "2.held.bubblewrap": None}),
    (f"baseline run dino --task coco --track {TRACK} --photos . {PYTHON} --pass-env A --pass-env B",
     "legoworld.baselines.baseline_run.run_baseline",
     {"0.pass_variables": ("A", "B"), "0.dtype": "float16"}),
    (f"plugin evidence --photo x.txt --provider vggt {PYTHON}",
     "legoworld.commands.plugin_evidence._ask", {"0.dtype": "float16"}),
]  # fmt: skip


#: What stands before the work: it would need a dataset, an environment or an agent.
STUBS: Final = (
    "legoworld.evaluation.reconstruction.dataset.read_dataset",
    "legoworld.agents.run_plan.plan_run",
    "legoworld.baselines.environments.chosen_python",
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

    monkeypatch.setattr("sys.stdin", io.TextIOWrapper(io.BytesIO(b"{}")))

    def receive(*args, **kwargs):
        raise ReceivedError(args, kwargs)

    for stub in STUBS:
        monkeypatch.setattr(stub, MagicMock())
    monkeypatch.setattr(target, receive)
    with pytest.raises(ReceivedError) as caught:
        cli.run(command.split())
    assert {name: value(caught.value, name) for name in expected} == expected
