"""A model that follows a script, behind the APIs that agents speak: no network, no account.

It speaks Anthropic Messages, OpenAI Responses and Chat Completions, and Gemini, on this machine
alone, and keeps every request with the tokens that it said it used. The tools of a request are the
program's own; a script names a tool by the end of its name.
"""

from __future__ import annotations

import base64
import hashlib
import json
import re
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

from agent_programs.dialects import DIALECTS, EXEC, SEARCH, WAITING, Dialect, Reply


@dataclass(frozen=True, kw_only=True)
class Turn:
    """What the model says, and the tool that it calls, by the end of the tool's name."""

    says: str
    tool: str | None = None
    server: str = "blender"
    arguments: dict[str, Any] = field(default_factory=dict)

    def within(self, request: str) -> Turn:
        """The turn with the workspace that a prompt names for {workspace}."""
        named = re.search(r"(/[^ ]+)/scene[.]blend", request)
        folder = named[1] if named else ""
        filled = {
            key: value.replace("{workspace}", folder) if isinstance(value, str) else value
            for key, value in self.arguments.items()
        }
        return replace(self, arguments=filled)


@dataclass(frozen=True, kw_only=True)
class Asked:
    """One request. turn: of the script; None for what has no tools: titles, routing, summaries."""

    path: str
    turn: int | None
    tools: tuple[str, ...]
    pictures: frozenset[str]  # sha256 of each picture's bytes
    text: str
    prompt_tokens: int
    cached_tokens: int
    completion_tokens: int


class ModelServer:
    """The server. failing: how many of the next requests are answered with status 529."""

    def __init__(self, script: Sequence[Turn]) -> None:
        self.script = tuple(script)
        self.asked: list[Asked] = []
        self.unknown: list[str] = []
        self.failing = 0
        self._lock = threading.Lock()
        self._server = ThreadingHTTPServer(("127.0.0.1", 0), _handler(self))
        self._server.daemon_threads = True

    @property
    def url(self) -> str:
        """Where it listens."""
        return f"http://127.0.0.1:{self._server.server_address[1]}"

    @property
    def tokens(self) -> tuple[int, int, int]:
        """Prompt, cached and completion tokens of all requests."""
        totals = [(a.prompt_tokens, a.cached_tokens, a.completion_tokens) for a in self.asked]
        return tuple(map(sum, zip(*totals, strict=True))) if totals else (0, 0, 0)

    @contextmanager
    def serving(self) -> Iterator[ModelServer]:
        """Serve until the end of the block."""
        thread = threading.Thread(target=self._server.serve_forever, args=(0.05,), daemon=True)
        thread.start()
        try:
            yield self
        finally:
            self._server.shutdown()
            self._server.server_close()
            thread.join()

    def reply(self, path: str, body: dict[str, Any], dialect: Dialect) -> Reply | None:
        """The answer to a request, which is kept; None while the server is failing."""
        text = json.dumps(body)
        with self._lock:
            if self.failing > 0:
                self.failing -= 1
                return None
            number = len(self.asked)
            tools = tuple(dialect.tools(body))
            turn = dialect.results(body) if tools else None
            says, name, arguments = self._next(turn, tools, text)
            usage = (1000 + 10 * number, 200, 50 + number)
            self.asked.append(
                Asked(
                    path=path, turn=turn, tools=tools, pictures=frozenset(_pictures(text)),
                    text=text, prompt_tokens=usage[0], cached_tokens=usage[1],
                    completion_tokens=usage[2],
                )
            )  # fmt: skip
        return Reply(number=number, says=says, tool=name, arguments=arguments, usage=usage)

    def _next(
        self, turn: int | None, tools: Sequence[str], text: str
    ) -> tuple[str, str | None, dict[str, Any]]:
        if turn is None or turn >= len(self.script):
            return "A scene", None, {}
        step = self.script[turn].within(text)
        if step.tool is None:
            return step.says, None, {}
        found = [name for name in tools if re.search(rf"(^|[_.]){step.tool}$", name)]
        if not found and SEARCH in tools:
            return "I find the tool.", SEARCH, {"query": f"+{step.tool}", "max_results": 5}
        if not found and EXEC in tools:
            if f"mcp__{step.server}" not in text:  # not started yet: Codex does not wait for it
                time.sleep(1)
                return "I wait.", EXEC, {"input": WAITING}
            call = f"tools.mcp__{step.server}__{step.tool}({json.dumps(step.arguments)})"
            wait = '// @exec: {"yield_time_ms": 120000}'
            return step.says, EXEC, {"input": f"{wait}\ntext(await {call});"}
        return step.says, found[0] if found else step.tool, step.arguments


def _pictures(text: str) -> Iterator[str]:
    """sha256 of every picture in a request: whatever key holds it, it is base64 of a known kind."""
    for data in re.findall(r"(?:iVBORw0KGgo|/9j/)[A-Za-z0-9+/]{100,}={0,2}", text):
        yield hashlib.sha256(base64.b64decode(data)).hexdigest()


def _handler(server: ModelServer) -> type[BaseHTTPRequestHandler]:
    class Handler(BaseHTTPRequestHandler):
        protocol_version = "HTTP/1.1"

        def log_message(self, *_: object) -> None:
            pass

        def do_HEAD(self) -> None:
            self._send(200, b"", "text/plain")

        def do_GET(self) -> None:
            server.unknown.append(f"GET {self.path}")
            self._send(404, b"{}", "application/json")

        def do_POST(self) -> None:
            data = self.rfile.read(int(self.headers.get("Content-Length", 0)))
            path = self.path.split("?")[0]
            dialect = next((d for d in DIALECTS if re.search(d.path, path)), None)
            if dialect is None:
                server.unknown.append(f"POST {path}")
                self._send(404, b"{}", "application/json")
                return
            body = json.loads(data)
            reply = server.reply(path, body, dialect)
            if reply is None:
                self._send(529, b'{"error": {"type": "overloaded_error"}}', "application/json")
                return
            streams = dialect.streams(path, body)
            sent = dialect.stream(reply) if streams else dialect.whole(reply)
            self._send(200, sent.encode(), "text/event-stream" if streams else "application/json")

        def _send(self, status: int, data: bytes, kind: str) -> None:
            self.send_response(status)
            self.send_header("Content-Type", kind)
            self.send_header("Content-Length", str(len(data)))
            self.end_headers()
            self.wfile.write(data)

    return Handler
