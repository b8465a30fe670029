"""What each module of the plugin offers, and which of them are on."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final, get_args

from legoworld.errors import UsageError
from legoworld.records.plugin_install import Module

MODULES: Final[tuple[Module, ...]] = get_args(Module)
#: A tool belongs to one module; those of none are always there. The ledger is always written: the
#: limits of transactions are read off it.
TOOLS: Final[dict[str, Module]] = {
    "reference_evidence": "evidence",
    "initialize": "initialisation",
    "plan": "initialisation",
    "measure": "measurement",
    "validate": "measurement",
    "begin": "transactions",
    "diff": "transactions",
    "commit": "transactions",
    "rollback": "transactions",
    "history": "records",
    "review": "records",
    "export": "records",
    "look": "looking",
}


def modules_without(off: Iterable[str]) -> tuple[Module, ...]:
    """The modules that are on. UsageError for a name that is none, and where all are off."""
    left = set(off)
    if unknown := sorted(left - set(MODULES)):
        raise UsageError(
            "unknown plugin module",
            found=", ".join(unknown),
            expected=", ".join(MODULES),
        )
    on: tuple[Module, ...] = tuple(module for module in MODULES if module not in left)
    if not on:
        raise UsageError(
            "every module of the plugin is off",
            found=", ".join(MODULES),
            expected="at least one module on",
            next_step="leave the plugin out",
        )
    return on


def tools_off(on: Iterable[Module]) -> list[str]:
    """The tools whose module is off."""
    kept = set(on)
    return [name for name, module in TOOLS.items() if module not in kept]
