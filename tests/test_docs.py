"""The documentation against the program: commands parse, links lead somewhere, output is real."""

from __future__ import annotations

import json
import re
import shlex
import subprocess
import sys
import typing
from pathlib import Path

import click
import pytest
import stranger
from checkout import CHECKOUT
from commands import every_command
from packaging.requirements import Requirement

import legoworld
from legoworld import cli, extras

ROOT = CHECKOUT
DOCS = ROOT / "docs"
PAGES = sorted(
    [
        ROOT / "README.md",
        ROOT / "CONTRIBUTING.md",
        ROOT / "tests" / "README.md",
        *DOCS.rglob("*.md"),
        *ROOT.glob("examples/*/README.md"),
        *ROOT.glob("baselines/*/README.md"),
    ]
)
TUTORIAL = DOCS / "tutorial.md"
LABELS = DOCS / "labels.md"
PICTURE_MAX_BYTES = 150_000

#: What a value can be held to without the files a page speaks of.
_CHECKED = (click.Choice, click.IntRange, click.FloatRange)


def page_name(path: Path) -> str:
    return str(path.relative_to(ROOT))


def blocks(page: Path) -> list[tuple[str, str]]:
    """The fenced code blocks of a page: language, content."""
    return re.findall(r"^```(\w*)\n(.*?)^```$", page.read_text(encoding="utf-8"), re.M | re.S)


def code_lines(page: Path) -> list[str]:
    """Lines of all code blocks, fenced or indented; a line that goes on is one line."""
    fenced = "\n".join(text for _, text in blocks(page))
    outside = re.sub(r"^```.*?^```$", "", page.read_text(encoding="utf-8"), flags=re.M | re.S)
    indented = "\n".join(re.findall(r"^    (.*)$", outside, re.M))
    return re.sub(r"\\\n", " ", f"{fenced}\n{indented}").splitlines()


def commands(page: Path) -> list[list[str]]:
    """The arguments of every legoworld command in a page's code."""
    lines = (line.strip().removeprefix("$ ") for line in code_lines(page))
    return [
        shlex.split(line, comments=True)[1:] for line in lines if re.match(r"legoworld [a-z]", line)
    ]


def parse_command(arguments: list[str]) -> None:
    """Parse a command as the program would, short of opening what it names."""
    command, words = cli.main, list(arguments)
    context = click.Context(command, info_name="legoworld", **command.context_settings)
    while isinstance(command, click.Group):
        name = words.pop(0)
        found = command.get_command(context, name)
        assert found is not None, f"there is no command {name!r}"
        command = found
        context = click.Context(found, info_name=name, parent=context, **found.context_settings)
    values, _, _ = command.make_parser(context).parse_args(words)
    for parameter in command.params:
        value = values.get(parameter.name)
        if isinstance(parameter, click.Option) and parameter.required:
            assert value is not None, f"{parameter.name} is not given"
        if isinstance(parameter.type, _CHECKED) and value is not None:
            parameter.type_cast_value(context, value)


@pytest.mark.parametrize("page", [p for p in PAGES if commands(p)], ids=page_name)
def test_every_command_of_a_page_exists_with_its_options(page):
    for arguments in commands(page):
        try:
            parse_command(arguments)
        except (click.UsageError, AssertionError) as error:
            pytest.fail(f"legoworld {shlex.join(arguments)}: {error}")


def test_the_check_of_commands_can_fail():
    for wrong in (
        ["inspct", "scenes"],
        ["inspect", "scenes", "--foto", "x.png"],
        ["readout", "scenes", "--task", "cocoa"],
        ["evaluate", "runs/coco", "--truth", "t.json"],
        ["baseline", "imports", "x.json"],
    ):
        with pytest.raises((click.UsageError, AssertionError)):
            parse_command(wrong)


def test_the_tutorial_goes_through_every_step():
    steps = [arguments[0] for arguments in commands(TUTORIAL)]
    wanted = ["execute", "inspect", "freeze", "readout", "evaluate", "report"]
    assert [steps.index(step) for step in wanted] == sorted(steps.index(step) for step in wanted)


