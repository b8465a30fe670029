"""The scene folders behind a page: final.png made small, scene.glb as it was read out."""

from __future__ import annotations

import json
import struct
from collections.abc import Callable, MutableMapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path, PurePosixPath
from typing import Final

from legoworld.files import names_a_file, sha256_of_file
from legoworld.records.base import UNSET
from legoworld.records.report_page import PageCamera, PageScene
from legoworld.records.run_file import ImageSource
from legoworld.records.run_rows import RunRow
from legoworld.report.photos import page_picture

RENDER: Final = "final.png"
GLB: Final = "scene.glb"
#: A larger scene is not shown.
MOST_BYTES: Final = 64 << 20
#: What a glTF file may ask for that the page cannot read.
_PACKED: Final = {
    "KHR_draco_mesh_compression": "its geometry is Draco-compressed",
    "EXT_meshopt_compression": "its geometry is meshopt-compressed",
    "KHR_meshopt_compression": "its geometry is meshopt-compressed",
    "KHR_texture_basisu": "its textures are Basis-compressed",
}


@dataclass(kw_only=True)
class SceneFiles:
    """Renders and scenes of a page, each file once.

    folders: where scene folders are looked up, in this order.
    """

    folders: Sequence[Path]
    renders: list[bytes] = field(default_factory=list)
    glbs: list[bytes] = field(default_factory=list)
    _render_of: dict[str, tuple[int | None, str]] = field(default_factory=dict)
    _glb_of: dict[str, tuple[int | None, str]] = field(default_factory=dict)

    def page_scene(self, scene: ImageSource | None, row: RunRow) -> PageScene | None:
        """What the page shows of one scene; scene, row: a run's own records of it.

        Only files of the recorded hash are shown: the page never shows another scene than the one
        that was scored. None without a record and without folders.
        """
        if not self.folders or scene is None:
            return None
        files, name = scene.files or {}, scene.scene or ""
        render, render_said = self._file(
            name, RENDER, files.get(RENDER), self._render_of, self._add_render
        )
        glb, glb_said = self._file(name, GLB, files.get(GLB), self._glb_of, self._add_glb)
        return PageScene(
            render=render,
            render_said=render_said,
            glb=glb,
            glb_said=glb_said,
            camera=_camera(scene, row),
        )

    def bench_scene(
        self, scene: ImageSource | None, row: RunRow, render: Path | str
    ) -> PageScene | None:
        """What the page shows of a submission: the evaluator's own render, and its scene.glb.

        render: the file, whose hash is known to be the run's, or why there is none. None where
        neither render nor scene is known.
        """
        at, said = (None, render) if isinstance(render, str) else self._add_render(render)
        glb, glb_said = None, "no --scenes was given"
        if self.folders and scene is not None:
            sha256 = (scene.files or {}).get(GLB)
            glb, glb_said = self._file(scene.scene or "", GLB, sha256, self._glb_of, self._add_glb)
        camera = None if row.camera is UNSET else row.camera
        return PageScene(
            render=at,
            render_said=said,
            glb=glb,
            glb_said=glb_said,
            camera=PageCamera(
                world_from_cam=camera.world_from_cam[:3],
                fx=camera.fx,
                fy=camera.fy,
                cx=camera.cx,
                cy=camera.cy,
                orthographic=camera.type == "ORTHO",
                size_wh=row.size_wh,
            )
            if camera and row.size_wh
            else None,
        )

    def _file(
        self,
        scene: str,
        name: str,
        sha256: str | None,
        known: MutableMapping[str, tuple[int | None, str]],
        add: Callable[[Path], tuple[int | None, str]],
    ) -> tuple[int | None, str]:
        if not sha256:
            return None, f"the scene had no {name} when it was read out"
        if sha256 not in known:
            path, said = self._find(scene, name, sha256)
            known[sha256] = (None, said) if path is None else add(path)
        return known[sha256]

    def _find(self, scene: str, name: str, sha256: str) -> tuple[Path | None, str]:
        """The file of this hash in one of the folders, or None and why there is none."""
        parts = PurePosixPath(scene)
        if parts.is_absolute() or ".." in parts.parts:
            return None, f"{scene} leads out of the scenes"
        paths = [p for f in self.folders if names_a_file(p := f / parts / name)]
        for path in paths:
            if sha256_of_file(path) == sha256:
                return path, ""
        if paths:
            return None, f"{name} is not the one that was read out: its sha256 differs"
        return None, f"{scene}/{name} was not found below --scenes"

    def _add_render(self, path: Path) -> tuple[int | None, str]:
        picture = page_picture(path, f"{path.parent.name}/{path.name}")
        if picture.webp is None:
            return None, picture.said
        self.renders.append(picture.webp)
        return len(self.renders) - 1, ""

    def _add_glb(self, path: Path) -> tuple[int | None, str]:
        if path.stat().st_size > MOST_BYTES:
            size = f"{path.stat().st_size / 1e6:.0f} MB"
            return None, f"{path.parent.name}/{path.name} is {size}: more than a page shows"
        data = path.read_bytes()
        said = why_not_shown(data)
        if said:
            return None, said
        self.glbs.append(data)
        return len(self.glbs) - 1, ""


def why_not_shown(glb: bytes) -> str:
    """Why the page cannot show a scene.glb; "" where it can."""
    try:
        magic, version, _ = struct.unpack_from("<4sII", glb)
        length, kind = struct.unpack_from("<I4s", glb, 12)
        if (magic, version, kind) != (b"glTF", 2, b"JSON"):
            return f"{GLB} is not a binary glTF 2 file"
        content = json.loads(glb[20 : 20 + length])
        needed = {str(name) for name in content.get("extensionsRequired", ())}
        outside = [
            str(part["uri"])[:40]
            for key in ("buffers", "images")
            for part in content.get(key, ())
            if "uri" in part and not str(part["uri"]).startswith("data:")
        ]
    except (struct.error, ValueError, AttributeError, TypeError) as error:
        return f"{GLB} could not be read: {error}"
    for name in sorted(needed & set(_PACKED)):
        return f"{_PACKED[name]} ({name}), and the page carries no decoder for it"
    if outside:
        return f"{GLB} refers to files outside itself: {', '.join(sorted(outside)[:3])}"
    return ""


def _camera(scene: ImageSource, row: RunRow) -> PageCamera | None:
    camera, projection = scene.camera, scene.projection
    if not (camera and projection and row.rendered_wh):
        return None
    return PageCamera(
        world_from_cam=tuple(tuple(map(float, r[:4])) for r in camera.world_from_camera[:3]),
        fx=float(projection.fx),
        fy=float(projection.fy),
        cx=float(projection.cx),
        cy=float(projection.cy),
        orthographic=projection.orthographic,
        size_wh=row.rendered_wh,
    )
