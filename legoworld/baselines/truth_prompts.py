"""LVIS's verified categories as prompts: the only ground truth read upstream of `evaluate`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from legoworld.baselines.cards import BaselineCard
from legoworld.errors import CatalogError, UsageError
from legoworld.files import sha256_of_file
from legoworld.records.base import RecordError, decode
from legoworld.records.coco_file import VerifiedTruth
from legoworld.records.run_file import UsedTruth
from legoworld.tasks.registry import require_task
from legoworld.tracks.track import TrackImage

WHAT = "each image's positive and negative categories, as prompts"


@dataclass(frozen=True, kw_only=True)
class TruthPrompts:
    """category_ids: per image id, ascending; used: how run.json says it."""

    category_ids: dict[int, list[int]]
    used: UsedTruth


def read_truth_prompts(
    path: Path, images: Sequence[TrackImage], card: BaselineCard, task: str
) -> TruthPrompts:
    """The categories that LVIS verified on each image: annotated ones and those known absent.

    UsageError if the baseline cannot be prompted or the task is not lvis; CatalogError if the file
    is not LVIS ground truth of these images.
    """
    if not require_task(task).dataset.federated or not card.about.prompts_from_truth:
        raise UsageError(
            "--prompts-from-truth is for prompted baselines on LVIS, whose images list categories",
            found=f"the baseline {card.name} on {task}",
            expected="--task lvis and a baseline whose card says prompts_from_truth = true",
        )
    try:
        truth = decode(VerifiedTruth, path.read_bytes())
        negative = {image.id: set(image.neg_category_ids) for image in truth.images}
        verified = {image.id: negative[image.id] for image in images}
        for annotation in truth.annotations:
            if annotation.image_id in verified:
                verified[annotation.image_id].add(annotation.category_id)
    except (OSError, RecordError, KeyError) as error:
        raise CatalogError(
            f"{path.name} cannot give prompts",
            found=f"no image {error}" if isinstance(error, KeyError) else str(error),
            expected="LVIS annotations with neg_category_ids, of every image of the track",
        ) from error
    return TruthPrompts(
        category_ids={i: sorted(ids) for i, ids in verified.items()},
        used=UsedTruth(sha256=sha256_of_file(path), what=WHAT),
    )


def request_prompts(prompts: TruthPrompts | None) -> dict[str, list[int]] | None:
    """The request's "prompts", with string keys as JSON requires."""
    if prompts is None:
        return None
    return {str(image_id): ids for image_id, ids in sorted(prompts.category_ids.items())}
