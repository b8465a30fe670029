"""Every command is a function of the same words, with the same options and defaults."""

from __future__ import annotations

import ast
import inspect
import re
import sys
from typing import Any, Final

import click
import pytest
from checkout import CHECKOUT
from commands.every_command import command_of, commands

import legoworld
from legoworld import cli
from legoworld.api.bench import bench_serve
from legoworld.bench.harbor import HarborOptions
from legoworld.plugin.serve import serve_plugin

#: Commands whose words are taken: a scene is opened once and viewed often, `report` is a room,
#: `score` scores what is in memory, and `import` is a word of Python.
OTHER_NAMES: Final = {
    "inspect": "open_scene", "report": "write_report", "score": "score_photo",
    "import": "import_usd",
}  # fmt: skip
#: Commands about this installation, and those that serve another program: no functions.
NO_FUNCTION: Final = {
    "demo", "doctor", "list", "agent list", "agent check", "agent install", "baseline install",
    "plugin install", "plugin serve", "plugin hook", "blender serve", "blender mcp",
}  # fmt: skip
COMMANDS: Final = list(commands(cli.main))
WITH_FUNCTION: Final = [words for words in COMMANDS if " ".join(words) not in NO_FUNCTION]

#: What only a command takes: how it prints, and words that it reads before the function is called.
OF_THE_COMMAND: Final = {"out", "as_json", "quiet", "verbose", "no_cache"}
OF_ONE_COMMAND: Final = {
    "baseline run": {"resume"},  # the default
    "bench export": {"harbor"},  # the only form there is
    "bench serve": {  # of `serve_bench_http`, which serves another program
        "http", "host", "port", "token_file", "queue", "body_limit", "unpacked_limit", "step",
        "per_object",
    },
    "compare": {"joining"},  # legoworld.comparison has joined comparisons
    # of a view
    "inspect": {
        "scene", "size_wh", "photo", "task", "track", "compare_sources", "output", "animation",
    },
    "trajectory pick": {"scores"},  # of what is printed
    "plugin evidence": {"verbose"},
}  # fmt: skip
#: Parameters of functions that are other words, or files, on the command line.
OTHER_WORDS: Final = {
    "evaluate": {"truths": "truth"},
    "track make": {"truths": "truth"},
}
#: Arguments that no command offers: they are about Python, or a command decides them.
OF_PYTHON: Final = {
    "folder", "listener", "started", "answer", "requests", "require_frozen", "program_or_scene",
    "shading",
}  # fmt: skip


#: The same, of answers in memory, and for type checkers.
OF_MEMORY: Final = {"evaluate": {"task"}, "compare": {"task", "truth"}}


NONE: Final = inspect.Parameter.empty


def name_of(words: tuple[str, ...]) -> str:
    return OTHER_NAMES.get(" ".join(words), "_".join(words))


def arguments(function: Any) -> dict[str, tuple[Any, str]]:
    """Default and type of the function's parameters, those of an unpacked TypedDict, too.

    A type is its source text; a Literal's alias is written out, as an alias of a module is.
    """
    found: dict[str, tuple[Any, str]] = {}
    names = inspect.unwrap(function).__globals__
    for name, one in inspect.signature(function).parameters.items():
        if one.kind is not inspect.Parameter.VAR_KEYWORD:
            found[name] = one.default, type_text(one.annotation, names)
            continue
        unpacked = re.match(r"Unpack\[(\w+)\]", str(one.annotation))
        kind = names[unpacked[1]] if unpacked else HarborOptions
        module = vars(sys.modules[kind.__module__])
        for key, annotation in kind.__annotations__.items():
            text = getattr(annotation, "__forward_arg__", annotation)
            found[key] = getattr(kind, key, NONE), type_text(text, module)
    return found


def type_text(annotation: str, names: dict[str, Any]) -> str:
    """The annotation, with an alias of a Literal in its place."""
    alias, *optional = annotation.split(" | ")
    written = str(names.get(alias, alias)).removeprefix("typing.")
    return " | ".join([written if written.startswith("Literal") else alias, *optional])


def test_every_command_is_a_function_or_one_of_those_that_need_none():
    assert {" ".join(words) for words in COMMANDS} >= NO_FUNCTION | set(OTHER_NAMES)
    assert {name_of(words) for words in WITH_FUNCTION} <= set(legoworld.__all__)
    assert all(callable(getattr(legoworld, name_of(words))) for words in WITH_FUNCTION)


@pytest.mark.parametrize("words", WITH_FUNCTION, ids=" ".join)
def test_every_option_is_an_argument_with_the_same_default(words):
    name = " ".join(words)
    function = getattr(legoworld, name_of(words))
    taken = arguments(function)
    own = OF_ONE_COMMAND.get(name, set()) | OF_THE_COMMAND
    other = OTHER_WORDS.get(name, {})
    offered = {str(p.name): p for p in command_of(words).params if p.name not in own | {"help"}}
    assert {other.get(n, n) for n in offered} <= set(taken) | {"cache"}
    missing = set(taken) - {other.get(n, n) for n in offered} - OF_PYTHON
    missing -= OF_MEMORY.get(name, set())
    assert missing == set()
    context = click.Context(command_of(words))
    for option, parameter in offered.items():
        default, _ = taken.get(other.get(option, option), (NONE, ""))
        if default is NONE or "UNSET" in str(parameter.default) or option == "cache":
            continue  # required, a TypedDict's, or of two options
        offered_default = parameter.type_cast_value(context, parameter.default)
        assert (offered_default or None) == (default or None) or str(offered_default) == default


#: What an option of a simple type is on the command line.
KINDS: Final = {
    "bool": click.types.BoolParamType, "int": click.types.IntParamType,
    "float": click.types.FloatParamType, "Literal": click.Choice,
}  # fmt: skip


@pytest.mark.parametrize("words", WITH_FUNCTION, ids=" ".join)
def test_every_option_has_the_type_of_its_argument(words):
    taken = arguments(getattr(legoworld, name_of(words)))
    for parameter in command_of(words).params:
        _, text = taken.get(str(parameter.name), (NONE, ""))
        kind = re.match(r"bool|int|float|Literal", text.removeprefix("Sequence["))
        if kind is None or text.startswith("bool | str"):
            continue
        assert isinstance(parameter.type, KINDS[kind[0]]), parameter.name
        assert parameter.multiple == text.startswith("Sequence["), parameter.name
        if isinstance(parameter.type, click.Choice):
            listed = ast.literal_eval(text[len("Literal") :].removesuffix(" | None"))
            assert list(parameter.type.choices) == listed, parameter.name


def test_the_page_names_every_function_and_every_command_without_one():
    page = (CHECKOUT / "docs" / "python.md").read_text(encoding="utf-8")
    for words in WITH_FUNCTION:
        assert f"`{name_of(words)}" in page
    for name in NO_FUNCTION:
        assert f"`{name}`" in page


def test_the_plugin_s_server_takes_what_its_command_offers():
    """It serves until its input ends, and is no function of the API."""
    taken = inspect.signature(serve_plugin).parameters
    offered = {p.name for p in command_of(("plugin", "serve")).params}
    assert offered - {"rounds", "rollbacks", "help"} == set(taken) - {"limits"}


def test_the_scoring_service_takes_what_its_command_offers():
    taken = set(inspect.signature(bench_serve).parameters) - {"requests", "answer"}
    offered = {str(p.name) for p in command_of(("bench", "serve")).params}
    of_http = OF_ONE_COMMAND["bench serve"]
    assert offered == of_http | taken | {"no_cache"}
