"""A child process's pipes, its end with its group, and its last words."""

from __future__ import annotations

import gc
import os
import sys
from contextlib import closing

import pytest

from legoworld.workers.child_process import ChildProcess, last_line

LONG_S = 120.0
#: A program with a child of its own in its group, which holds the same standard output.
FAMILY = """
import subprocess, sys, time
child = subprocess.Popen([sys.executable, "-c", "import time; time.sleep(600)"])
print(child.pid, flush=True)
sys.stdin.readline()
"""


def running(program: str, **options) -> closing[ChildProcess]:
    return closing(ChildProcess([sys.executable, "-c", program], os.environ, **options))


def has_ended(process: ChildProcess) -> bool:
    """Whether all that held its standard output has ended."""
    return process.answers(LONG_S) and process.stdout.read() == b""


def test_it_answers_and_its_end_is_told_with_its_last_words():
    program = (
        "import sys; print(sys.stdin.readline().upper(), end='', flush=True);"
        "print('first', file=sys.stderr); print('/last ', file=sys.stderr); sys.exit(3)"
    )
    with running(program) as process:
        process.send(b"hello\n")
        assert process.answers(LONG_S)
        assert process.stdout.readline() == b"HELLO\n"
        assert process.how_it_ended(within_s=LONG_S) == "exit code 3"
        assert process.last_words() == "/last"
        assert process.last_words(lambda line: "/" not in line) == "first"
        assert process.last_words(lambda line: "?" in line) == "no message"


def test_what_it_started_ends_with_it_when_it_ends_by_itself():
    with running(FAMILY) as process:
        process.stdout.readline()
        process.send(b"\n")
        assert process.exit_code(within_s=LONG_S) == 0
        assert has_ended(process)


def test_what_it_started_is_killed_with_it():
    with running(FAMILY) as process:
        process.stdout.readline()
        assert not process.answers(0.0)
        assert process.exit_code() is None
        process.end()
        assert process.how_it_ended() == "signal 9"
        assert has_ended(process)


def test_one_that_is_dropped_ends_with_what_it_started():
    process = ChildProcess([sys.executable, "-c", FAMILY], os.environ)
    assert process.stdout.readline()
    held = os.dup(process.stdout.fileno())
    del process
    gc.collect()
    with open(held, "rb") as output:  # noqa: PTH123  a descriptor
        assert output.read() == b""


def test_a_limit_on_the_whole_of_its_output():
    with running("import sys; print(len(sys.stdin.read()))") as process:
        assert process.output_for(b"x" * 1_000_000, LONG_S) == b"1000000\n"
        assert process.exit_code(within_s=LONG_S) == 0
    with running("import time; time.sleep(600)") as process, pytest.raises(TimeoutError):
        process.output_for(b"", 0.1)


def test_unsent_bytes_and_a_second_close_are_no_error():
    with running("import os; os.close(0); print(flush=True); input()") as process:
        process.stdout.readline()
        with pytest.raises(BrokenPipeError):
            process.send(b"x" * 1_000_000)
    process.close()
    process.kill()


def test_a_program_that_is_not_there_is_an_error():
    with pytest.raises(FileNotFoundError):
        ChildProcess(["/no/such/program"], {})


def test_the_last_line():
    assert last_line([]) == last_line(["", "  "]) == "no message"
    assert last_line(["a", " b ", ""]) == "b"
