"""What `program` plays for an image: recorded steps, or a scene program cut into steps."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from legoworld.agents.program_steps import cut_program, saving_step
from legoworld.agents.trial_plan import TrialPlan
from legoworld.agents.workspaces import Workspace
from legoworld.errors import LegoWorldError
from legoworld.records.agents import RecordedStep
from legoworld.records.base import RecordError, canonical, decode_lines
from legoworld.records.endpoint import Call
from legoworld.tracks.track import TrackImage


class StepsUnusableError(LegoWorldError):
    """An image has no program to play, or it cannot be read."""

    code = "steps_unusable"


def remaining_steps(
    plan: TrialPlan, image: TrackImage, workspace: Workspace, calls: Sequence[Call]
) -> list[RecordedStep] | None:
    """The steps left to play after these calls; None for an agent that plays none.

    Raises StepsUnusableError for an image without a program and for a damaged recording.
    """
    if plan.programs is None:
        return None
    recorded = _recording_path(plan.programs, image)
    if recorded.is_file():
        text = recorded.read_text(encoding="utf-8")
        text = text.replace("{workspace}", str(workspace.folder))
        try:
            return steps_left(decode_lines(RecordedStep, text.encode()), calls)
        except RecordError as error:
            raise StepsUnusableError(
                f"the steps of {image.scene} cannot be played",
                found=f"{recorded.name}: {error}",
                expected='lines such as {"tool": "execute_blender_code", "arguments": {...}}',
            ) from error
    program = plan.programs / image.scene / "scene.py"
    if not program.is_file():
        raise StepsUnusableError(
            "there is no program to play for this image",
            found=f"no {image.scene}/scene.py and no {image.scene}.steps.jsonl",
            expected="one of them below --programs",
        )
    return [*cut_program(program), saving_step(workspace.folder)]


def may_continue(plan: TrialPlan, image: TrackImage) -> bool:
    """Whether a half-built trial of this image continues; otherwise it starts again.

    The variables of a program that was cut into steps are gone with the Blender that had them, and
    a transaction with the plugin's server that had begun it.
    """
    if plan.card.about.resume == "restart" or plan.plugin is not None:
        return False
    return plan.programs is None or _recording_path(plan.programs, image).is_file()


def steps_left(steps: Sequence[RecordedStep], calls: Sequence[Call]) -> list[RecordedStep]:
    """The steps after the last one whose code is among these calls, in order.

    A step that was played and not answered has no call, and is played again. None is left after
    one that had to succeed and did not.
    """
    waiting = [call for call in calls if call.code is not None and call.by == "agent"]
    done = 0
    for number, step in enumerate(steps, start=1):
        code = step.arguments.get("code")
        if not isinstance(code, str):
            continue
        played = next((n for n, call in enumerate(waiting) if call.code == code), None)
        if played is None:
            break
        if step.must_succeed and waiting[played].status != "success":
            return []
        done = number
        del waiting[: played + 1]
    return list(steps[done:])


def encode_steps(steps: Sequence[RecordedStep]) -> str:
    """Steps as the player reads them."""
    return "".join(canonical(step) + "\n" for step in steps)


def _recording_path(programs: Path, image: TrackImage) -> Path:
    return programs / f"{image.scene}.steps.jsonl"
