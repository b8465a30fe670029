"""The server's tool that looks: `look`."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from legoworld.plugin.case import Case
from legoworld.plugin.looks import PANE_PX, Beside, Draw, Viewpoint, look
from legoworld.plugin.server_answers import (
    JsonObject,
    answer_text,
    decode_arguments,
    one_at_a_time,
)
from legoworld.records.base import as_json

if TYPE_CHECKING:
    from mcp.server import MCPServer


def add_looking(server: MCPServer[Any], case: Case) -> None:
    """Offer look."""
    from mcp.server.mcpserver.utilities.types import Image

    @server.tool(name="look", structured_output=False)
    @one_at_a_time(case)
    def look_tool(
        at: JsonObject | None = None,
        beside: Beside = "nothing",
        draw: Draw = "render",
        pane_px: int = PANE_PX,
    ) -> list[Any]:
        """Look at the scene as it is now, from any side; nothing changes.

        at: {} is the active camera; {"camera": name}; {"around": object, "azimuth_deg": 0,
        "elevation_deg": 30} turns to an object, with what stands before it cut away;
        {"from_m": [x, y, z], "to_m": [x, y, z]}. beside: "photo" shows photo, scene and difference
        (active camera only); "before" the scene at begin, now and difference. In differences red is
        brighter than on the left, blue darker. draw: "geometry" is quicker, needs no light, and has
        a colour for each object.
        """
        viewpoint = decode_arguments(Viewpoint, at or {})
        made, png = look(case, viewpoint, beside=beside, draw=draw, pane_px=pane_px)
        return [answer_text(case, **as_json(made)), Image(data=png, format="png")]
