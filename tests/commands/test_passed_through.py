"""An option that is passed through is an argument of the API, with the same default."""

from __future__ import annotations

import inspect
from pathlib import Path
from typing import Any, Final

import pytest

from legoworld import cli
from legoworld.agents import run_plan
from legoworld.api import comparison, evaluation, one_photo, readout, scenes
from legoworld.baselines import request
from legoworld.plugin import serve
from legoworld.trajectories import score_checkpoints

#: The least that is typed, the function that is called, and the type of what is passed to it.
CALLS: Final[list[tuple[str, Any, type]]] = [
    ("readout . --task coco -o out", readout.readout, readout.ReadoutOptions),
    ("evaluate . --truth x -o out", evaluation.evaluate, evaluation.EvaluationOptions),
    ("compare . . -o out", comparison.compare, comparison.ComparisonOptions),
    ("inspect .", scenes.open_scene, scenes.SceneOptions),
    ("plugin serve", serve.serve_plugin, serve.PluginServing),
]
#: What the command line does not offer, and what it gives instead of the default.
NOT_OFFERED: Final = {"require_frozen", "shading"}
OF_THE_COMMAND: Final = {"listener", "started", "cache", "ledger", "address", "limits"}


class ReceivedError(BaseException):
    """The arguments of a call; no command catches it."""


def received(command: str, function: Any, tmp_path: Path, monkeypatch: Any) -> dict[str, Any]:
    """The arguments by name that the command passes."""

    def receive(*_args: object, **given: object) -> None:
        raise ReceivedError(given)

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(f"{function.__module__}.{function.__name__}", receive)
    (tmp_path / "x").touch()
    with pytest.raises(ReceivedError) as caught:
        cli.run(command.split())
    given: dict[str, Any] = caught.value.args[0]
    return given


@pytest.mark.parametrize(("command", "function", "kind"), CALLS, ids=[c[0] for c in CALLS])
def test_options_have_the_defaults_of_the_api(command, function, kind, tmp_path, monkeypatch):
    signature = inspect.signature(function)
    passed = received(command, function, tmp_path, monkeypatch)
    assert set(passed) >= set(kind.__annotations__) - NOT_OFFERED
    assert set(passed) <= set(signature.parameters)
    for name in set(kind.__annotations__) - OF_THE_COMMAND - NOT_OFFERED:
        default = signature.parameters[name].default
        assert passed[name] == default or (default is inspect.Parameter.empty), name


@pytest.mark.parametrize(
    ("target", "kind"),
    [
        (run_plan.plan_run, run_plan.RunOptions),
        (serve.serve_plugin, serve.PluginServing),
        (request.BaselineRequest, request.RequestOptions),
        (score_checkpoints.ScoringPlan, score_checkpoints.ScoringOptions),
        (one_photo.PhotoRequest, one_photo.PhotoOptions),
    ],
)
def test_what_is_passed_has_the_types_of_what_takes_it(target, kind):
    taken = inspect.signature(target).parameters
    without_default = {name: taken[name].annotation for name in kind.__annotations__}
    declared = {name: part.__forward_arg__ for name, part in kind.__annotations__.items()}
    optional = {name: text.removesuffix(" | None") for name, text in without_default.items()}
    assert {name: text.removesuffix(" | None") for name, text in declared.items()} == optional
