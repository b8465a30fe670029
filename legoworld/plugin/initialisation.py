"""What `initialize` recovers from a photo, before and after it is in the scene."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np

from legoworld.plugin.evidence import Evidence
from legoworld.plugin.measure import surface_view
from legoworld.plugin.plan import construction_plan, plan_markdown
from legoworld.plugin.room import assign_structures, recover_room, shell_view
from legoworld.plugin.room_fit import FACES
from legoworld.plugin.room_install import face_entities
from legoworld.plugin.state import LiveScene
from legoworld.readouts.pictures import Rgb, png_bytes
from legoworld.records.base import readable
from legoworld.records.plugin_evidence import ConstructionPlan, Room, Structure

#: Shades of the faces in the order of `FACES`, and of what is open.
_SHADES: Final = np.array(
    [(126, 104, 84), (226, 226, 222), (176, 184, 196), (188, 178, 166), (206, 204, 200),
     (150, 150, 150), (24, 24, 28)],
    np.uint8,
)  # fmt: skip
_EDGE_RGB: Final = (255, 64, 0)


@dataclass(frozen=True, kw_only=True)
class Initialisation:
    """The room, the plan, and the room drawn over the photo (None without the photo)."""

    room: Room
    plan: ConstructionPlan
    over_photo: Rgb | None

    def files(self, shell: Rgb | None) -> dict[str, bytes]:
        """By name; shell: the kernel's (H, W, 3) picture of the installed shell."""
        files = {
            "room.json": readable(self.room).encode(),
            "plan.json": readable(self.plan).encode(),
            "plan.md": plan_markdown(self.plan).encode(),
        }
        if self.over_photo is not None:
            files["room_over_photo.png"] = png_bytes(self.over_photo)
        if shell is not None:
            files["shell.png"] = png_bytes(shell)
        return files


def recover(
    evidence: Evidence, given: Mapping[str, Structure] | None, camera_height_m: float
) -> Initialisation:
    """The room and the plan of a photo. RoomUnknownError where it does not tell the room."""
    structures = assign_structures(evidence, given)
    room = recover_room(evidence, structures, camera_height_m)
    over = None if evidence.photo is None else _over_photo(room, evidence.photo)
    return Initialisation(room=room, plan=construction_plan(evidence, structures), over_photo=over)


def shell_picture(room: Room, scene: LiveScene) -> Rgb:
    """(H, W, 3) the faces as the readout's kernel sees them in the scene; all else is dark."""
    face_of = np.full(len(scene.snapshot.surface_mesh) + 1, len(FACES))
    for face, surfaces in face_entities(room, scene):
        face_of[:-1][surfaces] = FACES.index(face)
    hit = surface_view(scene, (room.width, room.height)).instance
    return np.ascontiguousarray(_SHADES[face_of[hit]])


def _over_photo(room: Room, photo: Rgb) -> Rgb:
    """The photo with the edges between the room's faces, about 1/300 of its width wide."""
    import cv2

    seen = shell_view(room)
    edge = np.zeros(seen.shape, np.uint8)
    edge[:, 1:] |= seen[:, 1:] != seen[:, :-1]
    edge[1:] |= seen[1:] != seen[:-1]
    wide = max(1, room.width // 300)
    grown = cv2.dilate(edge, np.ones((wide, wide), np.uint8))
    drawn = photo.copy()
    drawn[np.asarray(grown) > 0] = _EDGE_RGB
    return drawn
