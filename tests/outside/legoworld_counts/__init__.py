"""The task `counts`: how many instances of each category a photo shows."""

from pathlib import Path

from legoworld.tasks.shipped import COCO
from legoworld.tasks.task import Family, Task

FAMILY = Family(
    name="counts",
    noun="counts",
    records="legoworld_counts.records:RECORDS",
    readout="legoworld_counts.readout:READOUT",
    evaluation="legoworld_counts.evaluation:EVALUATION",
    comparison="legoworld_counts.comparison:COMPARISON",
    page="legoworld_counts.page:PAGE",
    track="legoworld_counts.track:TRACK",
    baseline="legoworld_counts.baseline:BASELINE",
    labelled=True,
    draws=200,
)

TASK = Task(
    name="counts",
    family=FAMILY,
    dataset=COCO,
    title="Counts",
    noun="Scene counts",
    card=Path(__file__).parent / "counts.toml",
    fixed={"readout.reads": "counts"},
)