def anchors(page: Path) -> set[str]:
    """The anchors GitHub gives a page's headings."""
    headings = re.findall(r"^#+ (.*)$", page.read_text(encoding="utf-8"), re.M)
    return {re.sub(r"[^\w\- ]", "", text).strip().lower().replace(" ", "-") for text in headings}


@pytest.mark.parametrize("page", PAGES, ids=page_name)
def test_every_relative_link_and_picture_exists(page):
    prose = re.sub(r"^```.*?^```$", "", page.read_text(encoding="utf-8"), flags=re.M | re.S)
    for target in re.findall(r"\]\(([^)\s]+)\)", prose):
        if re.match(r"[a-z]+:", target):
            continue
        file, _, anchor = target.partition("#")
        path = (page.parent / file).resolve() if file else page
        assert path.exists(), f"{target} is not there"
        if anchor and path.suffix == ".md":
            assert anchor in anchors(path), f"{target}: no such heading"


@pytest.mark.parametrize("picture", sorted((DOCS / "pictures").iterdir()), ids=page_name)
def test_every_picture_is_used_and_small(picture):
    assert picture.stat().st_size < PICTURE_MAX_BYTES
    texts = [page.read_text(encoding="utf-8") for page in PAGES]
    assert any(f"pictures/{picture.name})" in text for text in texts), "no page shows it"


def test_the_index_lists_every_page():
    index = (DOCS / "README.md").read_text(encoding="utf-8")
    for page in [*DOCS.glob("*.md"), *DOCS.glob("protocols/*.md")]:
        link = f"]({page.relative_to(DOCS)})"
        assert page.name == "README.md" or index.count(link) == 1, page.name


#: Words of commands that mean what they mean anywhere, or name a program of others.
PLAIN = set(
    re.findall(
        r"\w+",
        """
        agent agents allow any array assets batch below blender body box by cache call camera
        category changed check compare count cpus demo denoise depth device doctor dtype env execute
        export fail fast file files folder folders for format fov harbor host http id ids image
        images import index inspect install join json keep kind limit list load make max mb memory
        merge model name network no object of offline option options or output overwrite pass per
        photo photos picture port prebuilt prices programs project python queue quiet render repeat
        replay require results root run sample samples scene scenes score seed serve show side size
        step suffix table time timeout token torch truth undo unpacked verbose verifier verify
        weights with without write
        """,
    )
)


def test_the_glossary_knows_every_word_that_the_commands_use():
    text = (DOCS / "glossary.md").read_text(encoding="utf-8")
    bold = " ".join(re.findall(r"\*\*(.+?)\*\*", text, re.S)).casefold()
    known = set(re.findall(r"[a-z]+", bold))
    known |= {word.removesuffix("s") for word in known} | {f"{word}s" for word in known}
    used: set[str] = set()
    for words in every_command.commands(cli.main):
        used |= set(words)
        for one in every_command.command_of(words).params:
            names = [one.name] if isinstance(one, click.Argument) else one.opts
            used |= {part for name in names for part in re.findall(r"[a-z]+", str(name))}
    unknown = {word for word in used - PLAIN - known if len(word) > 1}
    assert unknown == set()
    assert {"readout", "frozen", "ledger", "shard"} <= used & known


_BUILD = """
import json, os, sys
import bpy
for folder, program in json.load(sys.stdin).items():
    bpy.ops.wm.read_factory_settings()
    exec(compile(program, folder, "exec"), {"__name__": "__main__"})
    os.makedirs(folder)
    bpy.ops.wm.save_as_mainfile(filepath=os.path.join(folder, "scene.blend"))
"""


