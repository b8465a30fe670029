"""A vocabulary's names as the texts that a zero-shot detector is asked for."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from legoworld_baseline import Refused

#: OWL's authors and its model card ask for "a photo of a cat"; Grounding DINO's for "cat".
DEFAULT_TEMPLATES = {
    "owlvit": "a photo of a {}",
    "owlv2": "a photo of a {}",
    "grounding-dino": "{}",
    "mm-grounding-dino": "{}",
}


@dataclass(frozen=True, kw_only=True)
class Caption:
    """Phrases in one text. columns: which phrases; spans: of each, its characters [begin, end)."""

    text: str
    columns: tuple[int, ...]
    spans: tuple[tuple[int, int], ...]


def phrases(names: Sequence[str], template: str) -> list[str]:
    """One prompt a name, in order. Refused for a template without exactly one {}."""
    if template.count("{}") != 1:
        raise Refused(
            "the template has no placeholder for the name",
            found=f"template={template}",
            expected="one {}, such as 'a photo of a {}'",
            next_step="omit --option template",
        )
    return [template.replace("{}", " ".join(name.replace("_", " ").split())) for name in names]


def captions(asked: Sequence[str], n_tokens: Sequence[int], most_tokens: int) -> Iterator[Caption]:
    """Lower-case phrases with a full stop after each, as many in a caption as it has tokens for.

    n_tokens: of each phrase alone. A caption begins and ends with a token of its own.
    """
    first = 0
    while first < len(asked):
        text, spans, used = "", [], 2
        for phrase, tokens in zip(asked[first:], n_tokens[first:], strict=True):
            if spans and used + tokens + 1 > most_tokens:
                break
            begin = len(text) + bool(text)
            text += (" " if text else "") + phrase.lower() + "."
            spans.append((begin, len(text) - 1))
            used += tokens + 1
        columns = tuple(range(first, first + len(spans)))
        yield Caption(text=text, columns=columns, spans=tuple(spans))
        first += len(spans)
