"""The alpha rules of all materials in a walk, each read once, and their cut-outs."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Final

import bpy
import numpy as np
from numpy.typing import NDArray

from legoworld.scene.blender.alpha_images import ImageSource
from legoworld.scene.blender.alpha_values import ProductSource
from legoworld.scene.blender.materials import (
    AlphaRule,
    AttributeAlpha,
    ImageAlpha,
    OneSided,
    SidedAlpha,
    bake_alpha,
    image_value,
    material_rule,
)
from legoworld.scene.blender.objects import identity
from legoworld.scene.snapshot import Sides

_OPAQUE: Final = 0
_GONE: Final = 1
_HOLDOUT: Final = 2
_FIRST: Final = 3
_WHOLE: Final = {"there": _OPAQUE, "gone": _GONE, "holdout": _HOLDOUT}


@dataclass(frozen=True, kw_only=True)
class ImageFactor:
    """gain * the image's value + offset, in 0..1: a factor of alpha, the corners hold the other."""

    source: ImageSource
    gain: float
    offset: float


@dataclass(frozen=True, kw_only=True)
class Cut:
    """What becomes a `Cutout` of the snapshot. image: None where only corners or sides decide."""

    image: ImageAlpha | ImageFactor | None
    sides: Sides


VaryingRule = ImageAlpha | AttributeAlpha | SidedAlpha
"""An alpha rule that is not the same for the whole surface."""


@dataclass(kw_only=True)
class AlphaTable:
    """Numbers for alpha rules: 0 opaque, 1 not there, 2 a holdout, 3 + i the i-th of `rules`.

    Materials whose rules are equal share a number. cuts, pictures: what triangles are cut by, with
    its (H, W) uint8 alpha.
    """

    rules: list[VaryingRule] = field(default_factory=list)
    cuts: list[Cut] = field(default_factory=list)
    pictures: list[NDArray[np.uint8]] = field(default_factory=list)
    _by_material: dict[int, int] = field(default_factory=dict)
    _values: dict[ImageSource, NDArray[np.float32] | None] = field(default_factory=dict)

    def index(self, material: bpy.types.Material, warnings: set[str]) -> int:
        """The number of a material's rule; warnings grow by what could not be read."""
        if material is None:
            return _OPAQUE
        original = material.original
        key = original.as_pointer()
        if key not in self._by_material:
            rule, unread = material_rule(original)
            warnings.update(unread)
            self._by_material[key] = self._number(self._with_images(rule, original.name, warnings))
        return self._by_material[key]

    def find_rule(self, number: int) -> VaryingRule | None:
        """The rule behind a number; None for a constant."""
        return self.rules[number - _FIRST] if number >= _FIRST else None

    def cut_number(self, cut: Cut) -> int:
        """Index into `cuts`; its picture is made on first sight."""
        if cut not in self.cuts:
            self.cuts.append(cut)
            self.pictures.append(self._picture(cut))
        return self.cuts.index(cut)

    @staticmethod
    def is_there(rules: NDArray[np.int32]) -> NDArray[np.bool_]:
        """Which rules' numbers leave something visible."""
        there: NDArray[np.bool_] = (rules != _GONE) & (rules != _HOLDOUT)
        return there

    @staticmethod
    def is_holdout(rules: NDArray[np.int32]) -> NDArray[np.bool_]:
        """Which rules' numbers stand for a holdout."""
        holdout: NDArray[np.bool_] = rules == _HOLDOUT
        return holdout

    def sort_key(self, cut: int) -> str:
        """Sort key for `cuts` that does not depend on the order of discovery."""
        return repr(self.cuts[cut])

    def _number(self, rule: AlphaRule) -> int:
        if isinstance(rule, str):
            return _WHOLE[rule]
        if rule not in self.rules:
            self.rules.append(rule)
        return _FIRST + self.rules.index(rule)

    def _with_images(self, rule: AlphaRule, material: str, warnings: set[str]) -> AlphaRule:
        """The rule with what a missing image would decide taken as opaque."""
        if not isinstance(rule, SidedAlpha):
            return self._with_image(rule, material, warnings)
        front = self._with_image(rule.front, material, warnings)
        back = self._with_image(rule.back, material, warnings)
        return front if front == back else SidedAlpha(front=front, back=back)

    def _with_image(self, rule: OneSided, material: str, warnings: set[str]) -> OneSided:
        source = None if isinstance(rule, str) else rule.source
        if isinstance(source, ProductSource):
            source = source.image
        if not isinstance(source, ImageSource) or self._value(source) is not None:
            return rule
        warnings.add(
            f"material {material!r}: the alpha image {source.image!r} is missing; "
            "its surface is taken as opaque"
        )
        return "there"

    def _value(self, source: ImageSource) -> NDArray[np.float32] | None:
        if source not in self._values:
            image = _find_image(source)
            self._values[source] = image_value(image, source) if image is not None else None
        return self._values[source]

    def _picture(self, cut: Cut) -> NDArray[np.uint8]:
        if cut.image is None:
            return np.full((1, 1), 255, np.uint8)
        value = self._value(cut.image.source)
        assert value is not None
        if isinstance(cut.image, ImageAlpha):
            return bake_alpha(value, cut.image)
        share = cut.image.gain * value.astype(np.float64) + cut.image.offset
        return np.asarray(np.rint(np.clip(share, 0.0, 1.0) * 255.0), np.uint8)


def _find_image(source: ImageSource) -> Any:
    for image in bpy.data.images:
        if identity(image) == (source.image, source.library):
            return image
    return None
