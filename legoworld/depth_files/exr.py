"""Pictures from OpenEXR files: a channel of depth, or three of vectors."""

from __future__ import annotations

import importlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from legoworld import extras
from legoworld.depth_files.errors import DepthFileError
from legoworld.depth_files.headers import MOST_PX, SizeCheck, check_claim
from legoworld.errors import cause

#: Last parts of the names of depth channels, the most specific first; `<layer>.Z` counts as Z.
_DEPTH_NAMES: Final = (("Z",), ("DEPTH",), ("Y", "V"))
_GREY: Final = ("R", "G", "B")
_VECTORS: Final = (_GREY, ("X", "Y", "Z"))


def read_exr(
    path: Path, channel: str | None, check_size: SizeCheck | None, channels_wanted: int = 1
) -> tuple[NDArray[Any], str]:
    """A channel of an EXR, float32 or float16, and its name (needs OpenEXR 3).

    channels_wanted: 3 for (H, W, 3) float32 of the channels R, G, B, or X, Y, Z.

    channel: its name; None selects the only Z, else the only depth, else the only Y or V, else the
    only channel, else R if G and B are equal. DepthFileError if that is ambiguous.
    """
    openexr = _openexr(path)
    try:
        with openexr.File(str(path), separate_channels=True, header_only=True) as file:
            (x0, y0), (x1, y1) = file.header()["dataWindow"]
            n_parts = len(file.parts)
            n_channels = sum(len(part.header["channels"]) for part in file.parts)
        shape = (int(y1) - int(y0) + 1, int(x1) - int(x0) + 1)
        check_claim(path, shape, check_size)
        if shape[0] * shape[1] * n_channels > MOST_PX:  # all of them are read
            raise ValueError(f"{n_channels} channels of {shape[1]}x{shape[0]}")
        with openexr.File(str(path), separate_channels=True) as file:
            channels = {name: c.pixels for name, c in file.channels().items()}
    except (RuntimeError, ValueError, TypeError, KeyError, OSError) as error:
        raise DepthFileError(f"{path.name} cannot be read", found=cause(error)) from error
    if n_parts != 1:
        raise DepthFileError(
            f"{path.name} is not one depth image", found=f"{n_parts} parts", expected="one part"
        )
    if channels_wanted > 1:
        return _vectors(path, channels)
    name = channel if channel is not None else _depth_channel(channels)
    values = channels.get(name) if name is not None else None
    if name is None or values is None or values.dtype not in (np.float32, np.float16):
        raise DepthFileError(
            f"{path.name} has no single depth channel of floating-point numbers",
            found=", ".join(f"{n} {c.dtype}" for n, c in sorted(channels.items())) or "no channel",
            expected=f"channel {channel}" if channel else "one channel Z (or <layer>.Z), Y, V or R",
            next_step="name the channel: --array NAME in an import, array in depth.toml",
        )
    return values, name


def _vectors(path: Path, channels: Mapping[str, NDArray[Any]]) -> tuple[NDArray[Any], str]:
    """The only three channels of vectors, without their layer's name."""
    by_end: dict[str, list[NDArray[Any]]] = {}
    for name, values in channels.items():
        by_end.setdefault(name.rpartition(".")[2].upper(), []).append(values)
    for names in _VECTORS:
        found = [one for name in names for one in by_end.get(name, [])]
        if len(found) == 3 and all(one.dtype in (np.float32, np.float16) for one in found):
            return np.stack(found, axis=-1).astype(np.float32), "".join(names)
    raise DepthFileError(
        f"{path.name} is not a single 3-channel picture",
        found=", ".join(f"{n} {c.dtype}" for n, c in sorted(channels.items())) or "no channel",
        expected="R, G, B or X, Y, Z of floating-point numbers, each once",
    )


def _depth_channel(channels: Mapping[str, NDArray[Any]]) -> str | None:
    """The depth channel; None if there is none or it is ambiguous."""
    for names in _DEPTH_NAMES:
        fitting = [name for name in channels if name.rpartition(".")[2].upper() in names]
        if fitting:
            return fitting[0] if len(fitting) == 1 else None
    if len(channels) == 1:
        return next(iter(channels))
    greys = [channels[name] for name in _GREY if name in channels]
    same = len(greys) == 3 and all(np.array_equal(greys[0], g, equal_nan=True) for g in greys[1:])
    return "R" if same else None


def _openexr(path: Path) -> Any:
    try:
        return importlib.import_module("OpenEXR")
    except ImportError as error:
        raise DepthFileError(
            f"{path.name} needs an EXR reader",
            found="the package OpenEXR is not installed",
            expected="OpenEXR 3",
            next_step=extras.install_command("exr"),
        ) from error
