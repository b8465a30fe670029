"""The scene folders behind a page: final.png made small, scene.glb as it was read out."""

from __future__ import annotations

from collections.abc import Callable, MutableMapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path, PurePosixPath
from typing import Final

from legoworld.errors import SceneInvalidError
from legoworld.files import names_a_file, sha256_of_file
from legoworld.records.base import UNSET
from legoworld.records.report_page import PageCamera, PageScene
from legoworld.records.run_file import ImageSource
from legoworld.records.run_rows import RunRow
from legoworld.report.photos import page_picture
from legoworld.scene.gltf.accessors import Accessors
from legoworld.scene.gltf.buffers import Buffers, image_bytes
from legoworld.scene.gltf.container import Glb, parse_glb
from legoworld.scene.gltf.nodes import node_tree
from legoworld.scene.gltf.verdicts import Budget
from legoworld.scene.pictures import MOST_PX, claimed_size_wh

RENDER: Final = "final.png"
GLB: Final = "scene.glb"
#: A larger scene is not shown.
MOST_BYTES: Final = 64 << 20
#: Of all textures of a scene, 0.5 GB decoded: eight of 4096 x 4096.
_MOST_TEXTURE_PX: Final = 4 * MOST_PX
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
        glb, glb_said = self._file(name, GLB, files.get(GLB), self._glb_of, self.add_glb)
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
            glb, glb_said = self._file(scene.scene or "", GLB, sha256, self._glb_of, self.add_glb)
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
        picture = page_picture(path, f"{path.parent.name}/{path.name}", most_px=MOST_PX)
        if picture.webp is None:
            return None, picture.note
        self.renders.append(picture.webp)
        return len(self.renders) - 1, ""

    def add_glb(self, path: Path) -> tuple[int | None, str]:
        """Take a scene.glb: its place in glbs, or None and why it is not shown."""
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
        parsed = parse_glb(glb)
        document = parsed.document
        for name in sorted({*document.texts("extensionsRequired")} & set(_PACKED)):
            return f"{_PACKED[name]} ({name}), and the page carries no decoder for it"
        owners = (*document.children("buffers"), *document.children("images"))
        uris = sorted(o.text("uri")[:40] for o in owners if "uri" in o)
        outside = [uri for uri in uris if not uri.startswith("data:")]
        if outside:
            return f"{GLB} refers to files outside itself: {', '.join(outside[:3])}"
        return _too_much(parsed)
    except SceneInvalidError as error:
        return f"{GLB} could not be read: {error.found}"


def _too_much(glb: Glb) -> str:
    """What a sound file asks a browser to make that is larger than it; "" where nothing is.

    An accessor without bytes, or one of many over the same bytes, costs the file nothing. Raises
    SceneInvalidError for nodes in a circle and for an accessor that does not lie in its buffer.
    """
    node_tree(glb.document)
    budget = Budget(glb.file_bytes)
    buffers = Buffers(glb, Path(), budget)
    accessors = Accessors(glb.document, buffers, budget)
    numbers = 0
    for index in range(len(accessors)):
        accessors.check(index)
        layout = accessors.layout(index)
        numbers += layout.count * layout.element_bytes
    if numbers > MOST_BYTES + glb.file_bytes:
        size = f"{numbers / 1e6:,.0f} MB"
        return (
            f"{GLB} of {glb.file_bytes:,} bytes claims {size} of vertices: more than a page shows"
        )
    pictures = [image_bytes(image, buffers) or b"" for image in glb.document.children("images")]
    pixels = sum(width * height for width, height in map(claimed_size_wh, pictures))
    if pixels > _MOST_TEXTURE_PX:
        return f"{GLB} holds textures of {pixels:,} pixels: not shown"
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
