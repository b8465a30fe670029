"""What a model's numbers are: declared by its type or by the user, never guessed."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

from legoworld_baseline import Refused

Space = Literal["depth", "disparity"]


@dataclass(frozen=True, kw_only=True)
class Numbers:
    """space and unit of predicted_depth, and who said so: "model_type" or "option"."""

    space: Space
    unit: str | None
    said_by: str


#: By model_type, as each one's authors train and publish it.
_BY_TYPE: dict[str, tuple[Space, str | None]] = {
    "dpt": ("disparity", None),  # MiDaS: affine in 1 / z
    "glpn": ("depth", "m"),
    "zoedepth": ("depth", "m"),
    "depth_pro": ("depth", "m"),
}
_DEPTH_ANYTHING: dict[str, tuple[Space, str | None]] = {
    "relative": ("disparity", None),
    "metric": ("depth", "m"),
}


def declared_numbers(config: Any, space: str, unit: str) -> Numbers:
    """What the model of a configuration gives, or what the options say it gives.

    Refused where neither says it: a disparity scored as a depth gives a plausible wrong number.
    """
    if space != "declared":
        known: Space = "depth" if space == "depth" else "disparity"
        return Numbers(space=known, unit="m" if unit == "m" else None, said_by="option")
    if unit != "declared":
        raise Refused(
            "a unit without a space", found=f"unit={unit}", expected="space=depth or disparity"
        )
    own = _BY_TYPE.get(config.model_type)
    if config.model_type == "depth_anything":
        own = _DEPTH_ANYTHING.get(config.depth_estimation_type)
    if own is None:
        raise Refused(
            "the meaning of this model's output is not declared",
            found=f"model_type {config.model_type!r}",
            expected=", ".join(["depth_anything", *_BY_TYPE]),
            next_step="pass --option space=depth or --option space=disparity"
            " (and --option unit=m if the output is in metres)",
        )
    return Numbers(space=own[0], unit=own[1], said_by="model_type")
