"""Laws over all commands: which options a refusal names, exit codes, and numbers in a last line."""

from __future__ import annotations

import ast
import importlib
import inspect
import json
import pkgutil
from types import SimpleNamespace
from typing import Any

import click
import pytest
from commands.every_command import command_of, commands

import legoworld.commands
from legoworld import cli
from legoworld.cards import load_card
from legoworld.commands import model_options, run_text
from legoworld.records.run_file import RunCoverage, RunSummary
from legoworld.records.scene_folder import ExecutionFile, FrozenRow, ProgramError, Verdict
from legoworld.tasks.registry import known_tasks
from legoworld.workers.protections import protections


def refused_names() -> list[tuple[str, str]]:
    """(module, parameter) of each name that a call of `refuse_given` is given."""
    found = []
    for module in pkgutil.iter_modules(legoworld.commands.__path__):
        loaded = importlib.import_module(f"legoworld.commands.{module.name}")
        for call in ast.walk(ast.parse(inspect.getsource(loaded))):
            if isinstance(call, ast.Call) and ast.unparse(call.func).endswith("refuse_given"):
                text = ast.unparse(call.args[0])
                if text != "names":  # what export computes
                    found += [(module.name, name) for name in eval(text, vars(loaded))]
    return found


def parameters(module: str) -> set[str]:
    every = [command_of(words) for words in commands(cli.main)]
    return {
        str(parameter.name)
        for command in every
        if command.callback.__module__ == f"legoworld.commands.{module}"
        for parameter in command.params
    }


def test_a_refusal_names_options_that_its_command_has():
    """A name that is none would refuse nothing: the option would be ignored in silence."""
    found = refused_names()
    assert len(found) > 30
    assert [(module, name) for module, name in found if name not in parameters(module)] == []


def test_the_options_of_a_model_are_all_named():
    @click.command()
    @model_options.model_options("Seconds.", required=False)
    def command(**_given: Any) -> None: ...

    assert {p.name for p in command.params} == {*model_options.NAMES}


@pytest.mark.parametrize(("count", "word"), [(1, ("box", "mask")), (2, ("boxes", "masks"))])
def test_each_task_counts_its_own_kind(count, word):
    box, mask = word
    kinds = {"boxes": box, "boxes_3d": box, "masks": mask, "amodal": mask}
    assert {load_card(task.name).reads for task in known_tasks()} > kinds.keys()
    for task in known_tasks():
        summary = RunSummary(
            schema_version=1, task=task.name, partial=False, warnings=0, predictions=count,
            coverage=RunCoverage(attempted=3, ok=2, by_status={}),
        )  # fmt: skip
        kind = kinds.get(load_card(task.name).reads)
        assert run_text._counts(summary) == "2 of 3 images read" + (
            f", {count} {kind}" if kind else ""
        )


def run_command(
    monkeypatch: Any, capsys: Any, work: str, answer: Any, *words: str
) -> tuple[int, Any]:
    """The exit code and the document of a command whose work gives an answer."""
    monkeypatch.setattr(work, lambda *_, **__: answer)
    code = cli.run([*words, "--json"])
    return code, json.loads(capsys.readouterr().out)


@pytest.mark.parametrize("bad", [0, 1])
def test_evidence_that_does_not_hold_is_exit_code_1(bad, tmp_path, monkeypatch, capsys):
    checks = [SimpleNamespace(status="differs" if k < bad else "ok", what=f"w{k}", found=f"f{k}")
              for k in range(2)]  # fmt: skip
    words = ("evidence", "verify", str(tmp_path))
    code, document = run_command(
        monkeypatch, capsys, "legoworld.api.evidence.evidence_verify", checks, *words
    )
    assert (code, document["ok"]) == (bad, not bad)
    assert document["checks"] == [
        {"status": "differs" if k < bad else "ok", "what": f"w{k}", "found": f"f{k}"}
        for k in range(2)
    ]
    assert cli.run([*words]) == bad
    lines = capsys.readouterr().out.splitlines()
    holds = f"{2 - bad} of 2 checks {'holds' if bad else 'hold'}: {tmp_path}"
    assert lines[-1] == holds
    assert [line.split() for line in lines[2:-1]] == [["differs", "w0", "f0"]] * bad
    assert cli.run([*words, "-v"]) == bad
    assert len(capsys.readouterr().out.splitlines()) == 5


