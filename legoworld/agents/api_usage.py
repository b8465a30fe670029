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

_PATHS: Final[dict[Wire, str]] = {
    "messages": r"/messages$",
    "responses": r"/responses$",
    "chat": r"/chat/completions$",
    "gemini": r":(streamG|g)enerateContent$",
}
#: The numbers that sum to prompt, cached and completion tokens; a dot leads into a table.
_SUMS: Final[dict[Wire, tuple[str, str, str]]] = {
    "messages": (
        "input_tokens cache_creation_input_tokens cache_read_input_tokens",
        "cache_read_input_tokens", "output_tokens",
    ),
    "responses": ("input_tokens", "input_tokens_details.cached_tokens", "output_tokens"),
    "chat": ("prompt_tokens", "prompt_tokens_details.cached_tokens", "completion_tokens"),
    "gemini": (
        "promptTokenCount toolUsePromptTokenCount", "cachedContentTokenCount",
        "candidatesTokenCount thoughtsTokenCount",
    ),
}  # fmt: skip
_Tokens = int | None


def request_api(path: str) -> Wire | None:
    """The API that a request's path asks for an answer of a model; None for any other request."""
    return next((wire for wire, pattern in _PATHS.items() if re.search(pattern, path)), None)


class AnswerReader:
    """Reads the model's name and the tokens out of an answer, piece by piece."""

    def __init__(self, wire: Wire, *, streamed: bool) -> None:
        self._wire: Wire = wire
        self._is_stream = streamed
        self._partial_line = b""
        self._usage: dict[str, Any] = {}
        self.model: str | None = None

    def feed(self, data: bytes) -> None:
        """Take the next bytes."""
        self._partial_line += data
        if self._is_stream:
            *lines, self._partial_line = self._partial_line.split(b"\n")
            for line in lines:
                self._note(line.removeprefix(b"data:"))

    def tokens(self, *, whole: bool) -> tuple[_Tokens, _Tokens, _Tokens]:
        """Prompt, cached and completion tokens; null where the answer does not state them.

        whole: whether the answer came to its end; of a cut one the completion is not known.
        """
        if whole and not self._is_stream:
            self._note(self._partial_line)
        prompt, cached, completion = (self._sum(names.split()) for names in _SUMS[self._wire])
        return prompt, None if prompt is None else cached or 0, completion if whole else None

    def _note(self, text: bytes) -> None:
        try:
            value = msgspec.json.decode(text)
        except (msgspec.DecodeError, UnicodeDecodeError):
            return  # `event: ...`, [DONE]
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
            unmade = "output_tokens" if event.get("type") == "message_start" else ""
            self._usage |= {k: v for k, v in usage.items() if v is not None and k != unmade}

    def _sum(self, names: list[str]) -> int | None:
        values = [value for name in names if isinstance(value := self._value(name), int)]
        zero = self._wire == "gemini" and self._usage  # which leaves zeros out
        return sum(values) if values or zero else None

    def _value(self, name: str) -> Any:
        value: Any = self._usage
        for key in name.split("."):
            value = value.get(key) if isinstance(value, dict) else None
        return value
