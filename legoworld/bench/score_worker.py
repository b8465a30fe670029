"""One worker of `legoworld bench serve`: a submission to its answer, whatever was sent."""

from __future__ import annotations

import tempfile
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from msgspec.structs import replace

from legoworld.bench.archive import ArchiveError, UnpackLimits, unpack
from legoworld.errors import cause
from legoworld.evaluation.reconstruction.case import CaseTask, score_case
from legoworld.evaluation.reconstruction.dataset import BenchDataset
from legoworld.evaluation.reconstruction.protocol import BenchProtocol, Choices
from legoworld.evaluation.reconstruction.second_card import SecondCard
from legoworld.readouts.family import protocol
from legoworld.records.base import UNSET, RecordError, as_json, decode, to_record
from legoworld.records.bench_results import Parts, ServeAnswer, ServeRequest
from legoworld.records.reconstruction import EVALUATOR_ERROR, ReconstructionRow
from legoworld.records.run_rows import RunRow
from legoworld.records.submission import BenchRow
from legoworld.running.image import read_image
from legoworld.running.image_record import ImageOptions
from legoworld.running.submission import OK, BenchRules
from legoworld.scene.blender_process import BlenderProcess, Limits
from legoworld.scene.cache import SnapshotCache
from legoworld.tasks.shipped import BENCH
from legoworld.tracks.track import TrackImage
from legoworld.workers.scratch import ScratchFolder

REFUSED: Final = "refused"


@dataclass(frozen=True, kw_only=True)
class ServeOptions:
    """Settings shared by all submissions.

    root: the folder that all scenes named by path lie below; None: only what is sent is scored.
    rules: of each choice of parts that is offered, the last one where a request chooses none;
    second: the second card's half, where that is offered; threads: of each worker; unpacking:
    limits of what is sent.
    """

    root: Path | None
    dataset: BenchDataset
    bench: BenchProtocol
    rules: Mapping[Parts, BenchRules]
    diagnostics: bool
    cache: SnapshotCache | None
    limits: Limits
    threads: int
    second: SecondCard | None = None
    unpacking: UnpackLimits = field(default=UnpackLimits(unpacked_bytes=0))


@dataclass(frozen=True, kw_only=True)
class Order:
    """One request. line: its JSON; upload: the archive or .blend that was sent with it.

    The upload's folder is the order's own, and removed with it.
    """

    line: bytes
    upload: Path | None = None


@dataclass(frozen=True, kw_only=True)
class _Scene:
    """The scene of a request. lone: it was sent as a .blend alone, with no artefact beside it."""

    path: Path
    lone: bool
    cache: SnapshotCache | None