@pytest.mark.parametrize(
    ("line", "check", "code", "told"),
    [
        (None, "ok", 0, None), (7, "ok", 1, "line 7"), (0, "ok", 1, "outside its own lines"),
        (None, "invalid", 5, None), (3, "invalid", 5, "line 3"),
    ],
)  # fmt: skip
def test_the_exit_code_of_a_program_is_that_of_its_scene(
    line, check, code, told, tmp_path, monkeypatch, capsys
):
    error = None if line is None else ProgramError(line=line or None, type="E", message="no")
    made = ExecutionFile(
        status="stopped" if error else "complete", error=error, warnings=("odd",),
        files={"scene.blend": "a", "final.png": "b"}, sandbox=protections("limits").record(),
        check=Verdict(status=check, code="c", reason="r"),
    )  # fmt: skip
    (tmp_path / "p.py").touch()
    work = "legoworld.api.scene_folders.execute"
    words = ("execute", str(tmp_path / "p.py"), "-o", "out", "--sandbox", "limits")
    found, document = run_command(monkeypatch, capsys, work, made, *words)
    assert found == code
    assert document["status"] == made.status
    assert document["files"] == ["scene.blend", "final.png"]
    assert document["warnings"] == ["odd"]
    assert document["check"] == {"status": check, "code": "c", "reason": "r"}
    assert not document["sandbox"]["bubblewrap"]
    assert cli.run([*words]) == code
    out, err = capsys.readouterr()
    stopped = f"stopped: p.py, {told}: E: no; the partial scene was exported\n" if told else ""
    assert out == f"{stopped}scene.blend, final.png -> out\n"
    assert err == "warning: odd\n"


@pytest.mark.parametrize("bad", [0, 2])
def test_a_scene_that_fails_its_check_is_exit_code_1(bad, tmp_path, monkeypatch, capsys):
    rows = [
        FrozenRow(
            scene=f"s{k}", status="invalid" if k < bad else "ok", warnings=[f"w{k}"],
            checks={"scene.glb": Verdict(status="invalid" if k < bad else "ok", code="",
                                         reason=f"r{k}")},
        )
        for k in range(3)
    ]  # fmt: skip
    work, words = "legoworld.api.scene_folders.freeze", ("freeze", str(tmp_path), "--no-cache")
    code, document = run_command(monkeypatch, capsys, work, rows, *words)
    assert code == bool(bad)
    assert [row["scene"] for row in document["scenes"]] == ["s0", "s1", "s2"]
    failing = [f"invalid: s{k}/scene.glb: r{k}" for k in range(bad)]
    warned = [f"warning: s{k}: w{k}" for k in range(3)]
    end = ["3 of 3 scenes frozen, all checks passed", "1 of 3 scenes frozen, 2 scenes fail a check"]
    fine = [f"ok: s{k}" for k in range(bad, 3)]
    for more, lines in (("-q", failing), (None, [*warned, *failing]),
                        ("-v", [*warned, *failing, *fine])):  # fmt: skip
        assert cli.run([*words, *([more] if more else [])]) == bool(bad)
        assert capsys.readouterr().out.splitlines() == [*lines, end[bool(bad)]]


@pytest.mark.parametrize("failed", [0, 1])
def test_a_trial_without_a_scene_is_exit_code_1(failed, tmp_path, monkeypatch, capsys):
    rows = [SimpleNamespace(status="no_scene" if k < failed else "ok") for k in range(2)]
    (tmp_path / "t.json").touch()
    monkeypatch.setattr("legoworld.agents.campaign.reconstruct", lambda *_, **__: rows)
    words = ["reconstruct", str(tmp_path / "t.json"), "--photos", str(tmp_path), "--agent", "x"]
    assert cli.run([*words, "-o", "out"]) == failed
    trials = "1 of 2 trials" if failed else "2 of 2 trials"
    assert capsys.readouterr().out == f"{trials} left a scene -> out\n"


