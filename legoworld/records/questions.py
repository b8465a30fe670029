"""Questions about a picture, as a track carries and a page shows them."""

from __future__ import annotations

from typing import Literal

from legoworld.records.base import UNSET, Record, UnsetType

Box = tuple[int | float, int | float, int | float, int | float]
Which = Literal["", "leftmost", "rightmost", "closest", "farthest"]


class Designator(Record, frozen=True, kw_only=True):
    """A thing as a question names it. which: among several of its category."""

    category: str
    which: Which = ""


Kind = Literal["yes_no", "choice", "count", "number", "refer"]
Answered = bool | int | float | str | Box


class Question(Record, frozen=True, kw_only=True):
    """One question about a picture, without its answer.

    kind: of the answer: true or false, one of the options, a whole number, metres, or a box x, y,
    width, height in pixels. relation: what is asked; a, b: the things it names; options: what a
    choice is among. any: whether it holds of any two things of these categories; frame: an object's
    own frame of reference, UNSET for the picture's.
    """

    id: str
    image_id: int
    kind: Kind
    relation: str
    text: str
    a: Designator
    b: Designator | None = None
    options: tuple[Designator, ...] = ()
    any: bool | UnsetType = UNSET
    frame: str | UnsetType = UNSET


class ShownQuestion(Record, frozen=True, kw_only=True):
    """A question as a page shows it. boxes: of the things it names, where they are known."""

    id: str
    text: str
    truth: str
    answer: str
    score: float | None
    boxes: tuple[Box, ...]
