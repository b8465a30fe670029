"""How many files an image, an evaluation and a comparison walk through, and how often back.

    python benchmarks/walk/walk.py [SCENE_FOLDER] [--files] [--back]

A file is entered when one of its functions is called. A call goes back when its file was entered
before the file that it is called from: whoever follows the code returns to a page already read.
Each pair of functions counts once, however often one calls the other. Calls back to the ground
(bytes and records, which every room uses) and to properties of a value are counted apart: neither
sends a reader anywhere. The walk is done once before it is counted, so that no import is part of
it; what runs in Blender's process and in threads is not seen.

An image is read by `SceneReader.do`, with nothing cached and with its snapshot cached. Evaluated by
`legoworld.evaluate` are the shipped examples' boxes; compared by `legoworld.compare` are they with
the same boxes, imported.
Another checkout is measured with its folder in PYTHONPATH.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections.abc import Callable
from contextlib import redirect_stdout
from functools import cached_property
from io import StringIO
from pathlib import Path
from types import FrameType
from typing import Any
from unittest import mock

import legoworld
from legoworld import cli
from legoworld.running.image import SceneReader

PACKAGE = Path(legoworld.__file__).parent
PREFIX = f"{PACKAGE}/"
GROUND = ("files.py", "records/base.py")
Function = tuple[str, str]  # its file below the package, its name


class Walk:
    """The files that a call enters, in their order, and the calls between functions."""

    def __init__(self) -> None:
        self.entered: dict[str, int] = {}
        self.calls: dict[tuple[Function, Function], bool] = {}  # whether a property is called

    def follow(self, work: Callable[..., Any], *arguments: object, **options: object) -> Any:
        """Do the work and follow it."""
        sys.setprofile(self._event)
        try:
            return work(*arguments, **options)
        finally:
            sys.setprofile(None)

    def _event(self, frame: FrameType, event: str, _argument: object) -> None:
        function = function_of(frame)
        if event != "call" or function is None:
            return
        self.entered.setdefault(function[0], len(self.entered))
        above, caller = frame.f_back, None
        while above is not None and caller is None:
            above, caller = above.f_back, function_of(above)
        if caller is not None and caller[0] in self.entered:
            self.calls[caller, function] = is_property(frame)

    def back(self, *, aside: bool) -> list[tuple[Function, Function]]:
        """The calls into a file that was entered before the caller's.

        aside: those into the ground and to properties, or all others.
        """
        place = self.entered
        return [
            (caller, called)
            for (caller, called), of_value in self.calls.items()
            if place[called[0]] < place[caller[0]] and aside == (of_value or called[0] in GROUND)
        ]


def function_of(frame: FrameType) -> Function | None:
    """The file and name of a function of legoworld's; None of another."""
    path = frame.f_code.co_filename
    if not path.startswith(PREFIX):
        return None
    return path.removeprefix(PREFIX), frame.f_code.co_qualname


def is_property(frame: FrameType) -> bool:
    """Whether the function that begins here is a property of its first argument."""
    owner = frame.f_locals.get("self")
    value = getattr(type(owner), frame.f_code.co_name, None)
    return isinstance(value, property | cached_property)


def one_image(scene: Path, folder: Path) -> dict[str, Walk]:
    """The walks of one scene's image: read by Blender, and from its cached snapshot."""
    (folder / "scenes").mkdir()
    (folder / "scenes" / "one").symlink_to(scene.resolve())
    do, walks = SceneReader.do, [Walk(), Walk(), Walk()]
    for k, walk in enumerate(walks):

        def followed(reader: SceneReader, image: Any, walk: Walk = walk) -> Any:
            return walk.follow(do, reader, image)

        with mock.patch.object(SceneReader, "do", followed):
            cache = folder / ("cache" if k else "cache of the first")
            legoworld.readout(folder / "scenes", folder / f"run {k}", task="coco", cache=cache)
    return dict(zip(("image", "image, cached"), walks[1:], strict=True))


def evaluation_and_comparison(folder: Path) -> dict[str, Walk]:
    """The walks of evaluating the shipped examples' boxes, and of comparing them with the same."""
    data = PACKAGE.parent / "datasets" / "skimage_examples"
    results = str(folder / "run" / "predictions.json")
    track = ["--task", "coco", "--track", str(data / "track_coco.json")]
    with redirect_stdout(StringIO()):
        assert cli.run(["readout", "-q", "--task", "coco", "-o", str(folder / "run")]) == 0
        imported = [
            "baseline",
            "import",
            results,
            *track,
            "--category-ids",
            "dataset",
            "-o",
            str(folder / "imported"),
        ]
        assert cli.run(imported) == 0
    truth = data / "truth_coco.json"
    evaluated, compared = Walk(), Walk()
    evaluations = [
        legoworld.evaluate(folder / "imported", folder / "eval imported", truth=truth),
        evaluated.follow(legoworld.evaluate, folder / "run", folder / "eval run", truth=truth),
    ]
    legoworld.compare(evaluations, folder / "compared first")
    compared.follow(legoworld.compare, evaluations, folder / "compared")
    return {"evaluation": evaluated, "comparison": compared}


def main() -> int:
    """Print the counts; see the module's docstring."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", 1)[0])
    example = PACKAGE.parent / "examples" / "coffee"
    parser.add_argument("scene", type=Path, nargs="?", default=example)
    parser.add_argument("--files", action="store_true", help="name the files, as entered")
    parser.add_argument("--back", action="store_true", help="name the calls that go back")
    chosen = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="legoworld-walk-") as name:
        walks = {
            **one_image(chosen.scene, Path(name)),
            **evaluation_and_comparison(Path(name)),
        }
    for what, walk in walks.items():
        back, aside = walk.back(aside=False), walk.back(aside=True)
        print(
            f"{what}: {len(walk.entered)} files entered, {len(back)} calls back, "
            f"{len(aside)} more to the ground and to properties"
        )
        if chosen.files:
            print(*(f"    {file}" for file in walk.entered), sep="\n")
        if chosen.back:
            print(*(f"    {caller[0]} {caller[1]} -> {called[0]} {called[1]}"
                    for caller, called in back), sep="\n")  # fmt: skip
    return 0


if __name__ == "__main__":
    sys.exit(main())