@pytest.mark.parametrize("verbose", [True, False])
def test_the_steps_of_a_score_are_said_and_its_tracebacks_with_v(
    verbose, tmp_path, monkeypatch, capsys
):
    row = SimpleNamespace(status="failed", file_name="a.png", reason="no", unmatched=())
    found = SimpleNamespace(row=row, summary=None, advice=(), execution=None, overlay=None)

    def work(*_: Any, listener: Any, **__: Any) -> Any:
        listener.notice("step")
        listener.trace("where")
        return found

    monkeypatch.setattr("legoworld.api.score.score_photo", work)
    for name in ("a.png", "t.json"):
        (tmp_path / name).touch()
    words = ["score", str(tmp_path), "--photo", str(tmp_path / "a.png"),
             "--truth", str(tmp_path / "t.json"), "--no-cache"]  # fmt: skip
    assert cli.run([*words, *["-v"] * verbose]) == 1
    said = capsys.readouterr()
    assert said.out == "failed: a.png: no\n"
    assert said.err == "step\nwhere\n" * verbose


def made_family(name: str, *noise: Any, status: str = "ok") -> Any:
    cases = [
        SimpleNamespace(
            file_name=f"{name}_{k}.png",
            truth=SimpleNamespace(noise_floor=floor, scored=["a"] * (k + 1)),
        )
        for k, floor in enumerate(noise)
    ]
    return SimpleNamespace(family=name, status=status, reason="no view" * (status != "ok"),
                           cases=cases)  # fmt: skip


def floor(sd: float, *a_self: float) -> Any:
    return SimpleNamespace(a_self=a_self, sd=sd, seeds=(1, 2, 3))


def test_a_dataset_in_words(monkeypatch, tmp_path, capsys):
    monkeypatch.setattr("legoworld.bench.hidden.hidden_things",
                        lambda cases: {c.file_name: ("cup", "pen") for c in cases[1:]})  # fmt: skip
    families = [made_family("den", floor(0.02, 0.9, 0.8, 0.95), floor(0.03, 0.85, 0.99)),
                made_family("hall", floor(0.01, 0.97)), made_family("attic", status="invalid"),
                made_family("bare", None)]  # fmt: skip
    made: Any = SimpleNamespace(
        families=families, refused_families=families[2:3],
        track=SimpleNamespace(categories=["cup"]),
    )  # fmt: skip
    end = [
        "3 of 4 scenes made into 4 cases, 1 category",
        "A of the references rendered by the card: 0.8000 at least; seed to seed sd 0.0300 at most "
        "(3 seeds a case)",
        "public -> out/public; private -> out/private",
    ]
    words = ["bench", "make", str(tmp_path), "-o", "out"]
    work = "legoworld.api.bench.bench_make"
    told = [
        "invalid: attic: no view",
        "den_1.png: hidden here and not scored, though in an earlier tier: cup, pen",
    ]
    monkeypatch.setattr(work, lambda *_, **__: made)
    assert cli.run(words) == 1
    assert capsys.readouterr().out.splitlines() == [*told, *end]
    assert cli.run([*words, "-v"]) == 1
    cases = ["den_0.png: 1 scored object", "den_1.png: 2 scored objects",
             "hall_0.png: 1 scored object", "bare_0.png: 1 scored object"]  # fmt: skip
    assert capsys.readouterr().out.splitlines() == [*told, *cases, *end]
    code, document = run_command(monkeypatch, capsys, work, made, *words)
    assert (code, document["dataset"]) == (1, "out")
    assert document["families"][0] == {
        "family": "den", "status": "ok", "reason": "", "cases": ["den_0.png", "den_1.png"],
        "hidden": {"den_1.png": ["cup", "pen"]},
    }  # fmt: skip
    made.families, made.refused_families, made.track = families[2:3], families[2:3], None
    assert cli.run(words) == 1
    nothing = "0 of 1 scene made into 0 cases: no dataset was written"
    assert capsys.readouterr().out.splitlines() == [told[0], nothing]
    made.families, made.refused_families = families[3:], []
    made.track = SimpleNamespace(categories=["cup", "pen"])
    assert cli.run(words) == 0
    assert capsys.readouterr().out.splitlines() == [
        "1 of 1 scene made into 1 case, 2 categories", end[-1]
    ]  # fmt: skip
