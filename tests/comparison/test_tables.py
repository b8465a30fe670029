"""The tables of a comparison, to the last cell."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import msgspec

from legoworld.comparison.folder import rendered_tables
from legoworld.records.comparison import (
    Comparison,
    ComparisonRow,
    Difference,
    JoinedComparison,
    Measured,
    Pair,
)
from legoworld.records.evaluation import Interval
from legoworld.tables.files import latex
from legoworld.tables.table import table


def interval(low: float, high: float) -> dict[str, Any]:
    return {"low": low, "high": high}


#: Two rows of one pair; only what tables show.
DOCUMENT: dict[str, Any] = {
    "task": "coco",
    "evaluator": {"name": "judge", "version": "1.2"},
    "bootstrap": {"draws": 7, "seed": 4, "level": 0.95, "unit": "image"},
    "notes": ["A 100 % & {b} ~ c^2 # $."],
    "pairs": [
        {
            "scene": "s_1",
            "baseline": "b|2",
            "coverage": {
                "attempted": 9, "with_truth": 8, "scene_scored": 7, "baseline_scored": 6,
                "paired": 5,
            },
            "dropped": [
                {"reasons": ["scene: missing"]}, {"reasons": ["no truth", "scene: missing"]},
            ],
            "rows": [
                {
                    "metric": "AP", "policy": "own_scores", "images": "attempted",
                    "better": "higher", "level": 1,
                    "scene": {"value": 0.25, "interval": interval(0.125, 0.5),
                              "over": {"images": 1, "categories": 1, "truths": 1}},
                    "baseline": {"value": 0.75, "interval": None,
                                 "over": {"images": 1, "categories": 2, "truths": 3}},
                    "difference": {"value": -0.5, "interval": interval(-0.75, -0.0)},
                },
                {
                    "metric": "err", "policy": "far", "images": "paired", "better": "lower",
                    "level": 2,
                    "scene": {"value": 0.5, "interval": {"low": None, "high": None}, "sd": 0.0625,
                              "over": {"images": 5, "missing": 2, "predictions": 1, "pairs": 1}},
                    "baseline": {"value": None, "interval": None, "sd": None,
                                 "over": {"images": 5, "missing": 2, "predictions": 4, "pairs": 1}},
                    "difference": {"value": None, "interval": None},
                },
                {
                    "metric": "detail", "policy": "far", "images": "paired", "better": "lower",
                    "level": 3,
                    "scene": {"value": -0.0, "interval": None, "over": {"images": 5}},
                    "baseline": {"value": 1.0, "interval": None, "over": {"images": 5}},
                    "difference": {"value": -1.0, "interval": None},
                },
            ],
        }
    ],
}  # fmt: skip

TABLE_MD = r"""| task | metric | s_1 | b\|2 | difference | over |
| --- | --- | --- | --- | --- | --- |
| coco | AP ↑ | 0.2500 [0.1250, 0.5000] | 0.7500 | -0.5000 [-0.7500, +0.0000] | 1 attempted image, 1 / 2 categories, 1 / 3 truths |
| coco | err ↓ | 0.5000 (sd 0.0625) | - | - | 5 paired images, 2 missing as 1.0, 1 / 4 predictions, 1 pair |

