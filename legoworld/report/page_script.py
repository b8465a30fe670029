"""The page's ES modules as one script: no build step, the same bytes from the same files."""

from __future__ import annotations

import re
from collections.abc import MutableMapping
from functools import cache
from pathlib import Path
from typing import Final

from legoworld.errors import LegoWorldError

SCRIPTS: Final = Path(__file__).parent / "page"
MAIN: Final = "main.js"
_IMPORT: Final = re.compile(r'^import \{[^}]*\} from "\./([\w.]+)";\n', re.MULTILINE)
_EXPORT: Final = re.compile(r"^export (?=(?:async )?function |const |let |class )", re.MULTILINE)
_LEFT: Final = re.compile(r"^\s*(?:import|export)\b.*$", re.MULTILINE)


@cache
def page_script(main: str = MAIN) -> str:
    """A module and everything it imports, each module once, after those it needs.

    Modules share one scope, so a name stands for one thing in all of them: a browser refuses a
    script that declares one twice. Only named imports and exports of a line are understood.
    """
    order: dict[str, str] = {}
    _add(main, order, ())
    return "".join(order.values())


def _add(name: str, order: MutableMapping[str, str], above: tuple[str, ...]) -> None:
    """A module after its imports. LegoWorldError for a circle and for other forms of import."""
    if name in order:
        return
    if name in above:
        raise LegoWorldError(
            "the page's scripts import each other in a circle",
            found=" -> ".join((*above, name)),
            expected="modules that can be put in order",
        )
    text = (SCRIPTS / name).read_text(encoding="utf-8")
    for needed in _IMPORT.findall(text):
        _add(needed, order, (*above, name))
    body = _EXPORT.sub("", _IMPORT.sub("", text))
    if left := _LEFT.search(body):
        raise LegoWorldError(
            f"{name} imports or exports in a way that is not understood",
            found=left.group().strip(),
            expected='import { names } from "./module.js"; and export before a declaration',
        )
    order[name] = body.strip() + "\n\n"
