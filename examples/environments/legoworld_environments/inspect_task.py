"""inspect_ai: `inspect eval legoworld/photo_to_blender -T dataset=bench --model ...`."""

from __future__ import annotations

import asyncio

from inspect_ai import Task, task
from inspect_ai._util.registry import registry_add, registry_info
from inspect_ai.dataset import MemoryDataset, Sample
from inspect_ai.model import ChatMessageUser, ContentImage, ContentText
from inspect_ai.scorer import Score, Scorer, Target, mean, scorer, stderr
from inspect_ai.solver import TaskState, generate

from legoworld_environments.cases import dataset_folder, program_of, read_cases
from legoworld_environments.scorer import shared_scorer

#: What is averaged, with the standard error clustered by family: its tiers and views are alike.
_MEANS = {name: [mean(), stderr(cluster="family")] for name in ("S", "V", "R", "A")}


@scorer(metrics=_MEANS)
def lego_bench(dataset: str | None = None, *, render: bool = True) -> Scorer:
    """V, R, A and S of the program in an answer; without a render S is R, and A not a number."""
    folder = dataset_folder(dataset)

    async def score(state: TaskState, target: Target) -> Score:
        asked = shared_scorer(folder, render=render)
        program = program_of(state.output.completion)
        answer = await asyncio.to_thread(asked.score_program, int(target.text), program)
        values = {name: float("nan") if answer[name] is None else answer[name] for name in "VRA"}
        values["S"] = answer["R"] if answer["S"] is None else answer["S"]
        told = {key: answer[key] for key in ("status", "flags", "warnings", "objects")}
        why = answer["program_error"] or answer["reason"] or ""
        return Score(value=values, answer=program, explanation=why, metadata=told)

    return score


@task
def photo_to_blender(
    dataset: str | None = None, *, tier: str | None = None, render: bool = True
) -> Task:
    """A picture in, a Blender program out. tier: easy, medium or hard alone."""
    samples = [
        Sample(
            id=case.name,
            input=[
                ChatMessageUser(
                    content=[ContentText(text=case.prompt), ContentImage(image=str(case.picture))]
                )
            ],
            target=str(case.image_id),
            metadata=case.about,
        )
        for case in read_cases(dataset_folder(dataset))
        if tier is None or case.about["tier"] == tier
    ]
    return Task(
        dataset=MemoryDataset(samples, name="lego-bench"),
        solver=generate(),
        scorer=lego_bench(dataset, render=render),
    )


# The registry names a task after the package that holds it; legoworld's name is the shorter one.
registry_add(
    photo_to_blender,
    registry_info(photo_to_blender).model_copy(update={"name": "legoworld/photo_to_blender"}),
)
