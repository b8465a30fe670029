"""One case of a study in every copy: its picture for the fault, its segments by category.

python benchmarks/matrix/sheet.py STUDY -o sheet.webp [--family kitchen]
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path

import numpy as np
from matrix import FAULTS
from PIL import Image, ImageDraw, ImageFont

from legoworld.readouts.label_maps import segment_picture

COLUMNS, WIDTH, HEIGHT, CAPTION = 4, 240, 135, 18


def segments(run: Path, scene: str) -> Image.Image:
    """A case's panoptic answer, coloured by category."""
    rows = map(json.loads, (run / "per_image.jsonl").read_text("utf-8").splitlines())
    row = next(row for row in rows if row["scene"] == scene)
    colors = np.asarray(Image.open(run / row["answer"]["file"])).astype(np.int32)
    ids = colors[..., 0] + 256 * colors[..., 1] + 65536 * colors[..., 2]
    return Image.fromarray(segment_picture(ids, [s["category_id"] for s in row["segments"]]))


def main() -> None:
    """Draw the reference and the large amount of each fault."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("study", type=Path)
    parser.add_argument("-o", "--output", type=Path, required=True)
    parser.add_argument("--family", default="kitchen")
    chosen = parser.parse_args()
    copies = ["itself", *(f"{fault}_{amounts[-1]:g}" for fault, amounts in FAULTS.items())]
    scene = f"{chosen.family}__view_00"
    rows = -(-len(copies) // COLUMNS)
    sheet = Image.new("RGB", (COLUMNS * WIDTH, rows * (HEIGHT + CAPTION)), "white")
    draw, font = ImageDraw.Draw(sheet), ImageFont.load_default(size=13)
    for number, copy in enumerate(copies):
        x, y = number % COLUMNS * WIDTH, number // COLUMNS * (HEIGHT + CAPTION)
        run = chosen.study / "runs" / copy
        render = run / "bench" / "render" / f"{scene}.png"
        if copy.startswith(("paint", "hollow")) and render.is_file():  # no segment changes
            shown = Image.open(render).convert("RGB")
        else:
            shown = segments(run / "coco-panoptic", scene)
        sheet.paste(shown.resize((WIDTH - 2, HEIGHT)), (x, y + CAPTION))
        draw.text((x + 4, y + 1), copy.replace("_", " "), fill="black", font=font)
    sheet.save(chosen.output)


if __name__ == "__main__":
    main()
