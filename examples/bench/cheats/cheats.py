"""Submissions that score without reconstructing: what each needs to know, and how it is made.

    python examples/bench/cheats/cheats.py DATASET --case kitchen__easy__view_00 \\
        --itself KEPT_SCENES -o SUBMISSIONS

writes SUBMISSIONS/<cheat>/<case>, one folder for each cheat below. Depth comes from the private
half, as the best network there could be would see it, or with a network's errors.
"""

from __future__ import annotations

import argparse
import json
import logging
import math
import shutil
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import bpy
import numpy as np
from mathutils import Matrix
from numpy.typing import NDArray

from legoworld.visibility.scoring_raster import raster_size

F64 = NDArray[np.float64]
#: From OpenCV's camera axes to Blender's.
AXES = np.array([1.0, -1.0, -1.0])
FAR_M = 60.0
#: Of 16 x 9 tiles.
ORDER = np.random.default_rng(0).permutation(144)


@dataclass(frozen=True, kw_only=True)
class Case:
    """What a cheat knows. depth_z_m: (H, W) at the photo's size, FAR_M where nothing is hit."""

    stem: str
    photo: Path
    size_wh: tuple[int, int]
    hfov_deg: float
    depth_z_m: F64
    instance: NDArray[np.int32]
    world_from_cam: F64
    other: Case | None = None


def read_case(dataset: Path, stem: str, *, with_other: bool = True) -> Case:
    """A case of a dataset, with the case of the family's next view where there is one."""
    track = json.loads((dataset / "public" / "track.json").read_text("utf-8"))["images"]
    truths = json.loads((dataset / "private" / "truth.json").read_text("utf-8"))["images"]
    image = next(i for i in track if i["file_name"] == f"{stem}.png")
    private = dataset / "private"
    depth = np.load(private / "depth" / f"{stem}.npz")["depth_z_m"].astype(np.float64)
    others = [
        i["file_name"].removesuffix(".png")
        for i in track
        if (i["family"], i["tier"]) == (image["family"], image["tier"]) and i["id"] != image["id"]
    ]
    return Case(
        stem=stem,
        photo=dataset / "public" / "images" / f"{stem}.png",
        size_wh=(image["width"], image["height"]),
        hfov_deg=image["hfov_deg"],
        depth_z_m=np.where(np.isfinite(depth), np.minimum(depth, FAR_M), FAR_M),
        instance=np.load(private / "instances" / f"{stem}.npz")["instance"],
        world_from_cam=np.array(truths[str(image["id"])]["camera"]["world_from_cam"]),
        other=read_case(dataset, others[0], with_other=False) if with_other and others else None,
    )


# Depth as an attacker has it.


def noisy(depth: F64) -> F64:
    """5 % off, and 8 % noise on every pixel."""
    return depth * 1.05 * (1 + 0.08 * np.random.default_rng(0).standard_normal(depth.shape))


def smooth_error(depth: F64) -> F64:
    """5 % off, and 8 % of error that changes slowly, as a network's does."""
    random = np.random.default_rng(0)
    return depth * 1.05 * (1 + 0.08 * _waves(depth.shape, random))


