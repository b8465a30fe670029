"""The server: `uvicorn legoworld_environments.openenv.server.app:app`."""

from __future__ import annotations

from openenv.core.env_server.http_server import create_app

from legoworld_environments.openenv.models import SceneAction, SceneObservation
from legoworld_environments.openenv.server.environment import PhotoToBlenderEnvironment, Settings

_settings = Settings()

app = create_app(
    lambda: PhotoToBlenderEnvironment(_settings),
    SceneAction,
    SceneObservation,
    env_name="legoworld_photo_to_blender",
    max_concurrent_envs=64,
)
