"""Modules of the plugin that are on or off: what a client is offered, without a Blender."""

from __future__ import annotations

import anyio
import pytest
from mcp import Client

from legoworld.errors import UsageError
from legoworld.plugin.case import Case
from legoworld.plugin.connection import Address, BlenderConnection
from legoworld.plugin.live import LiveBlender
from legoworld.plugin.modules import MODULES, TOOLS, modules_without
from legoworld.plugin.server import plugin_server
from legoworld.records.plugin_ledger import TransactionLimits
from legoworld.scene.blender_process import BlenderProcess, Limits

#: Tools of no module: where the case stands, and the rest of a long answer.
ALWAYS = {"status", "more"}


def list_tools(folder, modules, *call):
    """The tools' names, and what a call comes back with."""
    (folder / "states").mkdir(exist_ok=True)

    async def talk(server):
        async with Client(server) as client:
            names = {tool.name for tool in (await client.list_tools()).tools}
            said = await client.call_tool(*call) if call else None
        return names, said

    with BlenderProcess(Limits()) as reader:  # never asked, so never started
        live = LiveBlender(BlenderConnection(Address(port=9), time_s=5), reader, folder / "states")
        server = plugin_server(Case(folder, live, None, TransactionLimits()), None, modules)
        return anyio.run(talk, server)


def test_every_tool_is_of_one_module(tmp_path):
    names, _ = list_tools(tmp_path, MODULES)
    assert names - ALWAYS <= set(TOOLS)


@pytest.mark.parametrize("off", MODULES)
def test_a_module_that_is_off_takes_its_tools_and_no_others(tmp_path, off):
    everything, _ = list_tools(tmp_path, MODULES)
    names, _ = list_tools(tmp_path, modules_without([off]))
    assert everything - names == {name for name in everything if TOOLS.get(name) == off}
    assert everything - names


def test_nothing_is_required_where_nothing_is_measured(tmp_path):
    declared = {
        "editable": ["Cup"],
        "kinds": ["transform"],
        "requirements": [{"kind": "existence", "entity": "Cup"}],
    }
    _, said = list_tools(tmp_path, modules_without(["measurement"]), "begin", declared)
    assert said is not None
    assert said.is_error
    assert "`measurement` is off" in str(said.content[0])


@pytest.mark.parametrize("off", [["beauty"], list(MODULES)])
def test_what_cannot_be_left_out_is_refused(off):
    with pytest.raises(UsageError, match="module"):
        modules_without(off)