def monocular(depth: F64) -> F64:
    """A relative network's: disparity after a wrong scale and shift, edges blurred, slow errors.

    The scale is fitted to a guessed median distance that is 15 % off; 4 % of disparity is added.
    """
    random = np.random.default_rng(1)
    blurred = _blurred(1 / depth, max(1, depth.shape[1] // 100))
    disparity = blurred * (1 + 0.05 * _waves(depth.shape, random)) + 0.04 * float(blurred.max())
    return 1.15 * float(np.median(depth)) * float(np.median(disparity)) / disparity


def anything(depth: F64) -> F64:
    """Random for each pixel, between the least and the largest."""
    return np.random.default_rng(0).uniform(depth.min(), np.percentile(depth, 99), depth.shape)


def _waves(shape: tuple[int, ...], random: np.random.Generator) -> F64:
    """A smooth field of mean 0 and standard deviation 1."""
    y, x = np.mgrid[0 : shape[0], 0 : shape[1]] / shape[1] * 2 * math.pi
    field = sum(
        random.standard_normal() * np.sin(a * x + b * y + random.uniform(0, 2 * math.pi))
        for a in range(-3, 4)
        for b in range(4)
    )
    field = np.asarray(field, np.float64)
    return (field - field.mean()) / field.std()


def _blurred(values: F64, radius: int) -> F64:
    """A box filter, twice."""
    for axis in (0, 1, 0, 1):
        padded = np.pad(values, [(radius, radius) if a == axis else (0, 0) for a in (0, 1)], "edge")
        total = np.cumsum(padded, axis=axis)
        total = np.insert(total, 0, 0, axis=axis)
        n, width = values.shape[axis], 2 * radius + 1
        values = (total.take(range(width, width + n), axis) - total.take(range(n), axis)) / width
    return values


# What is built of it.


def new_scene(case: Case) -> Any:
    """An empty scene with the case's camera at the origin, and colours as they are in the photo."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    scene.view_settings.view_transform = "Standard"
    data = bpy.data.cameras.new("Camera")
    data.sensor_fit, data.clip_start, data.clip_end = "HORIZONTAL", 0.01, 1000.0
    data.angle = math.radians(case.hfov_deg)
    scene.camera = bpy.data.objects.new("Camera", data)
    scene.collection.objects.link(scene.camera)
    scene.render.resolution_x, scene.render.resolution_y = case.size_wh
    scene.world = bpy.data.worlds.new("World")
    return scene


def rays(case: Case, x_px: F64, y_px: F64, shape_wh: tuple[int, int]) -> F64:
    """(..., 3) points at planar depth 1 in Blender's camera frame, of places on a grid."""
    half = math.tan(math.radians(case.hfov_deg) / 2)
    aspect = case.size_wh[1] / case.size_wh[0]
    x = (2 * x_px / shape_wh[0] - 1) * half
    y = (2 * y_px / shape_wh[1] - 1) * half * aspect
    return np.stack([x, y, np.ones_like(x)], axis=-1) * AXES


def sampled(values: NDArray[Any], shape_wh: tuple[int, int]) -> NDArray[Any]:
    """An array of the photo's size at the centres of another grid."""
    rows, columns = (
        ((np.arange(n) + 0.5) * full / n).astype(int)
        for n, full in zip(shape_wh[::-1], values.shape[:2], strict=True)
    )
    return values[np.ix_(rows, columns)]


def quads(name: str, corners: F64, colours: F64 | None = None, uv: F64 | None = None) -> Any:
    """(N, 4, 3) squares as one object; colours: (N, 4, 3) linear; uv: (N, 4, 2)."""
    n = len(corners)
    mesh = bpy.data.meshes.new(name)
    mesh.vertices.add(4 * n)
    mesh.vertices.foreach_set("co", corners.astype(np.float32).ravel())
    mesh.loops.add(4 * n)
    mesh.loops.foreach_set("vertex_index", np.arange(4 * n, dtype=np.int32))
    mesh.polygons.add(n)
    mesh.polygons.foreach_set("loop_start", np.arange(0, 4 * n, 4, dtype=np.int32))
    if colours is not None:
        layer = mesh.color_attributes.new("Colour", "FLOAT_COLOR", "POINT")
        rgba = np.ones((4 * n, 4), np.float32)
        rgba[:, :3] = colours.reshape(-1, 3)
        layer.data.foreach_set("color", rgba.ravel())
    if uv is not None:
        mesh.uv_layers.new(name="UVMap").uv.foreach_set("vector", uv.astype(np.float32).ravel())
    mesh.update()
    made = bpy.data.objects.new(name, mesh)
    bpy.context.scene.collection.objects.link(made)
    return made


def photo_colours(case: Case) -> F64:
    """(H, W, 3) linear colours of the photo."""
    image = bpy.data.images.load(str(case.photo))
    values = np.empty(len(image.pixels), np.float32)
    image.pixels.foreach_get(values)
    bpy.data.images.remove(image)
    rgb = values.reshape(case.size_wh[1], case.size_wh[0], -1)[::-1, :, :3].astype(np.float64)
    return np.where(rgb <= 0.04045, rgb / 12.92, ((rgb + 0.055) / 1.055) ** 2.4)


def saved_picture(case: Case, name: str, change: Callable[[F64], F64]) -> Any:
    """The photo changed, as an image packed into the scene."""
    image = bpy.data.images.load(str(case.photo))
    values = np.empty(len(image.pixels), np.float32)
    image.pixels.foreach_get(values)
    width, height = image.size
    rgba = values.reshape(height, width, -1)
    rgba[..., :3] = change(rgba[..., :3].astype(np.float64))
    made = bpy.data.images.new(name, width, height)
    made.pixels.foreach_set(rgba.ravel())
    made.pack()
    bpy.data.images.remove(image)
    return made


def negative(rgb: F64) -> F64:
    """As a negative, so that it does not correlate with the photo."""
    return 1 - rgb


def tiles(rgb: F64) -> F64:
    """16 x 9 tiles in another order, rows from the top."""
    height, width = rgb.shape[0] // 9, rgb.shape[1] // 16
    made = rgb.copy()
    for here, there in enumerate(ORDER.tolist()):
        target, source = (
            np.s_[row * height : (row + 1) * height, column * width : (column + 1) * width]
            for row, column in (divmod(here, 16), divmod(there, 16))
        )
        made[target] = rgb[source]
    return made


def shader(tree: Any, kind: str, colour: Any) -> Any:
    """A shader of a colour, as the tree's output."""
    tree.nodes.clear()
    made = tree.nodes.new(kind)
    world = kind == "ShaderNodeBackground"
    output = tree.nodes.new("ShaderNodeOutputWorld" if world else "ShaderNodeOutputMaterial")
    tree.links.new(made.outputs[0], output.inputs["Surface"])
    tree.links.new(colour(tree), made.inputs["Color"])
    return output


def inverted_picture(case: Case, place: str) -> Callable[[Any], Any]:
    """A colour: the photo's negative turned back, by window or by UV coordinates."""
    image = saved_picture(case, "backdrop", negative)

    def colour(tree: Any) -> Any:
        place_node = tree.nodes.new("ShaderNodeTexCoord")
        picture = tree.nodes.new("ShaderNodeTexImage")
        picture.image, picture.interpolation, picture.extension = image, "Linear", "EXTEND"
        # sRGB as numbers: turned back before they become light.
        image.colorspace_settings.name = "Non-Color"
        turned = tree.nodes.new("ShaderNodeInvert")
        light = tree.nodes.new("ShaderNodeGamma")
        light.inputs["Gamma"].default_value = 2.2
        tree.links.new(place_node.outputs[place], picture.inputs["Vector"])
        tree.links.new(picture.outputs["Color"], turned.inputs["Color"])
        tree.links.new(turned.outputs["Color"], light.inputs["Color"])
        return light.outputs["Color"]

    return colour


def photo_in_world(case: Case) -> None:
    """The photo behind everything, wherever the camera is: window coordinates."""
    tree = bpy.context.scene.world.node_tree
    shader(tree, "ShaderNodeBackground", inverted_picture(case, "Window"))


def emission(name: str, colour: Callable[[Any], Any]) -> Any:
    """A material that shows a colour as it is."""
    material = bpy.data.materials.new(name)
    shader(material.node_tree, "ShaderNodeEmission", colour)
    return material


def vertex_colour(tree: Any) -> Any:
    """The mesh's own colours."""
    node = tree.nodes.new("ShaderNodeVertexColor")
    node.layer_name = "Colour"
    return node.outputs["Color"]


def dust(case: Case, depth: F64, size_px: float = 0.02) -> Any:
    """A square in the photo's colour at each public raster centre; the photo is in the world."""
    shape = raster_size(case.size_wh)
    z = sampled(depth, shape)
    rows, columns = np.mgrid[0 : shape[1], 0 : shape[0]] + 0.5
    around = np.array([(-1, 1), (1, 1), (1, -1), (-1, -1)]) * size_px / 2
    corners = rays(case, columns[..., None] + around[:, 0], rows[..., None] + around[:, 1], shape)
    colours = np.repeat(sampled(photo_colours(case), shape).reshape(-1, 1, 3), 4, axis=1)
    made = quads("dust", (corners * z[..., None, None]).reshape(-1, 4, 3), colours)
    made.data.materials.append(emission("dust", vertex_colour))
    photo_in_world(case)
    return made


def shell(
    case: Case, depth: F64, *, uv: bool = False, shape_wh: tuple[int, int] | None = None
) -> Any:
    """One connected surface through the depth of a grid; colours are its corners' own."""
    shape = shape_wh or raster_size(case.size_wh)
    z = sampled(depth, shape)
    edge = np.pad(z, 1, mode="edge")
    corner_z = np.minimum.reduce([edge[:-1, :-1], edge[1:, :-1], edge[:-1, 1:], edge[1:, 1:]])
    rows, columns = np.mgrid[0 : shape[1] + 1, 0 : shape[0] + 1].astype(np.float64)
    points = rays(case, columns, rows, shape) * corner_z[..., None]

    def four(values: F64) -> F64:
        parts = values[1:, :-1], values[1:, 1:], values[:-1, 1:], values[:-1, :-1]
        return np.stack(parts, axis=2).reshape(-1, 4, values.shape[-1])

    colours = np.repeat(sampled(photo_colours(case), shape).reshape(-1, 1, 3), 4, axis=1)
    places = np.stack([columns / shape[0], 1 - rows / shape[1]], axis=-1)
    made = quads("shell", four(points), colours, four(places) if uv else None)
    made.data.materials.append(emission("shell", vertex_colour))
    return made


def photo_plane(case: Case) -> None:
    """The photo's negative on a rectangle at the median depth, turned back by a node."""
    z = float(np.median(case.depth_z_m))
    x, y = np.array([0.0, 1.0, 1.0, 0.0]), np.array([1.0, 1.0, 0.0, 0.0])
    uv = np.stack([x, 1 - y], axis=-1)[None]
    made = quads("plane", (rays(case, x, y, (1, 1)) * z)[None], None, uv)
    made.data.materials.append(emission("photo", inverted_picture(case, "UV")))


def node_alpha(case: Case) -> None:
    """A true surface whose alpha is 0 by a node that only a renderer understands."""
    made = shell(case, case.depth_z_m)
    material = made.data.materials[0]
    tree = material.node_tree
    tree.nodes.clear()
    output = tree.nodes.new("ShaderNodeOutputMaterial")
    principled = tree.nodes.new("ShaderNodeBsdfPrincipled")
    noise, product = tree.nodes.new("ShaderNodeTexNoise"), tree.nodes.new("ShaderNodeMath")
    product.operation = "MULTIPLY"
    product.inputs[1].default_value = 0.0
    tree.links.new(noise.outputs[0], product.inputs[0])
    tree.links.new(product.outputs[0], principled.inputs["Alpha"])
    tree.links.new(principled.outputs[0], output.inputs["Surface"])
    photo_in_world(case)


def tiled_shell(case: Case) -> None:
    """A shell textured with the photo's tiles in another order, each found by its own UV."""
    made = shell(case, smooth_error(case.depth_z_m), uv=True, shape_wh=(416, 234))
    image = saved_picture(case, "tiles", lambda rgb: tiles(rgb[::-1])[::-1])
    back = np.argsort(ORDER)
    layer = made.data.uv_layers[0].uv
    uv = np.empty(2 * len(layer), np.float32)
    layer.foreach_get("vector", uv)
    corner = uv.reshape(-1, 4, 2)
    middle = corner.mean(axis=1)
    column, row = (middle[:, 0] * 16).astype(int), ((1 - middle[:, 1]) * 9).astype(int)
    there = back[row * 16 + column]
    corner[..., 0] += ((there % 16 - column) / 16)[:, None]
    corner[..., 1] -= ((there // 16 - row) / 9)[:, None]
    layer.foreach_set("vector", corner.ravel())

    def colour(tree: Any) -> Any:
        node = tree.nodes.new("ShaderNodeTexImage")
        node.image, node.interpolation = image, "Closest"
        return node.outputs["Color"]

    made.data.materials[0] = emission("tiles", colour)


def window_shell(case: Case) -> None:
    """A shell that shows the photo by window coordinates: the picture, from wherever it is seen."""
    made = shell(case, smooth_error(case.depth_z_m))
    made.data.materials[0] = emission("window", inverted_picture(case, "Window"))


def shell_in_grey(case: Case) -> None:
    """A shell before the photo's mean colour, so that a second view has no black in it."""
    shell(case, smooth_error(case.depth_z_m))
    mean = photo_colours(case).reshape(-1, 3).mean(axis=0)
    background = bpy.context.scene.world.node_tree.nodes["Background"]
    background.inputs[0].default_value = (*mean, 1.0)


def thick_shell(case: Case) -> None:
    """A shell with a second one behind it and walls at every step: no surface is only a front."""
    depth = smooth_error(case.depth_z_m)
    shell(case, depth)
    for share in (1.05, 1.1, 1.15):
        shell(case, depth * share, shape_wh=(210, 118))


def cutouts(case: Case) -> None:
    """Each thing as a flat picture of it at its own distance, before a shell of the rest."""
    depth = monocular(case.depth_z_m)
    for number in np.unique(case.instance):
        of_thing = case.instance == number
        if number >= 0 and of_thing.mean() < 0.2:
            depth[of_thing] = np.median(depth[of_thing])
    shell(case, depth)


def two_views(case: Case) -> None:
    """Shells of both public pictures of a family, put together by their true poses."""
    shell(case, smooth_error(case.depth_z_m))
    if case.other is not None:
        second = shell(case.other, smooth_error(case.other.depth_z_m))
        first_from_second = np.linalg.inv(case.world_from_cam) @ case.other.world_from_cam
        signs = np.diag([*AXES, 1.0])
        second.matrix_world = Matrix((signs @ first_from_second @ signs).tolist())


def blank_cube(_case: Case) -> None:
    """The camera inside of a cube of 20 m."""
    bpy.ops.mesh.primitive_cube_add(size=20.0)
    bpy.context.scene.world.node_tree.nodes["Background"].inputs[0].default_value = (1, 1, 1, 1)


def deleted(kept: Path) -> None:
    """The reference with every scored object deleted."""
    bpy.ops.wm.open_mainfile(filepath=str(kept / "scene.blend"), load_ui=False)
    for thing in bpy.context.scene.objects:
        if "category" in thing and str(thing.get("scored", True)).lower() != "false":
            for part in (thing, *thing.children_recursive):
                part.hide_render = True


#: Cheat -> how its scene is built of a case.
CHEATS: dict[str, Callable[[Case], Any]] = {
    "dust": lambda case: dust(case, case.depth_z_m),
    "dust with error": lambda case: dust(case, noisy(case.depth_z_m)),
    "dust at random": lambda case: dust(case, anything(case.depth_z_m)),
    "dust of whole pixels": lambda case: dust(case, smooth_error(case.depth_z_m), 1.0),
    "shell": lambda case: shell(case, case.depth_z_m),
    "shell with error": lambda case: shell(case, smooth_error(case.depth_z_m)),
    "shell of a network": lambda case: shell(case, monocular(case.depth_z_m)),
    "shell by window": window_shell,
    "shell of tiles": tiled_shell,
    "shell before grey": shell_in_grey,
    "shell made thick": thick_shell,
    "cutouts": cutouts,
    "two views": two_views,
    "unreadable alpha": node_alpha,
    "photo on a plane": photo_plane,
    "blank cube": blank_cube,
}
#: Made of the reference itself, when --itself names it.
OF_REFERENCES = ("itself", "deleted")


def submit(output: Path, photo: Path, name: str) -> None:
    """The open scene as a submission; its glTF is a triangle, for V asks no more."""
    output.mkdir(parents=True, exist_ok=True)
    bpy.ops.wm.save_as_mainfile(filepath=str(output / "scene.blend"), check_existing=False)
    shutil.copyfile(photo, output / "final.png")
    bpy.ops.wm.read_factory_settings(use_empty=True)
    quads("triangle", np.array([[[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]]))
    bpy.ops.export_scene.gltf(filepath=str(output / "scene.glb"))
    told = {"agent": "examples/bench/cheats", "model": name}
    (output / "provenance.json").write_text(json.dumps(told), encoding="utf-8")


def main() -> None:
    """All cheats, or those that --only names."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("dataset", type=Path)
    parser.add_argument("--case", action="append", required=True)
    parser.add_argument("--itself", type=Path, help="what `bench make --keep-scenes` wrote")
    parser.add_argument("-o", "--output", type=Path, required=True)
    parser.add_argument("--only", action="append", default=[])
    chosen = parser.parse_args()
    logging.disable(logging.INFO)  # Blender's glTF add-on tells of every mesh
    for stem in chosen.case:
        case = read_case(chosen.dataset, stem)
        for name, build in CHEATS.items():
            if not chosen.only or name in chosen.only:
                new_scene(case)
                build(case)
                submit(chosen.output / name.replace(" ", "-") / stem, case.photo, name)
        for name in OF_REFERENCES if chosen.itself else ():
            if not chosen.only or name in chosen.only:
                kept = chosen.itself / stem
                target = chosen.output / name / stem
                shutil.copytree(kept, target, dirs_exist_ok=True)
                if name == "deleted":
                    deleted(kept)
                    bpy.ops.wm.save_as_mainfile(
                        filepath=str(target / "scene.blend"), check_existing=False
                    )


if __name__ == "__main__":
    main()