- coco: judge 1.2; 95% intervals from 7 bootstrap samples over images, shared by both methods, seed 4.
- A 100 % & {b} ~ c^2 # $.
"""  # noqa: E501
TABLE_TEX = r"""% needs \usepackage{booktabs}
% coco: judge 1.2; 95% intervals from 7 bootstrap samples over images, shared by both methods, seed 4.
% A 100 % & {b} ~ c^2 # $.
\begin{tabular}{llllll}
\toprule
task & metric & s\_1 & b|2 & difference & over \\
\midrule
coco & AP $\uparrow$ & 0.2500 [0.1250, 0.5000] & 0.7500 & -0.5000 [-0.7500, +0.0000] & 1 attempted image, 1 / 2 categories, 1 / 3 truths \\
coco & err $\downarrow$ & 0.5000 (sd 0.0625) & - & - & 5 paired images, 2 missing as 1.0, 1 / 4 predictions, 1 pair \\
\bottomrule
\end{tabular}
"""  # noqa: E501
TABLE_CSV = """task,metric,policy,images,better,level,method,against,\
scene_value,scene_low,scene_high,scene_over_images,scene_over_missing,scene_over_categories,\
scene_over_truths,scene_over_predictions,scene_over_pairs,\
baseline_value,baseline_low,baseline_high,baseline_over_images,baseline_over_missing,\
baseline_over_categories,baseline_over_truths,baseline_over_predictions,baseline_over_pairs,\
difference_value,difference_low,difference_high,interval_level,interval_unit,draws
coco,AP,own_scores,attempted,higher,1,s_1,b|2,0.25,0.125,0.5,1,,1,1,,,\
0.75,,,1,,2,3,,,-0.5,-0.75,-0.0,0.95,image,7
coco,err,far,paired,lower,2,s_1,b|2,0.5,,,5,2,,,1,1,,,,5,2,,,4,1,,,,0.95,image,7
coco,detail,far,paired,lower,3,s_1,b|2,-0.0,,,5,,,,,,1.0,,,5,,,,,,-1.0,,,0.95,image,7
"""
COVERAGE_MD = r"""| task | attempted | with truth | method | scored | against | its scored | paired | not paired |
| --- | --- | --- | --- | --- | --- | --- | --- | --- |
| coco | 9 | 8 | s_1 | 7 | b\|2 | 6 | 5 | no truth (1), scene: missing (2) |
"""  # noqa: E501


def fill_record(kind: type[Any], **known: Any) -> Any:
    """A record of what tables show; other fields that it must have are None."""
    required = {field.name: None for field in msgspec.structs.fields(kind) if field.required}
    return kind(**required | known)


def side(kind: type[Any], said: dict[str, Any]) -> Any:
    ends = said["interval"]
    return fill_record(kind, **said | {"interval": fill_record(Interval, **ends) if ends else None})


def row(said: dict[str, Any]) -> Any:
    sides = {name: side(Measured, said[name]) for name in ("scene", "baseline")}
    return fill_record(
        ComparisonRow, **said | sides | {"difference": side(Difference, said["difference"])}
    )


def pair(said: dict[str, Any]) -> Any:
    parts = {
        "coverage": SimpleNamespace(**said["coverage"]),
        "dropped": [SimpleNamespace(**one) for one in said["dropped"]],
        "rows": [row(one) for one in said["rows"]],
    }
    return fill_record(Pair, **said | parts)


def comparison(said: dict[str, Any]) -> Any:
    parts = {name: SimpleNamespace(**said[name]) for name in ("evaluator", "bootstrap")}
    return fill_record(Comparison, **said | parts | {"pairs": [pair(one) for one in said["pairs"]]})


def test_tables_to_the_last_cell():
    found = rendered_tables(comparison(DOCUMENT))
    assert found.keys() == {
        f"{table}.{form}" for table in ("table", "coverage") for form in ("md", "tex", "csv")
    }
    assert found["table.md"] == TABLE_MD
    assert found["table.tex"] == TABLE_TEX
    assert found["table.csv"] == TABLE_CSV
    assert found["coverage.md"] == COVERAGE_MD
    assert len(found["coverage.csv"].splitlines()) == 2
    paired = {**DOCUMENT["pairs"][0], "dropped": []}
    whole = rendered_tables(comparison({**DOCUMENT, "pairs": [paired]}))
    assert whole["coverage.csv"].splitlines()[1] == "coco,9,8,s_1,7,b|2,6,5,-"


def test_several_methods_are_rows_and_joined_comparisons_show_their_headlines():
    other = {**DOCUMENT["pairs"][0], "baseline": "c"}
    several = {**DOCUMENT, "pairs": [*DOCUMENT["pairs"], other]}
    lines = rendered_tables(comparison(several))["table.md"].splitlines()
    assert lines[0] == (
        "| task | metric | method | value | against | its value | difference | over |"
    )
    assert lines[2].startswith("| coco | AP ↑ | s_1 | 0.2500 [0.1250, 0.5000] | b\\|2 | 0.7500 |")
    assert [line.split(" | ")[4] for line in lines[2:6]] == ["b\\|2", "b\\|2", "c", "c"]
    joined = fill_record(JoinedComparison, comparisons=[comparison(DOCUMENT)], notes=["Joined."])
    lines = rendered_tables(joined)["table.md"].splitlines()
    assert [line.split(" | ")[1] for line in lines[2:3]] == ["AP ↑"]
    assert lines[3] == ""
    assert [line[:16] for line in lines[4:]] == [
        "- coco: judge 1.",
        "- coco: A 100 % ",
        "- Joined.",
    ]
    assert len(rendered_tables(joined)["table.csv"].splitlines()) == 4


def test_every_character_that_latex_reads_is_escaped():
    made = table(["a\\b_c%d&e"], [["#$ {} ~ ^ ↑ ↓"], ["two\nlines"]])
    _, _, _, header, _, cells, lines, *_ = latex(made).splitlines()
    assert header == r"a\textbackslash{}b\_c\%d\&e \\"
    assert cells == r"\#\$ \{\} \textasciitilde{} \textasciicircum{} $\uparrow$ $\downarrow$ \\"
    assert lines == r"two lines \\"
