"""`compare`: compare evaluations over the same images."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, TypedDict, Unpack, overload

from legoworld.api.arguments import check_argument, check_arguments
from legoworld.api.by_task import ByTask, refuse_result_at
from legoworld.api.evaluation import Evaluation, evaluate
from legoworld.api.listener import SILENT, Listener
from legoworld.comparison.folder import COMPARISON
from legoworld.comparison.make_comparison import make_comparison
from legoworld.comparison.tables import Document, list_comparisons
from legoworld.comparison.thresholds import FailedThreshold, thresholds_by_task
from legoworld.errors import UsageError
from legoworld.records.base import as_json
from legoworld.records.comparison import ComparisonSettings
from legoworld.tasks.shipped import TaskName

if TYPE_CHECKING:
    from legoworld.api.scoring import Answers, Truth
    from legoworld.evaluation.family import LiveTruth

    #: The sides of a comparison by name: evaluations, or answers in memory.
    Sides = Mapping[str, Evaluation | str | Path | Answers]
#: The folder of a comparison of such sides, beside theirs.
_COMPARISON: Final = "comparison"


@dataclass(frozen=True, kw_only=True)
class Comparison:
    """A comparison folder. document: comparison.json; below: thresholds that are not met."""

    folder: Path
    document: Document
    below: tuple[FailedThreshold, ...]

    @property
    def table(self) -> list[dict[str, Any]]:
        """One row of plain values per metric and baseline: `pandas.DataFrame(x.table)`.

        images: "attempted", "scored" or "paired"; difference: scene minus baseline, with its 95 %
        bootstrap interval.
        """
        return [
            {
                "task": one.task,
                "scene": pair.scene,
                "baseline": pair.baseline,
                "metric": row.metric,
                "policy": row.policy,
                "images": row.images,
                "better": row.better,
                "scene_value": row.scene.value,
                "baseline_value": row.baseline.value,
                "difference": row.difference.value,
                "low": row.difference.interval.low if row.difference.interval else None,
                "high": row.difference.interval.high if row.difference.interval else None,
            }
            for one in list_comparisons(self.document)
            for pair in one.pairs
            for row in pair.rows
        ]

    def to_dict(self) -> dict[str, Any]:
        """The document that `legoworld compare --json` prints."""
        return {
            "folder": str(self.folder),
            "comparison": as_json(self.document),
            "below_threshold": [str(one) for one in self.below],
        }

    def _repr_html_(self) -> str:
        """What a notebook shows: the verdict, and both sides' main metrics."""
        from legoworld.report.notebook import comparison_html

        return comparison_html(self.document)


class ComparisonOptions(TypedDict, total=False):
    """The keyword arguments of `compare`."""

    draws: int
    seed: int
    fail_below: Sequence[str]
    allow_truth_prompts: bool
    overwrite: bool
    listener: Listener


