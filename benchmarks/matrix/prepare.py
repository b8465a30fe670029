"""References of examples/bench as one case each, labelled for every vocabulary.

python benchmarks/matrix/prepare.py REFERENCES -o FOLDER [--family kitchen]

All tiers in one, the first view alone. `category` stays what the bench scores; the labels of a
vocabulary that has another word, and those of floors, walls and roads, are added beside it.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import bpy

#: category, or the start of an unlabelled object's name -> its names in COCO's things and stuff,
#: VOC, LVIS, ADE20K and Cityscapes; None: that of `category`, or none.
NAMES: dict[str, tuple[str | None, ...]] = {
    "Floor": ("floor-other-merged", None, None, "floor", None),
    "Ground": ("grass-merged", None, None, "grass", "terrain"),
    "Wall": ("wall-other-merged", None, None, "wall", None),
    "base": ("pavement-merged", None, None, "sidewalk", "sidewalk"),
    "road": ("road", None, None, "road", "road"),
    "armchair": ("chair", "chair", None, None, None),
    "board": (None, None, "chopping_board", None, None),
    "bush": ("tree-merged", None, None, "plant", "vegetation"),
    "couch": (None, None, "sofa", "sofa", None),
    "fridge": ("refrigerator", None, "refrigerator", "refrigerator", None),
    "hydrant": ("fire hydrant", None, "fireplug", None, None),
    "lamp": ("light", None, None, None, None),
    "picture": (None, None, "painting", "painting", None),
    "plant": ("potted plant", "pottedplant", "flowerpot", None, None),
    "rug": ("rug-merged", None, None, None, None),
    "stool": ("chair", "chair", None, None, None),
    "street light": ("light", None, "streetlight", "streetlight", "pole"),
    "table": ("dining table", "diningtable", None, None, None),
    "trash": (None, None, "trash_can", "ashcan", None),
}
VOCABULARIES = ("coco", "voc", "lvis", "ade20k", "cityscapes")


def label(thing: bpy.types.Object) -> None:
    """The names of one object in each vocabulary."""
    key = thing.get("category") or thing.name.split()[0].split("_")[0].split(".")[0]
    for name, value in zip(VOCABULARIES, NAMES.get(key, ()), strict=False):
        if value:
            thing[f"{name}_category"] = value


def main() -> None:
    """A scene folder for each reference."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("references", type=Path)
    parser.add_argument("-o", "--output", type=Path, required=True)
    parser.add_argument("--family", action="append")
    chosen = parser.parse_args()
    for blend in sorted(chosen.references.glob("*/scene.blend")):
        family = blend.parent.name
        if chosen.family and family not in chosen.family:
            continue
        bpy.ops.wm.open_mainfile(filepath=str(blend), load_ui=False)
        for thing in list(bpy.context.scene.objects):
            if thing.get("view", 0) != 0:
                bpy.data.objects.remove(thing)
                continue
            if "tier" in thing:
                del thing["tier"]
            if thing.parent is None and thing.type in ("MESH", "EMPTY"):
                label(thing)
        (chosen.output / family).mkdir(parents=True, exist_ok=True)
        bpy.ops.wm.save_as_mainfile(
            filepath=str(chosen.output / family / "scene.blend"),
            compress=True,
            check_existing=False,
        )


if __name__ == "__main__":
    main()
