"""The tasks that ship, in the order in which tables list them, and their families."""

from __future__ import annotations

from typing import Any, Final, Literal

from legoworld.conventions import EQUAL_CONFIDENCE
from legoworld.tasks.task import Dataset, Family, Task


def _family(name: str, noun: str, *, files: str | None = None, **own: Any) -> Family:
    """A family whose value in each storey is in the module of its name, as shipped ones have it.

    files: the modules that it shares with another family, under its own name in capitals; own:
    what is elsewhere, and the other fields.
    """
    shared = files or name

    def value(usual: str) -> str:
        return name.upper() if files else usual

    storeys = {
        "records": f"legoworld.records.{shared}:RECORDS",
        "readout": f"legoworld.readouts.{name}:READOUT",
        "evaluation": f"legoworld.evaluation.{name}.family:EVALUATION",
        "comparison": f"legoworld.comparison.{shared}:{value('COMPARISON')}",
        "page": f"legoworld.report.{shared}_page:{value('PAGE')}",
        "track": f"legoworld.track_making.{shared}:{value('TRACK')}",
        "baseline": f"legoworld.baselines.{name}:BASELINE",
    }
    return Family(name=name, noun=noun, **{**storeys, **own})


DETECTION: Final = _family(
    "detection",
    "boxes and masks",
    comparison="legoworld.comparison.detections:COMPARISON",
    track="legoworld.track_making.annotations:TRACK",
    labelled=True,
    options=frozenset({"evaluator", "images_per_file", "vocabulary"}),
)
DEPTH: Final = _family(
    "depth", "depth", by_policy=True, options=frozenset({"camera_model", "max_side"})
)
NORMALS: Final = _family(
    "normals", "normals", by_policy=True, options=frozenset({"max_side", "variant"})
)
RELATIONS: Final = _family("relations", "relations", labelled=True, by_policy=True)
PANOPTIC: Final = _family(
    "panoptic", "panoptic segments", files="label_maps", labelled=True, options=frozenset({"sky"})
)
SEMANTIC: Final = _family(
    "semantic", "semantic maps", files="label_maps", labelled=True, options=frozenset({"sky"})
)
RECONSTRUCTION: Final = _family(
    "reconstruction",
    "a bench",
    readout="legoworld.running.submission:READOUT",
    track=None,
    baseline=None,
    options=frozenset({"reference_sampling", "diagnostics", "render", "render_noise"}),
    draws=10_000,
)

COCO: Final = Dataset(name="coco", version="2017")
COCO_PANOPTIC: Final = Dataset(name="coco-panoptic", version="2017")
ETH3D: Final = Dataset(name="eth3d")
#: v0.5's ids differ from v1's for the same names.
LVIS: Final = Dataset(name="lvis", version="1.0", by_categories={1230: "0.5"}, federated=True)

_EXPORT: Final[dict[str, Any]] = {
    "export.score": EQUAL_CONFIDENCE,
    "export.order": ["image_id", "category_id", "payload"],
    "export.min_area_px": 1,
}
_MASKS: Final[dict[str, Any]] = {
    **_EXPORT,
    "readout.reads": "masks",
    "export.fields": ["image_id", "category_id", "segmentation", "score"],
    "export.segmentation": "rle_compressed",
}
_SEGMENTS: Final[dict[str, Any]] = {
    "readout.reads": "segments",
    "vocabulary.override_property": "coco_category",
    "vocabulary.synonyms": "unambiguous",
    "vocabulary.qualifier": "required",
    "export.void": 0,
    "scoring.match_iou_above": 0.5,
    "scoring.void_share_above": 0.5,
    "scoring.failed_image": "all_void",
}
_CLASSES: Final[dict[str, Any]] = {
    "readout.reads": "category_map",
    "vocabulary.synonyms": "unambiguous",
    "vocabulary.qualifier": "required",
    "export.void": 255,
    "scoring.failed_image": "all_void",
}

