"""Scenes of one scene.glb, and the worker that reading them must not ask."""

from __future__ import annotations

from pathlib import Path

from scene.gltf.documents import Document

from legoworld.scene.blender_process import BlenderProcess


class NoBlender(BlenderProcess):
    """A worker that must not be asked."""

    def request(self, message):
        raise AssertionError(f"Blender was asked for {message['kind']}")


def scene_at(path: Path, name: str = "Chair", category: str = "chair") -> Path:
    made = Document()
    made.quad(name, 4, 4, extras={"category": category})
    path.mkdir(parents=True, exist_ok=True)
    (path / "scene.glb").write_bytes(made.glb())
    return path
