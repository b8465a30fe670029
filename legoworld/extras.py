"""What the optional extras of the installed package require, and the command that installs it."""

from __future__ import annotations

import re
import shlex
from collections.abc import Iterable
from importlib import import_module, metadata
from typing import Literal

from legoworld.errors import InstallationError

Extra = Literal[
    "draco", "exr", "ray", "url", "plugin", "usd", "hdf5", "serve", "record", "examples"
]


def requirements(extra: Extra) -> list[str]:
    """The requirements of an extra, in the package's own order.

    Raises importlib.metadata.PackageNotFoundError where legoworld runs without being installed.
    """
    lines = metadata.requires("legoworld") or []
    wanted = f'extra == "{extra}"'
    return [line.partition(";")[0].strip() for line in lines if wanted in line.replace("'", '"')]


def lacking(extra: Extra) -> list[str]:
    """The packages of an extra that are not installed, of whatever version."""
    names = [re.split(r"[^\w.-]", line)[0] for line in requirements(extra)]
    installed = {one.name.casefold() for one in metadata.distributions() if one.name}
    return [name for name in names if name.casefold() not in installed]


def install_command(extra: Extra) -> str:
    """The `pip` command that adds an extra to any installation, from a checkout or from a wheel.

    It names the packages: no project `legoworld` is published that pip could take an extra from.
    """
    return f"pip install {shlex.join(requirements(extra))}"


def require_extra(extra: Extra, what: str, modules: Iterable[str]) -> None:
    """InstallationError where one of an extra's modules cannot be imported. what: needs them."""
    try:
        for name in modules:
            import_module(name)
    except ImportError as error:
        raise InstallationError(
            f"{what} needs a package that is not installed",
            found=str(error),
            expected=f"the extra `{extra}`",
            next_step=install_command(extra),
        ) from error
