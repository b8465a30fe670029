"""One scene in a notebook or a program: open it, and see it from anywhere."""

from __future__ import annotations

import weakref
from collections.abc import Iterable
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Unpack

from legoworld.api.arguments import check_arguments, optional_path
from legoworld.api.cameras import (
    AnyCamera,
    CameraOptions,
    named_cameras,
    posed_cameras,
    read_cameras,
)
from legoworld.api.folders import parse_place, read_from
from legoworld.api.scene_view import SceneView
from legoworld.api.settings import (
    MEMORY_LIMIT_GIB,
    TIME_LIMIT_S,
    Cache,
    load_protocol,
    make_limits,
    snapshot_cache,
)
from legoworld.api.views import Views
from legoworld.errors import UsageError
from legoworld.readouts.family import Protocol
from legoworld.running.inspection import LabelledScene, OpenScene, label, look
from legoworld.running.inspection import open_scene as read_folder
from legoworld.running.scene_views import SceneViews
from legoworld.scene.blender_process import BlenderProcess
from legoworld.scene.folder import PICTURE, Source, scene_at
from legoworld.scene.snapshot import SceneCamera
from legoworld.tasks.shipped import TaskName
from legoworld.tracks.track import Track
from legoworld.visibility.posed_camera import place_scene_camera
from legoworld.workers.processors import usable_cores

if TYPE_CHECKING:
    from legoworld.readouts.relation_kinds import FactBase


@check_arguments
def open_scene(
    folder: str | Path,
    *,
    source: Source = "blend",
    cache: Cache = True,
    require_frozen: bool = False,
    allow_changed: bool = False,
    shading: bool = False,
    time_limit_s: float = TIME_LIMIT_S,
    memory_limit_gib: float = MEMORY_LIMIT_GIB,
) -> Scene:
    """Read a scene with Blender, or from the snapshot cache.

    folder: any .blend or .glb; or a scene folder (with scene.blend or scene.glb) or its URL.
    source: the file of a folder to read. cache: the snapshot cache folder, True for the user's own,
    False for none. require_frozen: refuse a scene without frozen.json. allow_changed: accept a
    scene whose files changed since it was frozen, with a warning. shading: also read what shading
    normals are made of. The limits apply to the Blender process.

    Raises a LegoWorldError if the scene cannot be read: SceneMissingError, SceneInvalidError (and
    its subclasses), SceneChangedError, WorkerTimeoutError, WorkerMemoryError, WorkerCrashedError.
    """
    with ExitStack() as fetched:
        here = fetched.enter_context(read_from(parse_place(folder)))
        found, own_source = scene_at(here, source)
        with BlenderProcess(make_limits(time_limit_s, memory_limit_gib)) as blender:
            scene = Scene(
                read_folder(
                    found,
                    source=own_source,
                    blender=blender,
                    cache=snapshot_cache(cache),
                    require_frozen=require_frozen,
                    allow_changed=allow_changed,
                    any_camera=True,
                    corner_normals=shading,
                )
            )
        weakref.finalize(scene, fetched.pop_all().close)
    return scene


