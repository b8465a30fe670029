"""What an agent sends and gets."""

from __future__ import annotations

from typing import Any

from openenv.core.env_server.types import Action, Observation
from pydantic import Field


class SceneAction(Action):
    """A submission: a program, or a scene folder below the server's root (LEGOWORLD_ROOT)."""

    program: str | None = Field(default=None, description="A Python program for Blender's API")
    scene: str | None = Field(default=None, description="A scene folder below the server's root")
    final: bool = Field(default=False, description="End the episode with this submission")


class SceneObservation(Observation):
    """The picture and the task after a reset, and what the submission scored after a step."""

    prompt: str = ""
    picture_png_base64: str = ""
    image_id: int = 0
    turns_left: int = 0
    feedback: dict[str, Any] = Field(default_factory=dict)
