"""A model as it is run: what a caller chose, with the card's and the machine's defaults."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TypedDict

from legoworld.baselines.accelerators import chosen_device, chosen_dtype
from legoworld.baselines.cards import BaselineCard, chosen_options
from legoworld.baselines.confinement import BaselineConfinement, confine_baseline
from legoworld.baselines.environments import chosen_python
from legoworld.records.cards import OptionValue
from legoworld.workers.protections import Confinement


class ModelOptions(TypedDict, total=False):
    """What a caller may choose of how a baseline's process is run.

    python: the Python with its requirements, None for the installed environment. device, dtype:
    such as "cuda:1" and "float16", "auto" for what the machine has. options: "KEY=VALUE" texts of
    the card. offline: local files only. time_limit_s: from one answer to the next, None for none.
    sandbox: as in `execute`.
    """

    python: str | Path | None
    device: str
    dtype: str
    options: Sequence[str]
    offline: bool
    time_limit_s: float | None
    sandbox: Confinement


@dataclass(frozen=True, kw_only=True)
class ChosenModel:
    """How a baseline's process is run. device: such as "cpu" or "cuda:1".

    time_limit_s: from one answer to the next; of a provider for its model, and again for the photo.
    """

    card: BaselineCard
    weights: str
    python: Path
    device: str
    dtype: str
    options: Mapping[str, OptionValue | None]
    offline: bool
    time_limit_s: float | None
    confined: BaselineConfinement

    @property
    def source(self) -> str:
        """As evidence names it: "vggt 1.0.0"."""
        return f"{self.card.name} {self.card.about.version}"


def choose_model(
    card: BaselineCard, weights: str, given: ModelOptions, inputs: Sequence[str | Path] = ()
) -> ChosenModel:
    """How the baseline of a card is run. inputs: what it may read besides its own files."""
    python, offline = given.get("python"), given.get("offline", False)
    used = chosen_python(card, None if python is None else Path(python))
    device = chosen_device(given.get("device", "cpu"), used)
    sandbox, paths = given.get("sandbox", "auto"), [Path(path) for path in inputs]
    return ChosenModel(
        card=card,
        weights=weights,
        python=used,
        device=device,
        dtype=chosen_dtype(given.get("dtype", "float32"), device, card),
        options=chosen_options(card, given.get("options", ())),
        offline=offline,
        time_limit_s=given.get("time_limit_s"),
        confined=confine_baseline(card, weights, sandbox, offline=offline, inputs=paths),
    )
