"""`legoworld compare`: write a comparison folder from evaluations, or from comparisons to join."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from msgspec.structs import replace

from legoworld.comparison.compatibility import check_comparable
from legoworld.comparison.document import compare, list_metrics
from legoworld.comparison.folder import (
    initial_evidence,
    paired_evidence,
    prepare_folder,
    read_document,
    write_comparison,
)
from legoworld.comparison.joined_comparison import join_comparisons, joined_evidence
from legoworld.comparison.sides import read_sides
from legoworld.comparison.thresholds import (
    FailedThreshold,
    find_failed_thresholds,
    parse_thresholds,
)
from legoworld.records.comparison import Comparison, JoinedComparison
from legoworld.records.evidence import ComparisonSettings


def make_comparison(
    evaluations: Sequence[Path],
    output: Path,
    settings: ComparisonSettings,
    *,
    thresholds: Sequence[str] = (),
    overwrite: bool = False,
    notice: Callable[[str], None] = lambda _text: None,
) -> tuple[Comparison, list[FailedThreshold]]:
    """Compare the first evaluation with the others and write the folder.

    Returns comparison.json's document and the thresholds ("METRIC=DELTA") that are not met. Every
    LegoWorldError is raised before anything is written.
    """
    sides = read_sides(evaluations)
    check_comparable(sides, allow_truth_prompts=settings.allow_truth_prompts)
    wanted = parse_thresholds(thresholds, [m.id for m in list_metrics(sides[0].task)])
    evidence = initial_evidence(output, sides, settings)
    prepare_folder(output, evidence, overwrite=overwrite)
    document = compare(sides, settings, notice)
    evidence = replace(evidence, pairs=paired_evidence(document))
    write_comparison(output, document, evidence, overwrite=overwrite)
    return document, find_failed_thresholds(document, wanted)


def join_folders(
    comparisons: Sequence[Path], output: Path, *, overwrite: bool = False
) -> JoinedComparison:
    """Join comparisons of different tasks and write the folder; returns its document."""
    documents = [read_document(folder) for folder in comparisons]
    document = join_comparisons(documents)
    places = dict(zip((id(d) for d in documents), comparisons, strict=True))
    ordered = [places[id(one)] for one in document.comparisons]
    evidence = joined_evidence(output, document, ordered)
    write_comparison(output, document, evidence, overwrite=overwrite)
    return document
