"""`legoworld plugin serve`: one case on standard input and output, until the client leaves."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Final, TypedDict

from legoworld import extras
from legoworld.errors import UsageError
from legoworld.locks import held_alone
from legoworld.plugin.case import STATES, Case
from legoworld.plugin.connection import Address, BlenderConnection
from legoworld.plugin.evidence import read_evidence
from legoworld.plugin.live import LiveBlender
from legoworld.plugin.make_evidence import photo_alone
from legoworld.plugin.modules import modules_without
from legoworld.records.plugin_ledger import TransactionLimits
from legoworld.scene.blender_process import BlenderProcess, Limits

_LOCK: Final = ".lock"


def require_server() -> None:
    """InstallationError without the extra that the server needs."""
    extras.require_extra("plugin", "the plugin's server", ("mcp.server",))


class PluginServing(TypedDict):
    """The keyword arguments of `serve_plugin` that a command passes through."""

    photo: Path | None
    evidence: Path | None
    address: str
    ledger: Path
    without: Sequence[str]
    require_transaction: bool
    limits: TransactionLimits


def serve_plugin(
    *,
    photo: Path | None,
    evidence: Path | None,
    address: str,
    ledger: Path,
    without: Sequence[str] = (),
    require_transaction: bool = False,
    limits: TransactionLimits | None = None,
) -> None:
    """Serve until standard input ends. InstallationError without the extra.

    photo: EvidenceInvalidError where the evidence is of another one. It may stand alone: then there
    regions, depth and camera are missing. without: names of modules to leave out.
    """
    require_server()
    from legoworld.plugin.server import plugin_server, run_on_stdio

    modules = modules_without(without)
    known = None
    if "evidence" in modules and evidence is not None:
        known = read_evidence(evidence, photo)
    elif "evidence" in modules and photo is not None:
        known = photo_alone(photo)
    # Before anything is read: opening a ledger drops the line that a killed server left.
    with one_server(ledger), BlenderProcess(Limits()) as reader:
        live = LiveBlender(BlenderConnection(parsed_address(address)), reader, ledger / STATES)
        case = Case(
            ledger,
            live,
            known,
            limits or TransactionLimits(),
            require_transaction=require_transaction,
        )
        case.serve()
        run_on_stdio(plugin_server(case, known, modules))


@contextlib.contextmanager
def one_server(ledger: Path) -> Iterator[None]:
    """One server at a time over a ledger; the lock ends with the process, however that ends."""
    ledger.mkdir(parents=True, exist_ok=True)
    refused = UsageError(
        "another server writes this ledger",
        found=f"{ledger / _LOCK} is locked",
        expected="one server for each ledger",
        next_step="end it, or pass another --ledger",
    )
    with held_alone(ledger / _LOCK, refused):
        yield


def parsed_address(text: str) -> Address:
    """HOST:PORT, :PORT or PORT. UsageError for anything else."""
    host, _, port = text.rpartition(":")
    if not port.isdecimal() or not 0 < int(port) < 1 << 16:
        raise UsageError(
            "--blender is not an address",
            found=repr(text),
            expected="HOST:PORT, such as 127.0.0.1:9876",
        )
    return Address(host=host or "127.0.0.1", port=int(port))
