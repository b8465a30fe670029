"""Tasks of installed packages: which can be asked for, and which installations are refused."""

from __future__ import annotations

from dataclasses import replace
from importlib.metadata import EntryPoint

import pytest

from legoworld import cli
from legoworld.commands import doctor_command
from legoworld.errors import InstallationError, UsageError
from legoworld.report.family import PageFamily
from legoworld.tasks import registry
from legoworld.tasks.shipped import BENCH, DEFAULT, TASKS

SHIPPED = tuple(task.name for task in TASKS)
#: What the entry points below name: a task under its own name, and what is none.
OWN = replace(TASKS[0], name="own")
NUMBER = 3


@pytest.fixture(autouse=True)
def _fresh():
    for kept in (registry._added_entry_points, registry._load_task):
        kept.cache_clear()
    yield
    for kept in (registry._added_entry_points, registry._load_task):
        kept.cache_clear()


@pytest.fixture
def installed(monkeypatch):
    """Installs tasks by name: each a module's value, as the entry points of packages name it."""

    def install(*named: tuple[str, str]) -> None:
        found = [EntryPoint(name, value, registry.GROUP) for name, value in named]
        monkeypatch.setattr(
            registry, "entry_points", lambda group: found * (group == registry.GROUP)
        )

    return install


def at(name: str) -> str:
    return f"{__name__}:{name}"


def test_tasks_that_ship_come_first_and_others_by_name(installed):
    installed(("zebra", at("OWN")), ("own", at("OWN")), ("coco", at("NUMBER")))
    assert registry.task_names() == (*SHIPPED, "own", "zebra")
    assert registry.require_task("own") == OWN
    assert registry.find_family("own") is OWN.family
    assert registry.require_task("coco") == next(task for task in TASKS if task.name == "coco")


def test_what_cannot_be_loaded_is_left_out_of_lists(installed):
    installed(("own", at("OWN")), ("broken", at("NONE")), ("number", at("NUMBER")))
    assert registry.known_tasks() == (*TASKS, OWN)
    assert registry.family_tasks(OWN.family) == (
        *(task for task in TASKS if task.family == OWN.family),
        OWN,
    )


def test_what_cannot_be_loaded_is_said_by_list_doctor_and_an_option(installed, capsys, monkeypatch):
    installed(("own", at("OWN")), ("broken", at("NONE")))
    (error,) = registry.broken_tasks()
    assert "the task broken of" in str(error)
    monkeypatch.setattr("legoworld.commands.list_command._cards", lambda *_: [("a",) * 4])
    assert cli.run(["list", "tasks"]) == 1
    assert "the task broken of" in capsys.readouterr().err
    (finding,) = doctor_command._tasks()
    assert (finding.good, finding.needed) == (False, False)
    assert cli.run(["readout", "--task", "broken", "-o", "x"]) == 4
    assert "the task broken of" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("place", "found"),
    [
        ("no_such_module:PAGE", "No module named"),
        (at("NOTHING"), "has no attribute"),
        (at("NUMBER"), "is a int"),
        (f"{__name__}_broken:X", "No module named"),
    ],
)
def test_a_part_of_a_family_that_cannot_be_used_is_named(place, found):
    family = replace(TASKS[0].family, name="mine", page=place)
    with pytest.raises(InstallationError, match="the page of the family mine") as refused:
        family.load("page", PageFamily)
    assert found in refused.value.found
    assert "PageFamily" in refused.value.expected
    with pytest.raises(KeyError):
        replace(family, track=None).load("track", PageFamily)


def test_the_named_tasks_exist():
    assert {DEFAULT, BENCH} <= set(SHIPPED)


def test_no_task_of_that_name(installed):
    installed(("own", at("OWN")))
    assert registry.find_task("owm") is None
    with pytest.raises(UsageError, match="unknown task 'owm'") as refused:
        registry.require_task("owm")
    assert refused.value.expected == " or ".join((*SHIPPED, "own"))
    assert "own" in refused.value.next_step


@pytest.mark.parametrize(
    ("named", "says"),
    [
        ([("own", at("OWN")), ("own", at("OWN"))], "more than one package adds the task own"),
        ([("own", at("NONE"))], "the task own of .* cannot be loaded"),
        ([("own", "no_such_module:TASK")], "the task own of no_such_module cannot be loaded"),
        ([("own", at("NUMBER"))], "the task own of .* cannot be used; found: .* is 'int'"),
        ([("other", at("OWN"))], "the task other of .* cannot be used; found: .* is 'own'"),
    ],
    ids=["two", "no value", "no module", "no task", "another name"],
)
def test_an_installation_that_cannot_serve_its_task_is_refused(named, says, installed):
    installed(*named)
    with pytest.raises(InstallationError, match=says):
        registry.find_task(named[0][0])
