"""Building scenes from KayKit's assets (CC0): things are dropped onto what lies below them."""

from __future__ import annotations

import logging
import math
import os
import sys
from pathlib import Path
from typing import Any

import bpy
from mathutils import Matrix, Vector

PACKS = ("furniture", "restaurant", "city_builder")
VARIABLE = "LEGOWORLD_KAYKIT"

logging.disable(logging.INFO)  # Blender's glTF add-on tells of every mesh


def assets_folder(chosen: str | None) -> Path:
    """The folder with KayKit's packs; ends the program with what to do where it is not there."""
    named = chosen or os.environ.get(VARIABLE)
    folder = Path(named) if named else None
    if folder is not None and all((folder / pack).is_dir() for pack in PACKS):
        return folder
    sys.exit(
        f"KayKit's assets are needed; found: {named or 'no folder named'}; expected: a folder with "
        f"{', '.join(PACKS)}, each the gltf folder of the pack of that name (CC0, "
        f"KayKit-Game-Assets on GitHub); next: pass --kaykit FOLDER or set {VARIABLE}"
    )


class Stage:
    """An empty scene that assets are put into; metres, z up, an asset's front towards -y."""

    def __init__(self, assets: Path, environment: str, theme: str) -> None:
        bpy.ops.wm.read_factory_settings(use_empty=True)
        self._assets = assets
        self._models: dict[str, Any] = {}
        self._materials: dict[str, Any] = {}
        self.scene = bpy.context.scene
        self.scene.render.resolution_x, self.scene.render.resolution_y = 1920, 1080
        self.scene["environment"], self.scene["theme"] = environment, theme

    def put(
        self,
        asset: str,
        x: float,
        y: float,
        *,
        z: float | None = None,
        turn: float = 0.0,
        scale: float = 1.0,
        category: str | None = None,
        tier: str | None = None,
        reach: float = 0.5,
    ) -> Any:
        """Stand an asset at (x, y), on the highest thing below it; z: its origin's height instead.

        turn: degrees about z. reach: how much of its footprint must be clear of higher things.
        """
        made = self._copied(asset)
        made.matrix_world = (
            Matrix.Translation((x, y, 0.0))
            @ Matrix.Rotation(math.radians(turn), 4, "Z")
            @ Matrix.Scale(scale, 4)
        )
        bpy.context.view_layer.update()
        low, high = extent(made)
        made.location.z = self._ground(made, low, high, reach) - low.z if z is None else z
        if category:
            made["category"] = category
        if tier:
            made["tier"] = tier
        bpy.context.view_layer.update()
        return made

    def box(self, name: str, low: tuple, high: tuple, color: tuple) -> Any:
        """A plain box of the architecture."""
        corners = [
            (x, y, z)
            for z in (low[2], high[2])
            for x, y in ((low[0], low[1]), (high[0], low[1]), (high[0], high[1]), (low[0], high[1]))
        ]
        faces = [(3, 2, 1, 0), (4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7)]
        data = bpy.data.meshes.new(name)
        data.from_pydata(corners, [], faces)
        material = bpy.data.materials.new(name)
        material.use_nodes = True
        shader = material.node_tree.nodes["Principled BSDF"]
        shader.inputs["Base Color"].default_value = (*color, 1.0)
        shader.inputs["Roughness"].default_value = 0.9
        data.materials.append(material)
        made = bpy.data.objects.new(name, data)
        self.scene.collection.objects.link(made)
        bpy.context.view_layer.update()
        return made

    def room(self, half_x: float, half_y: float, height: float, wall: tuple, floor: tuple) -> None:
        """A floor and walls at the back (+y) and on both sides; open to the front and above."""
        x, y, t = half_x, half_y, 0.2
        self.box("Floor", (-x - t, -y, -t), (x + t, y + t, 0.0), floor)
        self.box("Wall back", (-x - t, y, 0.0), (x + t, y + t, height), wall)
        self.box("Wall left", (-x - t, -y, 0.0), (-x, y, height), wall)
        self.box("Wall right", (x, -y, 0.0), (x + t, y, height), wall)

    def light(self, sky: tuple, strength: float, sun: float, tilt: tuple[float, float]) -> None:
        """An even sky and a soft sun; tilt: degrees about x and z."""
        world = bpy.data.worlds.new("World")
        world.use_nodes = True
        background = world.node_tree.nodes["Background"]
        background.inputs["Color"].default_value = (*sky, 1.0)
        background.inputs["Strength"].default_value = strength
        self.scene.world = world
        data = bpy.data.lights.new("Sun", "SUN")
        data.energy, data.angle = sun, math.radians(5)
        made = bpy.data.objects.new("Sun", data)
        made.rotation_euler = (math.radians(tilt[0]), 0.0, math.radians(tilt[1]))
        self.scene.collection.objects.link(made)
        self.scene.view_settings.view_transform = "Standard"

    def view(self, number: int, place: tuple, target: tuple, lens: float) -> None:
        """A camera that is one of the family's views."""
        data = bpy.data.cameras.new(f"View {number}")
        data.lens, data.clip_end = lens, 200.0
        made = bpy.data.objects.new(f"View {number}", data)
        made["view"] = number
        made.location = place
        made.rotation_euler = (Vector(target) - Vector(place)).to_track_quat("-Z", "Y").to_euler()
        self.scene.collection.objects.link(made)
        if self.scene.camera is None:
            self.scene.camera = made

    def save(self, folder: Path) -> None:
        """Write scene.blend with everything in it."""
        for image in bpy.data.images:
            if image.users and image.packed_file is None and image.source == "FILE":
                image.pack()
        folder.mkdir(parents=True, exist_ok=True)
        bpy.data.orphans_purge(do_recursive=True)
        bpy.ops.wm.save_as_mainfile(
            filepath=str(folder / "scene.blend"), compress=True, check_existing=False
        )

    def _ground(self, made: Any, low: Vector, high: Vector, reach: float) -> float:
        """The highest surface under the middle part of a thing's footprint; 0 where there is none.

        What stands there already counts, the thing itself does not.
        """
        own = {made, *made.children_recursive}
        for thing in own:
            thing.hide_set(True)
        bpy.context.view_layer.update()
        graph = bpy.context.evaluated_depsgraph_get()
        middle, half = (low + high) / 2, (high - low) / 2 * reach
        heights = [0.0]
        for i in range(5):
            for j in range(5):
                start = (middle.x + half.x * (i - 2) / 2, middle.y + half.y * (j - 2) / 2, 50.0)
                hit, place, *_ = self.scene.ray_cast(graph, start, (0, 0, -1))
                heights += [place.z] if hit else []
        for thing in own:
            thing.hide_set(False)
        return max(heights)

    def _copied(self, asset: str) -> Any:
        """A copy of an asset's objects that shares its meshes; its root."""
        if asset not in self._models:
            self._models[asset] = self._imported(asset)
        name = asset.rpartition("/")[2]

        def copied(source: Any, parent: Any) -> Any:
            made = source.copy()
            made.name = name if parent is None else source.name
            self.scene.collection.objects.link(made)
            made.parent = parent
            if parent is not None:
                made.matrix_parent_inverse = source.matrix_parent_inverse
            for child in source.children:
                copied(child, made)
            return made

        return copied(self._models[asset], None)

    def _imported(self, asset: str) -> Any:
        """An asset's root, outside of the scene, its materials those of its pack."""
        path = self._assets / f"{asset}.gltf"
        if not path.is_file():
            sys.exit(f"there is no asset {asset}; found: no {path.name}; expected: KayKit's pack")
        before = set(bpy.data.objects)
        bpy.ops.import_scene.gltf(filepath=str(path))
        made = [o for o in bpy.data.objects if o not in before]
        pack = asset.partition("/")[0]
        for thing in made:
            for slot in thing.material_slots:
                key = f"{pack} {slot.material.name.partition('.')[0]}"
                slot.material = self._materials.setdefault(key, slot.material)
            for holder in thing.users_collection:
                holder.objects.unlink(thing)
        roots = [o for o in made if o.parent is None]
        if len(roots) == 1:
            return roots[0]
        root = bpy.data.objects.new(asset.rpartition("/")[2], None)
        for thing in roots:
            thing.parent = root
        return root


def extent(root: Any) -> tuple[Vector, Vector]:
    """Corners of the box around a thing and what belongs to it, in the world."""
    corners = [
        thing.matrix_world @ Vector(corner)
        for thing in (root, *root.children_recursive)
        if thing.type == "MESH"
        for corner in thing.bound_box
    ]
    low = Vector(min(c[i] for c in corners) for i in range(3))
    high = Vector(max(c[i] for c in corners) for i in range(3))
    return low, high
