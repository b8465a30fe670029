"""The options that say how a model is run, and what they choose for a baseline's card."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, TypedDict

from legoworld.commands import options
from legoworld.commands.options import flag, option
from legoworld.commands.param_types import EXISTING_FILE, Choice

if TYPE_CHECKING:
    from legoworld.baselines.cards import BaselineCard
    from legoworld.baselines.confinement import BaselineConfinement
    from legoworld.records.cards import OptionValue
    from legoworld.workers.protections import Confinement


class ChosenModel(TypedDict):
    """A model as it is run: what is equal in the requests of a run and of a provider."""

    card: BaselineCard
    weights: str
    python: Path
    device: str
    dtype: str
    options: Mapping[str, OptionValue | None]
    offline: bool
    time_limit_s: float | None
    confined: BaselineConfinement


@dataclass(frozen=True, kw_only=True)
class ModelOptions:
    """The values of the options. weights: None where they are not required and not given."""

    weights: str | None
    python: Path | None
    device: str
    dtype: str
    options: tuple[str, ...]
    offline: bool
    time_limit_s: float | None
    sandbox: Confinement

    def chosen(self, card: BaselineCard, inputs: tuple[Path, ...] = ()) -> ChosenModel:
        """How the baseline of a card is run. inputs: what it may read besides its own files."""
        from legoworld.baselines.accelerators import chosen_device, chosen_dtype
        from legoworld.baselines.cards import chosen_options
        from legoworld.baselines.confinement import confine_baseline
        from legoworld.baselines.environments import chosen_python

        assert self.weights is not None
        python = chosen_python(card, self.python)
        device = chosen_device(self.device, python)
        return {
            "card": card,
            "weights": self.weights,
            "python": python,
            "device": device,
            "dtype": chosen_dtype(self.dtype, device, card),
            "options": chosen_options(card, self.options),
            "offline": self.offline,
            "time_limit_s": self.time_limit_s,
            "confined": confine_baseline(
                card, self.weights, self.sandbox, offline=self.offline, inputs=inputs
            ),
        }


def model_options(time_limit: str, *, required: bool) -> options.Decorator:
    """The options, as `model`. time_limit: what is limited; required: --weights."""
    return options.together(
        "model",
        ModelOptions,
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
