"""How far the render card's seed moves A, by number of samples, on kept reference cases.

    python benchmarks/bench/seed_noise.py DATASET KEPT_SCENES [--samples 16 32] [--only hard]

A of each seed's render against the case's own public picture, and the sd (ddof = 1) over seeds.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path

from legoworld.bench.case import noise_floor
from legoworld.cards import load_card
from legoworld.running.submission import card_size
from legoworld.scene.blender_process import BlenderProcess, Limits
from legoworld.scene.folder import SceneFolder
from legoworld.scene.freeze import checked_artefacts
from legoworld.scene.open_scene import CardRender, OpenedScene


def main() -> None:
    """A line for each case and number of samples."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("dataset", type=Path)
    parser.add_argument("scenes", type=Path)
    parser.add_argument("--samples", type=int, nargs="+", default=[16, 32, 64])
    parser.add_argument("--seeds", type=int, default=4)
    parser.add_argument("--only", default="")
    chosen = parser.parse_args()
    card = load_card("bench")
    largest: dict[int, float] = {}
    with BlenderProcess(Limits(time_s=600)) as blender:
        for path in sorted(chosen.scenes.iterdir()):
            if chosen.only not in path.name:
                continue
            folder = SceneFolder(path=path, name=path.name)
            opened = OpenedScene(
                folder, checked_artefacts(folder, require_frozen=False), blender, None
            )
            picture = (chosen.dataset / "public" / "images" / f"{path.name}.png").read_bytes()
            for samples in chosen.samples:
                begin = time.perf_counter()
                renders = [
                    opened.render(
                        CardRender(
                            size_wh=card_size((16, 9), card.value("render.longest_side_px")),
                            samples=samples,
                            seed=seed,
                            denoise=False,
                        )
                    )
                    for seed in range(chosen.seeds)
                ]
                floor = noise_floor(
                    tuple(range(chosen.seeds)), renders, picture, card.value("scoring.delta")
                )
                largest[samples] = max(largest.get(samples, 0.0), floor.sd)
                seconds = (time.perf_counter() - begin) / chosen.seeds
                mean = sum(floor.a_self) / len(floor.a_self)
                print(
                    f"{path.name} {samples:4d} samples: A {mean:.4f}, sd {floor.sd:.5f}, "
                    f"{seconds:.1f} s a render",
                    flush=True,
                )
    print({samples: round(sd, 5) for samples, sd in largest.items()}, "largest sd by samples")


if __name__ == "__main__":
    main()
