"""How options are declared, and the options that several commands take: each exists once.

A parameter has the name of the argument it becomes, so that a command can pass its options through.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping, Sequence
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, Protocol, TypeVar, cast

import click

from legoworld.commands.output import Output
from legoworld.commands.param_types import (
    AMOUNT,
    COUNT,
    EXISTING,
    EXISTING_FILE,
    EXISTING_FOLDER,
    FOLDER,
    FROM_ZERO,
    Choice,
    ParamType,
    SizeType,
)

if TYPE_CHECKING:
    from legoworld.workers.protections import Confinement, Protections

F = TypeVar("F", bound=Callable[..., Any])
_FLAG: Final = {"is_flag": True}
ANNOTATIONS: Final = (
    "COCO, LVIS or panoptic annotations (JSON), or a folder of measured depth, normals or classes."
)

#: The names of an option, the last one its parameter's; its help; and what else click is told. A
#: command's own help and settings go before these. "": every command has its own help.
SHARED: Final[Sequence[tuple[str, str, Mapping[str, Any]]]] = [
    # What is printed and written
    ("--json as_json", "Print one JSON document instead of tables.", _FLAG),
    ("-q --quiet", "Print no progress and no notices.", _FLAG),
    ("-v --verbose", "Print full details.", _FLAG),
    ("-o --output", "", {"type": FOLDER, "required": True}),
    ("--overwrite", "Delete the results of an earlier run first.", _FLAG),
    # Places
    ("--photos", "Folder of the photos.", {"type": EXISTING_FOLDER, "required": True}),
    ("--photo", "", {"type": EXISTING_FILE}),
    ("--track", "Track file (images).", {"type": EXISTING_FILE}),
    ("--truth", f"Ground truth: {ANNOTATIONS}", {"type": EXISTING, "required": True}),
    ("--input inputs", "", {"type": EXISTING, "multiple": True}),
    ("--workspace", "", {"type": FOLDER}),
    ("--scores", "What `trajectory score` wrote.", {"type": EXISTING_FOLDER}),
    # Selection
    ("--limit", "Only the first N images (partial run).", {"type": COUNT}),
    ("--image-id image_ids", "Only this image; repeatable.", {"type": click.INT, "multiple": True}),
    ("--size size_wh", "", {"type": SizeType()}),
    ("--draws", "", {"type": COUNT}),
    ("--seed", "RNG seed for tie orders and bootstrap.", {"type": FROM_ZERO, "default": 0}),
    # Running
    ("--workers", "Blender processes [default: cores].", {"type": COUNT}),
    (
        "--engine",
        "Run on this machine or on a Ray cluster (RAY_ADDRESS).",
        {"type": Choice(["local", "ray"]), "default": "local", "envvar": "LEGOWORLD_ENGINE"},
    ),
    (
        "--source",
        "File of a scene to read.",
        {"type": Choice(["blend", "glb"]), "default": "blend"},
    ),
    ("--require-frozen", "Refuse scenes without a frozen.json.", _FLAG),
    (
        "--images-per-file",
        "Boxes and masks: write predictions/00000.jsonl, ... of N images each [default: one file].",
        {"type": COUNT, "metavar": "N"},
    ),
    ("--no-render render", "", {**_FLAG, "flag_value": False, "default": True}),
    ("--no-cache", "Neither read nor write the snapshot cache; overrides --cache.", _FLAG),
    (
        "--cache",
        "Snapshot cache folder [default: the user's cache folder].",
        {"type": FOLDER, "envvar": "LEGOWORLD_CACHE"},
    ),
    (
        "--memory-limit memory_limit_gib",
        "Memory limit of one Blender process, in GiB.",
        {"type": AMOUNT, "default": 8.0},
    ),
    ("--time-limit time_limit_s", "Time limit of Blender per scene, in seconds.", {"type": AMOUNT}),
    (
        "--sandbox",
        "auto: bubblewrap where it works, otherwise resource limits only; bubblewrap: fail if "
        "unavailable; limits: never use it.",
        {"type": Choice(["auto", "bubblewrap", "limits"]), "default": "auto"},
    ),
    # Depth arrays, models, the plugin
    ("--space", "", {"type": Choice(["depth", "disparity", "ray_distance"])}),
    (
        "--sign",
        "Normals: which way they point, where the files do not say; a frontal wall is (0, 0, -1) "
        "towards the camera.",
        {"type": Choice(["towards_camera", "away_from_camera"])},
    ),
    ("--label-map", 'JSON {"their label": "category name" or null}.', {"type": EXISTING_FILE}),
    ("--ledger", "", {"type": FOLDER, "default": Path("legoworld-ledger")}),
    ("--without", "Leave a module of the plugin out, for ablations; repeatable.",
     {"multiple": True}),
    ("--regions", "", {"multiple": True}),
    ("--evidence", "Folder of `legoworld plugin evidence`.", {"type": EXISTING_FOLDER}),
    ("--blender address", "Address of Blender MCP's socket: HOST:PORT.",
     {"default": "127.0.0.1:9876"}),
    (
        "--require-transaction",
        "Refuse tools that change the scene while no transaction is open.",
        _FLAG,
    ),
]  # fmt: skip


class _Group(click.Group):
    """A group whose help has the whole first sentence of each command."""

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """List the commands; click alone would cut their sentences at the width."""
        known = [(name, self.commands[name]) for name in self.list_commands(ctx)]
        with formatter.section("Commands"):
            formatter.write_dl([(name, one.get_short_help_str(1000)) for name, one in known])


def group(name: str) -> Callable[[Callable[[], None]], click.Group]:
    """click's group, with that help."""
    return click.group(name, cls=_Group)