@overload
def compare(
    evaluations: Sequence[Evaluation | str | Path],
    output: str | Path,
    **options: Unpack[ComparisonOptions],
) -> Comparison: ...
@overload
def compare(
    evaluations: Sequence[ByTask[Evaluation]],
    output: str | Path,
    **options: Unpack[ComparisonOptions],
) -> ByTask[Comparison]: ...
@overload
def compare(
    evaluations: Sides,
    output: str | Path | None = ...,
    *,
    truth: Truth | LiveTruth | None = ...,
    task: TaskName | str | None = ...,
    **options: Unpack[ComparisonOptions],
) -> Comparison: ...
@partial(check_arguments, but=("evaluations", "output", "truth"))
def compare(
    evaluations: Sequence[Evaluation | str | Path] | Sequence[ByTask[Evaluation]] | Sides,
    output: str | Path | None = None,
    *,
    truth: Truth | LiveTruth | None = None,
    task: TaskName | str | None = None,
    draws: int = 2000,
    seed: int = 0,
    fail_below: Sequence[str] = (),
    allow_truth_prompts: bool = False,
    overwrite: bool = False,
    listener: Listener = SILENT,
) -> Comparison | ByTask[Comparison]:
    """Compare the first evaluation, the scene's, with each of the others, and write the folder.

    evaluations: of one task, or the evaluations of several tasks: the scene's of each is then
    compared, in output/<task>, with those of the others that have the task. Or sides by name, the
    scene's first: evaluations, or answers in memory, arrays (H, W) or (H, W, 3), evaluated against
    the truth as `evaluate` does, into output/<name> beside output/comparison; without an output
    only the document stays. draws, seed: number of bootstrap samples and RNG seed, shared by both
    sides. fail_below: "METRIC=DELTA" strings, the minimum gain of the scene; thresholds that are
    not met are in `Comparison.below`. Of several tasks, each holds for those that have the metric.
    allow_truth_prompts: accept a baseline that was prompted with ground truth. overwrite: replace
    an existing comparison.

    Raises UsageError or IncomparableError (different ground truth, track, card, evaluator or
    version) before anything is written.
    """
    settings = ComparisonSettings(draws=draws, seed=seed, allow_truth_prompts=allow_truth_prompts)
    if isinstance(evaluations, Mapping):
        from legoworld.api.kept_answers import named_folder

        place, _, delete = named_folder(output)
        try:
            folders = _evaluate_sides(evaluations, place, truth, task, settings, overwrite)
            return _compare(folders, place / _COMPARISON, settings, fail_below, overwrite, listener)
        finally:
            delete()
    check_argument("evaluations", evaluations)
    check_argument("output", output)
    assert output is not None
    several = [one for one in evaluations if isinstance(one, ByTask)]
    if not several:
        single = [_folder(one) for one in evaluations if not isinstance(one, ByTask)]
        return _compare(single, Path(output), settings, fail_below, overwrite, listener)
    if len(several) < len(evaluations):
        raise UsageError(
            "evaluations of one task and of several cannot be compared",
            found=f"{len(several)} of {len(evaluations)} are of several tasks",
            expected="folders of one kind",
        )
    refuse_result_at(Path(output), COMPARISON, "the comparisons of several tasks")
    sides = {
        task: [side[task] for side in several if task in side]
        for task in several[0]
        if any(task in side for side in several[1:])
    }
    alone = [task for task in several[0] if task not in sides]
    if not sides:
        raise UsageError(
            "no task was evaluated on two sides",
            found=" and ".join(", ".join(side) or "none" for side in several),
            expected="a task that the first has in common with another",
        )
    if alone:
        listener.notice(f"evaluated on one side only: {', '.join(alone)}")
    thresholds = thresholds_by_task(fail_below, list(sides))
    found = {
        task: _compare(
            [_folder(one) for one in of_task],
            Path(output) / task,
            settings,
            thresholds[task],
            overwrite,
            listener,
        )
        for task, of_task in sides.items()
    }
    return ByTask(folder=Path(output), results=found)


def _evaluate_sides(
    sides: Sides,
    output: Path,
    truth: Truth | LiveTruth | None,
    task: str | None,
    settings: ComparisonSettings,
    overwrite: bool,
) -> list[Path]:
    """The folders of the sides' evaluations; answers in memory are evaluated into output/<name>."""
    folders = []
    for name, side in sides.items():
        if isinstance(side, Evaluation | str | Path):
            folders.append(_folder(side))
            continue
        if truth is None:
            raise UsageError("answers in memory are compared with a truth", expected="truth=")
        check_argument("output", name)
        if Path(name).name != name or name in ("..", _COMPARISON):
            raise UsageError("a side cannot have such a name", found=repr(name))
        made = evaluate(
            side,
            output / name,
            truth=truth,
            task=task,
            draws=settings.draws,
            seed=settings.seed,
            overwrite=overwrite,
        )
        folders.append(_folder(made))
    return folders


def _compare(
    folders: Sequence[Path],
    output: Path,
    settings: ComparisonSettings,
    fail_below: Sequence[str],
    overwrite: bool,
    listener: Listener,
) -> Comparison:
    document, below = make_comparison(
        folders,
        output,
        settings,
        thresholds=fail_below,
        overwrite=overwrite,
        notice=listener.notice,
    )
    return Comparison(folder=output, document=document, below=tuple(below))


def _folder(evaluation: Evaluation | str | Path) -> Path:
    place = evaluation.folder if isinstance(evaluation, Evaluation) else Path(evaluation)
    if isinstance(place, Path):
        return place
    raise UsageError(
        "an evaluation at a URL cannot be compared", found=place, expected="a folder",
        next_step="copy the evaluation here first",
    )  # fmt: skip
