"""Cutting a program: its steps in order are the program, whatever it looks like."""

from __future__ import annotations

import sys
from pathlib import Path
from types import ModuleType, SimpleNamespace

import pytest

from legoworld.agents.program_steps import (
    ProgramNotCutError,
    _merge_groups,
    cut_program,
    saving_step,
)

EXAMPLES = Path(__file__).parents[2] / "examples"
PROGRAMS = sorted(EXAMPLES.glob("*/scene.py")) + sorted(EXAMPLES.glob("*/*/scene.py"))
SAYS = "import sys\ndef say(x): vars(sys.modules['program']).setdefault('said', []).append(x)\n"


def cut_text(tmp_path, text, most=24):
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
    assert cut_text(tmp_path, "a = 1\nsay(a)\na += 1\nb = a\nsay(b)\nc = 3\n") == (3, [1, 2])


def test_the_body_of_a_final_main_is_the_program_s_own(tmp_path):
    text = "def main():\n    x = 1\n    say(x)\n    say(x + 1)\n"
    assert cut_text(tmp_path, text + "main()\n") == (2, [1, 2])
    assert cut_text(tmp_path, text + "if __name__ == '__main__':\n    main()\n") == (2, [1, 2])


@pytest.mark.parametrize(
    "body",
    [
        "    say(1)\n    return\n",
        "    global x\n    x = 1\n    say(x)\n",
        "    say(1)\n    yield\n",
    ],
)
def test_a_main_that_means_something_else_outside_is_left_alone(tmp_path, body):
    count, _ = cut_text(tmp_path, f"def main():\n{body}main()\n")
    assert count == 1


def test_functions_see_names_that_later_steps_make(tmp_path):
    assert cut_text(tmp_path, "def f(): say(later)\nsay(0)\nlater = 5\nf()\n") == (2, [0, 5])


def test_neighbours_are_put_together_where_there_are_too_many(tmp_path):
    text = "".join(f"say({n})\n" for n in range(100))
    assert cut_text(tmp_path, text, most=7) == (7, list(range(100)))


@pytest.mark.parametrize(("n", "most"), [(10, 4), (25, 24), (3, 7), (24, 24), (1, 1)])
def test_they_are_put_together_evenly(n, most):
    sizes = [len(group) for group in _merge_groups([[k] for k in range(n)], most)]
    assert len(sizes) == min(n, most)
    assert sum(sizes) == n
    assert max(sizes) - min(sizes) <= 1
    assert _merge_groups([], most) == []


def test_future_imports_hold_in_every_step(tmp_path):
    text = "from __future__ import annotations\nsay(1)\ndef f(x: nowhere): say(x)\nf(2)\n"
    path = tmp_path / "scene.py"
    path.write_text(text.replace("say", "print"))
    for step in cut_program(path):
        assert "from __future__ import annotations" in step.arguments["code"]


def test_text_with_quotes_and_newlines_stays_as_it_is(tmp_path):
    assert cut_text(tmp_path, "say('''a\n  \"b\" \\\\ c''')\n") == (1, ['a\n  "b" \\ c'])


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


def test_each_step_must_succeed_and_there_are_no_more_than_asked_for(tmp_path):
    path = tmp_path / "scene.py"
    path.write_text('"""What it is."""\n' + "print(1)\n" * 30 + '"more text"\n')
    steps = cut_program(path)
    assert len(steps) == 24
    assert {(s.server, s.tool, s.must_succeed) for s in steps} == {
        ("blender", "execute_blender_code", True)
    }
    assert not any("text" in s.arguments["code"] or "What" in s.arguments["code"] for s in steps)
    path.write_text('"""Nothing else."""\n')
    assert cut_program(path) == []
    path.write_text("from __future__ import annotations\n")
    assert cut_program(path) == []


@pytest.mark.parametrize(
    "end",
    [
        "if __name__ == '__main__':\n    main()\nelse:\n    say(3)\n",
        "if __name__ == '__main__':\n    say(0)\n    main()\n",
        "if True:\n    main()\n",
        "main(*[])\n",
        "main(**{})\n",
        "vars()['main']()\n",
        "x = main()\n",
        "def main():\n    say(1)\n    say(2)\nmain()\n",
        "@staticmethod\ndef other():\n    say(1)\n    say(2)\nother()\n",
        "def other(a=1):\n    say(1)\n    say(2)\nother()\n",
        "def other(*a):\n    say(1)\n    say(2)\nother()\n",
        "def other(**a):\n    say(1)\n    say(2)\nother()\n",
        "def other(*, a=1):\n    say(1)\n    say(2)\nother()\n",
        "def other(a=1, /):\n    say(1)\n    say(2)\nother()\n",
        "def other():\n    if 1:\n        say(1)\n        say(2)\n        return\nother()\n",
    ],
)
def test_a_main_that_is_called_another_way_is_one_statement(tmp_path, end):
    text = "def main():\n    say(1)\n    say(2)\n"
    assert cut_text(tmp_path, text + end)[0] == 1


@pytest.mark.parametrize(
    "inner",
    ["    def g():\n        return 1\n", "    g = lambda: (yield)\n",
     "    class G:\n        def h(self): return 1\n"],
)  # fmt: skip
def test_what_a_main_defines_may_return(tmp_path, inner):
    text = f"def main():\n{inner}    say(1)\n    say(2)\nif '__main__' == __name__:\n    main()\n"
    assert cut_text(tmp_path, text) == (2, [1, 2])


def test_the_last_step_saves_the_scene_where_the_prompt_asks_for_it(monkeypatch):
    saved = []
    bpy = ModuleType("bpy")
    mainfile = SimpleNamespace(save_as_mainfile=lambda **how: saved.append(how))
    vars(bpy).update(ops=SimpleNamespace(wm=mainfile))
    monkeypatch.setitem(sys.modules, "bpy", bpy)
    step = saving_step(Path("/a 'b'"))
    assert (step.tool, step.must_succeed) == ("execute_blender_code", False)
    exec(step.arguments["code"], {})
    assert saved == [
        {"filepath": "/a 'b'/scene.blend", "compress": True, "relative_remap": False}
    ]  # fmt: skip
