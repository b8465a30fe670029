"""The command line as a whole: help, examples, pages, exit codes, quick start."""

from __future__ import annotations

import errno
import json
import re
import subprocess
import sys
import warnings
from collections.abc import Iterator

import click
import pytest
from checkout import CHECKOUT

from legoworld import cli, errors, exit_codes
from legoworld import remote as places
from legoworld.commands.param_types import Choice
from legoworld.shipped import catalog
from legoworld.tasks.shipped import TASKS
from legoworld.workers import engines, task_process

ROOT = CHECKOUT


def test_warnings_of_arithmetic_do_not_reach_the_user(monkeypatch):
    for given, shown in (([], []), (["default"], [RuntimeWarning])):
        monkeypatch.setattr(sys, "warnoptions", given)
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            cli._quiet_arithmetic()
            warnings.warn("overflow encountered in cast", RuntimeWarning, stacklevel=1)
        assert [w.category for w in caught] == shown


def command_name(value: object) -> str | None:
    """A test's name from the words of its command."""
    return " ".join(value) if isinstance(value, list) else None


def every_command(group: click.Command, *path: str) -> Iterator[tuple[str, click.Command]]:
    """A command with all below it, each with the words that call it."""
    yield " ".join(path), group
    if isinstance(group, click.Group):
        with click.Context(group) as context:
            for name in group.list_commands(context):
                command = group.get_command(context, name)
                assert command is not None
                yield from every_command(command, *path, name)


COMMANDS = dict(every_command(cli.main))
CALLED = [name for name in COMMANDS if name]


@pytest.mark.parametrize("name", CALLED)
def test_every_command_has_help_and_examples(name, capsys):
    assert cli.run([*name.split(), "-h"]) == 0
    text = capsys.readouterr().out
    examples = [x for x in text.splitlines() if x.strip().startswith(f"legoworld {name}")]
    assert 2 <= len(examples) <= 4
    # Help stands beside an option, or below one that is wider than the column.
    options = re.findall(r"^  (-\S+.*)\n( *)", text[text.index("Options:") :], re.MULTILINE)
    assert len(options) >= 1
    for option, below in options:
        assert "  " in option.strip() or len(below) > 10, f"no help for {option}"


@pytest.mark.parametrize("name", CALLED)
def test_after_ctrl_c_a_command_that_resumes_says_so(name, capsys):
    """`bench make` said that nothing was kept, though its renders are."""
    assert cli.run([*name.split(), "-h"]) == 0
    resumes = " to resume" in " ".join(capsys.readouterr().out.split())
    said = cli._after_ctrl_c(name.split())
    assert said.endswith("again to resume") == resumes, said


def test_the_reference_page_is_what_the_commands_say():
    check = [sys.executable, str(ROOT / "docs" / "commands_page.py"), "--check"]
    assert subprocess.run(check, check=False).returncode == 0, "run `python docs/commands_page.py`"


@pytest.mark.parametrize(
    ("words", "refused"),
    [
        (["track", "check", "pyproject.toml", "--photos", "docs", "--seed", "1"], "--seed"),
        (["track", "check", "pyproject.toml", "--photos", "docs", "--unit", "mm"], "--unit"),
        (["track", "make", "--task", "coco", "--truth", "x", "-o", "y", "--root", "z"], "--root"),
        (["evidence", "--root", "docs", "verify", "docs"], "--root"),
        (["baseline", "import", "x", "--weights", "y"], "--weights"),
    ],
    ids=command_name,
)
def test_a_command_has_no_option_of_its_neighbours(words, refused, capsys, monkeypatch):
    monkeypatch.chdir(ROOT)
    assert cli.run(words) == 2
    assert re.search(rf"No such option:? '?{refused}\b", capsys.readouterr().err)


@pytest.mark.parametrize(
    ("arguments", "code"),
    [
        (["--help"], 0),
        (["--version"], 0),
        (["nonsense"], 2),
        (["readout"], 2),
        (["readout", "--task", "nonsense"], 2),
        (["inspect", "no/such/folder"], 2),
        (["readout", "--task", "coco", "--track", "pyproject.toml"], 2),
    ],
)
def test_exit_codes(arguments, code, capsys):
    assert cli.run(arguments) == code
    capsys.readouterr()


