"""The alpha rules of all materials met on a walk, each read once."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Final

import bpy
import numpy as np
from numpy.typing import NDArray

from legoworld.scene.blender.alpha_values import ImageSource
from legoworld.scene.blender.materials import (
    AlphaRule,
    ImageAlpha,
    baked,
    image_value,
    material_rule,
)

_OPAQUE: Final = 0
_GONE: Final = 1
_HOLDOUT: Final = 2
_FIRST_IMAGE: Final = 3


@dataclass(kw_only=True)
class AlphaTable:
    """Numbers for alpha rules: 0 opaque, 1 not there, 2 a holdout, 3 + i the i-th of `images`."""

    images: list[ImageAlpha] = field(default_factory=list)
    pictures: list[NDArray[np.uint8]] = field(default_factory=list)
    _by_material: dict[int, int] = field(default_factory=dict)

    def index(self, material: Any, warnings: set[str]) -> int:
        """The number of a material's rule; warnings grow by what could not be read."""
        if material is None:
            return _OPAQUE
        original = material.original
        key = original.as_pointer()
        if key not in self._by_material:
            rule, unread = material_rule(original)
            warnings.update(unread)
            self._by_material[key] = self._number(rule, original.name, warnings)
        return self._by_material[key]

    def image_of(self, rules: NDArray[np.int32]) -> NDArray[np.int32]:
        """Index into `images` for each rule's number, -1 for none."""
        return np.where(rules >= _FIRST_IMAGE, rules - _FIRST_IMAGE, -1).astype(np.int32)

    @staticmethod
    def is_there(rules: NDArray[np.int32]) -> NDArray[np.bool_]:
        """Which rules' numbers leave something to be seen."""
        there: NDArray[np.bool_] = (rules != _GONE) & (rules != _HOLDOUT)
        return there

    @staticmethod
    def is_holdout(rules: NDArray[np.int32]) -> NDArray[np.bool_]:
        """Which rules' numbers stand for a holdout."""
        holdout: NDArray[np.bool_] = rules == _HOLDOUT
        return holdout

    def sort_key(self, image: int) -> str:
        """Orders the entries of `images` without regard to the order they were met in."""
        return repr(self.images[image])

    def _number(self, rule: AlphaRule, material: str, warnings: set[str]) -> int:
        if isinstance(rule, str):
            return {"there": _OPAQUE, "gone": _GONE, "holdout": _HOLDOUT}[rule]
        if rule in self.images:
            return _FIRST_IMAGE + self.images.index(rule)
        image = _find_image(rule.source)
        value = image_value(image, rule.source) if image is not None else None
        if value is None:
            warnings.add(
                f"material {material!r}: the alpha image {rule.source.image!r} is missing; "
                "its surface is taken as opaque"
            )
            return _OPAQUE
        self.images.append(rule)
        self.pictures.append(baked(value, rule))
        return _FIRST_IMAGE + len(self.images) - 1


def _find_image(source: ImageSource) -> Any:
    for image in bpy.data.images:
        if (image.name, image.library.filepath if image.library else "") == (
            source.image,
            source.library,
        ):
            return image
    return None