TASKS: Final = (
    Task(
        name="coco",
        family=DETECTION,
        dataset=COCO,
        title="COCO boxes",
        noun="Scene boxes",
        fixed={
            **_EXPORT,
            "readout.reads": "boxes",
            "export.fields": ["image_id", "category_id", "bbox", "score"],
            "export.bbox_format": "xywh",
            "export.bbox_edges": "integer_pixel_edges",
            "vocabulary.override_property": "coco_category",
            "vocabulary.synonyms": "none",
            "vocabulary.qualifier": "required",
        },
    ),
    Task(
        name="coco-masks",
        family=DETECTION,
        dataset=COCO,
        title="COCO masks",
        noun="Scene masks",
        fixed={
            **_MASKS,
            "vocabulary.override_property": "coco_category",
            "vocabulary.synonyms": "none",
        },
    ),
    Task(
        name="amodal",
        family=DETECTION,
        dataset=COCO,
        title="Amodal masks",
        noun="Scene masks with hidden parts",
        fixed={
            **_EXPORT,
            "readout.reads": "amodal",
            "export.segmentation": "rle_compressed",
            "export.hidden_instances": "exported",
            "export.crosses_near_plane": "whole_unknown",
            "scoring.occlusion_bounds": [0.0, 0.25, 1.0],
            "scoring.controls": ["visible_mask", "convex_hull"],
            "vocabulary.override_property": "coco_category",
            "vocabulary.synonyms": "none",
        },
    ),
    Task(
        name="boxes3d",
        family=DETECTION,
        dataset=COCO,
        title="Boxes in space",
        noun="Scene boxes in space",
        fixed={
            **_EXPORT,
            "readout.reads": "boxes_3d",
            "export.frame": "opencv_camera",
            "export.unit": "m",
            "export.box": "gravity",
            "export.extent": "whole_mesh",
            "vocabulary.override_property": "coco_category",
            "vocabulary.synonyms": "none",
            "vocabulary.qualifier": "required",
            "scoring.max_truncation": 1 / 3,
            "scoring.min_visibility": 1 / 3,
        },
    ),
    Task(
        name="lvis",
        family=DETECTION,
        dataset=LVIS,
        title="LVIS masks",
        noun="Scene masks (LVIS)",
        fixed={
            **_MASKS,
            "vocabulary.override_property": "lvis_category",
            "vocabulary.synonyms": "unambiguous",
            "vocabulary.qualifier": "where_ambiguous",
        },
    ),
    Task(
        name="eth3d",
        family=DEPTH,
        dataset=ETH3D,
        title="Depth",
        noun="Scene depth",
        fixed={"readout.reads": "depth"},
    ),
    Task(
        name="normals",
        family=NORMALS,
        dataset=Dataset(name="normal-maps"),
        title="Normals",
        noun="Scene normals",
        fixed={"readout.reads": "normals", "export.variants": ["geometric", "shading"]},
    ),
    Task(
        name="relations",
        family=RELATIONS,
        dataset=Dataset(name="spatial-questions"),
        title="Relations",
        noun="Scene relations",
        fixed={
            "readout.reads": "relations",
            "export.most_objects": 100,
            "export.touch_m": 0.01,
            "export.inside_share": 0.95,
            "export.collides_m": 0.005,
            "export.hides_share": 0.02,
            "export.facing_deg": 45.0,
            "questions.min_area_px": 100,
            "questions.min_visible": 0.25,
            "questions.per_relation": 4,
            "questions.options": 3,
            "questions.seed": 0,
            "scoring.several": "any",
            "scoring.unknown": "wrong",
            "scoring.refer_iou": 0.5,
            "vocabulary.override_property": "coco_category",
            "vocabulary.synonyms": "none",
            "vocabulary.qualifier": "required",
        },
    ),
    Task(
        name="coco-panoptic",
        family=PANOPTIC,
        dataset=COCO_PANOPTIC,
        title="COCO panoptic",
        noun="Scene segments",
        fixed=_SEGMENTS,
    ),
    Task(
        name="coco-semantic",
        family=SEMANTIC,
        dataset=COCO_PANOPTIC,
        title="COCO semantic",
        noun="Scene classes",
        fixed=_CLASSES,
    ),
    Task(
        name="voc-semantic",
        family=SEMANTIC,
        dataset=Dataset(name="voc", version="2012"),
        title="VOC semantic",
        noun="Scene classes (VOC)",
        fixed=_CLASSES,
    ),
    Task(
        name="ade20k-semantic",
        family=SEMANTIC,
        dataset=Dataset(name="ade20k", version="2016"),
        title="ADE20K semantic",
        noun="Scene classes (ADE20K)",
        fixed=_CLASSES,
    ),
    Task(
        name="cityscapes-semantic",
        family=SEMANTIC,
        dataset=Dataset(name="cityscapes", version="2016"),
        title="Cityscapes semantic",
        noun="Scene classes (Cityscapes)",
        fixed=_CLASSES,
    ),
    Task(
        name="bench",
        family=RECONSTRUCTION,
        dataset=Dataset(name="bench"),
        title="LEGO-Bench",
        noun="Scenes",
        fixed={
            "readout.reads": "surface_and_render",
            "raster.frame": "full",
            "raster.intrinsics": "reference",
            "render.engine": "CYCLES",
            "render.device": "CPU",
            "render.adaptive_sampling": False,
            "render.denoiser": False,
            "render.compositor": False,
            "render.sequencer": False,
            "render.border": False,
            "render.film_transparent": False,
            "render.resolution_percentage": 100,
            "scoring.comparison": "<=",
            "scoring.failed_image": "zero",
        },
    ),
    Task(
        name="bench-x",
        family=RECONSTRUCTION,
        dataset=Dataset(name="bench"),
        title="LEGO-Bench-X",
        noun="Scenes",
        fixed={"readout.reads": "surface_and_render", "x.offset": "private"},
    ),
)

#: The shipped tasks, for type checkers and completion; packages add others. A metric of the first
#: kind is a number, one of the second has a number by hole policy: `Family.by_policy`.
NumberTask = Literal[
    "coco",
    "coco-masks",
    "amodal",
    "boxes3d",
    "lvis",
    "coco-panoptic",
    "coco-semantic",
    "voc-semantic",
    "ade20k-semantic",
    "cityscapes-semantic",
    "bench",
    "bench-x",
]
PolicyTask = Literal["eth3d", "normals", "relations"]
TaskName = Literal[NumberTask, PolicyTask]
#: What a command asks where nobody says.
DEFAULT: Final = "coco"
#: The task of a bench, whose room serves it alone.
BENCH: Final = "bench"
#: The task of its second card.
BENCH_X: Final = "bench-x"
