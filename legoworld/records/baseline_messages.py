"""What legoworld and a baseline's process say to each other, one line of JSON each.

`CameraEntry`: --intrinsics of a depth import, the pinholes that ray distances were measured from.
"""

from __future__ import annotations

from typing import Annotated, Any

from msgspec import Meta, field

from legoworld.records.base import Record
from legoworld.records.cards import OptionValue
from legoworld.records.track import Pixels


class RequestedImage(Record, frozen=True, kw_only=True):
    """One photo. path: absolute; batch: those of one number are predicted together."""

    image_id: int
    file_name: str
    path: str
    width: int
    height: int
    batch: int


class RequestedCategory(Record, frozen=True, kw_only=True):
    """One category of the vocabulary."""

    id: int
    name: str
    synonyms: tuple[str, ...]


class ChildRequest(Record, frozen=True, kw_only=True):
    """The one request a process is sent.

    label_map: their names to ours, null to leave out; prompts: category ids by image id.
    """

    schema_version: int
    task: str
    images: tuple[RequestedImage, ...]
    categories: tuple[RequestedCategory, ...]
    label_map: dict[str, str | None]
    weights: str
    device: str
    dtype: str
    batch_size: int
    offline: bool
    options: dict[str, OptionValue | None]
    prompts: dict[str, list[int]] | None
    output: str


class Refusal(Record, frozen=True, kw_only=True):
    """Why nothing can be run as asked; the parts of an error."""

    message: str
    found: str | None = None
    expected: str | None = None
    next_step: str | None = None


class DepthSaid(Record, frozen=True, kw_only=True):
    """What a process says of a depth file that it wrote."""

    sha256: str
    size_wh: tuple[int, int]
    space: str
    unit: str | None


class CameraSaid(Record, frozen=True, kw_only=True):
    """A camera that a process recovered: pixels of the photo, origin in its upper left corner."""

    width: Annotated[int, Meta(ge=1)]
    height: Annotated[int, Meta(ge=1)]
    fx: Annotated[float, Meta(gt=0)]
    fy: Annotated[float, Meta(gt=0)]
    cx: float
    cy: float


class Message(Record, frozen=True, kw_only=True):
    """One line of a process: its beginning or refusal, what it works on, an answer, or its end.

    provenance: of the model, once it is loaded; environment: of the machine; predictions, depth,
    camera or failed: of the image; counts: what was counted on the way, by its name.
    """

    provenance: dict[str, Any] | None = None
    environment: dict[str, Any] = field(default_factory=dict)
    refused: Refusal | None = None
    working_on: tuple[int, ...] | None = None
    image_id: int | None = None
    predictions: tuple[dict[str, Any], ...] | None = None
    depth: DepthSaid | None = None
    camera: CameraSaid | None = None
    failed: str | None = None
    counts: dict[str, int] | None = None
    done: bool = False


Focal = Annotated[float, Meta(gt=0)]


class CameraEntry(Record, frozen=True, kw_only=True):
    """A pinhole in pixels. width, height: of the array it is for, where that is another size."""

    fx: Focal
    fy: Focal
    cx: float
    cy: float
    width: Pixels | None = None
    height: Pixels | None = None
