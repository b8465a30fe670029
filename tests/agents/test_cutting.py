"""Cutting a program: its steps in order are the program, whatever it looks like."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from legoworld.agents.cutting import ProgramNotCutError, cut_program

EXAMPLES = Path(__file__).parents[2] / "examples"
PROGRAMS = sorted(EXAMPLES.glob("*/scene.py")) + sorted(EXAMPLES.glob("*/*/scene.py"))
SAYS = "import sys\ndef say(x): vars(sys.modules['program']).setdefault('said', []).append(x)\n"


def said(tmp_path, text, most=24):
    path = tmp_path / "scene.py"
    path.write_text(SAYS + text)
    steps = cut_program(path, most)
    sys.modules.pop("program", None)
    try:
        for step in steps:
            exec(step.arguments["code"], {})
        return len(steps), vars(sys.modules["program"]).get("said", [])
    finally:
        sys.modules.pop("program", None)


def test_a_step_ends_with_each_statement_that_acts(tmp_path):
    assert said(tmp_path, "a = 1\nsay(a)\na += 1\nb = a\nsay(b)\nc = 3\n") == (3, [1, 2])


def test_the_body_of_a_final_main_is_the_program_s_own(tmp_path):
    text = "def main():\n    x = 1\n    say(x)\n    say(x + 1)\n"
    assert said(tmp_path, text + "main()\n") == (2, [1, 2])
    assert said(tmp_path, text + "if __name__ == '__main__':\n    main()\n") == (2, [1, 2])


@pytest.mark.parametrize(
    "body",
    [
        "    say(1)\n    return\n",
        "    global x\n    x = 1\n    say(x)\n",
        "    say(1)\n    yield\n",
    ],
)
def test_a_main_that_means_something_else_outside_is_left_alone(tmp_path, body):
    count, _ = said(tmp_path, f"def main():\n{body}main()\n")
    assert count == 1


def test_functions_see_names_that_later_steps_make(tmp_path):
    assert said(tmp_path, "def f(): say(later)\nsay(0)\nlater = 5\nf()\n") == (2, [0, 5])


def test_neighbours_are_put_together_where_there_are_too_many(tmp_path):
    text = "".join(f"say({n})\n" for n in range(100))
    assert said(tmp_path, text, most=7) == (7, list(range(100)))


def test_future_imports_hold_in_every_step(tmp_path):
    text = "from __future__ import annotations\nsay(1)\ndef f(x: nowhere): say(x)\nf(2)\n"
    path = tmp_path / "scene.py"
    path.write_text(text.replace("say", "print"))
    for step in cut_program(path):
        assert "from __future__ import annotations" in step.arguments["code"]


def test_text_with_quotes_and_newlines_stays_as_it_is(tmp_path):
    assert said(tmp_path, "say('''a\n  \"b\" \\\\ c''')\n") == (1, ['a\n  "b" \\ c'])


@pytest.mark.parametrize("program", PROGRAMS, ids=lambda p: p.parent.name)
def test_a_shipped_program_is_several_steps_that_compile(program):
    steps = cut_program(program)
    assert len(steps) >= 2
    for step in steps:
        compile(step.arguments["code"], "step", "exec")


def test_what_is_no_python_is_refused(tmp_path):
    (tmp_path / "scene.py").write_text("def broken(:\n")
    with pytest.raises(ProgramNotCutError):
        cut_program(tmp_path / "scene.py")
