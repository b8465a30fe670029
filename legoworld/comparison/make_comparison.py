"""`legoworld compare`: write a comparison folder from evaluations, or from comparisons to join.

Joined: task by metric by method.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from msgspec.structs import replace

from legoworld.comparison.compatibility import check_comparable, read_sides
from legoworld.comparison.document import compare
from legoworld.comparison.family import load_comparison_family
from legoworld.comparison.folder import (
    COMPARISON,
    ComparisonFolderError,
    initial_evidence,
    input_entry,
    paired_evidence,
    prepare_folder,
    read_document,
    write_comparison,
)
from legoworld.comparison.provenance import NOT_RECORDED, provenance_notes
from legoworld.comparison.thresholds import (
    FailedThreshold,
    find_failed_thresholds,
    parse_thresholds,
)
from legoworld.errors import UsageError
from legoworld.pluralize import plural
from legoworld.records.comparison import (
    JOINED,
    ByField,
    Comparison,
    ComparisonSettings,
    JoinedComparison,
)
from legoworld.records.evaluation import AnyEvidence
from legoworld.records.folders.evaluation_folder import installed_versions
from legoworld.records.folders.read_evaluation import EVIDENCE
from legoworld.tasks.registry import task_names


def join_comparisons(documents: Sequence[Comparison | JoinedComparison]) -> JoinedComparison:
    """One document of comparisons of different tasks, independent of their order.

    ComparisonFolderError for a document that is already joined; UsageError for fewer than two, or
    two of the same task.
    """
    comparisons = [d for d in documents if isinstance(d, Comparison)]
    if len(comparisons) < len(documents):
        raise ComparisonFolderError(
            "a joined comparison cannot be joined again",
            found=f"kind {JOINED}",
            expected="the comparisons of each task",
        )
    tasks = [d.task for d in comparisons]
    if len(set(tasks)) < max(2, len(tasks)):
        raise UsageError(
            "joined comparisons must be of different tasks",
            found=", ".join(tasks),
            expected="one comparison of each of two or more tasks",
            next_step="compare several baselines of a task at once: EVAL_SCENE EVAL_BASELINE...",
        )
    ordered = sorted(comparisons, key=lambda d: task_names().index(d.task))
    common = _common_images(ordered)
    by_field = _provenance(ordered)
    return JoinedComparison(
        comparisons=tuple(ordered),
        common_images=common,
        provenance=by_field,
        notes=(_images_note(ordered, common), *provenance_notes(by_field)),
    )


def joined_evidence(
    folder: Path, document: JoinedComparison, comparisons: Sequence[Path]
) -> AnyEvidence:
    """evidence.json of a joined comparison: the comparisons by hash, in task order."""
    return AnyEvidence(
        kind=JOINED,
        configuration={},
        versions=installed_versions(),
        inputs=tuple(
            input_entry(folder, f"comparison {one.task}", path / name)
            for one, path in zip(document.comparisons, comparisons, strict=True)
            for name in (COMPARISON, EVIDENCE)
        ),
        files={},
    )


def _common_images(documents: Sequence[Comparison]) -> int:
    """Images in every track, by id and file name: ids alone are not comparable across datasets."""
    sets = [{(i.image_id, i.file_name) for i in d.images} for d in documents]
    return len(set.intersection(*sets))


def _images_note(documents: Sequence[Comparison], common: int) -> str:
    sizes = {d.task: len(d.images) for d in documents}
    if set(sizes.values()) == {common}:
        return f"The {len(sizes)} tracks hold the same {plural(common, 'image', 'images')}."
    listed = ", ".join(f"{task} {n}" for task, n in sizes.items())
    return (
        f"The {len(sizes)} tracks hold different images ({listed}; {common} in all of them): "
        "numbers of different tasks are not of the same photos."
    )


def _provenance(documents: Sequence[Comparison]) -> ByField:
    """field -> "task method" -> value -> images; what no image of a task recorded is so named."""
    fields = [name for d in documents for name in d.provenance]
    return {
        field: {
            f"{d.task} {method.name}": d.provenance.get(field, {}).get(
                method.name, {NOT_RECORDED: len(d.images)}
            )
            for d in documents
            for method in d.methods
            if method.kind == "scene"
        }
        for field in dict.fromkeys(fields)
    }


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
    task = sides[0].task
    metrics = load_comparison_family(task).metrics(task)
    wanted = parse_thresholds(thresholds, [metric.id for metric in metrics])
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
