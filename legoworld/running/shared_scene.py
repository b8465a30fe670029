"""A scene folder that the tasks of a pass share: hashed, read and drawn once."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Generic, TypeVar

from legoworld.running.image_record import ImageOptions
from legoworld.running.scene_views import SceneViews
from legoworld.scene.blender_process import BlenderProcess
from legoworld.scene.folder import SceneFolder
from legoworld.scene.freeze import FrozenFiles
from legoworld.scene.open_scene import LOST
from legoworld.scene.read_scene import ReadScene, check_scene, read_scene
from legoworld.visibility.normals import Variant

T = TypeVar("T")


class HashedScene:
    """One scene folder on this machine, and the hashes of its files, made at the first question.

    scene: its path below SCENES.
    """

    def __init__(self, scene: str, options: ImageOptions) -> None:
        self._scene = scene
        self._options = options
        self._hashes = _Once(self._hash)

    @property
    def folder(self) -> SceneFolder:
        """The folder. Raises as `check_scene` does, each time."""
        return self._hashes.value()[0]

    @property
    def files(self) -> FrozenFiles:
        """Its files as they were hashed. Raises as `check_scene` does, each time."""
        return self._hashes.value()[1]

    def _hash(self) -> tuple[SceneFolder, FrozenFiles]:
        scenes = self._options.scenes
        assert isinstance(scenes, Path)
        return check_scene(scenes, self._scene, require_frozen=self._options.require_frozen)


class SharedScene(HashedScene):
    """A scene folder and what was read of it so far: its snapshot, and views of it.

    normals: what some task of the pass asks for.
    """

    def __init__(
        self,
        scene: str,
        options: ImageOptions,
        blender: BlenderProcess,
        *,
        normals: Variant | None = None,
    ) -> None:
        super().__init__(scene, options)
        self._normals = normals
        self._blender = blender
        self._snapshot = _Once(self._read)
        self.views = SceneViews(normals)

    def read(self, *, attempts: int = 1) -> ReadScene:
        """The snapshot, read at the first call. Raises as `check_scene` and `read_scene` do.

        An error is raised again without another attempt. attempts: how often in all a scene is read
        that loses its Blender process.
        """
        return self._snapshot.value(attempts)

    def _read(self) -> ReadScene:
        return read_scene(
            self.folder,
            source=self._options.source,
            blender=self._blender,
            cache=self._options.cache,
            files=self.files,
            corner_normals=self._normals == "shading",
        )


class _Once(Generic[T]):
    """A value that is made once, or the error that making it raised."""

    def __init__(self, make: Callable[[], T]) -> None:
        self._make = make
        self._values: list[T] = []
        self._error: Exception | None = None
        self._tries = 0

    def value(self, attempts: int = 1) -> T:
        """The value. attempts: how often in all it is tried while a Blender process is lost."""
        while not self._values and self._may_try(attempts):
            self._tries += 1
            try:
                self._values.append(self._make())
            except Exception as error:  # noqa: BLE001  raised below, each time
                self._error = error
        if not self._values:
            assert self._error is not None
            raise self._error
        return self._values[0]

    def _may_try(self, attempts: int) -> bool:
        return self._tries == 0 or (isinstance(self._error, LOST) and self._tries < attempts)