def raising(monkeypatch: pytest.MonkeyPatch, error: BaseException) -> None:
    """Every command ends with this."""

    def main(*_arguments, **_options):
        raise error

    monkeypatch.setattr(cli.main, "main", main)


@pytest.mark.parametrize(
    ("error", "code"),
    [
        (errors.UsageError("no"), 2),
        (errors.CatalogError("a track that is none"), 2),
        (errors.SceneInvalidError("no camera"), 2),
        (errors.InstallationError("a card is missing"), 4),
        (errors.KernelBuildError("no compiler"), 4),
        (places.PlaceError("s3://bucket cannot be reached"), 4),
        (engines.EngineMissingError("no ray"), 4),
        (engines.ClusterUnreachableError("nobody there"), 4),
        (task_process.ProcessLostError("killed"), 4),
        (OSError(errno.ENOSPC, "No space left on device", "run"), 4),
        (OSError(errno.EROFS, "Read-only file system", "run"), 4),
        (PermissionError(errno.EACCES, "Permission denied", "run"), 4),
        (OSError("a library's own, without a number"), 4),
        (FileNotFoundError(errno.ENOENT, "No such file or directory", "run"), 2),
        (NotADirectoryError(errno.ENOTDIR, "Not a directory", "run/x"), 2),
        (click.UsageError("no such option"), 2),
        (click.FileError("track.json"), 2),
    ],
    ids=lambda value: type(value).__name__ if isinstance(value, Exception) else None,
)
def test_an_error_is_one_line_and_the_exit_code_of_its_kind(error, code, monkeypatch, capsys):
    raising(monkeypatch, error)
    assert cli.run(["readout"]) == code
    shown = capsys.readouterr()
    assert shown.out == ""
    assert shown.err.count("\n") == 1


@pytest.mark.parametrize("error", [RuntimeError("x"), MemoryError(), RecursionError(), KeyError(1)])
def test_a_defect_is_shown_whole_and_never_taken_for_a_finished_command(error, monkeypatch, capsys):
    raising(monkeypatch, error)
    assert cli.run(["readout"]) == 4
    shown = capsys.readouterr().err
    assert "Traceback" in shown
    assert shown.splitlines()[-1].startswith("legoworld: internal error")


def test_every_exit_code_has_its_meaning_on_the_reference_page():
    page = (ROOT / "docs" / "commands.md").read_text(encoding="utf-8")
    assert sorted(exit_codes.MEANING) == [0, 1, 2, 3, 4, 5, 130]
    for code, meaning in exit_codes.MEANING.items():
        assert f"| {code} | {meaning} |" in page


@pytest.mark.parametrize(
    ("command", "resumes"),
    [
        (["readout", "scenes", "--task", "coco"], True),
        (["baseline", "run", "dino"], True),
        (["baseline", "import", "x.json"], False),
        (["evaluate", "run"], False),
        (["compare", "a", "b"], False),
        (["execute", "x.py"], False),
        ([], False),
    ],
    ids=command_name,
)
def test_ctrl_c_promises_to_resume_only_where_the_command_does(
    command, resumes, monkeypatch, capsys
):
    for stop in (click.Abort(), KeyboardInterrupt()):
        raising(monkeypatch, stop)
        assert cli.run(command) == 130
        shown = capsys.readouterr().err
        assert shown.count("\n") == 1
        assert ("to resume" in shown) is resumes
        assert ("to start over" in shown) is not resumes


@pytest.mark.parametrize(
    ("words", "near"),
    [
        (["redout"], "readout"),
        (["evalute", "x"], "evaluate"),
        (["readout", "--task", "cooc"], "coco"),
        (["list", "taks"], "tasks"),
        (["track", "mak"], "make"),
        (["baseline", "imports"], "import"),
        (["execute", "x.py", "--sandbox", "limit"], "limits"),
        (["track", "make", "--space", "dept"], "depth"),
        (["readout", "--trak", "x"], "--track"),
    ],
    ids=command_name,
)
def test_a_misspelt_word_is_refused_with_the_nearest(words, near, capsys):
    assert cli.run(words) == 2
    assert re.search(rf"Did you mean.*'{near}'", capsys.readouterr().err)
    assert cli.run(["xyzzy"]) == 2
    assert "Did you mean" not in capsys.readouterr().err


