"""Tables, notices and hints as every command prints them."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from legoworld import cli
from legoworld.commands import doctor_command, output
from legoworld.commands.output import Output
from legoworld.commands.progress import LineProgress
from legoworld.records.run_rows import RunRow
from legoworld.tables.terminal import WIDTH, within_width

WORDS = "several words that are longer than a line may be " * 4


@pytest.mark.parametrize("place", [0, 1, 2])
def test_the_widest_column_of_a_wide_table_is_wrapped(place: int) -> None:
    row = ["one", "two", "three"]
    row[place] = WORDS
    text = output.table(("a", "b", "c"), [row, ["x", "y", "z"]])
    lines = text.splitlines()
    assert max(map(len, lines)) <= WIDTH
    assert len(lines) > 4
    assert set(lines[1]) == {"-", " "}
    # The wrapped words are whole, in order, and the other cells stand in the first line alone.
    assert WORDS.split() == [w for line in lines[2:-1] for w in line.split() if w not in set(row)]
    assert {w for line in lines[3:-1] for w in line.split()} <= {*WORDS.split()}
    assert lines[-1].split() == ["x", "y", "z"]


def test_a_table_as_wide_as_it_may_be_is_left_alone() -> None:
    left = WIDTH - 2 - len("number")
    just, more = ("w" * (left // 2 - 1) + " " + "w" * (left - left // 2 + n) for n in (0, 1))
    for text, lines in ((just, 3), (more, 4)):
        assert len(output.table(("words", "number"), [(text, 12)]).splitlines()) == lines


@pytest.mark.parametrize(("other", "lines"), [(82, 6), (83, 1)])
def test_a_column_is_wrapped_to_16_and_never_narrower(other: int, lines: int) -> None:
    rows = [("w" * 45 + " " + "w" * 40, "o" * other)]
    text = output.table(("a", "b"), rows).splitlines()
    assert len(text) == 2 + lines
    assert len(text[1].split()[0]) == (16 if lines > 1 else 86)
    assert len(output.table(("h" * 17, "b"), rows).splitlines()) == 3, "its title is wider"


def test_numbers_and_what_is_absent_stand_on_the_right() -> None:
    rows = [("a", 1, "1"), ("bb", 22.5, "2"), ("c", "-", "10"), ("d", "", "")]
    assert output.table(("name", "n", "text"), rows).splitlines() == [
        "name     n  text",
        "----  ----  ----",
        "a        1  1",
        "bb    22.5  2",
        "c        -  10",
        "d",
    ]
    assert output.table(("name", "n"), []).splitlines() == ["name  n", "----  -"]


def test_long_lines_are_wrapped_and_indented() -> None:
    short = "x" * WIDTH
    said = within_width(f"{short}\n{WORDS}\nlast").splitlines()
    assert (said[0], said[-1]) == (short, "last")
    assert said[1].startswith("several")
    assert all(line.startswith("  ") and line[2] != " " for line in said[2:-1])
    assert max(map(len, said)) <= WIDTH


def test_the_hint_can_be_pasted_into_a_shell() -> None:
    assert output.report_hint(Path("my evals/a"), photos=True) == (
        "look at it: legoworld report 'my evals/a' --photos PHOTOS -o report.html"
    )
    assert output.report_hint(Path("e"), photos=False) == (
        "look at it: legoworld report e -o report.html"
    )


def test_notices_end_with_quiet_and_tracebacks_begin_with_verbose(
    capsys: pytest.CaptureFixture[str],
) -> None:
    said = []
    for given in ({}, {"quiet": True}, {"verbose": True}, {"verbose": True, "quiet": True}):
        Output(**given).notice("a notice")
        said.append(capsys.readouterr())
        Output(**given).trace("a trace")
        said.append(capsys.readouterr())
    assert [one.err for one in said] == [
        "a notice\n", "", "", "", "a notice\n", "a trace\n", "", "a trace\n",
    ]  # fmt: skip
    assert {one.out for one in said} == {""}


def test_the_doctor_tells_what_is_needed_from_what_is_not_ready(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def finding(name: str, **said: Any) -> doctor_command.Finding:
        return doctor_command.Finding(name=name, found="x", next_step=f"mend {name}", **said)

    good = finding("good", good=True)
    lacking = finding("lacking", good=False, needed=False)
    for name in (
        "_python",
        "_system_libraries",
        "_blender",
        "_kernel",
        "_lvis",
        "_cache",
        "_sandbox",
    ):
        monkeypatch.setattr(doctor_command, name, lambda: good)
    monkeypatch.setattr(doctor_command, "_baselines", lambda: [lacking])
    assert cli.run(["doctor"]) == 0
    said = capsys.readouterr().out
    assert "not ready  lacking" in said
    assert "mend lacking" in said
    assert "mend good" not in said
    monkeypatch.setattr(doctor_command, "_python", lambda: finding("bad", good=False))
    assert cli.run(["doctor"]) == 1
    assert "MISSING    bad" in capsys.readouterr().out
    assert cli.run(["doctor", "--json"]) == 1
    document = json.loads(capsys.readouterr().out)
    assert document["ok"] is False
    assert document["findings"][0] == {
        "name": "bad", "good": False, "found": "x", "next_step": "mend bad", "needed": True,
    }  # fmt: skip


@pytest.mark.parametrize("name", ["scene.blend", "scene.glb"])
def test_a_folder_of_scenes_is_no_scene_and_a_scene_of_one_file_is(
    tmp_path: Path, name: str, capsys: pytest.CaptureFixture[str]
) -> None:
    for folder in ("a", "b"):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / name).touch()
    assert cli.run(["inspect", str(tmp_path)]) == 2
    assert (
        f"contains 2 scene folders but is not one itself: pass one of them, such as {tmp_path}"
        in (" ".join(capsys.readouterr().err.split()))
    )
    (tmp_path / name).touch()
    source = name.rpartition(".")[2]
    assert cli.run(["inspect", str(tmp_path), "--source", source, "--no-cache"]) != 0
    assert "scene folders" not in capsys.readouterr().err


def test_progress_in_lines():
    now, said = [0.0], []
    step = LineProgress("image", said.append, lambda: now[0])
    step.total(100)
    for number in range(1, 101):
        now[0] = number * 1.0
        step(RunRow(image_id=number, file_name="", status="ok" if number != 50 else "failed"))
    assert said[0] == "2 of 100 images, 1 s each"
    assert said[-1] == "100 of 100 images, 1 failed, 1 s each"
    assert len(said) == 5


def test_a_run_of_two_seconds_says_no_progress():
    now, said = [0.0], []
    step = LineProgress("scene", said.append, lambda: now[0])
    step.total(2)
    for now[0] in (0.5, 1.9):
        step(RunRow(image_id=1, file_name="", status="ok"))
    assert said == []


def test_lines_of_a_resumed_run_count_what_was_kept_and_not_its_time() -> None:
    now, said = [10.0], []
    step = LineProgress("scene", said.append, lambda: now[0])
    step.total(10)
    step.count_kept(7)
    for number in range(8, 11):
        now[0] += 1.5
        step(RunRow(image_id=number, file_name="", status="ok"))
    assert said == ["9 of 10 scenes, 1.5 s each", "10 of 10 scenes, 1.5 s each"]


def test_words_are_never_cut_at_a_hyphen() -> None:
    text = "word " * 19 + "a-name-with-hyphens and more"
    assert within_width(text).splitlines() == [
        ("word " * 19).rstrip(), "  a-name-with-hyphens and more"
    ]  # fmt: skip
    cells = output.table(("a", "b"), [(text, "x")]).splitlines()
    assert any("a-name-with-hyphens" in line for line in cells)
