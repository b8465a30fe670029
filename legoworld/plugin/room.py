"""The room and the camera of a photo, recovered from evidence; refused where the photo is unclear.

Nothing here touches a scene. What the room does not explain stays unknown: a wall without a known
distance is left out.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Final, get_args

import numpy as np
from numpy.typing import NDArray

from legoworld.errors import LegoWorldError
from legoworld.plugin.evidence import Evidence, EvidenceInvalidError
from legoworld.plugin.room_fit import FACES, WALLS, fit_box, rays, seen_face
from legoworld.records.plugin_evidence import FaceName, Room, RoomFace, Structure

#: A room that explains fewer of its labelled pixels is none.
LEAST_AGREEMENT: Final = 0.9
STRUCTURES: Final[tuple[Structure, ...]] = get_args(Structure)
#: Names of regions and categories that say what they show, besides the structures' own.
_SAID: Final[dict[str, Structure]] = {
    "left wall": "left", "right wall": "right", "far wall": "far", "back wall": "far",
    "near wall": "near", "walls": "wall",
}  # fmt: skip


class RoomUnknownError(LegoWorldError):
    """The evidence does not determine the room, or the camera in it."""

    code = "room_unknown"


def assign_structures(
    evidence: Evidence, given: Mapping[str, Structure] | None
) -> dict[str, Structure]:
    """Structure by region name: as given, or from the region's name and category.

    EvidenceInvalidError for a region that the evidence does not have.
    """
    if given is None:
        return {
            region.name: said
            for region in evidence.file.regions
            if (said := _parse_structure(region.name) or _parse_structure(region.category or ""))
            is not None
        }
    known = {region.name for region in evidence.file.regions}
    if missing := sorted(set(given) - known):
        raise EvidenceInvalidError(
            "the evidence has no such region",
            found=", ".join(missing[:5]),
            expected=f"some of {', '.join(sorted(known)[:10]) or 'no regions at all'}",
        )
    return dict(sorted(given.items()))


def _parse_structure(name: str) -> Structure | None:
    """Parse "Back wall", "wall 2" or "floor"; None for any other name."""
    words = " ".join(name.lower().replace("-", " ").replace("_", " ").split())
    base = words.rstrip("0123456789 ")
    return _SAID.get(base) or next((s for s in STRUCTURES if s == base), None)


def recover_room(
    evidence: Evidence, structures: Mapping[str, Structure], camera_height_m: float
) -> Room:
    """The room that explains the regions best. RoomUnknownError names what the photo lacks.

    camera_height_m: a convention that sets the unit.
    """
    camera = evidence.file.camera
    if camera.hfov_deg is None or camera.world_from_cam_rotation is None:
        raise _unknown(
            camera.unknown or "no camera in the evidence",
            "the camera's field of view and rotation",
            "pass --fov to `legoworld plugin evidence`, or a provider's --camera",
        )
    directions = rays(camera.world_from_cam_rotation, camera.hfov_deg, evidence.size_wh)
    masks = _masks(evidence, structures)
    if "floor" not in masks:
        raise _unknown("no region shows the floor", "regions of the floor and of walls", _DRAW)
    fit = fit_box(directions, masks)
    room = Room(
        photo_sha256=evidence.file.photo.sha256,
        width=evidence.size_wh[0],
        height=evidence.size_wh[1],
        hfov_deg=camera.hfov_deg,
        world_from_cam_rotation=camera.world_from_cam_rotation,
        camera_height_m=camera_height_m,
        faces=fit.faces,
        structures=tuple(sorted(structures.items())),
        labelled_px=fit.labelled_px,
        agreement=fit.agreement,
    )
    _refuse_unclear(room)
    return room


_DRAW: Final = "draw the floor's and the walls' visible parts as regions of the evidence"


def _masks(
    evidence: Evidence, structures: Mapping[str, Structure]
) -> dict[Structure, NDArray[np.bool_]]:
    masks: dict[Structure, NDArray[np.bool_]] = {}
    for region in evidence.file.regions:
        if (structure := structures.get(region.name)) is not None:
            mask = evidence.mask(region)
            masks[structure] = masks[structure] | mask if structure in masks else mask
    return masks


def _refuse_unclear(room: Room) -> None:
    if room.agreement < LEAST_AGREEMENT:
        raise _unknown(
            f"the best box explains {room.agreement:.0%} of the labelled pixels",
            f"at least {LEAST_AGREEMENT:.0%}",
            "check the regions and the field of view: is the room a box?",
        )
    faces = {face.name: face for face in room.faces}
    if faces["floor"].unknown is not None:
        raise _unknown("the floor's region shows no floor", "a floor below the camera", _DRAW)
    walls = [faces[name] for name in WALLS]
    if all(wall.distance is None for wall in walls):
        reasons = "; ".join(f"{w.name}: {w.unknown}" for w in walls)
        raise _unknown(reasons, "a wall whose distance the photo tells", _DRAW)


def _unknown(found: str, expected: str, next_step: str) -> RoomUnknownError:
    return RoomUnknownError(
        "the room of the photo is unknown", found=found, expected=expected, next_step=next_step
    )


def known_faces(room: Room) -> Iterator[RoomFace]:
    """The faces that are built: those of a known distance."""
    return (face for face in room.faces if face.distance is not None)


def bounds_m(room: Room) -> NDArray[np.float64]:
    """(2, 3) lower and upper corner of the shell, metres, the camera above the origin.

    An unknown side is open: the shell reaches as far there as the photo shows it to, at least one
    camera height.
    """
    reach = {
        f.name: f.distance if f.distance is not None else max(f.at_least, 1.0) for f in room.faces
    }
    low = [-reach["left"], -reach["near"], 1 - reach["floor"]]
    high = [reach["right"], reach["far"], 1 + reach["ceiling"]]
    return np.array([low, high]) * room.camera_height_m


#: For each face: axis, and whether it is the upper end.
_SIDE: Final[dict[FaceName, tuple[int, bool]]] = {
    "floor": (2, False), "ceiling": (2, True), "left": (0, False),
    "right": (0, True), "far": (1, True), "near": (1, False),
}  # fmt: skip


def corners_m(room: Room, name: FaceName) -> NDArray[np.float64]:
    """(4, 3) corners of a face in the world, metres, counter-clockwise seen from inside."""
    low, high = bounds_m(room)
    axis, upper = _SIDE[name]
    u, v = ((1, 2), (2, 0), (0, 1))[axis]
    corners = np.empty((4, 3))
    corners[:, axis] = (high if upper else low)[axis]
    corners[:, u] = [low[u], high[u], high[u], low[u]]
    corners[:, v] = [low[v], low[v], high[v], high[v]]
    return corners[::-1].copy() if upper else corners


def shell_view(room: Room) -> NDArray[np.int64]:
    """(H, W) index into `FACES` of the known face that each pixel shows, -1 for an open side."""
    directions = rays(room.world_from_cam_rotation, room.hfov_deg, (room.width, room.height))
    low, high = bounds_m(room)
    camera = np.array([0.0, 0.0, room.camera_height_m])
    distances = np.empty(len(FACES))
    for index, name in enumerate(FACES):
        axis, upper = _SIDE[name]
        distances[index] = abs((high if upper else low)[axis] - camera[axis])
    seen = seen_face(directions, distances)
    built = np.array([face.distance is not None for face in room.faces])
    return np.where(built[seen], seen, -1)