def test_every_choice_names_the_nearest_word():
    """One way for all: an option with click's own Choice lists the words and leaves it there."""
    choices = [
        (name, parameter.name, parameter.type)
        for name, command in COMMANDS.items()
        for parameter in command.params
        if isinstance(parameter.type, click.Choice)
    ]
    assert len(choices) > 10
    assert [(c, p) for c, p, kind in choices if not isinstance(kind, Choice)] == []


def test_an_output_that_nobody_reads_is_no_finished_command():
    command = [sys.executable, "-m", "legoworld", "list", "schema", "--task", "lvis"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        process.stdout.close()
        assert process.stderr.read() == b""
    assert process.returncode == 4


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_shell_completion_is_installed_as_the_page_says(shell, monkeypatch, capsys):
    page = (ROOT / "docs" / "commands.md").read_text(encoding="utf-8")
    assert f"_LEGOWORLD_COMPLETE={shell}_source legoworld" in page
    monkeypatch.setenv("_LEGOWORLD_COMPLETE", f"{shell}_source")
    monkeypatch.setattr("click.shell_completion.BashComplete._check_version", lambda *_: None)
    assert cli.run([]) == 0
    assert "_LEGOWORLD_COMPLETE" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("words", "wanted"),
    [
        ("legoworld re", {"readout", "reconstruct", "report"}),
        ("legoworld readout --ta", {"--task"}),
        ("legoworld readout --task co", {"coco", "coco-masks", "coco-panoptic", "coco-semantic"}),
        ("legoworld baseline i", {"install", "import"}),
    ],
)
def test_completion_names_commands_options_and_choices(words, wanted, monkeypatch, capsys):
    monkeypatch.setenv("_LEGOWORLD_COMPLETE", "bash_complete")
    monkeypatch.setenv("COMP_WORDS", words)
    monkeypatch.setenv("COMP_CWORD", str(len(words.split()) - 1))
    assert cli.run([]) == 0
    found = {line.partition(",")[2] for line in capsys.readouterr().out.splitlines()}
    assert found == wanted


def test_a_folder_without_scenes_is_one_line(tmp_path, capsys):
    assert cli.run(["readout", str(tmp_path), "--task", "coco", "-o", str(tmp_path / "r")]) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert "no scene.blend" in error


def test_list_schema_gives_an_author_everything_needed(capsys):
    assert cli.run(["list", "schema", "--task", "lvis", "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert len(document["vocabulary"]) == 1203
    assert document["override_property"] == "lvis_category"
    assert document["schema_version"] == 1


@pytest.mark.parametrize("kind", ["tasks", "datasets", "baselines"])
def test_list(kind, capsys):
    assert cli.run(["list", kind, "--json"]) == 0
    names = [entry["name"] for entry in json.loads(capsys.readouterr().out)[kind]]
    if kind == "tasks":
        assert names == sorted(task.name for task in TASKS)
    if kind == "datasets":
        folder = catalog.folder("datasets")
        assert names == sorted(path.parent.name for path in folder.glob("*/card.toml"))


def test_help_imports_nothing_heavy():
    program = (
        "import sys; from legoworld.cli import run; run(['--help']);"
        "print([m for m in ('bpy', 'numpy', 'cv2', 'pycocotools', 'scipy', 'torch')"
        " if m in sys.modules], file=sys.stderr)"
    )
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True
    )
    assert done.stderr.strip() == "[]"


def test_the_main_process_never_imports_bpy():
    program = (
        "import sys, pkgutil, importlib, legoworld;"
        "[importlib.import_module(m.name)"
        " for m in pkgutil.walk_packages(legoworld.__path__, 'legoworld.')"
        " if '.blender.' not in m.name and not m.name.endswith(('__main__', '_kernel'))];"
        "print('bpy' in sys.modules)"
    )
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True
    )
    assert done.stdout.strip() == "False"
