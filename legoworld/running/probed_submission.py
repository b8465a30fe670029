"""What a private probe sees of a submission: moved samples, a second view, surface in boxes."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from msgspec.structs import replace as with_fields
from numpy.typing import NDArray

from legoworld.conventions import TAKEN_AS_OPAQUE
from legoworld.files import write_npz
from legoworld.readouts.probing import (
    box_samples,
    looks,
    probe_boxes,
    second_stand,
    surface_disagreement,
)
from legoworld.readouts.surface import VisibleSurface
from legoworld.records.run_rows import RunRow
from legoworld.records.submission import ProbedFile, RenderFile
from legoworld.records.track import Probe
from legoworld.running.submission import (
    BenchRules,
    card_render,
    card_size,
    describe_file,
    field_values,
    write_render,
)
from legoworld.scene.open_scene import OpenedScene
from legoworld.scene.snapshot import Snapshot
from legoworld.visibility.view import surfaces_through


def read_probe(
    row: RunRow,
    snapshot: Snapshot,
    surface: VisibleSurface,
    hfov_deg: float,
    probe: Probe,
    scene: OpenedScene,
    rules: BenchRules,
    run: Path,
    threads: int,
) -> RunRow:
    """Write the probe's files; the row with them. Raises the verdicts of a Blender process."""
    assert row.size_wh is not None
    arrays: dict[str, NDArray[Any]] = {
        f"{look.name}_depth_z_m": surfaces_through(
            look.projection, look.snapshot, surface.raster_wh, threads=threads
        ).depth_z_m
        for look in looks(snapshot, row.size_wh, hfov_deg, probe)
    }
    samples = box_samples(snapshot, probe_boxes(probe))
    arrays["points_m"] = np.concatenate([*samples, np.zeros((0, 3), np.float32)])
    arrays["point_object"] = np.repeat(
        np.arange(len(samples), dtype=np.int32), [len(points) for points in samples]
    )
    name = f"probe/{row.scene}.npz"
    write_npz(run / name, arrays)
    file = ProbedFile(
        **field_values(describe_file(run, name)),
        render=_second_render(row, snapshot, hfov_deg, probe, scene, rules, run, threads),
        surface_differs=_disagreement(snapshot, surface, scene, rules, threads),
        unreadable_alpha=sum(text.endswith(TAKEN_AS_OPAQUE) for text in snapshot.warnings),
    )
    return with_fields(row, probe=file)


def _second_render(
    row: RunRow,
    snapshot: Snapshot,
    hfov_deg: float,
    probe: Probe,
    scene: OpenedScene,
    rules: BenchRules,
    run: Path,
    threads: int,
) -> RenderFile | None:
    if rules.card is None or probe.view is None:
        return None
    assert row.size_wh is not None
    size_wh = card_size(row.size_wh, rules.card.longest_side_px)
    wanted = replace(
        card_render(rules.card, size_wh, rules.card.seed, threads),
        stand=second_stand(snapshot, probe.view, hfov_deg),
    )
    return write_render(run, f"probe/{row.scene}.png", scene.render(wanted), size_wh, rules.card)


def _disagreement(
    snapshot: Snapshot,
    surface: VisibleSurface,
    scene: OpenedScene,
    rules: BenchRules,
    threads: int,
) -> float | None:
    """Cycles against the kernel at the scoring raster, both through the submission's own camera."""
    if rules.card is None or snapshot.camera.type != "PERSP":
        return None
    wanted = card_render(rules.card, surface.raster_wh, rules.card.seed, threads)
    met = scene.first_hits(wanted, snapshot)
    depth, shown = surface.depth_z_m, surface.surface_index
    if surface.own_depth_z_m is not None and surface.own_shown is not None:
        depth, shown = surface.own_depth_z_m, surface.own_shown
    occurrence = snapshot.occurrence_object[snapshot.surface_occurrence]
    ours = np.where(shown < 0, -1, np.append(met.place[occurrence], -1)[shown])
    return surface_disagreement(depth, met.depth_z_m, ours, met.object, rules.disagreement)
