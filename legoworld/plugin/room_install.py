"""A room and its camera as one edit of the live scene, and whether the scene then has them."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from legoworld.errors import LegoWorldError
from legoworld.plugin.entities import Entities
from legoworld.plugin.measure import surface_view
from legoworld.plugin.room import corners_m, known_faces, shell_view
from legoworld.plugin.room_fit import FACES
from legoworld.plugin.state import LiveScene
from legoworld.records.plugin_evidence import FaceName, Room
from legoworld.records.plugin_ledger import Declaration
from legoworld.records.plugin_requirements import Existence
from legoworld.visibility.camera import projection

SHELL: Final = "Room shell"
CAMERA: Final = "Reference camera"
_SENSOR_MM: Final = 36.0
#: Blender keeps lens and coordinates as 32-bit floats.
_FLOAT32: Final = 1e-5
#: Pixels of an edge between two faces may fall on either face.
_EDGE_PX: Final = 0.01

_INSTALL: Final = """
import bpy, json, mathutils
given = json.loads({given!r})
scene = bpy.context.scene
unit = scene.unit_settings.scale_length or 1.0
shell = bpy.data.collections.new(given["shell"])
scene.collection.children.link(shell)
for face in given["faces"]:
    mesh = bpy.data.meshes.new(face["name"])
    mesh.from_pydata([[x / unit for x in c] for c in face["corners_m"]], [], [[0, 1, 2, 3]])
    shell.objects.link(bpy.data.objects.new(face["name"], mesh))
data = bpy.data.cameras.new(given["camera"])
data.sensor_fit, data.sensor_width, data.lens = "HORIZONTAL", given["sensor_mm"], given["lens_mm"]
camera = bpy.data.objects.new(given["camera"], data)
camera.matrix_world = mathutils.Matrix(given["world_from_camera"])
camera.location = [x / unit for x in given["place_m"]]
shell.objects.link(camera)
scene.camera = camera
render = scene.render
render.resolution_x, render.resolution_y = given["size_wh"]
render.resolution_percentage, render.pixel_aspect_x, render.pixel_aspect_y = 100, 1, 1
print("installed")
"""


class NotInstalledError(LegoWorldError):
    """The live scene does not have the room or the camera that was to be installed."""

    code = "not_installed"


def face_object(name: FaceName) -> str:
    """The name of a face's object: "Room floor", "Room far wall"."""
    return f"Room {name}" if name in ("floor", "ceiling") else f"Room {name} wall"


def installation(room: Room) -> Declaration:
    """The changes that installing a room may make, and the requirements on the result."""
    objects = [face_object(face.name) for face in known_faces(room)]
    return Declaration(
        editable=(SHELL, CAMERA, "camera", "render", "collections"),
        kinds=("added", "camera", "render", "collection"),
        requirements=tuple(Existence(entity=name) for name in objects),
    )


def install_code(room: Room) -> str:
    """Python for the live Blender. The names it adds must be free: see `refuse_taken_names`."""
    rotation = np.array(room.world_from_cam_rotation) * [1.0, -1.0, -1.0]  # Blender: y up, z back
    given: dict[str, Any] = {
        "shell": SHELL,
        "camera": CAMERA,
        "faces": [
            {"name": face_object(f.name), "corners_m": corners_m(room, f.name).tolist()}
            for f in known_faces(room)
        ],
        "sensor_mm": _SENSOR_MM,
        "lens_mm": _SENSOR_MM / 2 / math.tan(math.radians(room.hfov_deg) / 2),
        "world_from_camera": [[*row, 0.0] for row in rotation.tolist()] + [[0.0, 0.0, 0.0, 1.0]],
        "place_m": [0.0, 0.0, room.camera_height_m],
        "size_wh": [room.width, room.height],
    }
    return _INSTALL.format(given=json.dumps(given))


def refuse_taken_names(room: Room, names: set[str]) -> None:
    """NotInstalledError where the scene has an object or a collection of a name that is added."""
    wanted = {SHELL, CAMERA} | {face_object(face.name) for face in known_faces(room)}
    if taken := sorted(wanted & names):
        raise NotInstalledError(
            "the scene has a room already",
            found=", ".join(taken),
            expected="none of these names in the scene",
            next_step="remove or rename them, then initialize again",
        )


def refuse_another(room: Room, scene: LiveScene) -> None:
    """NotInstalledError where the scene's camera is not the room's, or shows another shell.

    The camera as the snapshot has it, and the kernel's view of the shell against the rays through
    the box; other objects may hide parts.
    """
    size = room.width, room.height
    shot = scene.snapshot
    camera = projection(shot.camera, shot.render, size)
    focal = room.width / 2 / math.tan(math.radians(room.hfov_deg) / 2)
    pose = np.array(shot.camera.world_from_camera)
    centre = camera.cx / room.width, camera.cy / room.height
    errors = {
        "focal length": max(abs(camera.fx / focal - 1), abs(camera.fy / focal - 1)),
        "principal point": max(abs(part - 0.5) for part in centre),
        "rotation": float(np.abs(pose[:, :3] - room.world_from_cam_rotation).max()),
        "place": float(
            np.abs(pose[:, 3] * shot.render.unit_scale - [0, 0, room.camera_height_m]).max()
        ),
    }  # fmt: skip
    wrong = {name: error for name, error in errors.items() if not error <= _FLOAT32}
    if shot.camera.name != CAMERA or camera.orthographic or wrong:
        raise _another(f"{shot.camera.name}: {', '.join(wrong) or 'another camera'}")
    _refuse_another_view(room, scene)


def face_entities(room: Room, scene: LiveScene) -> Iterator[tuple[FaceName, NDArray[np.bool_]]]:
    """(n_surfaces,) which surfaces are each face's. NotInstalledError where one is not there."""
    entities = Entities(scene.snapshot)
    for face in known_faces(room):
        surfaces = entities.surfaces(face_object(face.name))
        if surfaces is None or not surfaces.any():
            raise _another(f"no {face_object(face.name)} that renders")
        yield face.name, surfaces


def _refuse_another_view(room: Room, scene: LiveScene) -> None:
    face_of = np.full(len(scene.snapshot.surface_mesh) + 1, -1)  # the last: nothing is hit
    for name, surfaces in face_entities(room, scene):
        face_of[:-1][surfaces] = FACES.index(name)
    hit = surface_view(scene, (room.width, room.height)).instance
    seen = face_of[hit]
    away = int(((seen != shell_view(room)) & (seen >= 0)).sum())
    if away > _EDGE_PX * hit.size:
        raise _another(f"{away} of {hit.size} pixels show another face than the room has there")


def _another(found: str) -> NotInstalledError:
    return NotInstalledError(
        "the scene does not show the room that was installed",
        found=found,
        expected="the reference camera inside the room's shell",
        next_step="look at the scene's modifiers, handlers and view layers",
    )
