"""The options that say how a model is run."""

from __future__ import annotations

from typing import Final

from legoworld.commands import options
from legoworld.commands.options import flag, option
from legoworld.commands.param_types import EXISTING_FILE, Choice

#: The parameters of the options.
NAMES: Final = (
    "weights", "python", "device", "dtype", "options", "offline", "time_limit_s", "sandbox",
)  # fmt: skip


def model_options(time_limit: str, *, required: bool) -> options.Decorator:
    """The options, each an argument. time_limit: what is limited; required: --weights."""
    return options.combine_options(
        option("--weights", "Weights: a file, a folder or a hub id.", required=required),
        option(
            "--python",
            "Python with the baseline's requirements [default: its installed environment].",
            EXISTING_FILE,
            envvar="LEGOWORLD_BASELINE_PYTHON",
        ),
        option("--device", "cpu, cuda, cuda:1, mps; auto: a GPU if present.", default="cpu"),
        option(
            "--dtype",
            "Type the network computes in; auto: the original's on that device.",
            Choice(["float32", "float16", "bfloat16", "auto"]),
            default="float32",
        ),
        option("--option options", "Baseline option; repeatable.", multiple=True,
               metavar="KEY=VALUE"),
        flag("--offline", "Use local files only; download nothing."),
        option("--time-limit", time_limit),
        option("--sandbox"),
    )  # fmt: skip
