"""What a scene.glb is refused for."""

from __future__ import annotations

from typing import Final

from legoworld.errors import SceneInvalidError


class UnreadableGltfError(SceneInvalidError):
    """The file is damaged or does not follow glTF 2.0."""

    code = "unreadable_gltf"


class UnsupportedGltfError(SceneInvalidError):
    """The file is sound and uses something that is not read."""

    code = "unsupported_gltf"


def unreadable(found: str, expected: str = "a whole glTF 2.0 .glb") -> UnreadableGltfError:
    """The verdict for a damaged file, as an exception to raise."""
    return UnreadableGltfError(
        "scene.glb is not a usable glTF binary",
        found=found,
        expected=expected,
        next_step="export the scene again",
    )


#: Decoded arrays may take this much whatever the file's size ...
_FLOOR_BYTES: Final = 256 << 20
#: ... and this many times the file: a uint8 triangle list with a cut-out grows 13-fold, Draco 30.
_GROWTH: Final = 64


class Budget:
    """How much memory one file's arrays may take: counted before each is made."""

    def __init__(self, file_bytes: int) -> None:
        self.limit = _FLOOR_BYTES + _GROWTH * file_bytes
        self.bytes_left = self.limit

    def take(self, n_bytes: int, what: str) -> None:
        """Count an array of that size. Raises UnreadableGltfError when the file holds too much."""
        if n_bytes > self.bytes_left:
            raise unreadable(
                f"{what}: {n_bytes:,} bytes when decoded",
                f"at most {self.limit:,} bytes in all for a file of this size",
            )
        self.bytes_left -= n_bytes
