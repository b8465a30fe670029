"""Baseline cards (card.toml): description, options and code hash of each baseline."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final, get_args

from legoworld.cards import read_toml
from legoworld.errors import CatalogError, UsageError
from legoworld.files import canonical_json, sha256_of_file, sha256_of_text
from legoworld.pluralize import nearest_names
from legoworld.records.base import UnsetType
from legoworld.records.cards import BaselineCardFile, BaselineOption, Dtype, OptionValue
from legoworld.shipped import catalog
from legoworld.tasks.registry import find_task, task_names

CARD: Final = "card.toml"
PROJECT: Final = "pyproject.toml"
PROGRAM: Final = "run.py"
SHARED: Final = "shared"
DTYPES: Final[tuple[Dtype, ...]] = get_args(Dtype)
_TYPES: Final[Mapping[str, type]] = {"str": str, "int": int, "float": float, "bool": bool}
_EXPECTED: Final = (
    "name, title, version, licence, tasks such as coco, and [options.KEY] with a help each"
)
_TRUE_AND_FALSE: Final = {"true": True, "false": False}


@dataclass(frozen=True, kw_only=True)
class Option:
    """One [options.KEY] of a card. default None: the baseline's choice; choices (): any value."""

    key: str
    type: str
    default: OptionValue | None
    choices: tuple[OptionValue, ...]
    help: str


@dataclass(frozen=True, kw_only=True)
class BaselineCard:
    """One baseline. about: its card; folder: with its run.py."""

    about: BaselineCardFile
    options: tuple[Option, ...]
    folder: Path
    sha256: str

    @property
    def name(self) -> str:
        """The name, equal to the folder's."""
        return self.about.name

    @property
    def shelf(self) -> str:
        """The folder of environments its own is in."""
        return "baselines"

    @property
    def program(self) -> Path:
        """The program to start."""
        return self.folder / PROGRAM

    @property
    def shared_path(self) -> Path:
        """The folder the program imports legoworld_baseline from."""
        return catalog.folder("baselines") / SHARED

    def code_sha256(self) -> str:
        """Hash of all code and cards that a run depends on: the baseline's and the shared ones."""
        named = [
            (kind, path.relative_to(top).as_posix(), sha256_of_file(path))
            for kind, top in (("own", self.folder), ("shared", self.shared_path))
            for path in (*top.rglob("*.py"), *top.rglob("*.toml"))
            if not any(part.startswith(".") for part in path.relative_to(top).parts)
        ]
        return sha256_of_text(canonical_json(sorted(named)))


def baseline_cards() -> list[BaselineCard]:
    """All baselines by name. CatalogError for an unusable card."""
    return [read_card(p) for p in sorted(catalog.folder("baselines").glob(f"*/{CARD}"))]


def load_baseline(name: str) -> BaselineCard:
    """A baseline by name, or by the path of its folder, which must contain a "/".

    UsageError lists the nearest names for an unknown one.
    """
    folder = Path(name) if "/" in name else catalog.folder("baselines") / name
    if (folder / CARD).is_file():
        return read_card(folder.resolve() / CARD)
    names = sorted(p.parent.name for p in catalog.folder("baselines").glob(f"*/{CARD}"))
    near = nearest_names(name, names)
    raise UsageError(
        "unknown baseline",
        found=repr(name),
        expected=" or ".join([*(near or names), f"a folder's path, with a /, that has a {CARD}"]),
        next_step="`legoworld list baselines` lists all of them",
    )


def read_card(path: Path) -> BaselineCard:
    """Read a card.toml. Raises CatalogError for an invalid one."""
    about = read_toml(BaselineCardFile, path, what=_card_name(path), expected=_EXPECTED)
    if about.name != path.parent.name:
        raise _error(path, f"name = {about.name!r}", f"its folder's name, {path.parent.name!r}")
    for i, name in enumerate(about.tasks):
        if find_task(name) is None:
            known = f"tasks: {', '.join(task_names())}"
            raise _error(path, f"{name!r} at $.tasks[{i}]", known)
    if not (path.parent / PROGRAM).is_file():
        raise _error(path, f"no {PROGRAM} beside it", f"{PROGRAM}, the program that is started")
    return BaselineCard(
        about=about,
        options=tuple(_option(key, entry, path) for key, entry in sorted(about.options.items())),
        folder=path.parent,
        sha256=sha256_of_file(path),
    )


def chosen_options(card: BaselineCard, given: Sequence[str]) -> dict[str, OptionValue | None]:
    """The card's options, overridden by KEY=VALUE texts. UsageError for an unknown option."""
    known = {option.key: option for option in card.options}
    values = {option.key: option.default for option in card.options}
    for text in given:
        key, equals, value = text.partition("=")
        if not equals or key not in known:
            near = nearest_names(key, known, cutoff=0.5)
            raise UsageError(
                f"the baseline {card.name} has no such option",
                found=f"--option {text}",
                expected=" | ".join(f"{k}=..." for k in (near or known)) or "none: it has none",
            )
        values[key] = _parse_option(known[key], value)
    return values


def _parse_option(option: Option, text: str) -> OptionValue:
    expected = f"{option.key}=<{option.type}>"
    try:
        value: OptionValue = (
            _TRUE_AND_FALSE[text] if option.type == "bool" else _TYPES[option.type](text)
        )
        canonical_json(value)
    except (KeyError, ValueError) as error:
        if option.type == "bool":
            expected = f"{option.key}=true or {option.key}=false"
        raise UsageError(
            "an option's value cannot be used",
            found=f"--option {option.key}={text}",
            expected=expected,
        ) from error
    if option.choices and value not in option.choices:
        raise UsageError(
            "an option's value cannot be used",
            found=f"--option {option.key}={text}",
            expected=" or ".join(f"{option.key}={choice}" for choice in option.choices),
        )
    return value


def _option(key: str, entry: BaselineOption, path: Path) -> Option:
    default = None if isinstance(entry.default, UnsetType) else entry.default
    kind = entry.type or type(default).__name__
    values = (*entry.choices, *(() if default is None else (default,)))
    if any(type(value) is not _TYPES.get(kind) for value in values) or kind not in _TYPES:
        raise _error(
            path,
            f"options.{key}: type {kind!r}, default {default!r}, choices {list(entry.choices)!r}",
            f"a type of {', '.join(_TYPES)}, and values of it",
        )
    return Option(key=key, type=kind, default=default, choices=entry.choices, help=entry.help)


def _error(path: Path, found: str, expected: str) -> CatalogError:
    return CatalogError(f"{_card_name(path)} cannot be used", found=found, expected=expected)


def _card_name(path: Path) -> str:
    return f"baselines/{path.parent.name}/{CARD}"
