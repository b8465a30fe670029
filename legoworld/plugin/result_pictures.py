"""A small picture of each measurement: the entity, what it was measured against, the region."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

import numpy as np
from numpy.typing import NDArray

from legoworld.plugin.entities import Entities
from legoworld.plugin.evidence import Evidence
from legoworld.plugin.measure import surface_pixels, surface_view
from legoworld.plugin.residuals import outline
from legoworld.plugin.small_render import rec709_luma
from legoworld.plugin.state import LiveScene
from legoworld.readouts.pictures import Rgb
from legoworld.records.base import as_json
from legoworld.records.plugin_requirements import Report, Requirement
from legoworld.visibility.kernel import Buffers

Mask = NDArray[np.bool_]

_LONGEST_PX: Final = 240
_MARGIN: Final = 0.25
_ENTITY_RGB: Final = (40, 120, 255)
_OTHER_RGB: Final = (60, 190, 90)
_REGION_RGB: Final = (255, 120, 0)


def result_pictures(
    scene: LiveScene, evidence: Evidence | None, report: Report
) -> list[Rgb | None]:
    """One for each result: at most 240 pixels long, around what was measured.

    The photo in grey, or the scene's depth without it; on it the entity in blue, what it is
    measured against in green, and the outline of the region in orange. None where nothing of these
    is in the picture.
    """
    if not isinstance(scene.reading, BaseException):
        view = _View(scene, evidence, report.size_wh)
        return [view.picture(result.requirement) for result in report.results]
    return [None] * len(report.results)


class _View:
    def __init__(
        self, scene: LiveScene, evidence: Evidence | None, size_wh: tuple[int, int]
    ) -> None:
        self._entities = Entities(scene.snapshot)
        self._buffers = surface_view(scene, size_wh)
        self._evidence = evidence
        photo = evidence.photo if evidence else None
        self._ground = _gray(photo) if photo is not None else _shade_depth(self._buffers)

    def picture(self, requirement: Requirement) -> Rgb | None:
        drawn = self._ground.copy()
        shown = np.zeros(drawn.shape[:2], bool)
        first, *others = _names(requirement) or [""]
        for names, rgb in ((others, _OTHER_RGB), ([first], _ENTITY_RGB)):
            for name in names:
                surfaces = self._entities.surfaces(name)
                if surfaces is None:
                    continue
                mask = surface_pixels(surfaces, self._buffers)
                shown |= mask
                drawn[mask] = drawn[mask] // 3 + np.array(rgb, np.uint8) // 3 * 2
        for name in _regions(requirement):
            if self._evidence and (region := self._evidence.region(name)) is not None:
                mask = self._evidence.mask(region)
                shown |= mask
                drawn[_thick(outline(mask))] = _REGION_RGB
        return _crop_picture(drawn, shown) if shown.any() else None


def _names(requirement: Requirement) -> list[str]:
    """Entities, the one that is measured first."""
    fields = as_json(requirement)
    named = [fields.get(key) for key in ("entity", "on", "inside", "other", "towards")]
    named += fields.get("entities", [])
    named += [entity for entity, _ in fields.get("matched", [])]
    return list(dict.fromkeys(name for name in named if name))


def _regions(requirement: Requirement) -> Iterator[str]:
    fields = as_json(requirement)
    if "region" in fields:
        yield fields["region"]
    for _, region in fields.get("matched", []):
        yield region


def _gray(photo: Rgb) -> Rgb:
    gray = np.rint(255 * rec709_luma(photo)).astype(np.uint8)
    return np.repeat(gray[..., None], 3, axis=2)


def _shade_depth(buffers: Buffers) -> Rgb:
    """Depth as grey levels: near is light, background black."""
    finite = np.isfinite(buffers.depth_z_m) & (buffers.depth_z_m > 0)
    inverse = np.zeros(buffers.depth_z_m.shape)
    inverse[finite] = 1.0 / buffers.depth_z_m[finite]
    top = float(inverse.max()) or 1.0
    gray = np.where(finite, 60 + 160 * inverse / top, 0).astype(np.uint8)
    return np.repeat(gray[..., None], 3, axis=2)


def _thick(line: Mask) -> Mask:
    grown = line.copy()
    grown[1:] |= line[:-1]
    grown[:, 1:] |= line[:, :-1]
    return grown


def _crop_picture(picture: Rgb, shown: Mask) -> Rgb:
    """Around what is shown with a margin, scaled down to 240 pixels; never scaled up."""
    import cv2

    rows, columns = np.flatnonzero(shown.any(axis=1)), np.flatnonzero(shown.any(axis=0))
    margin = round(_MARGIN * max(rows[-1] - rows[0], columns[-1] - columns[0])) + 8
    top, left = max(0, rows[0] - margin), max(0, columns[0] - margin)
    part = picture[top : rows[-1] + margin + 1, left : columns[-1] + margin + 1]
    shrink = min(1.0, _LONGEST_PX / max(part.shape[:2]))
    size = max(1, round(part.shape[1] * shrink)), max(1, round(part.shape[0] * shrink))
    return np.asarray(cv2.resize(part, size, interpolation=cv2.INTER_AREA), np.uint8)
