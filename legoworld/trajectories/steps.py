"""Steps while a transcript is read: calls first, what they came back with later.

Each picture of a transcript is a file of its own beside trajectory.json, named by its hash.
"""

from __future__ import annotations

import base64
import hashlib
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final, Literal

from legoworld.files import Json
from legoworld.records.atif import (
    AtifFinalMetrics,
    AtifMetrics,
    AtifObservation,
    AtifResult,
    AtifStep,
    AtifToolCall,
    Content,
)
from legoworld.records.base import UNSET

#: Of a scene folder, relative to its trajectory.json.
PICTURES: Final = "trial/pictures"
#: How base64 begins of what agents look at.
_KINDS: Final = {
    "iVBORw0KGgo": ("image/png", ".png"),
    "/9j/": ("image/jpeg", ".jpg"),
    "UklGR": ("image/webp", ".webp"),
    "R0lGOD": ("image/gif", ".gif"),
}
_SHORTEST: Final = 64
_DATA_URL: Final = re.compile(r"^data:image/[\w.+-]+;base64,")
_BASE64: Final = re.compile(r"[A-Za-z0-9+/]+={0,2}")
#: What a block of a picture holds beside its bytes, in a model's API and in MCP.
_OF_A_BLOCK: Final = {"type", "source", "data", "mimeType", "media_type"}


def without_pictures(value: Json, scene_folder: Path | None = None) -> Json:
    """A JSON value with every picture in base64, in text or as a data URL, as its size and hash.

    scene_folder: where each picture is kept as a file; a block that is one picture is then ATIF's
    part, which names the file. The transcript itself keeps the bytes, too.
    """
    if isinstance(value, dict):
        path = _block_file(value, scene_folder) if scene_folder else None
        if path is not None:
            return path
        return {key: without_pictures(item, scene_folder) for key, item in value.items()}
    if isinstance(value, list):
        return [without_pictures(item, scene_folder) for item in value]
    picture = _picture(value) if isinstance(value, str) else None
    if picture is None:
        return value
    kind, data, name = picture
    if scene_folder:
        _keep(scene_folder, name, data)
    return f"[{kind}, {len(data)} bytes, sha256 {Path(name).stem}]"


def is_picture_file(part: Mapping[str, Json]) -> bool:
    """Whether a part of content is a picture that names its file."""
    source = part.get("source")
    return set(part) == {"type", "source"} and isinstance(source, dict) and "path" in source


def _block_file(block: Mapping[str, Json], scene_folder: Path) -> dict[str, Json] | None:
    """ATIF's part for a block that is one picture and nothing else; None for any other value."""
    source = block.get("source")
    inner = source if isinstance(source, dict) else block
    if block.get("type") != "image" or not (set(block) | set(inner)) <= _OF_A_BLOCK:
        return None
    text = inner.get("data")
    found = _picture(text) if isinstance(text, str) else None
    if found is None:
        return None
    kind, data, name = found
    _keep(scene_folder, name, data)
    return {"type": "image", "source": {"media_type": kind, "path": f"{PICTURES}/{name}"}}


def _picture(value: str) -> tuple[str, bytes, str] | None:
    """Kind, bytes and file name of a text that is a picture."""
    if len(value) < _SHORTEST:
        return None
    text = _DATA_URL.sub("", value)
    kind = next((kind for begin, kind in _KINDS.items() if text.startswith(begin)), None)
    if kind is None or not _BASE64.fullmatch(text) or len(text) % 4:
        return None
    data = base64.b64decode(text)
    return kind[0], data, hashlib.sha256(data).hexdigest() + kind[1]


def _keep(scene_folder: Path, name: str, data: bytes) -> None:
    path = scene_folder / PICTURES / name
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(data)


@dataclass(kw_only=True)
class ParsedStep:
    """One step as far as it was read. extra: what ATIF has no field for."""

    source: Literal["system", "user", "agent"]
    message: Content = ""
    reasoning: str = ""
    calls: list[AtifToolCall] = field(default_factory=list)
    results: list[AtifResult] = field(default_factory=list)
    metrics: AtifMetrics | None = None
    model: str | None = None
    timestamp: str | None = None
    extra: dict[str, Any] = field(default_factory=dict)

    def atif(self, number: int) -> AtifStep:
        """The step with its number."""
        acting = self.source == "agent"
        return AtifStep(
            step_id=number,
            source=self.source,
            message=self.message,
            timestamp=self.timestamp or UNSET,
            model_name=(self.model or UNSET) if acting else UNSET,
            reasoning_content=(self.reasoning or UNSET) if acting else UNSET,
            tool_calls=(self.calls or UNSET) if acting else UNSET,
            observation=AtifObservation(results=self.results) if self.results else UNSET,
            metrics=(self.metrics or UNSET) if acting else UNSET,
            extra=self.extra or UNSET,
        )


@dataclass(kw_only=True)
class ParsedTranscript:
    """A transcript as far as it was read."""

    steps: list[ParsedStep] = field(default_factory=list)
    session_id: str | None = None
    model: str | None = None
    notes: str | None = None
    total: AtifFinalMetrics | None = None

    def keep_unknown(self, event: Json) -> None:
        """Keep an event without a matching field, or a line that is not an event."""
        if isinstance(event, dict):
            kind = str(event.get("type", "event"))
            self.steps.append(ParsedStep(source="system", message=kind, extra={"event": event}))
        else:
            self.steps.append(ParsedStep(source="system", message=str(event)))


def parse_arguments(value: Json) -> dict[str, Any]:
    """A call's arguments as an object; any other value is stored under one key."""
    if isinstance(value, dict):
        return value
    return {} if value is None else {"value": value}


def remaining_fields(event: Mapping[str, Json], *lifted: str) -> dict[str, Any]:
    """An event without the named keys."""
    return {key: value for key, value in event.items() if key not in lifted}


def parse_content(value: Json) -> Content | None:
    """Text, or a list of parts, as ATIF has it. Pictures are files, which parts name.

    A part of MCP or of a model's API is turned into ATIF's: {"type": "text", "text": ...}.
    """
    if value is None or isinstance(value, str):
        return value
    if not isinstance(value, list):
        return [{"type": "text", "text": _as_text(value)}]
    parts = [part if isinstance(part, dict) else {"type": "text", "text": part} for part in value]
    if all(part.get("type") == "text" and set(part) <= {"type", "text"} for part in parts):
        return "\n".join(str(part["text"]) for part in parts)
    return [
        part
        if is_picture_file(part)
        else {"type": "text", "text": str(part["text"])}
        if part.get("type") == "text"
        else {"type": "text", "text": _as_text(part)}
        for part in parts
    ]


def _as_text(value: Json) -> str:
    import json

    return json.dumps(value, ensure_ascii=False, sort_keys=True)
