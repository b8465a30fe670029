"""Rooms: living room, bedroom, study, kitchen, restaurant."""

from __future__ import annotations

from kaykit import Stage

WARM, COOL, SAGE = (0.80, 0.66, 0.52), (0.55, 0.66, 0.78), (0.58, 0.68, 0.55)
OAK, STONE = (0.42, 0.27, 0.16), (0.50, 0.50, 0.52)
M, H = "medium", "hard"


def _daylight(stage: Stage) -> None:
    stage.light((0.95, 0.97, 1.0), 0.9, 1.8, (38.0, 25.0))


def living_room(stage: Stage) -> None:
    """A couch and armchairs around a low table."""
    stage.room(4.0, 3.5, 3.4, WARM, OAK)
    _daylight(stage)
    f = "furniture/"
    stage.put(f + "rug_rectangle_stripes_A", 0.0, 0.4, category="rug")
    stage.put(f + "couch", 0.0, 2.5, category="couch")
    stage.put(f + "table_low", 0.0, 0.5, category="table")
    stage.put(f + "armchair", -2.7, 0.6, turn=75, category="armchair")
    stage.put(f + "lamp_standing", 3.2, 2.8, category="lamp")
    stage.put(f + "cabinet_medium", -2.8, 2.9, category="cabinet", tier=M)
    stage.put(f + "chair_B", 2.4, 0.2, turn=-70, category="chair", tier=M)
    stage.put(f + "pictureframe_large_B", 0.0, 3.5, z=2.2, category="picture", tier=M)
    stage.put(f + "shelf_B_large", -4.0, 0.8, z=1.9, turn=90, category="shelf", tier=M)
    stage.put(f + "lamp_table", -3.2, 2.9, scale=0.7, category="lamp", tier=M)
    stage.put(f + "pillow_A", -0.75, 2.1, turn=20, category="pillow", tier=H)
    stage.put(f + "pillow_B", 0.7, 2.1, turn=-25, category="pillow", tier=H)
    stage.put(f + "book_single", 0.5, 0.5, turn=30, scale=0.8, category="book", tier=H)
    stage.put(f + "cactus_small_A", -0.5, 0.5, scale=0.7, category="plant", tier=H)
    stage.put(f + "pictureframe_standing_A", -2.3, 2.9, category="picture", tier=H)
    stage.put(f + "book_set", -3.75, 0.8, turn=90, category="book", tier=H)
    stage.view(0, (0.6, -5.6, 2.6), (-0.1, 1.2, 0.7), 30.0)
    stage.view(1, (3.3, -3.6, 2.3), (-0.9, 1.6, 0.8), 27.0)


def bedroom(stage: Stage) -> None:
    """A double bed between two bedside cabinets."""
    stage.room(3.8, 3.4, 3.2, COOL, OAK)
    _daylight(stage)
    f = "furniture/"
    stage.put(f + "rug_oval_A", -0.4, -1.2, scale=1.1, category="rug")
    stage.put(f + "bed_double_A", 0.0, 1.7, category="bed", reach=0.0)
    stage.put(f + "cabinet_small", -2.2, 2.8, category="cabinet")
    stage.put(f + "cabinet_small", 2.2, 2.8, category="cabinet")
    stage.put(f + "cabinet_medium", -3.25, 0.2, turn=90, category="cabinet", tier=M)
    stage.put(f + "armchair", 2.6, -0.4, turn=-50, category="armchair", tier=M)
    stage.put(f + "lamp_table", -2.2, 2.8, scale=0.8, category="lamp", tier=M)
    stage.put(f + "pictureframe_large_A", 0.0, 3.4, z=2.2, category="picture", tier=M)
    stage.put(f + "lamp_table", 2.2, 2.8, scale=0.8, category="lamp", tier=H)
    stage.put(f + "pillow_B", 2.38, -0.58, turn=-50, category="pillow", tier=H)
    stage.put(f + "cactus_medium_A", -3.2, 0.6, scale=0.6, category="plant", tier=H)
    stage.put(f + "book_set", -3.2, -0.3, turn=90, scale=0.8, category="book", tier=H)
    stage.put(f + "pictureframe_small_B", -3.8, 1.6, z=1.9, turn=90, category="picture", tier=H)
    stage.put(f + "chair_stool", -0.9, -1.0, category="stool", tier=H)
    stage.view(0, (0.4, -5.4, 2.9), (0.0, 1.4, 0.6), 28.0)
    stage.view(1, (-2.6, -4.2, 2.2), (0.6, 1.6, 0.7), 27.0)