class Decorator(Protocol):
    """Adds options to a command's function."""

    def __call__(self, command: F, /) -> F:
        """The function that click calls."""
        ...


def long_name(names: str) -> str:
    """The name with two dashes."""
    return next(name for name in names.split() if name.startswith("--"))


_KNOWN: Final = {long_name(names): (names, text, settings) for names, text, settings in SHARED}


def option(names: str, text: str = "", kind: ParamType | None = None, **more: Any) -> Decorator:
    """click's option: its names, its help, its type; a default is shown.

    names: such as "-o --output"; one without dashes is the parameter's, where it is another. One of
    several commands is named by its long name alone, and has the type and the help it has there.
    """
    known, help_text, settings = _KNOWN.get(long_name(names), (names, "", {}))
    declared = known if names == long_name(names) else names
    own: dict[str, Any] = {**settings, **more, "help": text or help_text}
    if kind is not None:
        own["type"] = kind
    if "default" in own and "is_flag" not in own:
        own.setdefault("show_default", True)
    return click.option(*declared.split(), **own)


def flag(names: str, text: str) -> Decorator:
    """An option without a value: True where it is given."""
    return option(names, text, is_flag=True)


def off(names: str, text: str) -> Decorator:
    """An option without a value: its parameter is True, and False where it is given."""
    return option(names, text, is_flag=True, flag_value=False, default=True)


def combine_options(*declared: Decorator) -> Decorator:
    """Several options, in the order of the help."""

    def decorate(command: F) -> F:
        for one in reversed(declared):
            command = one(command)
        return command

    return decorate


def together(name: str, make: Callable[..., object] | str, *declared: Decorator) -> Decorator:
    """Options whose values become one argument: name=make(**values).

    make: a function, or "module:NAME" of one that is imported when the command runs.
    """

    def decorate(command: F) -> F:
        @functools.wraps(command)
        def call(*args: Any, **given: Any) -> Any:
            own = {parameter: given.pop(parameter) for parameter in parameters}
            return command(*args, **given, **{name: _function(make)(**own)})

        known = len(getattr(command, "__click_params__", ()))
        whole = combine_options(*declared)(cast("F", call))
        parameters = [p.name for p in cast("Any", whole).__click_params__[known:]]
        return whole

    return decorate


def _function(make: Callable[..., object] | str) -> Callable[..., object]:
    if not isinstance(make, str):
        return make
    module, _, name = make.partition(":")
    found: Callable[..., object] = getattr(import_module(module), name)
    return found


def refuse_given(names: Sequence[str], why: str) -> None:
    """Raise click.UsageError when one of these options was given, so that none is ignored."""
    context = click.get_current_context()
    for parameter in context.command.params:
        source = context.get_parameter_source(parameter.name or "")
        if parameter.name in names and source is click.core.ParameterSource.COMMANDLINE:
            raise click.UsageError(f"{parameter.opts[0]} {why}")


def _cache(cache: Path | None, no_cache: bool) -> bool | Path:
    """--cache and --no-cache as the Python API's `cache` argument; --no-cache wins.

    A cache that nobody chose and that cannot be written is left out, and a notice says so.
    """
    if no_cache or cache:
        return False if no_cache else cache or True
    from legoworld.scene.cache import default_cache_folder, why_unwritable

    folder = default_cache_folder()
    why = why_unwritable(folder)
    if why:
        click.echo(
            f"the snapshot cache {folder} cannot be written ({why}): continuing without one; "
            "--cache DIR or LEGOWORLD_CACHE chooses another place, --no-cache none",
            err=True,
        )
    return not why


def _protections(sandbox: Confinement, *, network: bool = False) -> Protections:
    from legoworld.workers.protections import protections

    return protections(sandbox, network=network)


#: Limits of each Blender process, and the snapshot cache, as the Python API's arguments.
limits: Final = combine_options(
    option("--memory-limit", envvar="LEGOWORLD_MEMORY_LIMIT"),
    option("--time-limit", default=120.0, envvar="LEGOWORLD_TIME_LIMIT"),
)
cache: Final = together("cache", _cache, option("--no-cache"), option("--cache"))
#: -v, -q and --json as `out: Output`; or --json alone.
printing: Final = together("out", Output, option("--verbose"), option("--quiet"), option("--json"))
printing_json: Final = together("out", Output, option("--json"))


def quiet(text: str) -> Decorator:
    """-q alone as `out: Output`."""
    return together("out", Output, option("--quiet", text))


def protections(*network: Decorator) -> Decorator:
    """--sandbox as `protections`. network: an option that gives the network, before it."""
    return together("protections", _protections, *network, option("--sandbox"))


def memory_bytes(of: str) -> Decorator:
    """--memory-limit of a Blender that runs others' code, in bytes."""
    limit = option("--memory-limit gib", f"Memory limit of {of}, in GiB.")
    return together("memory_bytes", lambda gib: int(gib * 2**30), limit)
