"""Whether judges prefer what the score prefers, and whether they favour their own builds."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from legoworld.errors import LegoWorldError, cause
from legoworld.files import sha256_of_file
from legoworld.records.base import RecordError, decode_lines
from legoworld.records.reconstruction_judges import (
    Agreement,
    AspectAgreement,
    Judgement,
    JudgesFile,
    OrderSwaps,
)


class JudgementsError(LegoWorldError):
    """A file of judgements cannot be used."""

    code = "judgements"


def judge_agreement(path: Path) -> JudgesFile:
    """The agreement of a JSON Lines file of judgements. JudgementsError."""
    try:
        judgements = decode_lines(Judgement, path.read_bytes())
    except (OSError, RecordError) as error:
        raise _refusal(path, cause(error)) from error
    if not judgements:
        raise _refusal(path, "no judgement")
    for number, one in enumerate(judgements, start=1):
        if one.shown[0] == one.shown[1] or one.better not in one.shown:
            raise _refusal(path, f"judgement {number}: better {one.better!r} of {one.shown}")
        if one.chosen is not None and one.chosen not in one.shown:
            raise _refusal(path, f"judgement {number}: chosen {one.chosen!r} of {one.shown}")
    aspects = sorted({one.aspect for one in judgements}, reverse=True)
    return JudgesFile(
        judgements_sha256=sha256_of_file(path),
        judgements=len(judgements),
        aspects={
            aspect: aspect_agreement([one for one in judgements if one.aspect == aspect])
            for aspect in aspects
        },
    )


def aspect_agreement(judgements: Sequence[Judgement]) -> AspectAgreement:
    """Agreement of one aspect; builders and judges keep the order they first come in."""
    cells: dict[str, dict[str, list[Judgement]]] = {}
    for one in judgements:
        cells.setdefault(one.builder, {}).setdefault(one.judge, []).append(one)
    matrix = {
        builder: {judge: _agreement(found) for judge, found in by_judge.items()}
        for builder, by_judge in cells.items()
    }
    return of_matrix(matrix, _swaps(judgements))


def of_matrix(
    matrix: Mapping[str, Mapping[str, Agreement]], swaps: Mapping[str, OrderSwaps]
) -> AspectAgreement:
    """Self and cross means of a matrix, builder -> judge -> agreement."""
    own = [row[builder].share for builder, row in matrix.items() if builder in row]
    others = {b: [c.share for j, c in row.items() if j != b] for b, row in matrix.items()}
    both = [b for b, row in matrix.items() if b in row and others[b]]
    cross = [share for shares in others.values() for share in shares]
    return AspectAgreement(
        matrix={builder: dict(row) for builder, row in matrix.items()},
        self_mean=float(np.mean(own)) if own else None,
        cross_mean=float(np.mean(cross)) if cross else None,
        self_above_others=sum(matrix[b][b].share > float(np.mean(others[b])) for b in both),
        builders=len(both),
        order_swaps=dict(swaps),
    )


def _agreement(judgements: Sequence[Judgement]) -> Agreement:
    agreed = sum(one.chosen == one.better for one in judgements)
    return Agreement(agreed=agreed, n=len(judgements), share=agreed / len(judgements))


def _swaps(judgements: Sequence[Judgement]) -> dict[str, OrderSwaps]:
    """By judge: items shown in both orders, and whether the same one was chosen."""
    found = {}
    for judge in dict.fromkeys(one.judge for one in judgements):
        mine = [one for one in judgements if one.judge == judge]
        orders: dict[tuple[str, str], dict[tuple[str, str], str | None]] = {}
        for one in mine:
            orders.setdefault((one.builder, one.item), {})[one.shown] = one.chosen
        pairs = [
            (chosen, by_order[second, first])
            for by_order in orders.values()
            for (first, second), chosen in by_order.items()
            if first < second and (second, first) in by_order
        ]
        consistent = sum(a == b for a, b in pairs)
        found[judge] = OrderSwaps(
            swapped=len(pairs),
            consistent=consistent,
            share=consistent / len(pairs) if pairs else None,
            first_share=sum(one.chosen == one.shown[0] for one in mine) / len(mine),
        )
    return found


def _refusal(path: Path, found: str) -> JudgementsError:
    return JudgementsError(
        f"{path.name} holds no judgements that can be used",
        found=found,
        expected='JSON lines {"builder", "judge", "aspect": "reconstruction" or "appearance", '
        '"item", "shown": [first, second], "chosen": one of them or null, "better": one of them}',
    )
