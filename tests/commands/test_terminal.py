"""What a command prints cannot command the terminal, wherever the text comes from."""

from __future__ import annotations

import json
import sys

import click
import pytest

from legoworld import cli
from legoworld.commands import output
from legoworld.commands.terminal import printable_streams
from legoworld.errors import LegoWorldError, one_line

#: Sets the title, clears the screen, turns the writing round; ESC, BEL, CSI, RLO, half a pair.
HOSTILE = "a\x1b]0;owned\x07b\x1b[2J\x9b31m\u202etxt\u2066\x7f\udc80c"
OBEYED = set("\x1b\x07\x9b\u202e\u2066\x7f\udc80\r")


def test_errors_are_one_printable_line():
    assert not OBEYED & set(one_line(HOSTILE))
    assert not OBEYED & set(str(LegoWorldError("what", found=HOSTILE, next_step=HOSTILE)))
    assert one_line("two\r\nlines\tπ · 家 é") == "two lines π · 家 é"


def test_everything_that_is_printed_passes_one_place(capsys):
    with printable_streams():
        click.echo(output.table(("name", HOSTILE), [(HOSTILE, 1)]))
        click.echo(f"x{HOSTILE}\rover", err=True)
        print(HOSTILE)
        sys.stdout.writelines([HOSTILE, "\n"])
        sys.stderr.write("\r 5% done\tπ\n")
    said = capsys.readouterr()
    assert not OBEYED & set(said.out)
    assert not (OBEYED - {"\r"}) & set(said.err)  # a progress bar returns to the line's beginning
    assert "\r 5% done\tπ\n" in said.err


def test_streams_are_given_back_after_an_error():
    before = sys.stdout, sys.stderr
    with pytest.raises(ValueError, match="x"), printable_streams():
        raise ValueError("x")
    assert (sys.stdout, sys.stderr) == before


def test_json_keeps_its_values(capsys):
    with printable_streams():
        output.print_json({"name": HOSTILE + "é"})
    said = capsys.readouterr().out
    assert not OBEYED & set(said)
    assert json.loads(said)["name"] == HOSTILE + "é"


def test_a_file_name_in_a_message_is_printable(tmp_path, capsys):
    name = tmp_path / "a\x1b]0;owned\x07.json"
    name.write_text("no track")
    code = cli.run(["track", "check", str(name), "--photos", str(tmp_path)])
    said = capsys.readouterr()
    assert code == 2
    assert "owned" in said.out + said.err
    assert not OBEYED & set(said.out + said.err)


def test_a_name_with_a_newline_forges_no_line():
    text = output.table(("photo", "status"), [("a\nb\tc", "ok"), ("\x1b[2J", "ok")])
    assert text.splitlines()[2:] == ["a\ufffdb\ufffdc  ok", "\ufffd[2J   ok"]
