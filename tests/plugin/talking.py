"""Calls of a server's tools as a client makes them."""

from __future__ import annotations

import anyio


def called(server, *calls):
    """What a client reads for each call: (is it an error, text or JSON)."""
    from mcp import Client

    async def talk():
        answers = []
        async with Client(server) as client:
            for name, arguments in calls:
                result = await client.call_tool(name, arguments)
                answers.append((bool(result.is_error), result.content[0].text))
        return answers

    return anyio.run(talk)


def tools_of(server):
    """The names of the tools that a server offers."""
    from mcp import Client

    async def ask():
        async with Client(server) as client:
            return {tool.name for tool in (await client.list_tools()).tools}

    return anyio.run(ask)
