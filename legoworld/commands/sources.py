"""The output of `legoworld inspect --compare-sources`."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

from legoworld import exit_codes
from legoworld.commands.output import Output, table
from legoworld.pluralize import plural, word_for

if TYPE_CHECKING:
    from legoworld.records.scene_folder import InstanceRow
    from legoworld.running.source_comparison import Pair, SourceComparison


def document(comparison: SourceComparison) -> dict[str, Any]:
    """The comparison as a JSON document."""
    from legoworld.records.base import as_json

    return {
        "size_wh": list(comparison.blend.view.size_wh),
        "instances": [asdict(pair) for pair in comparison.pairs],
        "disagreeing": comparison.n_disagreeing,
        "differing_px": comparison.differing_px,
        "unseen": comparison.unseen,
        "lost": as_json(comparison.lost),
        "gained": as_json(comparison.gained),
        "differences": list(comparison.differences),
        "warnings": {
            "blend": list(comparison.blend.warnings),
            "glb": list(comparison.glb.warnings),
        },
        "snapshot_sha256": {
            "blend": comparison.blend.scene.snapshot_sha256,
            "glb": comparison.glb.scene.snapshot_sha256,
        },
    }


def show(comparison: SourceComparison, out: Output) -> int:
    """Print the shared instances, worst first, and other differences; return the exit code."""
    out.show(lambda: document(comparison), _lines(comparison, out))
    return exit_codes.DONE if comparison.faithful else exit_codes.INCOMPLETE


def _lines(found: SourceComparison, out: Output) -> Iterator[str]:
    pairs = found.pairs if out.verbose else found.pairs[: max(40, found.n_disagreeing)]
    rows = [
        (pair.name, _category(pair), pair.blend_area_px, pair.glb_area_px, f"{pair.iou:.5f}")
        for pair in pairs
    ]
    yield table(("instance", "category", ".blend px", ".glb px", "IoU"), rows)
    if len(pairs) < len(found.pairs):
        yield f"... and {len(found.pairs) - len(pairs)} more that agree (-v lists them)"
    width, height = found.blend.view.size_wh
    disagree = word_for(found.n_disagreeing, "disagrees", "disagree")
    yield (
        f"\n{plural(len(found.pairs), 'instance', 'instances')} in both sources at "
        f"{width}x{height}: {found.n_disagreeing} {disagree}; "
        f"{found.unseen} more {word_for(found.unseen, 'is', 'are')} not seen in either; "
        f"{plural(found.differing_px, 'pixel differs', 'pixels differ')}"
    )
    yield from _one_sided("only in scene.blend", found.lost)
    yield from _one_sided("only in scene.glb", found.gained)
    for line in found.differences:
        yield f"differs: {line}"
    for source, inspection in (("scene.blend", found.blend), ("scene.glb", found.glb)):
        for warning in inspection.warnings:
            out.notice(f"warning: {source}: {warning}")


def _category(pair: Pair) -> str:
    blend, glb = pair.blend_category or "-", pair.glb_category or "-"
    return blend if blend == glb else f"{blend} | {glb}"


def _one_sided(where: str, entries: tuple[InstanceRow, ...]) -> Iterator[str]:
    visible = sorted((e for e in entries if e.area_px), key=lambda e: -e.area_px)
    for entry in visible[:20]:
        category = f", {entry.category}" if entry.category else ""
        yield f"{where}: {entry.name!r}{category}, {entry.area_px} px"
    rest = len(entries) - len(visible[:20])
    if rest:
        yield f"{where}: {rest} more, {len(entries) - len(visible)} of them not seen"
