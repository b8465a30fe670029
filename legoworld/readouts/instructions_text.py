"""The public instructions of a task as a page of text: what `legoworld list schema` prints."""

from __future__ import annotations

import textwrap

from legoworld.pluralize import counted
from legoworld.readouts.instructions import Instructions


def instructions_text(told: Instructions) -> str:
    """What a scene's author needs to know, and nothing private. Ends with a newline."""
    task, card = told.protocol.task.name, told.protocol.card
    lines = [f"# How to write a scene for {task}: {card.declared.readout.title} ({card.version})"]
    for section in told.sections:
        lines.append(f"\n## {section.title}")
        lines += [_wrapped(statement, "- ", "  ") for statement in section.statements]
    if told.protocol.vocabulary is not None:
        names = [c.name for c in told.protocol.vocabulary.categories]
        lines.append(f"\n## Vocabulary: {counted(len(names), 'name', 'names')}")
        lines.append(_wrapped(", ".join(names), "", ""))
    return "\n".join(lines) + "\n"


def _wrapped(text: str, first: str, others: str) -> str:
    return textwrap.fill(
        text,
        width=100,
        initial_indent=first,
        subsequent_indent=others,
        break_long_words=False,
        break_on_hyphens=False,
    )
