"""Build the reference families from KayKit's assets: eight scenes, three tiers, two views each.

python examples/bench/build.py --kaykit FOLDER -o references [--family kitchen]
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path

import indoor
import outdoor
from kaykit import Stage, assets_folder

#: Each family's environment, theme and program.
FAMILIES: dict[str, tuple[str, str, Callable[[Stage], None]]] = {
    "bedroom": ("indoor", "home", indoor.bedroom),
    "car_park": ("outdoor", "city", outdoor.car_park),
    "crossing": ("outdoor", "city", outdoor.crossing),
    "kitchen": ("indoor", "restaurant", indoor.kitchen),
    "living_room": ("indoor", "home", indoor.living_room),
    "restaurant": ("indoor", "restaurant", indoor.restaurant),
    "street": ("outdoor", "city", outdoor.street),
    "study": ("indoor", "home", indoor.study),
}


def main() -> None:
    """Write a scene folder for each family."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--kaykit", help="folder of KayKit's packs [default: $LEGOWORLD_KAYKIT]")
    parser.add_argument("-o", "--output", type=Path, required=True)
    parser.add_argument("--family", choices=sorted(FAMILIES), action="append")
    chosen = parser.parse_args()
    assets = assets_folder(chosen.kaykit)
    for name in chosen.family or sorted(FAMILIES):
        environment, theme, program = FAMILIES[name]
        stage = Stage(assets, environment, theme)
        program(stage)
        stage.save(chosen.output / name)


if __name__ == "__main__":
    main()
