"""The errors of a family's arrays, whose types are built of its noun."""

from __future__ import annotations

from typing import Any, NamedTuple

from legoworld import exit_codes
from legoworld.errors import LegoWorldError


class PixelErrors(NamedTuple):
    """The errors of a family, each with its own code.

    truth: ground truth is missing, undeclared or contradicts the track, which ends scoring;
    prediction, missing: of a file that is unusable, or not there; unseen: of a machine that does
    not see the same files as the command.
    """

    truth: type[LegoWorldError]
    prediction: type[LegoWorldError]
    missing: type[LegoWorldError]
    unseen: type[LegoWorldError]


def pixel_errors(noun: str, module: str) -> PixelErrors:
    """The errors of a family, such as `DepthTruthError` of "depth" with the code "depth_truth".

    module: the one that holds them under these names, by which they cross processes.
    """
    attributes: dict[str, dict[str, Any]] = {
        "truth": {},
        "prediction": {"status": "invalid"},
        "missing": {"status": "missing"},
        "unseen": {"exit_code": exit_codes.BLOCKED},
    }
    return PixelErrors(
        **{
            kind: type(
                f"{noun.capitalize()}{kind.capitalize()}Error",
                (LegoWorldError,),
                {"code": f"{noun}_{kind}", "__module__": module, **own},
            )
            for kind, own in attributes.items()
        }
    )
