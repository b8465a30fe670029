"""What the answers of four APIs say they used, while they pass: streamed (SSE) or whole.

Messages (Anthropic), Responses and Chat Completions (OpenAI), generateContent (Gemini).
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any, Final

import msgspec

from legoworld.files import Json
from legoworld.records.agents import Wire

_PATHS: Final[dict[Wire, re.Pattern[str]]] = {
    "messages": re.compile(r"/messages$"),
    "responses": re.compile(r"/responses$"),
    "chat": re.compile(r"/chat/completions$"),
    "gemini": re.compile(r":(stream)?[gG]enerateContent$"),
}
#: The numbers that sum to prompt, cached and completion tokens; a dot leads into a table.
_SUMS: Final[dict[Wire, tuple[tuple[str, ...], ...]]] = {
    "messages": (
        ("input_tokens", "cache_creation_input_tokens", "cache_read_input_tokens"),
        ("cache_read_input_tokens",),
        ("output_tokens",),
    ),
    "responses": (
        ("input_tokens",), ("input_tokens_details.cached_tokens",), ("output_tokens",),
    ),
    "chat": (
        ("prompt_tokens",), ("prompt_tokens_details.cached_tokens",), ("completion_tokens",),
    ),
    "gemini": (
        ("promptTokenCount", "toolUsePromptTokenCount"),
        ("cachedContentTokenCount",),
        ("candidatesTokenCount", "thoughtsTokenCount"),
    ),
}  # fmt: skip


def wire_of(path: str) -> Wire | None:
    """The API that a request's path asks for an answer of a model; None for any other request."""
    return next((wire for wire, pattern in _PATHS.items() if pattern.search(path)), None)


class AnswerReader:
    """Reads the model's name and the tokens out of an answer, piece by piece."""

    def __init__(self, wire: Wire, *, streamed: bool) -> None:
        self._wire, self._streamed = wire, streamed
        self._rest = b""
        self._usage: dict[str, Any] = {}
        self.model: str | None = None

    def feed(self, data: bytes) -> None:
        """Take the next bytes."""
        self._rest += data
        if self._streamed:
            *lines, self._rest = self._rest.split(b"\n")
            for line in lines:
                if line.startswith(b"data:"):
                    self._note(line[5:])

    def tokens(self, *, whole: bool) -> tuple[int | None, int | None, int | None]:
        """Prompt, cached and completion tokens; null where the answer does not state them.

        whole: whether the answer came to its end; of a cut one the completion is not known.
        """
        if whole and not self._streamed:
            self._note(self._rest)
        prompt, cached, completion = (self._sum(names) for names in _SUMS[self._wire])
        if cached is None and prompt is not None:
            cached = 0
        return prompt, cached, completion if whole else None

    def _note(self, text: bytes) -> None:
        try:
            value = msgspec.json.decode(text)
        except (msgspec.DecodeError, UnicodeDecodeError):
            return  # such as [DONE]
        for event in value if isinstance(value, list) else [value]:
            if isinstance(event, dict):
                self._event(event)

    def _event(self, event: Mapping[str, Json]) -> None:
        inner = [one for key in ("message", "response") if isinstance(one := event.get(key), dict)]
        about = inner[0] if inner else event
        name = about.get("model") or about.get("modelVersion")
        self.model = name if isinstance(name, str) else self.model
        usage = about.get("usage") or about.get("usageMetadata")
        if isinstance(usage, dict):
            stated = {key: value for key, value in usage.items() if value is not None}
            if event.get("type") == "message_start":
                stated.pop("output_tokens", None)  # of what was not made yet: 1
            self._usage |= stated

    def _sum(self, names: tuple[str, ...]) -> int | None:
        values = [value for name in names if isinstance(value := self._value(name), int)]
        if values or (self._wire == "gemini" and self._usage):  # it leaves zeros out
            return sum(values)
        return None

    def _value(self, name: str) -> Any:
        value: Any = self._usage
        for key in name.split("."):
            value = value.get(key) if isinstance(value, dict) else None
        return value
