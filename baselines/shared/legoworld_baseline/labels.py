"""A model's label names to the dataset's category ids: by name, never by position."""

from __future__ import annotations

import difflib
from collections.abc import Iterable
from typing import Any

from legoworld_baseline.protocol import Refused


def match_labels(
    request: dict[str, Any], labels: Iterable[str], *, every_category: bool = True
) -> dict[str, int]:
    """The category id of each label that names one of the request's categories.

    Names match case-insensitively with "_" = " ", after request["label_map"] (their name to ours,
    None to leave a label out; legoworld puts the six old names of COCO's categories in it by
    itself). Labels that name no category are left out: "N/A", "background", other datasets'
    classes.

    Refused when two labels name one category, when a category of the vocabulary has no label and
    `every_category`, and when nothing matches, as with "LABEL_0", "LABEL_1", ...
    """
    labels = list(labels)
    mapping = {_normal(theirs): ours for theirs, ours in (request["label_map"] or {}).items()}
    ids = {_normal(c["name"]): c["id"] for c in request["categories"]}
    names = {c["id"]: c["name"] for c in request["categories"]}
    found: dict[str, int] = {}
    owners: dict[int, str] = {}
    for label in labels:
        name = mapping.get(_normal(label), label)
        category_id = ids.get(_normal(name)) if name is not None else None
        if category_id is None:
            continue
        if category_id in owners and owners[category_id] != label:
            raise Refused(
                "two labels of the model name one category",
                found=f"{owners[category_id]!r} and {label!r} for {names[category_id]!r}",
                expected="one label a category",
                next_step="say which is meant with --label-map",
            )
        owners[category_id] = label
        found[label] = category_id
    missing = [name for category_id, name in names.items() if category_id not in owners]
    if missing and (every_category or not found):
        _refuse(missing, [label for label in labels if label not in found], len(names))
    return found


def _refuse(missing: list[str], unused: list[str], n_categories: int) -> None:
    by_name = {_normal(label): label for label in unused}
    near = {
        name: [by_name[n] for n in difflib.get_close_matches(_normal(name), by_name, n=2)]
        for name in missing
    }
    shown = ", ".join(f"{n!r} (near: {', '.join(near[n]) or 'none'})" for n in missing[:5])
    raise Refused(
        f"{len(missing)} of {n_categories} categories have no label of the model",
        found=f"{shown}; the model's unused labels: {', '.join(map(repr, unused[:8])) or 'none'}",
        expected="a label for every category of the vocabulary",
        next_step='pass --label-map FILE with {"their label": "our name"}',
    )


def _normal(text: str) -> str:
    """Lower case, "_" as a space, white space runs as one space."""
    return " ".join(text.replace("_", " ").casefold().split())