class Scene:
    """A scene in memory: geometry, placements, label owners and cameras."""

    def __init__(self, open_scene: OpenScene) -> None:
        self._open_scene = open_scene

    @property
    def name(self) -> str:
        """The name of its folder or file."""
        return self._open_scene.folder.name

    @property
    def size_wh(self) -> tuple[int, int]:
        """Width and height in pixels of the scene's own render settings."""
        return self._open_scene.scene.snapshot.render.size_wh

    @property
    def snapshot_sha256(self) -> str:
        """Hash of the snapshot: equal scenes have equal hashes."""
        return self._open_scene.scene.snapshot_sha256

    @property
    def cameras(self) -> dict[str, SceneCamera]:
        """The cameras of the file by name, the active one first.

        Without those that are panoramic, excluded from the view layer or hidden from rendering.
        """
        snapshot = self._open_scene.scene.snapshot
        cameras = {camera.name: camera for camera in (snapshot.camera, *snapshot.cameras)}
        if self._open_scene.no_camera:
            del cameras[snapshot.camera.name]
        return cameras

    @check_arguments
    def view(
        self,
        *,
        task: TaskName | str | None = None,
        track: Track | str | Path | None = None,
        size_wh: tuple[int, int] | None = None,
        camera: AnyCamera | None = None,
    ) -> SceneView:
        """The scene as seen by its active camera, or by another.

        task: the task whose vocabulary resolves the labels (such as "coco"); without
        a task and a track every label counts as written. track: a track whose vocabulary (and task,
        if it records one) is used. size_wh: width and height in pixels; None uses the scene's own.
        camera: one of the file, by name, or a `Camera`, which has its own size.

        Raises LabelsInvalidError for an unusable labels.json, UsageError for an unknown task,
        NoCameraError for a scene without an active camera.
        """
        protocol = load_protocol(task, track)
        if camera is not None:
            return self.views_by(protocol, [camera], size_wh, workers=1)[0]
        return self.view_by(protocol, size_wh)

    @check_arguments
    def views(
        self,
        cameras: str | Path | Iterable[AnyCamera] | None = None,
        *,
        task: TaskName | str | None = None,
        track: Track | str | Path | None = None,
        size_wh: tuple[int, int] | None = None,
        workers: int | None = None,
        **given: Unpack[CameraOptions],
    ) -> Views:
        """The scene as seen by many cameras; every view shares the geometry and the labels.

        cameras: names of the file's cameras, `Camera`s (as of `orbit`), or a camera file (see
        `read_cameras`); None with poses: cam_from_world or world_from_cam, (n, 4, 4) in OpenCV axes
        and scene units. K: (3, 3) or (n, 3, 3), pixel centres at .5 (add .5 to the cx and cy of
        OpenCV's calibration); or fov_deg, horizontal; or ortho_scale, scene units along the longer
        side; without them the active camera's. clip: nearest and farthest z in scene units.
        size_wh: of the poses and of the file's cameras, None for the scene's own. task, track: as
        in `view`. workers: threads, None for one per core.

        Raises as `view` does, and UsageError for what is no camera.
        """
        posed = {name: value for name, value in given.items() if value is not None}
        if (cameras is None) == (not posed):
            raise UsageError(
                "views need cameras, or poses, and not both",
                found=", ".join(posed) or "neither",
                expected="cameras=[...], or cam_from_world or world_from_cam",
            )
        if cameras is None:
            snapshot = self._open_scene.scene.snapshot
            width, height = size_wh or self.size_wh
            size = int(width), int(height)
            if (
                self._open_scene.no_camera
                and len(posed.keys() & {"K", "fov_deg", "ortho_scale"}) == 0
            ):
                raise self._open_scene.no_camera
            own = place_scene_camera(snapshot.camera, snapshot.render, size)
            cameras = posed_cameras(size, own, **given)
        elif isinstance(cameras, str | Path):
            cameras = read_cameras(cameras)
        return self.views_by(load_protocol(task, track), cameras, size_wh, workers)

    @check_arguments
    def animate(self, file: str | Path, photo: str | Path | None = None) -> None:
        """Write a looping WebP to show others: photo, render, and the surfaces from around.

        photo: without one it begins with the scene's final.png, or with the surfaces alone where
        there is none. UsageError where the active camera sees no surface; LegoWorldError for a
        photo that is no picture.
        """
        from legoworld.api.animation import write_animation  # Pillow, for a few callers

        path = self._open_scene.folder.path / PICTURE
        render = path if path.is_file() else None
        write_animation(self, Path(file), optional_path(photo), render)

    def views_by(
        self,
        protocol: Protocol | None,
        cameras: Iterable[AnyCamera],
        size_wh: tuple[int, int] | None,
        workers: int | None = None,
    ) -> Views:
        """`views` through cameras, with a protocol already loaded."""
        render = self._open_scene.scene.snapshot.render
        made = named_cameras(cameras, self.cameras, render, size_wh)
        return Views(self._labelled(protocol), protocol, made, workers or usable_cores())

    def view_by(
        self,
        protocol: Protocol | None,
        size_wh: tuple[int, int] | None,
        threads: int | None = None,
        views: SceneViews | None = None,
    ) -> SceneView:
        """`view` with a protocol already loaded.

        threads: of the kernel, None for all cores; views: what was drawn of this scene already.
        """
        if self._open_scene.no_camera:
            raise self._open_scene.no_camera
        inspection = look(self._labelled(protocol), size_wh=size_wh, threads=threads, views=views)
        return SceneView(inspection, protocol)

    def facts(self) -> FactBase:
        """The relations of the scene's own view, every label as written; see `relations`."""
        return self.view().relations()

    def _labelled(self, protocol: Protocol | None) -> LabelledScene:
        return label(
            self._open_scene,
            protocol.vocabulary if protocol else None,
            protocol.override_property if protocol else None,
        )

    def __repr__(self) -> str:
        width, height = self.size_wh
        triangles = self._open_scene.scene.snapshot.n_triangles
        return f"<Scene {self.name!r}: {triangles:,} triangles, {width}x{height}>"
