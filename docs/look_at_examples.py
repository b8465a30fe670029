"""Draws each shipped example's readout over its photo: python docs/look_at_examples.py -o FOLDER.

The photos come from scikit-image (`pip install legoworld[examples]`) and are not part of legoworld.
"""

from __future__ import annotations

import argparse
import contextlib
import io
from pathlib import Path

import cv2
import skimage.data

from legoworld.cli import run

EXAMPLES = Path(__file__).parents[1] / "examples"


def photo(name: str) -> cv2.typing.MatLike:
    """The photo an example rebuilds, (H, W, 3) RGB."""
    if name == "motorcycle":
        return skimage.data.stereo_motorcycle()[0]
    return getattr(skimage.data, name)()


def main() -> int:
    """Inspect every example; returns 1 when one of them failed."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("-o", "--output", type=Path, required=True)
    output = parser.parse_args().output
    failed = False
    for scene in sorted(path.parent for path in EXAMPLES.glob("*/scene.blend")):
        folder = output / scene.name
        folder.mkdir(parents=True, exist_ok=True)
        file = folder / f"{scene.name}.png"
        cv2.imwrite(str(file), photo(scene.name)[:, :, ::-1])
        arguments = ["inspect", str(scene), "--photo", str(file), "--task", "coco", "-q"]
        with contextlib.redirect_stdout(io.StringIO()):  # its table of every instance
            code = run([*arguments, "-o", str(folder)])
        failed = failed or code != 0
    print(f"look at {output}/*/overlay.png and {output}/*/depth.png")
    return int(failed)


if __name__ == "__main__":
    raise SystemExit(main())
