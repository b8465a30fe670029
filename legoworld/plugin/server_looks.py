"""The tool `look`: the live scene in one small picture, from any side."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Annotated, Final, Literal
from zlib import crc32

import cv2
import numpy as np
from msgspec import Meta, field

from legoworld.errors import UsageError
from legoworld.plugin.case import STATES, Case
from legoworld.plugin.small_render import render_copy
from legoworld.plugin.state import LiveScene, read_live
from legoworld.plugin.viewpoints import Viewpoint, find_camera
from legoworld.readouts.pictures import Rgb, instance_picture, png_bytes
from legoworld.records.base import Record, as_json
from legoworld.records.plugin_evidence import Sha256
from legoworld.scene.blender_process import BlenderProcess
from legoworld.scene.instances import group
from legoworld.scene.labels import Labels
from legoworld.scene.pictures import decoded_picture
from legoworld.scene.snapshot import SceneCamera, Snapshot
from legoworld.visibility.view import view

_SAMPLES: Final = 16
#: So many colours of objects.
_COLORS: Final = 1000


class Looking(Record, frozen=True, kw_only=True):
    """What to look at. pane_px: of the longer side of each pane; models count 750 px as a token."""

    at: Viewpoint = field(default_factory=Viewpoint)
    beside: Literal["nothing", "photo", "before"] = "nothing"
    draw: Literal["render", "geometry"] = "render"
    pane_px: Annotated[int, Meta(ge=16, le=640)] = 256


class Look(Record, frozen=True, kw_only=True):
    """A picture of the live scene. panes: what it shows from left to right; size_wh: of each."""

    picture_sha256: Sha256
    panes: tuple[str, ...]
    size_wh: tuple[int, int]


def look(case: Case, arguments: Looking) -> tuple[Look, bytes]:
    """Look at the scene as it is now; the picture is a PNG. UsageError for what cannot be shown.

    beside: the photo, or the scene as the open transaction found it, is at the left and the
    difference at the right. TransactionError where none is open.
    """
    made: list[bytes] = []

    def call() -> Look:
        renderer = case.live.reader if arguments.draw == "render" else None
        begun = case.begun_entry() if arguments.beside == "before" else None
        with case.live.save_copy() as copy:
            scene = read_live(copy.path, case.live.reader)
            case.note(scene)
            camera = find_camera(scene.snapshot, arguments.at)
            wide, high = case.evidence.size_wh if case.evidence else scene.snapshot.render.size_wh
            shrink = arguments.pane_px / max(wide, high)
            size = max(1, round(wide * shrink)), max(1, round(high * shrink))
            panes = {"scene": _draw_scene(copy.path, scene, camera, renderer, size)}
            if arguments.beside == "photo":
                panes = {"photo": _photo(case, arguments.at, size), **panes}
            elif begun is not None:
                # In its place, where it finds what it names by relative paths.
                copy.write(case.folder / STATES / f"{begun.answer['base_sha256']}.blend")
                then = read_live(copy.path, case.live.reader)
                panes = {"before": _draw_scene(copy.path, then, camera, renderer, size), **panes}
        if len(panes) == 2:
            panes["difference"] = difference(*panes.values())
        made.append(png_bytes(np.concatenate(list(panes.values()), axis=1)))
        sha256 = case.artefacts.keep(made[0], "png")
        return Look(picture_sha256=sha256, panes=tuple(panes), size_wh=size)

    return case.record("look", as_json(arguments), call), made[0]


def _draw_scene(
    blend: Path,
    scene: LiveScene,
    camera: SceneCamera,
    renderer: BlenderProcess | None,
    size_wh: tuple[int, int],
) -> Rgb:
    """Rendered by Cycles; without a renderer the kernel's drawing."""
    if renderer is None:
        return draw_geometry(replace(scene.snapshot, camera=camera), size_wh)
    png = render_copy(blend, renderer, size_wh, samples=_SAMPLES, denoise=True, camera=camera)
    picture = decoded_picture(png, color=True)
    assert picture is not None  # our own PNG
    return np.ascontiguousarray(picture[:, :, ::-1])


def _photo(case: Case, at: Viewpoint, size: tuple[int, int]) -> Rgb:
    photo = case.evidence.photo if case.evidence else None
    if photo is None or at != Viewpoint():
        raise UsageError(
            "the photo cannot be put beside it",
            found="no photo" if photo is None else "another camera than the active one",
            expected="a server with --photo, and no viewpoint",
        )
    return np.asarray(cv2.resize(photo, size, interpolation=cv2.INTER_AREA), np.uint8)


def draw_geometry(snapshot: Snapshot, size_wh: tuple[int, int]) -> Rgb:
    """(H, W, 3): each object in a colour by its name, darker where it is seen at a slant."""
    grouping = group(snapshot, Labels(objects={}, collections={}, warnings=()))
    seen = view(snapshot, grouping, size_wh, exact=False, normals="geometric")
    numbers = np.array([crc32(i.name.encode()) % _COLORS for i in grouping.instances] + [-1])
    towards = np.nan_to_num(np.abs(seen.normals().normal_cam[:, :, 2:]))
    colored = instance_picture(numbers[seen.buffers.instance].astype(np.int32))
    return np.asarray(colored * (0.6 + 1.4 * towards), np.uint8)


def difference(first: Rgb, second: Rgb) -> Rgb:
    """White where two (H, W, 3) agree; red where the second is brighter, blue where darker."""
    apart = second.astype(np.int16) - first
    size = 255 - np.abs(apart).max(axis=2)
    brighter = apart.sum(axis=2) >= 0
    red, blue = np.where(brighter, 255, size), np.where(brighter, size, 255)
    return np.asarray(np.stack([red, size, blue], axis=2), np.uint8)
