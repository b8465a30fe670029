"""Whether judges prefer what the score prefers, and whether they favour their own builds."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Final

import numpy as np
from msgspec.structs import replace

from legoworld.errors import LegoWorldError, cause
from legoworld.files import sha256_of_file
from legoworld.records.base import UNSET, RecordError, decode_lines
from legoworld.records.bench_results import (
    BOTH_BAD,
    FAILED,
    TIE,
    Agreement,
    Aspect,
    AspectAgreement,
    Gap,
    Judgement,
    JudgePair,
    JudgesFile,
    OrderSwaps,
)

#: Scores of a case: by evaluation and file name, R and A.
Scores = Mapping[str, Mapping[str, tuple[float | None, float | None]]]

#: Builder, item and the two shown.
Pair = tuple[str, str, tuple[str, str]]
Gaps = Mapping[Pair, Gap]

#: Scores this close are a tie.
_TIE_WITHIN: Final = 1e-6


class JudgementsError(LegoWorldError):
    """A file of judgements cannot be used."""

    code = "judgements"


def judge_agreement(
    path: Path,
    scores: Scores | None = None,
    evidence_sha256: Mapping[str, str] | None = None,
    pairs: Sequence[JudgePair] | None = None,
) -> JudgesFile:
    """The agreement of a JSON Lines file of judgements. JudgementsError.

    scores: of the evaluations that say which submission is better, R for the reconstruction, A for
    the appearance; without them each judgement says it. evidence_sha256: of the same. pairs: those
    that were to be judged; all of a builder are in the denominator of each of its judges.
    """
    try:
        judgements = decode_lines(Judgement, path.read_bytes())
    except (OSError, RecordError) as error:
        raise _refusal(path, cause(error)) from error
    if not judgements:
        raise _refusal(path, "no judgement")
    for number, one in enumerate(judgements, start=1):
        if one.shown[0] == one.shown[1] or {TIE, BOTH_BAD, FAILED} & set(one.shown):
            raise _refusal(path, f"judgement {number}: shown {one.shown}")
        if one.answer not in (*one.shown, TIE, BOTH_BAD, FAILED):
            raise _refusal(path, f"judgement {number}: chosen {one.chosen!r} of {one.shown}")
        if one.better is UNSET and scores is None:
            raise _refusal(
                path, f"judgement {number}: neither `better` nor evaluations that say it"
            )
        if one.better is not UNSET and one.better not in (*one.shown, TIE):
            raise _refusal(path, f"judgement {number}: better {one.better!r} of {one.shown}")
    count = len(judgements)
    gaps: Gaps = {(p.builder, p.item, p.shown): p.gap for p in pairs or ()}
    if pairs is not None:
        judgements = _all_pairs(path, judgements, gaps)
    if scores is not None:
        judgements = [
            _with_direction(path, number, one, scores)
            for number, one in enumerate(judgements, start=1)
        ]
    aspects = sorted({one.aspect for one in judgements}, reverse=True)
    return JudgesFile(
        judgements_sha256=sha256_of_file(path),
        evidence_sha256=dict(evidence_sha256 or {}),
        judgements=count,
        aspects={
            aspect: _aspect([one for one in judgements if one.aspect == aspect], gaps)
            for aspect in aspects
        },
    )


def _with_direction(path: Path, number: int, one: Judgement, scores: Scores) -> Judgement:
    """A judgement with the better submission by two evaluations of the same case."""
    values = []
    for name in one.shown:
        if name not in scores:
            raise _refusal(path, f"judgement {number}: no evaluation {name!r}, but {list(scores)}")
        if one.item not in scores[name]:
            raise _refusal(path, f"judgement {number}: {name} has no case {one.item!r}")
        value = scores[name][one.item][one.aspect == "appearance"]
        if value is None:
            raise _refusal(path, f"judgement {number}: {name} has no {one.aspect} of {one.item!r}")
        values.append(value)
    difference = values[0] - values[1]
    better = TIE if abs(difference) <= _TIE_WITHIN else one.shown[difference < 0]
    if one.better not in (UNSET, better):
        raise _refusal(
            path, f"judgement {number}: better {one.better!r}, but {better!r} by the evaluations"
        )
    return replace(one, better=better)


def _all_pairs(path: Path, judgements: Sequence[Judgement], pairs: Gaps) -> list[Judgement]:
    """The judgements, and a failed one of each pair that a judge of its builder left out.

    JudgementsError for a pair that was not chosen, and for a second answer to one question.
    """
    cells: dict[tuple[str, str, Aspect], dict[Pair, Judgement]] = {}
    for number, one in enumerate(judgements, start=1):
        pair = one.builder, one.item, one.shown
        if pair not in pairs and (one.builder, one.item, one.shown[::-1]) not in pairs:
            raise _refusal(path, f"judgement {number}: {pair} is none of the chosen pairs")
        cell = cells.setdefault((one.builder, one.judge, one.aspect), {})
        if cell.setdefault(pair, one) is not one:
            raise _refusal(path, f"judgement {number}: {one.judge} judges {pair} a second time")
    left_out = [
        Judgement(builder=builder, judge=judge, aspect=aspect, item=pair[1], shown=pair[2],
                  chosen=FAILED)
        for (builder, judge, aspect), cell in cells.items()
        for pair in pairs
        if pair[0] == builder and pair not in cell
    ]  # fmt: skip
    return [*judgements, *left_out]


def _aspect(judgements: Sequence[Judgement], pairs: Gaps) -> AspectAgreement:
    """Agreement of one aspect; builders and judges keep the order they first come in.

    pairs: where there are any, an answer in the other order is for the audit alone.
    """
    cells: dict[str, dict[str, list[Judgement]]] = {}
    by_gap: dict[Gap, list[Judgement]] = {}
    for one in judgements:
        gap = pairs.get((one.builder, one.item, one.shown))
        if gap or not pairs:
            cells.setdefault(one.builder, {}).setdefault(one.judge, []).append(one)
        if gap:
            by_gap.setdefault(gap, []).append(one)
    matrix = {
        builder: {judge: _agreement(found) for judge, found in by_judge.items()}
        for builder, by_judge in cells.items()
    }
    found = summarise_matrix(matrix, _swaps(judgements))
    gaps: dict[Gap, Agreement] = {gap: _agreement(by_gap[gap]) for gap in by_gap}
    return replace(found, by_gap=gaps) if pairs else found


def summarise_matrix(
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
    answers = [one.answer for one in judgements]
    agreed = sum(one.answer == one.better for one in judgements)
    return Agreement(
        agreed=agreed,
        n=len(judgements),
        share=agreed / len(judgements),
        ties=answers.count(TIE),
        both_bad=answers.count(BOTH_BAD),
        failed=answers.count(FAILED),
        score_ties=sum(one.better == TIE for one in judgements),
    )


def _swaps(judgements: Sequence[Judgement]) -> dict[str, OrderSwaps]:
    """By judge: items answered in both orders, and whether the same one was chosen."""
    found = {}
    for judge in dict.fromkeys(one.judge for one in judgements):
        mine = [one for one in judgements if one.judge == judge]
        orders: dict[tuple[str, str], dict[tuple[str, str], str]] = {}
        for one in mine:
            orders.setdefault((one.builder, one.item), {})[one.shown] = one.answer
        pairs = [
            (chosen, by_order[second, first])
            for by_order in orders.values()
            for (first, second), chosen in by_order.items()
            if first < second and FAILED not in (chosen, by_order.get((second, first), FAILED))
        ]
        consistent = sum(a == b for a, b in pairs)
        found[judge] = OrderSwaps(
            swapped=len(pairs),
            consistent=consistent,
            share=consistent / len(pairs) if pairs else None,
            first_share=sum(one.answer == one.shown[0] for one in mine) / len(mine),
        )
    return found


def _refusal(path: Path, found: str) -> JudgementsError:
    return JudgementsError(
        f"{path.name} holds no judgements that can be used",
        found=found,
        expected='JSON lines {"builder", "judge", "aspect": "reconstruction" or "appearance", '
        '"item", "shown": [first, second], "chosen": one of them, "tie", "both_bad" or "failed", '
        '"better": one of them or "tie"}; with evaluations, `better` is left out, `shown` has the '
        "names of two of their folders, and `item` a case's file name",
    )
