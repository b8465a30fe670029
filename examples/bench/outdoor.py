"""Streets: a crossing, a row of houses, a car park, seen from the street and from above."""

from __future__ import annotations

from kaykit import Stage

C = "city_builder/"
M, H = "medium", "hard"
#: Height of a pavement or road tile's top.
GRASS = (0.30, 0.45, 0.18)


def _sky(stage: Stage) -> None:
    stage.light((0.60, 0.78, 1.0), 0.8, 3.0, (42.0, 40.0))


def _ground(stage: Stage, half: float) -> None:
    stage.box("Ground", (-half, -half, -0.3), (half, half, 0.0), GRASS)


def crossing(stage: Stage) -> None:
    """Four roads meet between houses."""
    _ground(stage, 9.0)
    _sky(stage)
    stage.put(C + "road_junction", 0, 0, z=0.0)
    for d in (2, 4, 6):
        tile = "road_straight_crossing" if d == 2 else "road_straight"
        for sign in (1, -1):
            stage.put(C + tile, sign * d, 0, z=0.0, turn=90)
            stage.put(C + tile, 0, sign * d, z=0.0)
    houses = [("A", 2, 2), ("C", -2, 2), ("G", 2, 4), ("E", -2, 4), ("B", 4, 2), ("D", -4, 2)]
    for name, x, y in houses:
        stage.put(f"{C}building_{name}", x, y, z=0.0, category="building")
    for x, y in ((2, -2), (-2, -2)):
        stage.put(C + "base", x, y, z=0.0)
    stage.put(C + "car_taxi", 0.33, -2.75, turn=180, category="car", tier=M)
    stage.put(C + "car_sedan", -3.2, -0.33, turn=90, category="car", tier=M)
    stage.put(C + "car_police", -0.33, 3.3, category="car", tier=M)
    for x, y, turn in ((0.85, -1.15, 0), (-0.85, 1.15, 180)):
        stage.put(C + "trafficlight_B", x, y, turn=turn, category="traffic light", tier=M)
    stage.put(C + "streetlight", 1.15, -2.6, category="street light", tier=M)
    stage.put(C + "bench", 2.0, -1.35, turn=180, category="bench", tier=H)
    stage.put(C + "bush", 1.5, -1.7, category="bush", tier=H)
    stage.put(C + "bush", 2.6, -1.6, category="bush", tier=H)
    stage.put(C + "bush", -1.5, -1.5, category="bush", tier=H)
    stage.put(C + "firehydrant", -1.25, -2.3, category="hydrant", tier=H)
    stage.put(C + "dumpster", -2.1, -1.6, category="dumpster", tier=H)
    stage.put(C + "box_A", -1.75, -1.3, turn=20, category="box", tier=H)
    stage.view(0, (1.9, -5.4, 2.0), (-0.1, 0.6, 0.5), 30.0)
    stage.view(1, (-5.2, -6.0, 6.0), (0.0, 0.4, 0.2), 38.0)


def street(stage: Stage) -> None:
    """A row of houses along a straight road."""
    _ground(stage, 9.0)
    _sky(stage)
    for i in range(-4, 5):
        stage.put(C + "road_straight", 2 * i, 0, z=0.0, turn=90)
        stage.put(C + "base", 2 * i, -2, z=0.0)
    for i, name in enumerate("BHDAFCG"):
        stage.put(f"{C}building_{name}", 2 * (i - 3), 2, z=0.0, category="building")
    stage.put(C + "car_hatchback", -1.6, -0.33, turn=90, category="car", tier=M)
    stage.put(C + "car_stationwagon", 1.1, 0.33, turn=-90, category="car", tier=M)
    stage.put(C + "streetlight", -2.2, -1.15, turn=-90, category="street light", tier=M)
    stage.put(C + "streetlight", 2.2, -1.15, turn=-90, category="street light", tier=M)
    stage.put(C + "watertower", 0.2, 2.0, category="water tower", tier=M)
    stage.put(C + "bench", 0.0, -1.6, category="bench", tier=H)
    stage.put(C + "trash_A", 0.5, -1.6, category="trash", tier=H)
    stage.put(C + "bush", -0.5, -1.7, category="bush", tier=H)
    stage.put(C + "bush", -1.2, -1.9, category="bush", tier=H)
    stage.put(C + "firehydrant", 1.3, -1.25, category="hydrant", tier=H)
    stage.put(C + "box_B", 1.7, -1.7, turn=35, category="box", tier=H)
    stage.put(C + "box_A", 1.9, -1.9, turn=10, category="box", tier=H)
    stage.view(0, (-0.6, -5.4, 1.7), (0.1, 0.6, 0.8), 28.0)
    stage.view(1, (-5.0, -4.4, 3.0), (0.6, 0.2, 0.4), 30.0)


def car_park(stage: Stage) -> None:
    """Cars on a paved yard behind a house, from above."""
    _ground(stage, 8.0)
    _sky(stage)
    for x in (-4, -2, 0, 2, 4):
        for y in (-2, 0):
            stage.put(C + "base", x, y, z=0.0)
        stage.put(C + "road_straight", x, -4, z=0.0, turn=90)
    for name, x in (("E", -2), ("H", 0), ("F", 2)):
        stage.put(f"{C}building_{name}", x, 2, z=0.0, category="building")
    for kind, x in (("sedan", -2.4), ("taxi", -0.8), ("hatchback", 0.8)):
        stage.put(C + f"car_{kind}", x, -0.6, category="car")
    stage.put(C + "car_stationwagon", 2.4, -0.6, category="car", tier=M)
    stage.put(C + "car_police", -1.4, -3.67, turn=90, category="car", tier=M)
    stage.put(C + "dumpster", 3.9, 0.3, turn=-90, category="dumpster", tier=M)
    stage.put(C + "streetlight", -3.6, -2.2, turn=-90, category="street light", tier=M)
    for x in (-3.4, -2.9, 3.3):
        stage.put(C + "bush", x, 0.55, category="bush", tier=H)
    stage.put(C + "bench", 0.0, -2.4, turn=180, category="bench", tier=H)
    stage.put(C + "box_A", 3.2, -1.4, turn=25, category="box", tier=H)
    stage.put(C + "box_B", 3.2, -1.4, turn=60, category="box", tier=H, reach=0.2)
    stage.put(C + "trash_B", 3.4, -0.3, category="trash", tier=H)
    stage.view(0, (0.3, -7.0, 6.0), (0.0, -1.0, 0.0), 36.0)
    stage.view(1, (5.2, -5.6, 3.2), (-0.2, -0.4, 0.3), 30.0)
