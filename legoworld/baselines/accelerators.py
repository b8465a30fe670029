"""The accelerators of a baseline's Python: its torch build, and the devices torch sees."""

from __future__ import annotations

import functools
from pathlib import Path
from typing import Final

from legoworld.baselines.cards import BaselineCard
from legoworld.baselines.environments import ask_python, requirements
from legoworld.records.base import Record, decode

#: Run by a baseline's Python. If torch does not import, for a missing library say, the reason is
#: reported.
_PROBE: Final = """
import json, sys
found = {"version": None, "cuda": None, "devices": [], "mps": False, "error": None}
try:
    import torch
    found["version"] = torch.__version__
    found["cuda"] = torch.version.cuda
    if torch.cuda.is_available():
        count = torch.cuda.device_count()
        found["devices"] = [torch.cuda.get_device_name(i) for i in range(count)]
    found["mps"] = torch.backends.mps.is_available()
except ModuleNotFoundError as error:
    found["error"] = str(error)
except Exception as error:
    found["error"] = f"{type(error).__name__}: {error}"
print(json.dumps(found))
"""


class Torch(Record, frozen=True, kw_only=True):
    """A Python's torch.

    version: such as "2.13.0+cpu", None where it cannot be imported, with the reason in `error`;
    cuda: the version it was built for, None for a build without CUDA; devices: names of the CUDA
    devices it sees; mps: whether it sees Apple's GPU.
    """

    version: str | None
    cuda: str | None
    devices: tuple[str, ...]
    mps: bool
    error: str | None

    @property
    def best_device(self) -> str:
        """The device of `--device auto`: "cuda" if torch sees a device, else "mps", else "cpu"."""
        if self.devices:
            return "cuda"
        return "mps" if self.mps else "cpu"

    def __str__(self) -> str:
        if self.version is None:
            return f"torch cannot be imported ({self.error})"
        build = f"built for CUDA {self.cuda}" if self.cuda else "built without CUDA"
        seen = ", ".join(self.devices) or ("Apple GPU" if self.mps else "no GPU seen")
        return f"torch {self.version} {build}, {seen}"


@functools.cache
def inspect_torch(python: Path) -> Torch:
    """The torch of a Python, cached. EnvironmentFailedError if the Python does not run."""
    return decode(Torch, ask_python(python, _PROBE).strip().splitlines()[-1])


def needs_torch(card: BaselineCard) -> bool:
    """Whether a baseline's requirements name torch."""
    return any(text.startswith("torch==") for text in requirements(card).dependencies)


def chosen_device(given: str, python: Path) -> str:
    """The device that a run records: `--device auto` resolves to what the baseline's torch sees."""
    return inspect_torch(python).best_device if given == "auto" else given


def chosen_dtype(given: str, device: str, card: BaselineCard) -> str:
    """The dtype that a run records: `--dtype auto` is the card's on CUDA, else float32."""
    if given != "auto":
        return given
    return card.about.dtype_on_cuda if device.partition(":")[0] == "cuda" else "float32"
