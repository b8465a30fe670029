"""What a newcomer meets in the first hour: mistakes, and the one line that says what to do."""

from __future__ import annotations

from pathlib import Path

import click
import pytest
from commands.every_command import command_of, commands

from legoworld import cli, extras
from legoworld.commands import doctor_command

#: A folder of each kind, by the file that only it holds.
MADE = {
    "runs/a": "run.json",
    "evals/a": "evidence.json",
    "comparisons/a": "comparison.json",
    "scenes/coffee": "scene.blend",
}


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ("export evals/a -o x.json", "evals/a is an evaluation, not a run"),
        ("export scenes/coffee -o x.json", "scenes/coffee is a scene folder, not a run"),
        ("export runs -o x.json", "runs is not a run: it holds runs/a, which is a run"),
        ("export photos -o x.json", "photos/run.json cannot be read"),
        ("evaluate evals/a --truth t.json -o x", "evals/a is an evaluation, not a run"),
        ("merge comparisons/a -o x", "comparisons/a is a comparison, not a run"),
        ("report runs/a -o x.html", "runs/a is a run, not an evaluation"),
        ("compare evals runs/a -o x", "evals is not an evaluation: it holds evals/a, which is an"),
        ("evidence verify runs/a", "runs/a is a run, not an evaluation"),
        ("freeze runs/a", "runs/a is a run, not a folder of scenes"),
        ("readout evals/a --task coco -o x", "evals/a is an evaluation, not a folder of scenes"),
    ],
)
def test_a_folder_of_another_kind_is_named_by_its_path_and_by_what_it_is(
    words: str, said: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys
) -> None:
    monkeypatch.chdir(tmp_path)
    for folder, file in MADE.items():
        (tmp_path / folder).mkdir(parents=True)
        (tmp_path / folder / file).write_text("{}")
    (tmp_path / "photos").mkdir()
    (tmp_path / "t.json").touch()
    assert cli.run(words.split()) == 2
    assert f"legoworld: {said}" in capsys.readouterr().err


def test_a_file_is_replaced_where_it_is_said_and_a_folder_never(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "there.json").mkdir()
    truth = tmp_path / "truth.json"
    truth.write_text('{"images": [], "annotations": [], "categories": []}')
    words = ["track", "make", "--task", "coco", "--truth", "truth.json", "-o", "there.json"]
    for more in ([], ["--overwrite"]):
        assert cli.run([*words, *more]) == 2
        assert capsys.readouterr().err == (
            "legoworld: there.json already exists; found: a folder; expected: a new file; "
            "next: choose another -o\n"
        )


@pytest.mark.parametrize("group", sorted({words[0] for words in commands(cli.main) if words[1:]}))
def test_the_help_of_a_group_has_whole_sentences(group, capsys):
    assert cli.run([group, "--help"]) == 0
    shown = " ".join(capsys.readouterr().out.split())
    found = command_of((group,))
    assert isinstance(found, click.Group)
    for one in found.commands.values():
        sentence = " ".join(str(one.help).partition("\n\n")[0].split()).partition(". ")[0]
        assert sentence.rstrip(".") in shown
    assert "..." not in shown.partition(" Commands: ")[2]


def test_the_doctor_looks_at_the_extras_and_the_agents_server(monkeypatch):
    monkeypatch.setattr(extras, "lacking", lambda extra: ["mcp"] if extra == "plugin" else [])
    found = {finding.name: finding for finding in doctor_command._extras()}
    assert [name for name, one in found.items() if not one.good] == ["extra plugin"]
    assert found["extra plugin"].next_step.startswith("pip install 'mcp")
    assert not found["extra plugin"].needed
    assert found["extra exr"].good
    problems = ["mcp-for-blender is not installed"]
    monkeypatch.setattr("legoworld.agents.mcp_server.server_problems", lambda: problems)
    server = doctor_command._agents_server()
    assert (server.good, server.needed) == (False, False)
    assert "legoworld agent install" in server.next_step


def test_what_an_extra_lacks_is_what_is_not_installed(monkeypatch):
    assert extras.lacking("examples") == []
    monkeypatch.setattr(extras, "requirements", lambda _extra: ["no-such-package>=1,<2", "click"])
    assert extras.lacking("exr") == ["no-such-package"]
