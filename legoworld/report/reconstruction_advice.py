"""What a bench case says of one submission: its checks, flags, objects, camera, and numbers."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

from legoworld.records.base import UNSET
from legoworld.records.reconstruction import (
    COMPARED,
    CameraError,
    Flag,
    ObjectRow,
    ReconstructionRow,
)
from legoworld.records.report_page import Advice, CheckLine
from legoworld.records.run_rows import RunRow
from legoworld.records.submission import Validity
from legoworld.report.advice import failure_advice, sorted_advice

#: From here on an object is no finding.
_GOOD_F1: Final = 0.9
#: F at 10 % that is so much above the headline's tells a displaced object from a wrong one.
_NEAR: Final = 0.25
_FOV_DEG: Final = 0.5
#: A step that was tried is told where R gains more.
_GAIN: Final = 0.01

#: V's checks in the order they are made.
_CHECKS: Final = Validity.__struct_fields__

Pairs = list[tuple[str, str]]


def bench_advice(
    row: ReconstructionRow, run_row: RunRow, posed: float | None = None
) -> tuple[Advice, ...]:
    """Everything to say of one submission of a case, what costs score first.

    posed: R of its surfaces as the reference's camera would see them in the scene's own world.
    """
    found = failure_advice(run_row)
    if not found and row.status != COMPARED:
        found.append(Advice(level="bad", what=f"not scored ({row.status}): {row.reason}"))
    found += _checks(row)
    if row.status == COMPARED:
        found += _camera(row.camera) + _alignment_advice(row, posed) + _objects(row)
    found += [_flag(flag) for flag in row.flags]
    warnings = {*row.warnings, *run_row.warnings}
    found += [Advice(level="warn", what=str(w)) for w in sorted(warnings)]
    return sorted_advice(found)


def check_lines(row: ReconstructionRow) -> tuple[CheckLine, ...]:
    """V's checks in their order; none where the readout recorded none."""
    known = row.validity or {}
    return tuple(
        CheckLine(
            name=name.replace("_", "."),
            ok=check.ok,
            found=check.found or "",
            expected=check.expected or "",
            next_step=check.next_step or "",
        )
        for name, check in ((name, known[name]) for name in _CHECKS if name in known)
    )


def bench_facts(row: ReconstructionRow, run_row: RunRow) -> Pairs:
    """Scores, diagnostics, cameras and files as name and text."""
    found: Pairs = [("status", row.status)]
    names = {"V": int(row.valid), "R": row.R, "A": row.A, "S": row.S}
    found += [(name, _number(value)) for name, value in names.items()]
    found += [(name, _number(value)) for name, value in row.R_at.items()]
    found += list(_appearance(row)) + list(_diagnostics(row)) + list(_cameras(row, run_row))
    for name, file in (("surface", run_row.surface), ("render", run_row.render)):
        if file is not UNSET:
            found.append((f"{name}, {file.bytes:,} bytes", f"sha256 {file.sha256}"))
    if run_row.integrity is not UNSET:
        facts = run_row.integrity
        text = (
            f"{len(facts.images)} image textures, {facts.drivers} drivers, {len(facts.texts)} texts"
        )
        found.append(("in the scene", text))
    return found


def _checks(row: ReconstructionRow) -> list[Advice]:
    return [
        Advice(
            level="bad",
            what=f"not valid, {line.name}: {line.found}; expected {line.expected}",
            do=line.next_step,
        )
        for line in check_lines(row)
        if not line.ok
    ]


def _objects(row: ReconstructionRow) -> list[Advice]:
    """The objects that R loses on, the worst first."""
    counted = [(k, o) for k, o in enumerate(row.objects) if o.eligible and o.f1 < _GOOD_F1]
    counted.sort(key=lambda one: (one[1].f1, one[0]))
    return [_object(k, scored) for k, scored in counted]


def _object(place: int, scored: ObjectRow) -> Advice:
    shares = f"precision {scored.precision:.2f}, recall {scored.recall:.2f}"
    farther, do = scored.at.get("F10"), ""
    if not scored.n_submitted:
        what, do = f"{scored.name}: nothing stands where it is seen", "build it, or move it there"
    else:
        what = f"{scored.name}: F {scored.f1:.2f} ({shares})"
        if farther is not None and farther.f1 - scored.f1 > _NEAR:
            do = f"near: F {farther.f1:.2f} at 10 % of its depth; move it by a little"
    return Advice(level="warn" if scored.f1 > 1 / 2 else "bad", what=what, do=do, truths=(place,))


