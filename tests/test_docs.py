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
from checkout import CHECKOUT
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
TRUTH = ROOT / "datasets" / "skimage_examples"

#: What a value can be held to without the files a page speaks of.
_CHECKED = (click.Choice, click.IntRange, click.FloatRange)


def named(path: Path) -> str:
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


def parsed(arguments: list[str]) -> None:
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


@pytest.mark.parametrize("page", [p for p in PAGES if commands(p)], ids=named)
def test_every_command_of_a_page_exists_with_its_options(page):
    for arguments in commands(page):
        try:
            parsed(arguments)
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
            parsed(wrong)


def test_the_tutorial_goes_through_every_step():
    steps = [arguments[0] for arguments in commands(TUTORIAL)]
    wanted = ["execute", "inspect", "freeze", "readout", "evaluate", "report"]
    assert [steps.index(step) for step in wanted] == sorted(steps.index(step) for step in wanted)


def anchors(page: Path) -> set[str]:
    """The anchors GitHub gives a page's headings."""
    headings = re.findall(r"^#+ (.*)$", page.read_text(encoding="utf-8"), re.M)
    return {re.sub(r"[^\w\- ]", "", text).strip().lower().replace(" ", "-") for text in headings}


@pytest.mark.parametrize("page", PAGES, ids=named)
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


@pytest.mark.parametrize("picture", sorted((DOCS / "pictures").iterdir()), ids=named)
def test_every_picture_is_used_and_small(picture):
    assert picture.stat().st_size < PICTURE_MAX_BYTES
    texts = [page.read_text(encoding="utf-8") for page in PAGES]
    assert any(f"pictures/{picture.name})" in text for text in texts), "no page shows it"


def test_the_index_lists_every_page():
    index = (DOCS / "README.md").read_text(encoding="utf-8")
    for page in [*DOCS.glob("*.md"), *DOCS.glob("protocols/*.md")]:
        link = f"]({page.relative_to(DOCS)})"
        assert page.name == "README.md" or index.count(link) == 1, page.name


def patched(program: str, difference: str) -> str:
    """A program with a unified diff without context applied; each hunk's place is checked."""
    lines, shift = program.splitlines(), 0
    for hunk in re.split(r"^@@ ", difference, flags=re.M)[1:]:
        head, _, body = hunk.partition("\n")
        start, count = re.match(r"-(\d+)(?:,(\d+))?", head).groups()
        removed = [x[1:] for x in body.splitlines() if x.startswith("-")]
        added = [x[1:] for x in body.splitlines() if x.startswith("+")]
        assert len(removed) == (1 if count is None else int(count))
        at = int(start) + shift - (1 if removed else 0)
        assert lines[at : at + len(removed)] == removed
        lines[at : at + len(removed)] = added
        shift += len(added) - len(removed)
    return "\n".join(lines) + "\n"


def tutorial_programs() -> tuple[str, str]:
    found = dict(blocks(TUTORIAL))
    return found["python"], patched(found["python"], found["diff"])


def test_the_tutorials_change_fits_its_program():
    first, second = tutorial_programs()
    compile(first, "coffee.py", "exec")
    compile(second, "coffee.py", "exec")
    assert "table[" not in first
    assert second.count('["category"]') == 4


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
def test_the_tutorials_tables_and_numbers_are_the_programs_own(tmp_path, capsys):
    text = TUTORIAL.read_text(encoding="utf-8")
    scenes = [tmp_path / name / "coffee" for name in ("first", "second")]
    build(dict(zip(scenes, tutorial_programs(), strict=True)))
    for scene in scenes:
        assert cli.run(["inspect", str(scene), "--size", "600x400", "--task", "coco"]) == 0
        table = capsys.readouterr().out.split("\n\n")[0]
        assert "".join(f"    {line}\n" for line in table.splitlines()) in text
    for row, column, task in (("COCO box AP", 0, "coco"), ("COCO box AP", 1, "coco"),
                              ("LVIS mask AP", 1, "lvis")):  # fmt: skip
        metrics, matched = scored(tmp_path, scenes[column].parent, task)
        shown = re.search(rf"^\| {row} \| (.*?) \| (.*?) \|", text, re.M).group(column + 1)
        assert f"{metrics['AP']:.3f}" == shown
        kind = {"coco": "box", "lvis": "mask"}[task]
        shown = re.search(rf"^\| mean {kind} IoU per annotation \| (.*?) \| (.*?) \|", text, re.M)
        assert f"{matched['miou_gt_micro']:.3f}" == shown.group(column + 1)


def scored(folder: Path, scenes: Path, task: str) -> tuple[dict, dict]:
    """Metrics and class-aware overlaps of the coffee scene below `scenes`."""
    track = json.loads((TRUTH / f"track_{task}.json").read_text())
    track["images"] = [i for i in track["images"] if i["file_name"] == "coffee.png"]
    (folder / f"{task}.json").write_text(json.dumps(track))
    run, evaluation = folder / f"run-{scenes.name}-{task}", folder / f"eval-{scenes.name}-{task}"
    arguments = ["--task", task, "--track", str(folder / f"{task}.json"), "-o", str(run), "-q"]
    assert cli.run(["readout", str(scenes), *arguments]) == 0
    truth = str(TRUTH / f"truth_{task}.json")
    arguments = ["--truth", truth, "-o", str(evaluation), "--draws", "10", "-q"]
    assert cli.run(["evaluate", str(run), *arguments]) == 0
    summary = json.loads((evaluation / "summary.json").read_text())
    return summary["metrics"], summary["matched"]["class_aware"]


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
