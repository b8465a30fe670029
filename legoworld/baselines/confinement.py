"""What a baseline's process may read, write and reach. docs/baselines.md tells users."""

from __future__ import annotations

import functools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from legoworld.baselines.cards import BaselineCard
from legoworld.baselines.environments import ask_python
from legoworld.records.base import decode
from legoworld.records.baseline_messages import ChildRequest
from legoworld.records.scene_folder import Protected
from legoworld.workers.bubblewrap import exposable_paths, follow_links
from legoworld.workers.protections import Confinement, Protections, protections

#: Bubblewrap looks through all that it shows for each file that it adds: 500 take it .7 s and
#: 2,500 take 15 s. Of more photos their folders are shown.
_MOST_SHOWN_ALONE: Final = 500
#: Protections that a baseline's process has; it has no limits on memory, output or processes.
_NAMES: Final = ("network", "files", "other processes", "environment", "child processes ended")
#: The variables of its environment that name files it reads, or folders of them.
_READ: Final = (
    "LD_LIBRARY_PATH", "CUDA_HOME", "CUDA_PATH", "SSL_CERT_FILE", "SSL_CERT_DIR",
    "REQUESTS_CA_BUNDLE", "CURL_CA_BUNDLE",
)  # fmt: skip
#: The caches that weights are downloaded to.
_CACHES: Final = ("HF_HUB_CACHE", "TORCH_HOME")
#: Run by a baseline's Python: where it and its packages are.
_FOLDERS: Final = """
import json, os, site, sys
given = os.environ.get("PYTHONPATH", "").split(os.pathsep)
found = [p for p in sys.path if p and p not in given]
print(json.dumps([sys.prefix, sys.base_prefix, sys.exec_prefix, sys.base_exec_prefix, *found]))
"""


@dataclass(frozen=True, kw_only=True)
class BaselineConfinement:
    """Protections of a baseline's process. inputs: other files and folders that it may read."""

    protections: Protections
    inputs: tuple[Path, ...] = ()

    def record(self) -> Protected:
        """What run.json says of it."""
        return Protected(
            bubblewrap=self.protections.bubblewrap,
            why_not=self.protections.why_not,
            holds=[name for name in self.protections.holds if name in _NAMES],
            does_not_hold=[name for name in self.protections.does_not_hold if name in _NAMES],
        )


def confine_baseline(
    card: BaselineCard,
    weights: str,
    confinement: Confinement,
    *,
    offline: bool,
    inputs: Sequence[Path] = (),
) -> BaselineConfinement:
    """The protections of a run's processes: with the network only to download what the card may.

    SandboxUnavailableError if bubblewrap is required and does not work.
    """
    network = card.about.network and not offline and not Path(weights).exists()
    return BaselineConfinement(
        protections=protections(confinement, network=network), inputs=tuple(inputs)
    )


def readable(
    card: BaselineCard,
    python: Path,
    request: ChildRequest,
    environment: Mapping[str, str],
    inputs: Sequence[Path],
) -> tuple[Path, ...]:
    """The files and folders a process is shown: its code, its Python, its weights, its photos."""
    photos = [Path(image.path) for image in request.images]
    if len(photos) > _MOST_SHOWN_ALONE:
        photos = [*dict.fromkeys(photo.parent for photo in photos)]
    named = [Path(p) for name in _READ for p in environment.get(name, "").split(":") if p]
    caches = [Path(environment[name]) for name in _CACHES if name in environment]
    return exposable_paths(
        [
            card.folder.resolve(), card.shared_path, *_of_python(python), *photos, *named, *caches,
            *_of_weights(Path(request.weights)), *(path.resolve() for path in inputs),
        ]
    )  # fmt: skip


def writable(environment: Mapping[str, str]) -> tuple[Path, ...]:
    """The caches that a process with the network downloads into; they are made if need be."""
    caches = [Path(environment[name]) for name in _CACHES if name in environment]
    for cache in caches:
        cache.mkdir(parents=True, exist_ok=True)
    return tuple(caches)


@functools.cache
def _of_python(python: Path) -> tuple[Path, ...]:
    folders = decode(list[str], ask_python(python, _FOLDERS).strip().splitlines()[-1])
    return (python, *follow_links(python), *map(Path, folders))


def _of_weights(weights: Path) -> Iterator[Path]:
    """A file or a folder, and what its links lead to: the hub's snapshots are links alone."""
    if weights.is_absolute() and weights.exists():
        yield weights
        yield from (p.resolve() for p in weights.rglob("*") if p.is_symlink())
