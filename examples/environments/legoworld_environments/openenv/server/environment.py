"""An episode: a picture, and one submission or several."""

from __future__ import annotations

import base64
import os
from typing import Any
from uuid import uuid4

from openenv.core.env_server.interfaces import Environment
from openenv.core.env_server.types import State

from legoworld_environments.cases import dataset_folder, read_cases
from legoworld_environments.openenv.models import SceneAction, SceneObservation
from legoworld_environments.scorer import Scorer, reward_of

#: What a step tells besides the reward at the end. residuals: of each scored object how much of it
#: was found, which says where the private truth is.
FEEDBACK = ("none", "score", "residuals")


class Settings:
    """One dataset and its scorer, for all sessions; from LEGOWORLD_* unless they are given.

    feedback: see FEEDBACK; turns: submissions of an episode; render: S as reward, otherwise R.
    """

    def __init__(
        self, dataset: str | None = None, *, feedback: str | None = None, turns: int | None = None,
        render: bool | None = None, root: str | None = None,
    ) -> None:  # fmt: skip
        told = os.environ.get
        self.feedback = feedback or told("LEGOWORLD_FEEDBACK", "score")
        if self.feedback not in FEEDBACK:
            raise ValueError(f"feedback is one of {', '.join(FEEDBACK)}, not {self.feedback!r}")
        self.turns = turns or int(told("LEGOWORLD_TURNS", "1"))
        rendered = told("LEGOWORLD_RENDER", "1") != "0" if render is None else render
        folder = dataset_folder(dataset)
        self.cases = read_cases(folder)
        self.scorer = Scorer(folder, render=rendered, root=root or told("LEGOWORLD_ROOT"))


class PhotoToBlenderEnvironment(Environment[SceneAction, SceneObservation, State]):
    """One session. The seed chooses the picture; the same seed is the same picture."""

    SUPPORTS_CONCURRENT_SESSIONS = True

    def __init__(self, settings: Settings) -> None:
        super().__init__()
        self._settings = settings
        self._case, self._left = settings.cases[0], 0
        self._state = State(episode_id=str(uuid4()), step_count=0)

    def reset(
        self, seed: int | None = None, episode_id: str | None = None,
        image_id: int | None = None, **_options: Any,
    ) -> SceneObservation:  # fmt: skip
        """A picture: that of an image id, or of the seed."""
        cases = self._settings.cases
        chosen = [case for case in cases if case.image_id == image_id]
        if image_id is not None and not chosen:
            raise ValueError(f"the dataset has no image {image_id}")
        self._case = chosen[0] if chosen else cases[(seed or 0) % len(cases)]
        self._left = self._settings.turns
        self._state = State(episode_id=episode_id or str(uuid4()), step_count=0)
        picture = base64.b64encode(self._case.picture.read_bytes()).decode("ascii")
        return SceneObservation(
            prompt=self._case.prompt,
            picture_png_base64=picture,
            image_id=self._case.image_id,
            turns_left=self._left,
        )

    def step(self, action: SceneAction, **_options: Any) -> SceneObservation:
        """Score a submission. Before the last turn the reward is null without feedback."""
        if not self._left:
            raise ValueError("there is no episode, or it has ended; reset begins one")
        if (action.program is None) == (action.scene is None):
            raise ValueError("an action has a program or a scene, one of them")
        scorer, image_id = self._settings.scorer, self._case.image_id
        if action.program is not None:
            answer = scorer.score_program(image_id, action.program)
        else:
            answer = scorer.score_scene(image_id, scorer.root / str(action.scene))
        self._state.step_count += 1
        self._left = 0 if action.final else self._left - 1
        hidden = self._left > 0 and self._settings.feedback == "none"
        return SceneObservation(
            image_id=image_id,
            turns_left=self._left,
            feedback=self._feedback(answer),
            done=self._left == 0,
            reward=None if hidden else reward_of(answer),
        )

    def _feedback(self, answer: dict[str, Any]) -> dict[str, Any]:
        keys = {
            "none": ("status", "program_error"),
            "score": ("status", "reason", "program_error", "V", "R", "A", "S", "warnings"),
            "residuals": ("status", "reason", "program_error", "V", "R", "A", "S", "warnings",
                          "objects"),
        }  # fmt: skip
        return {key: answer.get(key) for key in keys[self._settings.feedback]}

    @property
    def state(self) -> State:
        """The episode and how many submissions it has had."""
        return self._state
