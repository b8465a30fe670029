"""LEGO-Bench as an OpenEnv environment."""

from legoworld_environments.openenv.client import PhotoToBlenderEnv
from legoworld_environments.openenv.models import SceneAction, SceneObservation

__all__ = ["PhotoToBlenderEnv", "SceneAction", "SceneObservation"]