def build(programs: dict[Path, str]) -> None:
    """Save the scene of each program into its folder, all in one Blender process."""
    done = subprocess.run(
        [sys.executable, "-c", _BUILD],
        input=json.dumps({str(folder): program for folder, program in programs.items()}),
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr[-3000:]


@pytest.mark.blender
def test_the_tutorial_runs_as_a_stranger_runs_it_and_its_numbers_are_its_own(tmp_path):
    assert stranger.count_unmarked(TUTORIAL) == 0
    stranger.run_page(TUTORIAL, tmp_path / "tutorial")
    text = TUTORIAL.read_text(encoding="utf-8")
    for row, column, folder in (("COCO box AP", 0, "first"), ("COCO box AP", 1, "boxes"),
                                ("LVIS mask AP", 1, "masks")):  # fmt: skip
        path = tmp_path / "tutorial" / "evals" / folder / "summary.json"
        summary = json.loads(path.read_text(encoding="utf-8"))
        shown = re.search(rf"^\| {row} \| (.*?) \| (.*?) \|", text, re.M).group(column + 1)
        assert f"{summary['metrics']['AP']:.3f}" == shown
        kind = row.split()[1]
        shown = re.search(rf"^\| mean {kind} IoU per annotation \| (.*?) \| (.*?) \|", text, re.M)
        overlap = summary["matched"]["class_aware"]["miou_gt_micro"]
        assert f"{overlap:.3f}" == shown.group(column + 1)


def test_a_page_that_fails_or_prints_something_else_is_found(tmp_path):
    page = tmp_path / "page.md"
    for number, (block, shown) in enumerate(
        [("false", ""), ("echo $HERE", ""), ("echo a", "    b\n"), ("echo a", "    a\n    ...\n")]
    ):
        page.write_text(f"<!-- run -->\n```sh\n{block}\n```\n\n{shown}\nText.\n")
        if number == 3:
            stranger.run_page(page, tmp_path / "good")
        else:
            with pytest.raises(AssertionError):
                stranger.run_page(page, tmp_path / f"bad{number}")
    page.write_text("```sh\nlegoworld doctor\n```\n")
    assert stranger.count_unmarked(page) == 1


def label_examples() -> tuple[dict[str, str], list[tuple[str, str | None, str]]]:
    """The programs of labels.md by scene, and each command with its labels.json and its output."""
    (_, start), *rest = blocks(LABELS)
    programs: dict[str, str] = {}
    shown: list[tuple[str, str | None, str]] = []
    program, labels = "", None
    for language, content in rest:
        if language == "python":
            program, labels = f"{start}\n\n{content}", None
        elif language == "json":
            labels = content
        else:
            command, _, output = content.partition("\n")
            shown.append((command, labels, output))
            if scene := re.search(r"scenes/(\w+)", command):
                programs[scene[1]] = program
    return programs, shown


@pytest.mark.blender
def test_every_example_of_labelling_prints_what_the_page_says(tmp_path, capsys, monkeypatch):
    programs, shown = label_examples()
    assert len(shown) >= 12
    build({tmp_path / name / "scenes" / name: program for name, program in programs.items()})
    name = ""
    for command, labels, output in shown:
        if scene := re.search(r"scenes/(\w+)", command):
            name = scene[1]
        file = tmp_path / name / "scenes" / name / "labels.json"
        file.unlink(missing_ok=True)
        if labels is not None:
            file.write_text(labels)
        monkeypatch.chdir(tmp_path / name)
        assert cli.run(shlex.split(command)[2:]) == 2 * output.startswith("legoworld: ")
        printed = capsys.readouterr()
        assert printed.out + printed.err == output, command


def test_no_text_tells_anyone_to_install_an_extra_of_a_project_that_is_not_published():
    """pip takes extras from a checkout or a wheel file; `extras.install_command` works anywhere."""
    package = Path(legoworld.__file__).parent
    files = [*PAGES, *package.rglob("*.py"), *(ROOT / "baselines").rglob("*.py")]
    assert len(files) > 500
    found = [str(f) for f in files if re.search(r"\blegoworld\[", f.read_text(encoding="utf-8"))]
    assert found == []


@pytest.mark.parametrize("extra", typing.get_args(extras.Extra))
def test_every_extra_has_a_command_that_pip_understands_and_its_row_in_the_docs(extra):
    wanted = extras.requirements(extra)
    assert wanted
    assert shlex.split(extras.install_command(extra)) == ["pip", "install", *wanted]
    page = (DOCS / "installation.md").read_text(encoding="utf-8")
    (row,) = re.findall(rf"^\|.*`(pip install .*?)`.*\| `{extra}` \|$", page, re.M)
    assert {Requirement(r) for r in shlex.split(row)[2:]} == {Requirement(r) for r in wanted}
