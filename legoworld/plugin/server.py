"""The plugin's MCP server: its tools, prompts and resources over one case."""

from __future__ import annotations

import base64
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Final, TypeAlias

from legoworld.errors import LegoWorldError, UsageError, cause
from legoworld.files import Json, canonical_json
from legoworld.plugin.artefacts import MIME_TYPES, URIS, Kind, find_kind
from legoworld.plugin.case import Case
from legoworld.plugin.evidence import Evidence
from legoworld.plugin.modules import MODULES, tools_off
from legoworld.plugin.tool_answers import brief, cut_answer, page_start
from legoworld.plugin.tool_schemas import (
    answer_schema,
    decode_arguments,
    describe_choices,
    requirements_page,
    shown_schema,
)
from legoworld.plugin.tools import TOOLS, Session
from legoworld.records.plugin_install import Module

if TYPE_CHECKING:
    from mcp import types
    from mcp.server.context import ServerRequestContext
    from mcp.server.lowlevel import Server

_INSTRUCTIONS: Final = """\
Measure the live Blender scene against evidence from the reference photo, and guard edits to it.
Edit with the Blender tools. Around every edit call `begin` with what you will change and what has
to hold, then edit, then `commit`; when it is refused, correct the edit or call `rollback`. Verdicts
are pass, fail or unknown; unknown is never pass. A report is stale as soon as the scene changes.
At the end call `validate`, `review` (look at the render, then say what is in it) and `export`.
"""
_REQUIREMENTS: Final = "legoworld://requirements"
_PROMPT: Final = "refine"
#: Resources of one page of the list.
_PAGE: Final = 100
#: An answer, and the picture beside it.
_Made: TypeAlias = tuple[dict[str, Json], bytes | None]


def plugin_server(
    case: Case, evidence: Evidence | None, modules: Sequence[Module] = MODULES
) -> Server:
    """A server over a case; every answer carries scene_signature and ledger_seq.

    modules: those that are on; tools of the others are not offered.
    """
    from mcp.server.lowlevel import Server

    from legoworld.version import __version__

    desk = _Desk(Session(case=case, evidence=evidence, modules=modules))
    return Server(
        "legoworld",
        title="legoworld: measured edits",
        version=__version__,
        instructions=_INSTRUCTIONS,
        on_list_tools=desk.list_tools,
        on_call_tool=desk.call_tool,
        on_list_resources=desk.list_resources,
        on_list_resource_templates=desk.list_templates,
        on_read_resource=desk.read_resource,
        on_list_prompts=desk.list_prompts,
        on_get_prompt=desk.get_prompt,
    )


def run_on_stdio(server: Server) -> None:
    """Serve on standard input and output until the client leaves."""
    import anyio
    from mcp.server.stdio import stdio_server

    async def serve() -> None:
        async with stdio_server() as (read, write):
            await server.run(read, write, server.create_initialization_options())

    anyio.run(serve)


