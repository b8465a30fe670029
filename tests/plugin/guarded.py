"""One scene through the real MCP client and an endpoint: a good edit stays, harmful ones go."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import anyio
import cv2
import numpy as np
from mcp import Client

from legoworld.plugin.case import STATES, Case
from legoworld.plugin.connection import BlenderConnection
from legoworld.plugin.evidence import Evidence, read_evidence
from legoworld.plugin.live import LiveBlender
from legoworld.plugin.make_evidence import UserEvidence, make_evidence
from legoworld.plugin.measure import measure, surface_view
from legoworld.plugin.server import plugin_server
from legoworld.plugin.state import LiveScene, read_live
from legoworld.records.base import as_json, canonical, to_record
from legoworld.records.plugin_ledger import TransactionLimits
from legoworld.records.plugin_requirements import Requirement
from legoworld.scene.blender_process import BlenderProcess

Ask = Callable[..., Any]

#: What each harmful edit does to the object it may only move, and the reason it is refused for.
HARMFUL = {
    "object moved away": ("o.matrix_world.translation.x += 1e4", "blocked"),
    "camera changed": ("bpy.context.scene.camera.data.lens *= 1.5", "undeclared"),
    "mesh deleted": ("bpy.data.objects.remove(o)", "kind not declared"),
    "material swapped": (
        "m = bpy.data.materials.new('Gold')\n"
        "if o.data.materials: o.data.materials[0] = m\n"
        "else: o.data.materials.append(m)",
        "kind not declared",
    ),
}


def check_scene(
    blend: Path, folder: Path, connection: BlenderConnection, blender: BlenderProcess
) -> None:
    """Everything about one scene. connection: a Blender that can read `blend`; folder: empty."""
    offline = read_live(blend, blender)
    target, evidence = seen_object(offline, folder)
    connection.run(f"import bpy; bpy.ops.wm.open_mainfile(filepath={str(blend)!r})")
    (folder / STATES).mkdir()
    live = LiveBlender(connection, blender, folder / STATES)
    case = Case(folder, live, evidence, TransactionLimits(rollbacks=len(HARMFUL)))

    def edit(code: str) -> None:
        connection.run(f"import bpy\no = bpy.data.objects[{target!r}]\n{code}")

    async def talk() -> None:
        async with Client(plugin_server(case, evidence)) as client:

            async def ask(tool: str, **arguments: Any) -> Any:
                result = await client.call_tool(tool, arguments)
                text = getattr(result.content[0], "text", "")
                assert not result.is_error, text
                return json.loads(text)

            required = _requirements(target)
            shown = (await ask("measure", requirements=required))["report"]
            said = case.ledger.entries[-1].answer
            wanted = to_record(tuple[Requirement, ...], required)
            expected = as_json(measure(offline, wanted, evidence))
            for ours, theirs in zip(said["results"], expected["results"], strict=True):
                assert canonical(ours) == canonical(theirs), f"{ours} {theirs}"
            assert canonical(said) == canonical(expected)
            assert {"pass"} <= {result["verdict"] for result in said["results"]}
            for brief, result in zip(shown["results"], said["results"], strict=True):
                assert brief["verdict"] == result["verdict"]
            declared: dict[str, Any] = {
                "editable": [target],
                "kinds": ["transform"],
                "requirements": [{"kind": "visibility", "entity": target}],
            }
            await ask("begin", **declared)
            edit("o.location.x += 1e-4")
            assert (await ask("commit"))["judgement"]["accepted"]
            for name, (code, why) in HARMFUL.items():
                begun = await ask("begin", **declared)
                edit(code)
                judgement = (await ask("commit"))["judgement"]
                assert not judgement["accepted"], name
                whys = {v["why"] for v in judgement["violations"]}
                assert why in (whys or {"blocked" if judgement["blocked"] else ""}), (name, whys)
                restored = await ask("rollback")
                assert restored["restored"] == begun["scene_signature"], name

    anyio.run(talk)


def seen_object(scene: LiveScene, folder: Path) -> tuple[str, Evidence]:
    """The mesh object that the camera sees most of, and evidence that has its outline."""
    width, height = (max(48, side // 4) for side in scene.snapshot.render.size_wh)
    shown = surface_view(scene, (width, height)).instance
    shot = scene.snapshot
    owner = shot.occurrence_object[shot.surface_occurrence]
    area = np.bincount(owner[shown[shown >= 0]], minlength=len(shot.objects))
    meshes = [i for i, o in enumerate(shot.objects) if o.type == "MESH" and o.library is None]
    index = max(meshes, key=lambda i: int(area[i]))
    mask = np.append(owner == index, False)[shown].astype(np.uint8)
    found = cv2.findContours(mask, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)[0]
    polygons = [c[:, 0].tolist() for c in found if len(c) >= 3]
    (folder / "outlines.json").write_text(
        json.dumps({"regions": [{"name": "it", "polygons": polygons}]})
    )
    cv2.imwrite(str(folder / "photo.png"), np.zeros((height, width, 3), np.uint8))
    given = UserEvidence(
        photo=folder / "photo.png",
        regions=[folder / "outlines.json"],
        image_id=None,
        vocabulary=None,
        depth=None,
        depth_space="depth",
        hfov_deg=None,
    )
    make_evidence(given, folder / "evidence")
    return shot.objects[index].name, read_evidence(folder / "evidence")


def _requirements(target: str) -> list[dict[str, Any]]:
    world = [
        {"kind": "existence"},
        {"kind": "valid_transform"},
        {"kind": "support"},
        {"kind": "visibility"},
        {"kind": "dimensions", "low_m": [0, 0, 0], "high_m": [1, 1, 1]},
    ]
    picture = [{"kind": k, "region": "it"} for k in ("centroid", "extent", "overlap", "boundary")]
    return [{**requirement, "entity": target} for requirement in [*world, *picture]]