class ScoreWorker:
    """Scores submission after submission with one Blender process of its own."""

    def __init__(self, options: ServeOptions) -> None:
        self._options = options
        self._scratch = ScratchFolder("legoworld-serve-")
        self._blender = BlenderProcess(options.limits)

    def answer(self, order: Order) -> ServeAnswer:
        """Answer one order. Invalid input gets status `refused`; nothing is raised.

        What fails twice while it is scored gets status `evaluator_error`, and no numbers either.
        """
        options = self._options
        try:
            request = decode(ServeRequest, order.line)
        except RecordError as error:
            return no_score(None, f"the line is not a request; found: {error}")
        if request.image_id not in options.dataset.cases:
            return no_score(request, f"the dataset has no image {request.image_id}")
        if request.parts is not UNSET and request.parts not in options.rules:
            return no_score(request, f"this server gives {' or '.join(options.rules)} alone")
        reason = ""
        for _ in range(2):
            try:
                scene = self._scene(request, order)
                if scene is None:
                    return no_score(
                        request, "the scene is not below the server's root folder (--root)"
                    )
                return _answer(request, scene, self._score_scene(request, scene))
            except ArchiveError as error:
                return no_score(request, str(error))
            except Exception as error:  # noqa: BLE001  one request may not end the server
                reason = f"{type(error).__name__}: {cause(error)}"
        return no_score(request, reason, status=EVALUATOR_ERROR)

    def close(self) -> None:
        """End the Blender process and remove what was written."""
        self._blender.close()
        self._scratch.close()

    def _scene(self, request: ServeRequest, order: Order) -> _Scene | None:
        """None for a path that is not below the root. ArchiveError."""
        options = self._options
        if order.upload is None:
            path = scene_below(options.root, request.scene)
            return None if path is None else _Scene(path=path, lone=False, cache=options.cache)
        name = Path(options.dataset.cases[request.image_id].file_name).stem
        path, lone = unpack(order.upload, name, options.unpacking)
        # A trainer sends no scene twice: the cache would only grow.
        return _Scene(path=path, lone=lone, cache=None)

    def _score_scene(self, request: ServeRequest, scene: _Scene) -> ReconstructionRow:
        options = self._options
        case, parts = options.dataset.cases[request.image_id], self._parts(request)
        x = options.second.images[case.image.id] if options.second and "X" in parts else None
        image = TrackImage(
            id=request.image_id,
            file_name=case.file_name,
            size_wh=case.size_wh,
            scene=scene.path.name,
            hfov_deg=case.image.hfov_deg,
            probe=x.probe if x else None,
        )
        row = read_image(image, self._readout(options.rules[parts], scene), self._blender).row
        task = CaseTask(
            run=self._scratch.path,
            row=to_record(BenchRow, as_json(_without_artefacts(row) if scene.lone else row)),
            case=case,
            folders=options.dataset.folders,
            protocol=options.bench,
            choices=Choices(diagnostics=options.diagnostics),
            x=x,
        )
        try:
            return score_case(task)
        finally:
            for file in row.files:
                (self._scratch.path / file.file).unlink(missing_ok=True)

    def _parts(self, request: ServeRequest) -> Parts:
        return list(self._options.rules)[-1] if request.parts is UNSET else request.parts

    def _readout(self, rules: BenchRules, scene: _Scene) -> ImageOptions:
        options = self._options
        return ImageOptions(
            scenes=scene.path.parent,
            run=self._scratch.path,
            protocol=protocol(BENCH, None),
            source="blend",
            cache=scene.cache,
            require_frozen=False,
            max_side=None,
            threads=options.threads,
            bench=rules,
        )


class ProcessScorer:
    """A worker as a function of its own process, which is made with the first order there."""

    def __init__(self, options: ServeOptions, scratch: Path) -> None:
        self._options, self._folder = options, str(scratch)
        self._worker: ScoreWorker | None = None

    def __call__(self, order: Order) -> ServeAnswer:
        """The order's answer."""
        if self._worker is None:
            # Below the server's own folder, which goes with the server however this one ends.
            tempfile.tempdir = self._folder
            self._worker = ScoreWorker(self._options)
        return self._worker.answer(order)


def scene_below(root: Path | None, scene: str) -> Path | None:
    """A scene folder from a path, absolute or relative to the root; None if it is outside.

    Links are followed before the comparison.
    """
    if root is None:
        return None
    try:
        place = (root / scene).resolve()
    except (OSError, ValueError, RuntimeError):  # NUL, halves of surrogate pairs, loops of links
        return None
    return place if place.is_relative_to(root.resolve()) else None


def _without_artefacts(row: RunRow) -> RunRow:
    """A .blend alone is valid where it opens, has geometry and a camera."""
    if not row.validity:
        return row
    validity = replace(row.validity, scene_glb=OK, final_png=OK)
    warnings = tuple(w for w in row.warnings if not w.startswith("not valid: "))
    return replace(row, validity=validity, valid=validity.valid, warnings=warnings)


def no_score(request: ServeRequest | None, reason: str, *, status: str = REFUSED) -> ServeAnswer:
    """An answer without numbers."""
    return ServeAnswer(
        id=request.id if request else None,
        scene=request.scene if request else None,
        image_id=request.image_id if request else None,
        status=status,
        reason=reason,
        V=None,
        R=None,
        A=None,
        S=None,
        objects=(),
        validity=None,
        flags=(),
        warnings=(),
    )


def _answer(request: ServeRequest, scene: _Scene, row: ReconstructionRow) -> ServeAnswer:
    return ServeAnswer(
        id=request.id,
        scene=request.scene,
        image_id=request.image_id,
        status=row.status,
        reason=row.reason,
        V=None if scene.lone and row.valid else 1 if row.valid else 0,
        R=row.R or 0.0,
        A=row.A,
        S=row.S,
        objects=row.objects,
        validity=row.validity,
        flags=row.flags,
        warnings=row.warnings,
        x=row.x,
    )
