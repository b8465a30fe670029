"""Pictures of label maps: a hue for each category, things of one category in several shades."""

from __future__ import annotations

import colorsys
from collections.abc import Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from legoworld.readouts.label_maps import NO_CLASS
from legoworld.readouts.pictures import Rgb

#: The golden ratio, and the two of the plane (Roberts, 2018).
_STEPS: Final = (0.618034, 0.569840, 0.754878)
_SHADES: Final = (1.0, 0.72, 0.86, 0.58)
_VOID_RGB: Final = (0, 0, 0)
_EDGE_RGB: Final = (255, 255, 255)
_RIGHT_RGB: Final = (70, 130, 180)
_WRONG_RGB: Final = (200, 60, 40)


def segment_picture(place: NDArray[Any], category_ids: Sequence[int]) -> Rgb:
    """Segments in their categories' hues, with white lines between them; VOID is black.

    place: (H, W), 0 for VOID, or 1 + the place of a segment's category in `category_ids`.
    """
    nth: dict[int, int] = {}
    colors: list[tuple[int, int, int]] = [_VOID_RGB]
    for number in category_ids:
        turn = nth[number] = nth.get(number, -1) + 1
        colors.append(category_color(number, _SHADES[turn % len(_SHADES)]))
    picture: Rgb = np.array(colors, np.uint8)[place]
    picture[_between(place)] = _EDGE_RGB
    return picture


def category_picture(categories: NDArray[Any]) -> Rgb:
    """(H, W, 3) of (H, W) categories: each in its hue; black where there is none."""
    colors = [category_color(number) for number in range(256)]
    colors[NO_CLASS] = _VOID_RGB
    picture: Rgb = np.array(colors, np.uint8)[categories]
    return picture


def picture_categories(picture: Rgb, category_ids: Sequence[int]) -> NDArray[np.int64]:
    """(H, W) categories of a (H, W, 3) picture of either kind: -1 where black, -2 on a line."""
    packed = picture.astype(np.int64) @ [1 << 16, 1 << 8, 1]
    known = {0: -1}
    for number in category_ids:
        for r, g, b in (category_color(number, shade) for shade in _SHADES):
            known[r << 16 | g << 8 | b] = number
    colors, numbers = (np.array(of, np.int64) for of in zip(*sorted(known.items()), strict=True))
    place = np.minimum(np.searchsorted(colors, packed), len(colors) - 1)
    return np.where(colors[place] == packed, numbers[place], -2)


def agreement_picture(truth: NDArray[Any], answer: NDArray[Any], counted: NDArray[np.bool_]) -> Rgb:
    """Blue where two (H, W) maps of categories agree, red where not, black where not counted."""
    colors = np.array([_VOID_RGB, _WRONG_RGB, _RIGHT_RGB], np.uint8)
    picture: Rgb = colors[np.where(counted, np.where(truth == answer, 2, 1), 0)]
    return picture


def category_color(number: int, shade: float = 1.0) -> tuple[int, int, int]:
    """A category's colour: neighbouring ids, and ids of one hue, differ in the other two parts."""
    hue, saturation, value = (number * step % 1.0 for step in _STEPS)
    r, g, b = colorsys.hsv_to_rgb(hue, 0.45 + 0.45 * saturation, (0.6 + 0.4 * value) * shade)
    return round(r * 255), round(g * 255), round(b * 255)


def _between(numbers: NDArray[Any]) -> NDArray[np.bool_]:
    """Pixels whose right or lower neighbour is of another segment."""
    edges = np.zeros(numbers.shape, bool)
    edges[:, :-1] |= numbers[:, 1:] != numbers[:, :-1]
    edges[:-1] |= numbers[1:] != numbers[:-1]
    return edges
