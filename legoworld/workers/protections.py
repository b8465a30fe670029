"""The protections of a sandbox: which are in force on this machine, and which are not."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from typing import Final, Literal

from legoworld import exit_codes
from legoworld.errors import LegoWorldError
from legoworld.records.scene_folder import Protected
from legoworld.workers.bubblewrap import Bubblewrap, find_bubblewrap, how_to_have
from legoworld.workers.task_group import group_place

Confinement = Literal["auto", "bubblewrap", "limits"]


class SandboxUnavailableError(LegoWorldError):
    """Bubblewrap was requested but cannot be used on this machine."""

    code = "sandbox_unavailable"
    exit_code = exit_codes.BLOCKED


@dataclass(frozen=True, kw_only=True)
class Protections:
    """The protections of a sandbox.

    why_not: why bubblewrap is not used; network: whether the program was given the network;
    task_group: whether the kernel counts its processes (see task_group).
    """

    bubblewrap: str | None
    why_not: str | None
    network: bool = False
    task_group: bool = False

    @property
    def holds(self) -> list[str]:
        """Names of the protections that are in force."""
        linux = sys.platform == "linux"
        return [
            *(p for p in _WITH_BUBBLEWRAP if self.bubblewrap and not (self.network and p == _NET)),
            *_EVERYWHERE,
            *(_ON_LINUX if linux else ()),
            *([_COUNTED] if self.task_group else ()),
        ]

    @property
    def does_not_hold(self) -> list[str]:
        """Names of the protections that are not in force."""
        held = self.holds
        return [p for p in (*_WITH_BUBBLEWRAP, *_EVERYWHERE, *_ON_LINUX) if p not in held]

    def record(self) -> Protected:
        """The record in execution.json."""
        return Protected(
            bubblewrap=self.bubblewrap,
            why_not=self.why_not,
            holds=self.holds,
            does_not_hold=self.does_not_hold,
        )


_NET: Final = "network"
#: Without it a program reads the variables of every process of its user in /proc, and kills them,
#: its keeper among them.
_WITH_BUBBLEWRAP: Final = (_NET, "files", "other processes", "environment", "child processes ended")
_EVERYWHERE: Final = ("time", "output", "file size", "workspace size")
_ON_LINUX: Final = ("memory with child processes",)
#: Elsewhere processes are counted from outside, 20 times a second.
_COUNTED: Final = "process count in the kernel"


def protections(confinement: Confinement, *, network: bool = False) -> Protections:
    """The protections of a sandbox here. SandboxUnavailableError if bubblewrap is required.

    network: the program is to have the network.
    """
    grouped = group_place() is not None
    if confinement == "limits":
        why_not = "not asked for"
        return Protections(bubblewrap=None, why_not=why_not, network=network, task_group=grouped)
    usable = find_bubblewrap()
    if isinstance(usable, Bubblewrap):
        version = usable.version
        return Protections(bubblewrap=version, why_not=None, network=network, task_group=grouped)
    if confinement == "bubblewrap":
        raise SandboxUnavailableError(
            "bubblewrap cannot be used",
            found=usable,
            expected="bubblewrap, allowed to create user namespaces",
            next_step=how_to_have(usable),
        )
    return Protections(bubblewrap=None, why_not=usable, network=network, task_group=grouped)