def _camera(camera: CameraError | None) -> list[Advice]:
    found = []
    if camera is not None and camera.fov_deg is not None and abs(camera.fov_deg) > _FOV_DEG:
        found.append(
            Advice(
                level="warn",
                what=f"its field of view is off by {camera.fov_deg:+.1f} degrees",
                do="set the camera to the case's hfov_deg: A renders through the scene's lens",
            )
        )
    return found


def _alignment_advice(row: ReconstructionRow, posed: float | None) -> list[Advice]:
    """The pose, the motion or the scale that R was measured with, where it gains: the best."""
    found, camera = row.diagnostics, row.camera
    if row.R is None or camera is None:
        return []
    steps: list[tuple[float | None, str, str]] = []
    if camera.world_rotation_deg is not None and camera.world_translation_m is not None:
        away = f"{camera.world_rotation_deg:.1f} degrees and {camera.world_translation_m:.2f} m"
        by = f"seen from the reference camera's pose, {away} from its own"
        steps.append((posed, by, "correct the camera's pose by as much"))
    if found is not None and (moved := camera.registration):
        by = f"moved by {moved.rotation_deg:.1f} degrees and {moved.translation_m:.2f} m"
        steps.append((found.R_rigid, by, "correct the camera's pose, or the whole scene's"))
    if found is not None:
        by = "scaled to the reference's median depth"
        steps.append((found.R_median_scale, by, "scale the scene about its camera"))
    gains = [(r, by, do) for r, by, do in steps if r is not None and r - row.R > _GAIN]
    return [
        Advice(level="warn", what=f"R {row.R:.3f} would be {r:.3f} with the surfaces {by}", do=do)
        for r, by, do in sorted(gains, key=lambda gain: -gain[0])[:1]
    ]


def _flag(flag: Flag) -> Advice:
    kind = flag.kind.replace("_", " ")
    measured = f"{flag.measured:.3g}, flagged from {flag.threshold:g}"
    return Advice(
        level="warn",
        what=f"flag, {kind}: {flag.what} ({measured})",
        do="for a person to look at: it changes no score",
    )


def _appearance(row: ReconstructionRow) -> Iterator[tuple[str, str]]:
    seen = row.appearance
    if seen is None:
        return
    yield "pixels of A", f"{seen.n_hits:,} of {seen.n_px:,} within the tolerance"
    yield (
        "A where geometry agrees",
        f"{_number(seen.where_geometry_agrees)} over {seen.n_geometry_agrees_px:,} px",
    )
    yield (
        "A where it differs",
        f"{_number(seen.where_geometry_differs)} over {seen.n_geometry_differs_px:,} px",
    )
    deltas = sorted(seen.curve, key=int)  # stored in the order of text
    yield "A by delta", ", ".join(f"{d}: {seen.curve[d]:.3f}" for d in deltas)
    if seen.noise.reference_mean is not None:
        sd = f", sd {seen.noise.reference_sd:.4f}" if seen.noise.reference_sd is not None else ""
        yield "A of the reference itself", f"{seen.noise.reference_mean:.4f}{sd} between seeds"


def _diagnostics(row: ReconstructionRow) -> Iterator[tuple[str, str]]:
    found = row.diagnostics
    for name in found.__struct_fields__ if found else ():
        value = getattr(found, name)
        number = value if value is None or isinstance(value, float) else value.f1
        yield name.replace("_", " "), _number(number)


def _cameras(row: ReconstructionRow, run_row: RunRow) -> Iterator[tuple[str, str]]:
    camera = row.camera
    if camera is not None:
        if camera.fov_deg is not None:
            yield "field of view, error", f"{camera.fov_deg:+.3f} degrees"
        if camera.world_rotation_deg is not None and camera.world_translation_m is not None:
            moved = f"{camera.world_rotation_deg:.2f} degrees, {camera.world_translation_m:.3f} m"
            yield "camera, in each one's world", moved
        if camera.registration is not None:
            r = camera.registration
            text = f"{r.rotation_deg:.2f} degrees, {r.translation_m:.3f} m"
            yield "surfaces, best rigid fit", f"{text}, rms {r.trimmed_rms_m:.3f} m"
    if run_row.camera is not UNSET:
        own = run_row.camera
        lens = "orthographic" if own.hfov_deg is None else f"{own.hfov_deg:.2f} degrees wide"
        clip = f"clip {own.clip_start_m:.3g} to {own.clip_end_m:.4g} m"
        yield "submitted camera", f"{lens}, {clip}"


def _number(value: float | None) -> str:
    return "-" if value is None else f"{value:.4f}" if isinstance(value, float) else str(value)
