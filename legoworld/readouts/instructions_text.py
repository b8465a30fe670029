"""The public instructions of a task as a page of text: what `legoworld list schema` prints."""

from __future__ import annotations

import textwrap

from legoworld.pluralize import plural
from legoworld.readouts.instructions import Instructions


def instructions_text(instructions: Instructions) -> str:
    """What a scene's author needs to know, and nothing private. Ends with a newline."""
    task, card = instructions.protocol.task.name, instructions.protocol.card
    lines = [f"# How to write a scene for {task}: {card.record.readout.title} ({card.version})"]
    for section in instructions.sections:
        lines.append(f"\n## {section.title}")
        lines += [_wrap_text(statement, "- ", "  ") for statement in section.statements]
    if instructions.protocol.vocabulary is not None:
        names = [c.name for c in instructions.protocol.vocabulary.categories]
        lines.append(f"\n## Vocabulary: {plural(len(names), 'name', 'names')}")
        lines.append(_wrap_text(", ".join(names), "", ""))
    return "\n".join(lines) + "\n"


def _wrap_text(text: str, first: str, others: str) -> str:
    return textwrap.fill(
        text,
        width=100,
        initial_indent=first,
        subsequent_indent=others,
        break_long_words=False,
        break_on_hyphens=False,
    )