def study(stage: Stage) -> None:
    """A long desk below shelves."""
    stage.room(3.4, 3.2, 3.3, SAGE, OAK)
    _daylight(stage)
    f = "furniture/"
    stage.put(f + "table_medium_long", -0.6, 2.1, category="table")
    stage.put(f + "chair_A_wood", -0.6, 0.8, turn=180, category="chair")
    stage.put(f + "rug_rectangle_B", -0.5, -0.7, category="rug")
    stage.put(f + "cabinet_medium", 2.4, 2.65, category="cabinet")
    stage.put(f + "shelf_B_large", -1.5, 3.2, z=2.2, category="shelf", tier=M)
    stage.put(f + "lamp_table", -1.7, 2.4, scale=0.8, category="lamp", tier=M)
    stage.put(f + "armchair_pillows", 2.3, 0.3, turn=-65, category="armchair", tier=M)
    stage.put(f + "pictureframe_medium", 1.0, 3.2, z=2.2, category="picture", tier=M)
    stage.put(f + "lamp_standing", -2.8, 0.9, category="lamp", tier=M)
    stage.put(f + "book_set", -1.7, 3.0, scale=0.9, category="book", tier=H)
    stage.put(f + "cactus_small_B", -1.0, 3.0, scale=0.6, category="plant", tier=H)
    stage.put(f + "book_single", -0.2, 1.9, turn=15, category="book", tier=H)
    stage.put(f + "pictureframe_standing_B", 0.5, 2.3, turn=-15, category="picture", tier=H)
    stage.put(f + "cactus_medium_B", 2.1, 2.65, scale=0.7, category="plant", tier=H)
    stage.put(f + "chair_stool_wood", 0.2, -0.8, category="stool", tier=H)
    stage.view(0, (0.3, -5.2, 2.7), (-0.1, 1.2, 0.9), 28.0)
    stage.view(1, (2.6, -3.4, 2.4), (-0.8, 1.7, 0.9), 26.0)


def kitchen(stage: Stage) -> None:
    """Counters along the wall, a table with food in front of them."""
    stage.room(5.2, 4.2, 4.2, (0.83, 0.80, 0.72), STONE)
    _daylight(stage)
    r = "restaurant/"
    for x in (-2.0, 2.0):
        stage.put(r + "kitchencounter_straight_A_backsplash", x, 3.2, category="counter", reach=0.3)
    stage.put(r + "kitchencounter_sink_backsplash", 0.0, 3.2, category="sink", reach=0.3)
    stage.put(r + "fridge_A", 4.0, 3.2, category="fridge", reach=0.2)
    stage.put(r + "kitchentable_A_large", -0.4, -0.2, category="table")
    stage.put(r + "oven", -4.1, 3.1, category="oven", tier=M)
    stage.put(r + "kitchencabinet", -2.0, 4.2, z=0.3, category="cabinet", tier=M)
    stage.put(r + "kitchencabinet", 2.0, 4.2, z=0.3, category="cabinet", tier=M)
    stage.put(r + "chair_A", -0.9, -1.5, turn=180, category="chair", tier=M)
    stage.put(r + "chair_A", 0.4, 1.2, category="chair", tier=M)
    stage.put(r + "pot_A", -2.1, 2.75, category="pot", tier=M, reach=0.3)
    stage.put(r + "plate", -1.1, -0.5, scale=0.8, category="plate", tier=H)
    stage.put(r + "food_burger", -1.1, -0.5, scale=0.45, category="food", tier=H)
    stage.put(r + "bowl", 0.3, 0.1, scale=0.8, category="bowl", tier=H)
    stage.put(r + "ketchup", -0.3, 0.3, category="bottle", tier=H)
    stage.put(r + "cuttingboard", 1.75, 2.9, scale=0.8, category="board", tier=H)
    stage.put(r + "food_ingredient_tomato", 1.6, 2.9, scale=0.5, category="food", tier=H)
    stage.put(r + "jar_A_medium", 2.68, 2.85, category="jar", tier=H)
    stage.put(r + "crate_carrots", 3.4, 0.2, turn=15, scale=0.7, category="crate", tier=H)
    stage.view(0, (0.5, -7.0, 3.6), (-0.1, 1.4, 1.0), 27.0)
    stage.view(1, (-3.9, -4.4, 3.0), (0.6, 1.8, 1.0), 24.0)


def restaurant(stage: Stage) -> None:
    """Two round tables with chairs, laid for a meal."""
    stage.room(5.0, 4.0, 4.0, (0.72, 0.48, 0.40), (0.30, 0.22, 0.18))
    _daylight(stage)
    r = "restaurant/"
    for x, y in ((-2.1, 0.9), (2.2, 0.2)):
        stage.put(r + "table_round_A", x, y, category="table")
        stage.put(r + "chair_B", x, y + 1.75, category="chair")
        stage.put(r + "chair_B", x, y - 1.75, turn=180, category="chair")
    for x, y in ((-2.1, 0.9), (2.2, 0.2)):
        stage.put(r + "chair_A", x - 1.75, y, turn=90, category="chair", tier=M)
        stage.put(r + "plate", x, y - 0.85, scale=0.8, category="plate", tier=M)
        stage.put(r + "menu", x + 0.2, y + 0.1, turn=30, category="menu", tier=M)
        stage.put(r + "food_dinner", x - 0.1, y + 0.8, scale=0.7, category="food", tier=H)
        stage.put(r + "food_ingredient_steak", x, y - 0.85, scale=0.4, category="food", tier=H)
        stage.put(r + "ketchup", x + 0.7, y + 0.3, scale=0.8, category="bottle", tier=H)
        stage.put(r + "mustard", x + 0.8, y - 0.1, scale=0.8, category="bottle", tier=H)
    stage.put(r + "pillar_A", 4.5, 3.5, category="pillar", tier=M)
    stage.put(r + "crate_lettuce", -4.1, 3.1, scale=0.7, category="crate", tier=H)
    stage.view(0, (0.2, -6.4, 3.4), (0.0, 0.9, 0.7), 26.0)
    stage.view(1, (-4.2, -4.2, 3.0), (0.4, 0.8, 0.7), 24.0)
