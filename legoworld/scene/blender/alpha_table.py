"""The alpha rules of all materials met on a walk, each read once."""

from __future__ import annotations

from dataclasses import astuple, dataclass, field
from typing import Any

import bpy
import numpy as np
from numpy.typing import NDArray

from legoworld.conventions import ALPHA_THRESHOLD
from legoworld.scene.blender.materials import ImageAlpha, image_alpha, material_alpha

_OPAQUE, _GONE, _FIRST_IMAGE = 0, 1, 2


@dataclass(kw_only=True)
class AlphaTable:
    """Numbers for alpha rules: 0 opaque, 1 not there, 2 + i the i-th of `images`."""

    images: list[ImageAlpha] = field(default_factory=list)
    pictures: list[NDArray[np.uint8]] = field(default_factory=list)
    _by_material: dict[tuple[str, str], int] = field(default_factory=dict)

    def index(self, material: Any, warnings: set[str]) -> int:
        """The number of a material's rule; warnings grow by what could not be read."""
        if material is None:
            return _OPAQUE
        original = material.original
        key = (original.name, original.library.filepath if original.library else "")
        if key not in self._by_material:
            alpha, warning = material_alpha(original)
            if warning:
                warnings.add(warning)
            self._by_material[key] = self._number(alpha, original.name, warnings)
        return self._by_material[key]

    def per_slot(self, slots: tuple[int, ...]) -> tuple[NDArray[np.int32], NDArray[np.bool_]]:
        """For each slot: index into `images` (-1 for none), and whether its faces are gone."""
        numbers = np.array(slots, np.int32)
        return np.where(numbers >= _FIRST_IMAGE, numbers - _FIRST_IMAGE, -1).astype(
            np.int32
        ), numbers == _GONE

    def sort_key(self, image: int) -> tuple[str, ...]:
        """Orders the entries of `images` without regard to the order they were met in."""
        return tuple(str(value) for value in astuple(self.images[image]))

    def _number(self, alpha: float | ImageAlpha, material: str, warnings: set[str]) -> int:
        if isinstance(alpha, float):
            return _GONE if alpha < ALPHA_THRESHOLD else _OPAQUE
        if alpha in self.images:
            return _FIRST_IMAGE + self.images.index(alpha)
        image = _find_image(alpha)
        picture = image_alpha(image, alpha) if image is not None else None
        if picture is None:
            warnings.add(
                f"material {material!r}: the alpha image {alpha.image!r} is missing; "
                "its surface is taken as opaque"
            )
            return _OPAQUE
        self.images.append(alpha)
        self.pictures.append(picture)
        return _FIRST_IMAGE + len(self.images) - 1


def _find_image(alpha: ImageAlpha) -> Any:
    for image in bpy.data.images:
        library = image.library.filepath if image.library else None
        if (image.name, library) == (alpha.image, alpha.library):
            return image
    return None
