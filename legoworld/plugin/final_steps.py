"""The end of a case: everything that was required, a render that was looked at, the files."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Final

import numpy as np

from legoworld.endpoint.finalisation import export_submission
from legoworld.errors import LegoWorldError, SceneInvalidError
from legoworld.files import atomic_path, sha256_of_file
from legoworld.plugin.case import Case, told_changes
from legoworld.plugin.measure import measure
from legoworld.plugin.open_ledger import TransactionError
from legoworld.plugin.remaining_work import standing_requirements
from legoworld.plugin.small_render import render_copy
from legoworld.plugin.state import NOTHING, LiveScene, read_live
from legoworld.readouts.pictures import Rgb, png_bytes
from legoworld.records.base import as_json
from legoworld.records.plugin_ledger import Export, Review
from legoworld.records.plugin_requirements import Report, Requirement
from legoworld.scene.blender_process import BlenderProcess, Limits
from legoworld.scene.folder import BLEND
from legoworld.scene.pictures import decoded_picture
from legoworld.workers.protections import protections
from legoworld.workers.sandbox import SandboxLimits
from legoworld.workers.scratch import scratch_folder

EXPORT: Final = "export"
RENDER: Final = "render.png"
#: What a case delivers, beside the scene.
RENDER_WH: Final = (1920, 1080)
_REVIEW_LONGEST_PX: Final = 800
_SAMPLES: Final = 16
#: A full-size render of a lit interior takes minutes on two cores.
_RENDER_LIMITS: Final = Limits(time_s=1800.0)
_EXPORT_LIMITS: Final = SandboxLimits(time_s=600.0, memory_bytes=8 << 30)


class StaleError(LegoWorldError):
    """A call refers to another state of the scene."""

    code = "stale"


def validate(case: Case, given: Sequence[Requirement]) -> Report:
    """Measure what every committed transaction required, and more, on the scene as it is now."""
    requirements = tuple(dict.fromkeys([*standing_requirements(case.ledger.entries), *given]))

    def call() -> Report:
        return measure(case.read(requirements), requirements, case.evidence)

    return case.record("validate", {"requirements": as_json(tuple(given))}, call)


def render_for_review(case: Case) -> tuple[Review, bytes]:
    """A render of the live scene, beside the photo where that is known; the picture is a PNG."""
    made: list[bytes] = []

    def call() -> Review:
        step = case.interruption.step
        step(0, 3, "saving the scene")
        with case.live.save_copy() as copy, _renderer(case) as renderer:
            step(1, 3, "reading it")
            scene = read_live(copy.path, case.live.reader)
            case.note(scene)
            size = _review_size(case, scene)
            step(2, 3, "rendering")
            png = render_copy(copy.path, renderer, size, samples=_SAMPLES, denoise=True)
        made.append(_beside_photo(png, case))
        return Review(render_sha256=case.artefacts.keep(made[0], "png"), findings=None)

    return case.record("review", {}, call), made[0]


@contextmanager
def _renderer(case: Case) -> Iterator[BlenderProcess]:
    """A Blender of the call's own, which ends with it or when its client cancels."""
    with BlenderProcess(_RENDER_LIMITS) as renderer, case.interruption.ending(renderer.abort):
        yield renderer


def _review_size(case: Case, scene: LiveScene) -> tuple[int, int]:
    wide, high = case.evidence.size_wh if case.evidence else scene.snapshot.render.size_wh
    shrink = min(1.0, _REVIEW_LONGEST_PX / max(wide, high))
    return max(1, round(wide * shrink)), max(1, round(high * shrink))


def _beside_photo(png: bytes, case: Case) -> bytes:
    import cv2

    photo = case.evidence.photo if case.evidence else None
    decoded = decoded_picture(png, color=True)
    if photo is None or decoded is None:
        return png
    height, width = decoded.shape[:2]
    small = cv2.resize(photo, (width, height), interpolation=cv2.INTER_AREA)
    pair: Rgb = np.concatenate([np.asarray(small, np.uint8), decoded[:, :, ::-1]], axis=1)
    return png_bytes(pair)


def note_review(case: Case, render_sha256: str, findings: Sequence[str]) -> Review:
    """Record what was seen in a render. StaleError for a render of another state of the scene."""

    def call() -> Review:
        rendered = [
            e for e in case.ledger.entries
            if e.tool == "review" and e.error is None
            and e.answer["render_sha256"] == render_sha256
        ]  # fmt: skip
        last = case.ledger.entries[-1] if case.ledger.entries else None
        if not rendered or last is None or last.scene_signature != rendered[-1].scene_signature:
            raise StaleError(
                "the render shows another state of the scene" if rendered else "no such render",
                found=render_sha256[:64],
                expected="the render_sha256 of a review since the last change",
                next_step="call review without arguments first, and look at the picture",
            )
        return Review(render_sha256=render_sha256, findings=tuple(findings))

    request = {"render_sha256": render_sha256, "findings": list(findings)}
    return case.record("review", request, call)


def export(case: Case, *, render_wh: tuple[int, int] = RENDER_WH) -> Export:
    """Write scene.blend, scene.glb, final.png and a render into the case's folder.

    The exported scene is read again: its geometry signature has to be the live scene's.
    TransactionError while a transaction is open.
    """

    def call() -> Export:
        if case.phase == "open":
            raise TransactionError(
                "a transaction is open",
                found=f"transaction {case.transaction}",
                expected="a scene that was committed or rolled back",
                next_step="commit or roll back, then export",
            )
        into = case.folder / EXPORT
        into.mkdir(exist_ok=True)
        step = case.interruption.step
        step(0, 4, "saving and reading the scene")
        with _renderer(case) as renderer:
            with case.live.save_copy() as copy, scratch_folder("legoworld-exporting-") as kept:
                scene = read_live(copy.path, case.live.reader)
                case.note(scene)
                unguarded = case.unguarded_changes(scene.state)
                step(1, 4, "writing scene.blend and scene.glb")
                warnings = export_submission(
                    copy.keep(kept),
                    into,
                    workspace=copy.workspace,
                    place=copy.folder,
                    limits=_EXPORT_LIMITS,
                    protections=protections("auto"),
                    blender=renderer,
                )
            step(2, 4, "reading the exported scene")
            _refuse_other_geometry(read_live(into / BLEND, case.live.reader), scene)
            step(3, 4, "rendering 1920 x 1080" if render_wh == RENDER_WH else "rendering")
            png = render_copy(into / BLEND, renderer, render_wh, samples=_SAMPLES, denoise=True)
        with atomic_path(into / RENDER) as temporary:
            temporary.write_bytes(png)
        if unguarded:
            edits = f"edits without a transaction since the last one: {told_changes(unguarded)}"
            warnings = [*warnings, edits]
        return Export(files=_hashes(into), warnings=tuple(warnings))

    return case.record("export", {"render_wh": list(render_wh)}, call)


def _refuse_other_geometry(exported_scene: LiveScene, scene: LiveScene) -> None:
    signature = exported_scene.state.geometry_signature
    if signature != scene.state.geometry_signature or signature == NOTHING:
        raise SceneInvalidError(
            "the exported scene is not the live one",
            found=signature,
            expected=scene.state.geometry_signature,
            next_step="keep the live scene, and save it from Blender",
        )


def _hashes(folder: Path) -> dict[str, str]:
    return {path.name: sha256_of_file(path) for path in sorted(folder.iterdir())}
