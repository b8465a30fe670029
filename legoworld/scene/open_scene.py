"""What is asked of a .blend besides its snapshot: a render by a card, and facts; both cached."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final, TypeVar, cast

import numpy as np
from numpy.typing import NDArray

from legoworld.conventions import MOST_OBJECTS
from legoworld.errors import WorkerCrashedError, WorkerMemoryError
from legoworld.files import Json, atomic_path, canonical_json, sha256_of_text, write_npz
from legoworld.scene.artefacts import without_metadata
from legoworld.scene.blender_process import BlenderProcess
from legoworld.scene.cache import SnapshotCache
from legoworld.scene.folder import BLEND, SceneFolder
from legoworld.scene.freeze import FrozenFiles
from legoworld.scene.requests import CardRequest, Request, StandRequest
from legoworld.scene.snapshot import Snapshot

T = TypeVar("T")
#: Raised whenever what `facts` answers changes.
_FACTS: Final = 2
#: Raised whenever what `depth` answers changes.
_DEPTH: Final = 2
#: A Blender process that ended while it was asked.
LOST: Final = (WorkerCrashedError, WorkerMemoryError)


@dataclass(frozen=True, kw_only=True)
class CardRender:
    """How a picture is rendered, apart from the scene. threads: 0 for all; changes no byte.

    stand: where the camera is put before; None where it stays.
    """

    size_wh: tuple[int, int]
    samples: int
    seed: int
    denoise: bool
    threads: int = 0
    stand: StandRequest | None = None


@dataclass(frozen=True, kw_only=True)
class SceneFacts:
    """Facts of a .blend as JSON values, and its images scaled down: (N, H, W, 3) uint8."""

    values: dict[str, Any]
    textures: NDArray[np.uint8]


@dataclass(frozen=True, kw_only=True)
class FirstHits:
    """Surfaces at the pixels of a render: (H, W) depth_z_m float32, +inf for none, object int32.

    place: of each of the snapshot's objects, its value in `object`.
    """

    depth_z_m: NDArray[np.float32]
    object: NDArray[np.int32]
    place: NDArray[np.int64]


class OpenedScene:
    """A scene folder whose files were hashed, and the Blender process that opens it.

    Each question is asked again in a fresh process when the first one is lost on it: a scene is
    not judged by one bad moment of a machine. content: what answers are cached under, where the
    file's own bytes do not identify the scene.
    """

    def __init__(
        self,
        folder: SceneFolder,
        files: FrozenFiles,
        blender: BlenderProcess,
        cache: SnapshotCache | None,
        *,
        content: Mapping[str, Json] | None = None,
    ) -> None:
        self.folder = folder
        self._blend = str(folder.path.resolve() / folder.name_on_disk(BLEND))
        hashes = {**files.dependencies, BLEND: files.artefacts.get(BLEND)}
        own = {name: found.sha256 if found else None for name, found in hashes.items()}
        self._content = own if content is None else content
        self._blender = blender
        self._cache = cache

    def render(self, request: CardRender) -> bytes:
        """The active camera's picture: an 8-bit RGB PNG without metadata.

        Raises the verdicts of `errors`.
        """
        card = card_request(request)
        stored = self._entry("render", _question(request), ".png")
        if stored is not None and stored.is_file():
            return stored.read_bytes()
        output = self._blender.workspace("legoworld-render-") / "render.png"
        output.unlink(missing_ok=True)
        self._ask({"kind": "card_render", "output": str(output), "card": card})
        png = without_metadata(output.read_bytes())
        if stored is not None:
            with atomic_path(stored) as temporary:
                temporary.write_bytes(png)
        return png

    def first_hits(self, request: CardRender, snapshot: Snapshot) -> FirstHits:
        """What Cycles meets in the first sample of that render, in metres; see `card_depth`."""
        card = card_request(request)
        path = self._entry("depth", {**_question(request), "version": _DEPTH}, ".npz")
        if path is None or not path.is_file():
            output = self._blender.workspace("legoworld-render-") / "depth.npz"
            self._ask({"kind": "card_depth", "output": str(output), "card": card})
            if path is None:
                path = output
            else:
                with atomic_path(path) as temporary:
                    temporary.write_bytes(output.read_bytes())
        with np.load(path) as arrays:
            names = json.loads(arrays["object_names"].tobytes())
            place = {(name, library): n % MOST_OBJECTS for n, (name, library) in enumerate(names)}
            return FirstHits(
                depth_z_m=arrays["depth_z"] * np.float32(snapshot.render.unit_scale),
                object=arrays["object"],
                place=np.array(
                    [place.get((o.name, o.library or ""), -1) for o in snapshot.objects]
                ),
            )

    def facts(self, thumbnail_wh: tuple[int, int]) -> SceneFacts:
        """What the .blend holds besides geometry. Raises the verdicts of `errors`."""
        question: dict[str, Json] = {"thumbnail_wh": thumbnail_wh, "version": _FACTS}
        stored = self._entry("facts", question, ".npz")
        if stored is not None and stored.is_file():
            with np.load(stored) as arrays:
                values = json.loads(arrays["facts"].tobytes().decode("utf-8"))
                return SceneFacts(values=values, textures=arrays["textures"])
        output = self._blender.workspace("legoworld-render-") / "facts.npz"
        values = self._ask({"kind": "facts", "output": str(output), "thumbnail_wh": thumbnail_wh})[
            "facts"
        ]
        with np.load(output) as arrays:
            textures = arrays["textures"]
        if stored is not None:
            text = np.frombuffer(canonical_json(values).encode("utf-8"), np.uint8)
            write_npz(stored, {"facts": text, "textures": textures})
        return SceneFacts(values=values, textures=textures)

    def _entry(self, kind: str, question: Mapping[str, Json], suffix: str) -> Path | None:
        """Where the answer to a question about this content is, or belongs."""
        if self._cache is None:
            return None
        key = sha256_of_text(canonical_json([kind, self._content, question]))
        return self._cache.entry_path(key, suffix)

    def _ask(self, message: Request) -> dict[str, Any]:
        return retry_once(lambda: self._blender.request({**message, "blend": self._blend}))


def card_request(request: CardRender) -> CardRequest:
    """A card as the Blender process is given it."""
    return cast("CardRequest", {k: v for k, v in vars(request).items() if v is not None})


def _question(request: CardRender) -> dict[str, Json]:
    """What of a card an answer depends on."""
    return cast("dict[str, Json]", card_request(replace(request, threads=0)))


def retry_once(ask: Callable[[], T]) -> T:
    """The answer; asked once more where the process that was asked is lost."""
    try:
        return ask()
    except LOST:
        return ask()
