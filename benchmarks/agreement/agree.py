"""How far legoworld and Cycles agree on real scenes: one row per scene folder, and a verdict.

    python benchmarks/agreement/agree.py SCENES [--size WxH] [--max-side 960] [--judgements DIR]
        [--normals]

SCENES is a folder of scene folders (at any depth). Exit 1 when a scene is below target, 2 when
nothing could be compared. A scene that legoworld refuses with a verdict is listed with it.
--normals compares shading normals with Cycles' Normal pass besides, which 99.9 % of the pixels off
silhouettes and creases must meet.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "tests"))

from agreement.comparison import LEAST_NORMAL, Agreement, compare, compare_normals
from agreement.judge import Judge, JudgeError
from agreement.ours import picture_of, snapshot_of

from legoworld.errors import LegoWorldError
from legoworld.scene.blender_process import BlenderProcess, Limits
from legoworld.scene.folder import BLEND, SceneFolder

HEADER = (
    f"{'scene':34} {'size':>10} {'hit %':>6} {'same %':>9} {'tied px':>7} {'inside %':>9} "
    f"{'z<1e-4 %':>9} {'z median':>9} {'z worst':>9} {'s':>5}  verdict"
)


def main() -> int:
    """Print the table; see the module's docstring for exit codes."""
    arguments = _arguments()
    scenes = sorted(p.parent for p in arguments.scenes.rglob(BLEND))
    print(HEADER)
    verdicts = []
    with tempfile.TemporaryDirectory(prefix="agree-") as temporary:
        kept = arguments.judgements or Path(temporary)
        kept.mkdir(parents=True, exist_ok=True)
        for path in scenes:
            name = str(path.relative_to(arguments.scenes))
            verdicts.append(_row(SceneFolder(path=path, name=name), arguments, kept))
    compared = [v for v in verdicts if v is not None]
    print(f"\n{sum(compared)} of {len(compared)} compared scenes meet the targets", end="")
    print(f"; {len(verdicts) - len(compared)} were not compared")
    if not compared:
        return 2
    return 0 if all(compared) else 1


def _row(scene: SceneFolder, arguments: argparse.Namespace, kept: Path) -> bool | None:
    """Compare and print one scene: whether it meets the targets, None when it has no verdict."""
    start = time.monotonic()
    stem = scene.name.replace("/", "__")
    try:
        with BlenderProcess(Limits(time_s=300)) as blender:
            snapshot = snapshot_of(scene, blender, corner_normals=arguments.normals)
        size = arguments.size or capped(snapshot.render.size_wh, arguments.max_side)
        ours = picture_of(snapshot, size)
        with (kept / f"{stem}.log").open("wb") as log, Judge(log) as judge:
            cycles = judge.picture_of(scene.file(BLEND), size, (kept / f"{stem}.npz").resolve())
    except (LegoWorldError, JudgeError) as error:
        print(f"{scene.name[:34]:34} not compared: {' '.join(str(error).split())[:150]}")
        return None
    found = compare(ours, cycles)
    print(_line(scene.name, size, found, time.monotonic() - start), flush=True)
    for mine, theirs, pixels in found.differing[:5]:
        if found.verdict != "ok":
            print(f"{'':36}{pixels} px: ours {mine!r}, Cycles {theirs!r}")
    met = found.verdict == "ok"
    if arguments.normals:
        normals = compare_normals(ours, cycles)
        met &= not normals.within < LEAST_NORMAL
        print(
            f"{'':34} normals: {100 * normals.within:.4f} % within 0.1 degrees of "
            f"{normals.pixels} px, {normals.creased} px of creases left out; "
            f"median {normals.median_deg:.1e}, worst {normals.worst_deg:.1e}",
            flush=True,
        )
    if arguments.verbose:
        for warning in snapshot.warnings:
            print(f"{'':36}warning: {warning}")
    return met


def _line(name: str, size: tuple[int, int], found: Agreement, seconds: float) -> str:
    shares = (found.hit, found.same, found.same_inside, found.depth)
    hit, same, inside, depth = (100 * x for x in shares)
    return (
        f"{name[:34]:34} {'x'.join(map(str, size)):>10} {hit:6.2f} {same:9.4f} "
        f"{found.tied:7} {inside:9.4f} {depth:9.4f} {found.depth_median:9.1e} "
        f"{found.depth_worst:9.1e} {seconds:5.1f}  {found.verdict}"
    )


def capped(size_wh: tuple[int, int], max_side: int) -> tuple[int, int]:
    """The size made smaller, if need be, until its longer side is max_side."""
    longest = max(size_wh)
    if longest <= max_side:
        return size_wh
    width, height = (max(1, round(side * max_side / longest)) for side in size_wh)
    return width, height


def _size(text: str) -> tuple[int, int]:
    width, height = (int(part) for part in text.lower().split("x"))
    return width, height


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("scenes", type=Path, metavar="SCENES")
    parser.add_argument("--size", type=_size, metavar="WxH", help="default: each scene's own")
    parser.add_argument("--max-side", type=int, default=960, help="cap on a scene's own size")
    parser.add_argument("--judgements", type=Path, help="keep Cycles' passes and logs here")
    parser.add_argument("--normals", action="store_true", help="compare shading normals, too")
    parser.add_argument("-v", "--verbose", action="store_true", help="print warnings too")
    return parser.parse_args()


if __name__ == "__main__":
    sys.exit(main())
