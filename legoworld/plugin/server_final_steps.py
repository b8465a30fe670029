"""The server's tools at the end: validate, review, export; and what a case made, by hash."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from legoworld.plugin.case import Case
from legoworld.plugin.final_steps import export, note_review, render_for_review, validate
from legoworld.plugin.result_pictures import result_pictures
from legoworld.plugin.server_answers import (
    JsonObject,
    answer,
    answer_text,
    decode_arguments,
    one_at_a_time,
)
from legoworld.readouts.pictures import png_bytes
from legoworld.records.base import as_json, readable
from legoworld.records.plugin_requirements import Report, Requirement

if TYPE_CHECKING:
    from mcp.server import MCPServer


def add_finishing(server: MCPServer[Any], case: Case) -> None:
    """Offer validate, review and export, and the resources."""
    _add_review(server, case)

    @server.tool(name="validate")
    @one_at_a_time(case)
    def validate_tool(
        requirements: list[JsonObject] | None = None, pictures: bool = False
    ) -> JsonObject:
        """Measure what all committed transactions required, and more, on the scene as it is now.

        The report is kept as the resource legoworld://reports/REPORT_SHA256. pictures: also a small
        picture of each result, as the resource legoworld://renders/SHA256.
        """
        given: tuple[Requirement, ...] = decode_arguments(
            tuple[Requirement, ...], requirements or []
        )
        report = validate(case, given)
        sha256 = case.artefacts.keep(readable(report).encode(), "json")
        drawn = {"pictures": kept_pictures(case, report)} if pictures else {}
        return answer(case, report=as_json(report), report_sha256=sha256, **drawn)

    @server.tool(name="export")
    @one_at_a_time(case)
    def export_tool() -> JsonObject:
        """Write scene.blend, scene.glb, final.png and a 1920 x 1080 render into the case's folder.

        The exported scene is read again: its geometry is the live scene's. Not while a transaction
        is open.
        """
        return answer(case, **as_json(export(case)))

    @server.resource("legoworld://reports/{sha256}", mime_type="application/json")
    def reports(sha256: str) -> str:
        """A report, a room or a plan, by its hash."""
        return case.artefacts.read(sha256, "json").decode()

    @server.resource("legoworld://texts/{sha256}", mime_type="text/markdown")
    def texts(sha256: str) -> str:
        """A plan as Markdown, by its hash."""
        return case.artefacts.read(sha256, "md").decode()

    @server.resource("legoworld://renders/{sha256}", mime_type="image/png")
    def renders(sha256: str) -> bytes:
        """A render or another picture, by its hash."""
        return case.artefacts.read(sha256, "png")


def kept_pictures(case: Case, report: Report) -> list[str | None]:
    """sha256 of a small picture of each result, null where there is nothing to see."""
    assert case.scene is not None  # the report is of it
    pictures = result_pictures(case.scene, case.evidence, report)
    return [None if p is None else case.artefacts.keep(png_bytes(p), "png") for p in pictures]


def _add_review(server: MCPServer[Any], case: Case) -> None:
    from mcp.server.mcpserver.utilities.types import Image

    @server.tool(structured_output=False)
    @one_at_a_time(case)
    def review(render_sha256: str | None = None, findings: list[str] | None = None) -> list[Any]:
        """Look at the scene: without arguments a render, beside the photo where that is known.

        Then call it again with the render's render_sha256 and your findings, one a difference from
        the photo, [] for none.
        """
        if render_sha256 is not None:
            noted = note_review(case, render_sha256, findings or [])
            return [answer_text(case, **as_json(noted))]
        made, png = render_for_review(case)
        return [answer_text(case, **as_json(made)), Image(data=png, format="png")]