class _Desk:
    """The handlers of one server. One call runs at a time; the others wait for it."""

    def __init__(self, session: Session) -> None:
        import anyio

        off = tools_off(session.modules)
        self._session = session
        self._tools = {tool.name: tool for tool in TOOLS if tool.name not in off}
        self._call_lock = anyio.Lock()

    async def list_tools(
        self, _context: ServerRequestContext, _params: types.PaginatedRequestParams | None
    ) -> types.ListToolsResult:
        from mcp import types

        return types.ListToolsResult(
            tools=[
                types.Tool(
                    name=tool.name,
                    title=tool.title,
                    description=tool.says,
                    input_schema=shown_schema(tool.name, tool.arguments),
                    output_schema=None if tool.answer is None else answer_schema(tool.answer),
                    annotations=types.ToolAnnotations(
                        read_only_hint="reads" in tool.hints,
                        destructive_hint="undoes" in tool.hints,
                        idempotent_hint="again" in tool.hints,
                        open_world_hint=False,
                    ),
                )
                for tool in self._tools.values()
            ]
        )

    async def call_tool(
        self, context: ServerRequestContext, params: types.CallToolRequestParams
    ) -> types.CallToolResult:
        """Run a tool: its answer as JSON, and as one line of text for clients that take text."""
        from mcp import types
        from mcp.shared.exceptions import MCPError

        try:
            answer, png = await self._run(context, params.name, params.arguments or {})
        except LegoWorldError as error:
            return _error_result(str(error))
        except OSError as error:
            where = f" of {error.filename}" if error.filename else ""
            return _error_result(
                f"the operating system refused a file{where}; found: {cause(error)}"
            )
        except Exception as error:
            said = f"unexpected error in {params.name}: {type(error).__name__}; this is a bug in"
            raise MCPError(types.INTERNAL_ERROR, f"{said} legoworld, please report it") from error
        content: list[types.ContentBlock] = [types.TextContent(text=canonical_json(answer))]
        if png is not None:
            data = base64.b64encode(png).decode()
            content.append(types.ImageContent(data=data, mime_type="image/png"))
        if self._tools[params.name].answer is None:
            return types.CallToolResult(content=content)
        return types.CallToolResult(content=content, structured_content=answer)

    async def _run(
        self, context: ServerRequestContext, name: str, given: Mapping[str, Json]
    ) -> _Made:
        tool = self._tools.get(name)
        if tool is None:
            raise UsageError(
                "unknown tool",
                found=repr(name),
                expected=describe_choices(self._tools, name),
            )
        arguments = decode_arguments(tool.arguments, given)
        case = self._session.case
        async with self._call_lock:
            case.interruption.begin(_progress(context))

            def call() -> _Made:
                made = tool.call(self._session, arguments)
                made, png = made if isinstance(made, tuple) else (made, None)
                return cut_answer(case, brief(made)), png

            try:
                cancel = None if "to its end" in tool.hints else case.interruption.ask
                return await _uncut(call, cancel)
            finally:
                case.interruption.begin(None)

    async def list_resources(
        self, _context: ServerRequestContext, params: types.PaginatedRequestParams | None
    ) -> types.ListResourcesResult:
        from mcp import types
        from mcp.shared.exceptions import MCPError

        first = types.Resource(
            uri=_REQUIREMENTS,
            name="requirements",
            title="Kinds of requirements",
            mime_type="text/markdown",
        )
        try:
            start = page_start(params.cursor, "cursor") if params and params.cursor else 0
        except UsageError as error:
            raise MCPError(types.INVALID_PARAMS, str(error)) from error
        listed = [first, *(_resource(path) for path in self._session.case.artefacts.files())]
        page = listed[start : start + _PAGE]
        more = str(start + _PAGE) if start + _PAGE < len(listed) else None
        return types.ListResourcesResult(resources=page, next_cursor=more)

    async def list_templates(
        self, _context: ServerRequestContext, _params: types.PaginatedRequestParams | None
    ) -> types.ListResourceTemplatesResult:
        from mcp import types

        return types.ListResourceTemplatesResult(
            resource_templates=[
                types.ResourceTemplate(
                    uri_template=uri + "{sha256}",
                    name=uri.strip("/").rpartition("/")[2],
                    description="By the sha256 that an answer names.",
                    mime_type=MIME_TYPES[kind],
                )
                for kind, uri in URIS.items()
            ]
        )

    async def read_resource(
        self, _context: ServerRequestContext, params: types.ReadResourceRequestParams
    ) -> types.ReadResourceResult:
        from mcp import types
        from mcp.shared.exceptions import MCPError

        uri = params.uri
        if uri == _REQUIREMENTS:
            text = types.TextResourceContents(
                uri=uri, mime_type="text/markdown", text=requirements_page()
            )
            return types.ReadResourceResult(contents=[text])
        kind: Kind | None = next((k for k, start in URIS.items() if uri.startswith(start)), None)
        if kind is None:
            valid = ", ".join([_REQUIREMENTS, *(f"{u}SHA256" for u in URIS.values())])
            raise MCPError(types.INVALID_PARAMS, f"no resource {uri[:100]}; expected: {valid}")
        try:
            data = self._session.case.artefacts.read(uri.removeprefix(URIS[kind]), kind)
        except UsageError as error:
            raise MCPError(types.INVALID_PARAMS, str(error)) from error
        mime = MIME_TYPES[kind]
        if kind == "png":
            blob = base64.b64encode(data).decode()
            picture = types.BlobResourceContents(uri=uri, mime_type=mime, blob=blob)
            return types.ReadResourceResult(contents=[picture])
        text = types.TextResourceContents(uri=uri, mime_type=mime, text=data.decode())
        return types.ReadResourceResult(contents=[text])

    async def list_prompts(
        self, _context: ServerRequestContext, _params: types.PaginatedRequestParams | None
    ) -> types.ListPromptsResult:
        from mcp import types

        prompt = types.Prompt(
            name=_PROMPT,
            title="Measured refinement",
            description="How a scene is built from a photo by measured edits.",
        )
        return types.ListPromptsResult(prompts=[prompt])

    async def get_prompt(
        self, _context: ServerRequestContext, params: types.GetPromptRequestParams
    ) -> types.GetPromptResult:
        from mcp import types
        from mcp.shared.exceptions import MCPError

        if params.name != _PROMPT:
            raise MCPError(types.INVALID_PARAMS, f"no prompt {params.name!r}; expected: {_PROMPT}")
        skill = Path(__file__).with_name("SKILL.md").read_text("utf-8").split("---\n", 2)[2].strip()
        said = types.PromptMessage(role="user", content=types.TextContent(text=skill))
        return types.GetPromptResult(messages=[said])


async def _uncut(call: Callable[[], _Made], cancel: Callable[[], None] | None) -> _Made:
    """Run a call in a thread to its end; `cancel` is what a cancelled client makes of it.

    The call after it waits for that end, too: a case is never in two hands.
    """
    import anyio

    ended = anyio.Event()

    async def watch() -> None:
        try:
            await ended.wait()
        except anyio.get_cancelled_exc_class():
            if cancel is not None:
                cancel()
            raise

    raised: list[Exception] = []
    made: list[_Made] = []
    async with anyio.create_task_group() as group:
        group.start_soon(watch)
        with anyio.CancelScope(shield=True):
            try:
                made.append(await anyio.to_thread.run_sync(call))
            except Exception as error:  # noqa: BLE001  raised below: the group would wrap it
                raised.append(error)
        ended.set()
    if raised:
        raise raised[0]
    return made[0]


def _progress(context: ServerRequestContext) -> Callable[[int, int, str], None]:
    """Tells the client, from the thread of its call, which step begins."""
    import anyio

    def report(number: int, of: int, what: str) -> None:
        anyio.from_thread.run(context.session.report_progress, float(number), float(of), what)

    return report


def _error_result(text: str) -> types.CallToolResult:
    from mcp import types

    return types.CallToolResult(content=[types.TextContent(text=text)], is_error=True)


def _resource(path: Path) -> types.Resource:
    from mcp import types

    kind = find_kind(path.name)
    return types.Resource(
        uri=f"{URIS[kind]}{path.stem}",
        name=path.name,
        mime_type=MIME_TYPES[kind],
        size=path.stat().st_size,
    )
