"""An MCP client that plays recorded steps: what the agent `program` runs.

Started as a program with the Python of mcp-for-blender's environment, whose MCP package it uses; it
imports nothing of legoworld. The transcript is ATIF, written anew after every step, so that what is
there when its time is over is whole.
"""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import importlib
import json
import os
import sys
from collections.abc import AsyncIterator, Mapping, Sequence
from datetime import datetime, timezone
from pathlib import Path
from typing import Any, TypedDict


def main() -> int:
    """Play --steps through the servers that --mcp-config names; exit code 1 where a step failed."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--mcp-config", type=Path, required=True)
    parser.add_argument("--steps", type=Path, required=True)
    parser.add_argument("--transcript", type=Path, required=True)
    parser.add_argument("--prompt", type=Path, required=True)
    given = parser.parse_args()
    lines = given.steps.read_text(encoding="utf-8").splitlines()
    servers = json.loads(given.mcp_config.read_text(encoding="utf-8"))["mcpServers"]
    transcript = Transcript(given.transcript, given.prompt.read_text(encoding="utf-8"))
    return asyncio.run(_play(servers, [json.loads(line) for line in lines if line], transcript))


class _Command(TypedDict):
    command: str


class Server(_Command, total=False):
    """How an MCP server is started."""

    args: list[str]
    env: dict[str, str]


class _Call(TypedDict):
    tool: str
    arguments: dict[str, Any]


class Step(_Call, total=False):
    """One call of the program."""

    server: str
    message: str
    must_succeed: bool


class Transcript:
    """The steps so far as an ATIF document, on disk after each."""

    def __init__(self, path: Path, prompt: str) -> None:
        self._path = path
        self._agent: dict[str, Any] = {"name": "program", "version": "1.0.0"}
        self._steps: list[dict[str, Any]] = []
        self._add({"source": "user", "message": prompt})

    def add_start(self, tools: list[str]) -> None:
        """Record the tools that the servers offer."""
        self._agent["tool_definitions"] = [
            {"type": "function", "function": {"name": name}} for name in tools
        ]
        self._write()

    def add_call(self, call: Step, said: str, *, failed: bool, images: int) -> None:
        """Record one call and its reply."""
        number = f"call_{len(self._steps)}"
        arguments = {"tool_call_id": number, "function_name": call["tool"]}
        result = {"source_call_id": number, "content": said}
        self._add(
            {
                "source": "agent",
                "message": call.get("message", ""),
                "llm_call_count": 0,
                "tool_calls": [{**arguments, "arguments": call["arguments"]}],
                "observation": {
                    "results": [{**result, "extra": {"is_error": failed, "images": images}}]
                },
            }
        )

    def _add(self, step: dict[str, Any]) -> None:
        now = datetime.now(timezone.utc).isoformat()  # noqa: UP017  as old Pythons have it
        self._steps.append({"step_id": len(self._steps) + 1, "timestamp": now, **step})
        self._write()

    def _write(self) -> None:
        document = {
            "schema_version": "ATIF-v1.6",
            "session_id": "program",
            "agent": self._agent,
            "steps": self._steps,
            "final_metrics": {"total_steps": len(self._steps)},
        }
        unfinished = self._path.with_name(f".{self._path.name}")
        unfinished.write_text(json.dumps(document), encoding="utf-8")
        unfinished.replace(self._path)


async def _play(
    servers: Mapping[str, Server], steps: Sequence[Step], transcript: Transcript
) -> int:
    async with contextlib.AsyncExitStack() as stack:
        sessions, tools = {}, []
        for name, server in sorted(servers.items()):
            sessions[name] = await stack.enter_async_context(_session(server))
            tools += [tool.name for tool in (await sessions[name].list_tools()).tools]
        transcript.add_start(tools)
        for step in steps:
            session = sessions[step.get("server", "blender")]
            answer = await session.call_tool(step["tool"], step["arguments"])
            texts = [part.text for part in answer.content if part.type == "text"]
            images = sum(part.type == "image" for part in answer.content)
            said = "\n".join(texts)
            # The server's own report of code that raised; not a protocol error.
            failed = bool(answer.isError) or said.startswith("Error executing code")
            transcript.add_call(step, said, failed=failed, images=images)
            if failed and step.get("must_succeed"):
                return 1
    return 0


@contextlib.asynccontextmanager
async def _session(server: Server) -> AsyncIterator[Any]:
    """A client's session with a server that is started for it."""
    mcp = importlib.import_module("mcp")
    stdio = importlib.import_module("mcp.client.stdio")
    how = mcp.StdioServerParameters(
        command=server["command"], args=server.get("args", []), env=server.get("env")
    )
    with Path(os.devnull).open("w") as unheard:
        async with (
            stdio.stdio_client(how, errlog=unheard) as (read, write),
            mcp.ClientSession(read, write) as session,
        ):
            await session.initialize()
            yield session


if __name__ == "__main__":
    sys.exit(main())
