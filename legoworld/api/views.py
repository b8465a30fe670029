"""Many views of one scene: drawn by threads, in order, a few ahead."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from itertools import islice
from typing import Final

from legoworld.api.scene_view import SceneView
from legoworld.readouts.family import Protocol
from legoworld.running.inspection import LabelledScene, look_through
from legoworld.visibility.distorted import LensMap, lens_map
from legoworld.visibility.posed_camera import Camera

#: Views drawn before they are asked for, by thread.
_AHEAD: Final = 2


class Views(Sequence[SceneView]):
    """The views of a scene through cameras, in their order; drawn when they are asked for.

    Iterating draws the next few while one is used, and keeps none: memory does not grow with the
    number of cameras.
    """

    def __init__(
        self,
        labelled: LabelledScene,
        protocol: Protocol | None,
        cameras: Sequence[Camera],
        workers: int,
    ) -> None:
        self._labelled = labelled
        self._protocol = protocol
        self._workers = workers
        self.cameras: tuple[Camera, ...] = tuple(cameras)
        self._lens_maps: dict[Camera, LensMap] = {}

    def __len__(self) -> int:
        return len(self.cameras)

    def __getitem__(self, index: int) -> SceneView:  # type: ignore[override]
        """The view through one camera."""
        return self.through(self.cameras[index])

    def __iter__(self) -> Iterator[SceneView]:
        if self._workers == 1:
            yield from map(self.through, self.cameras)
            return
        left = iter(self.cameras)
        with ThreadPoolExecutor(self._workers) as pool:
            drawn: deque[Future[SceneView]] = deque()
            try:
                for camera in islice(left, _AHEAD * self._workers):
                    drawn.append(pool.submit(self.through, camera))
                while drawn:
                    view = drawn.popleft().result()
                    for camera in islice(left, 1):
                        drawn.append(pool.submit(self.through, camera))
                    yield view
                    del view
            finally:
                for future in drawn:
                    future.cancel()

    def through(self, camera: Camera) -> SceneView:
        """Draw the view of a camera with one thread."""
        lens = None if camera.lens is None else self._lens_map(camera)
        inspection = look_through(self._labelled, camera, threads=1, lens=lens)
        return SceneView(inspection, self._protocol, camera)

    def _lens_map(self, camera: Camera) -> LensMap:
        """Made once for all cameras of equal intrinsics."""
        snapshot = self._labelled.open_scene.scene.snapshot
        alike = camera.anywhere()
        if alike not in self._lens_maps:
            assert camera.lens is not None
            pinhole = camera.projection(snapshot)
            self._lens_maps[alike] = lens_map(camera.lens, pinhole, camera.size_wh)
        return self._lens_maps[alike]
