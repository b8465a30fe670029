"""A client: `with PhotoToBlenderEnv(base_url=...).sync() as env: env.reset(seed=0)`."""

from __future__ import annotations

from typing import Any

from openenv.core import EnvClient
from openenv.core.client_types import StepResult
from openenv.core.env_server.types import State

from legoworld_environments.openenv.models import SceneAction, SceneObservation


class PhotoToBlenderEnv(EnvClient[SceneAction, SceneObservation, State]):
    """A session on a server."""

    def _step_payload(self, action: SceneAction) -> dict[str, Any]:
        return action.model_dump(exclude={"metadata"})

    def _parse_result(self, payload: dict[str, Any]) -> StepResult[SceneObservation]:
        reward, done = payload.get("reward"), payload.get("done", False)
        seen = {**payload.get("observation", {}), "reward": reward, "done": done}
        return StepResult(observation=SceneObservation(**seen), reward=reward, done=done)

    def _parse_state(self, payload: dict[str, Any]) -> State:
        return State(**payload)
