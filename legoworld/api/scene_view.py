"""One view of a scene: what is at each pixel, and the labels of a task, all in one order."""

from __future__ import annotations

import json
from collections.abc import Iterator
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, Literal, overload

import numpy as np
from numpy.typing import NDArray

from legoworld.api.arguments import check_argument, check_arguments
from legoworld.api.targets import (
    Arrays,
    HfTarget,
    TorchvisionTarget,
    hf_target,
    torchvision_target,
)
from legoworld.errors import UsageError
from legoworld.readouts import pictures
from legoworld.readouts.amodal import AMODAL
from legoworld.readouts.boxes3d import BOXES_3D, Box3d, Kind, box_lines_px, fit_boxes
from legoworld.readouts.family import AnsweredImage, Protocol, load_readout_family
from legoworld.readouts.label_maps import category_map, segment_map
from legoworld.records.base import as_json, canonical
from legoworld.records.predictions import Rle
from legoworld.records.scene_folder import InstanceRow
from legoworld.running.inspection import Inspection, write_inspection
from legoworld.running.source_comparison import SourceComparison, compare_sources
from legoworld.scene.snapshot import RenderSettings, SceneCamera
from legoworld.tables.table import Table
from legoworld.tasks.registry import known_tasks
from legoworld.tracks.vocabulary import Category, Vocabulary
from legoworld.visibility.amodal import Amodal
from legoworld.visibility.normals import Variant
from legoworld.visibility.posed_camera import Camera, place_scene_camera
from legoworld.visibility.projection import Projection
from legoworld.visibility.runs import ColumnRuns

if TYPE_CHECKING:
    from legoworld.readouts.relation_kinds import FactBase

Photo = str | Path | NDArray[np.uint8]
#: Sides of the picture from above.
_PLAN_PX: Final = 640


class SceneView:
    """One view of a scene: instance and depth per pixel, and all instances.

    `labelled`, `category_ids`, `masks`, `boxes_xywh_px`, `predictions` and the amodal ones have the
    same N rows in the same order: by instance id.
    """

    def __init__(
        self, inspection: Inspection, protocol: Protocol | None, posed: Camera | None = None
    ) -> None:
        self._inspection = inspection
        self._protocol = protocol
        self._posed = posed

    @property
    def instances(self) -> tuple[InstanceRow, ...]:
        """Every instance of the scene by id, and why it is not visible, if so."""
        return self._inspection.entries

    @property
    def task(self) -> str | None:
        """The task's name, None for a view without one."""
        return self._protocol.task.name if self._protocol else None

    @property
    def vocabulary(self) -> Vocabulary | None:
        """The categories that labels were matched to; None for labels as they are written."""
        return self._inspection.labelled.vocabulary

    @cached_property
    def _camera(self) -> Camera:
        snapshot = self._inspection.scene.snapshot
        return self._posed or place_scene_camera(snapshot.camera, snapshot.render, self.size_wh)

    @property
    def K(self) -> NDArray[np.float64]:  # noqa: N802  what everybody calls it
        """(3, 3) float64: intrinsics in pixels, pixel centres at .5; without lens distortion."""
        return self._camera.K

    @property
    def cam_from_world(self) -> NDArray[np.float64]:
        """(4, 4) float64: OpenCV camera axes from the scene's world, scene units."""
        return self._camera.cam_from_world

    @property
    def world_from_cam(self) -> NDArray[np.float64]:
        """(4, 4) float64: the scene's world from OpenCV camera axes, scene units."""
        return np.array([*self._camera.world_from_cam, (0, 0, 0, 1)], np.float64)

    @property
    def valid(self) -> NDArray[np.bool_]:
        """(H, W) bool: False where the lens has no ray; True everywhere without distortion."""
        lens = self._inspection.view.lens
        return np.ones(self.instance.shape, bool) if lens is None else lens.valid

    @property
    def size_wh(self) -> tuple[int, int]:
        """Width and height in pixels."""
        return self._inspection.view.size_wh

    @property
    def instance(self) -> NDArray[np.int32]:
        """(H, W) int32: the id of the instance at each pixel, -1 where nothing is hit."""
        return self._inspection.view.buffers.instance

    @property
    def depth_z_m(self) -> NDArray[np.float32]:
        """(H, W) float32: planar depth in metres along the optical axis, +inf for no hit."""
        return self._inspection.view.buffers.depth_z_m

    @check_arguments
    def normals(self, variant: Variant = "geometric") -> NDArray[np.float32]:
        """(H, W, 3) float32: unit normals of the surfaces shown, NaN for no hit.

        In the OpenCV camera frame (x right, y down, z forward) and towards the camera: a frontal
        wall has (0, 0, -1). variant: "geometric", of the triangles' planes, or "shading",
        interpolated between their corners. Each call draws them. UsageError for shading normals of
        a scene that was opened without them.
        """
        view = self._inspection.view
        if variant == "shading" and view.snapshot.corner_normal is None:
            raise UsageError(
                "the scene was opened without shading normals",
                expected="open_scene(folder, shading=True)",
            )
        return view.normals(variant).normal_cam

    @property
    def projection(self) -> Projection:
        """The camera's intrinsics in pixels, pixel centres at .5; see `Projection`."""
        return self._inspection.view.projection

    @property
    def camera(self) -> SceneCamera:
        """The camera of the view in Blender's terms: its name, pose and lens."""
        return self._inspection.scene.snapshot.camera

    @property
    def render(self) -> RenderSettings:
        """The scene's render settings: size, pixel aspect, unit scale, frame."""
        return self._inspection.scene.snapshot.render

    @property
    def n_triangles(self) -> int:
        """Number of triangles in the scene's meshes, each mesh counted once for all placements."""
        return self._inspection.scene.snapshot.n_triangles

    @property
    def outside_vocabulary(self) -> dict[str, int]:
        """Labels outside the vocabulary, and the number of instances with each."""
        return self._inspection.outside_vocabulary

    @property
    def nearest(self) -> dict[str, list[str]]:
        """The most similar category names for each label outside the vocabulary."""
        return self._inspection.nearest

    @property
    def not_rendered(self) -> tuple[tuple[str, str], ...]:
        """Name and label of labelled objects and collections without a surface that renders."""
        return self._inspection.not_rendered

    @property
    def warnings(self) -> tuple[str, ...]:
        """Caveats about this view, as sentences."""
        notes = self._protocol.readout.notes if self._protocol else None
        return (*self._inspection.warnings, *(notes(self._answered_image()) if notes else ()))

    @property
    def labelled(self) -> tuple[InstanceRow, ...]:
        """The instances with a category and at least one visible pixel: those a task exports."""
        return self._inspection.exported_rows

    def instance_ids(self) -> NDArray[np.int64]:
        """(N,) int64: the ids of `labelled`, which `instance` has at their pixels."""
        return np.array([i.id for i in self.labelled], np.int64)

    def category_ids(self) -> NDArray[np.int64]:
        """(N,) int64: the dataset's category id of each of `labelled`.

        UsageError for a view without a task or track: a label as it is written has no id.
        """
        ids = [i.category_id for i in self.labelled]
        if self.vocabulary is None:
            raise UsageError(
                "only a view of a task with a vocabulary has category ids",
                found=f"task {self.task}" if self.task else "a view without a task",
                expected="view(task=...) or view(track=...)",
            )
        return np.array(ids, np.int64)

    @check_arguments
    def mask(self, instance_id: int) -> NDArray[np.bool_]:
        """(H, W) bool: the visible pixels of an instance. UsageError for an unknown id."""
        if not 0 <= instance_id < len(self._inspection.grouping.instances):
            raise UsageError(
                "the scene has no such instance",
                found=repr(instance_id),
                expected=f"an id of 0 to {len(self.instances) - 1}",
            )
        return np.asarray(self.instance == instance_id)

    def masks(self) -> NDArray[np.bool_]:
        """(N, H, W) bool: the visible mask of each of `labelled`; they are disjoint."""
        masks = np.zeros((len(self.labelled), *self.instance.shape), bool)
        for mask, row in zip(masks, self.labelled, strict=True):
            x, y, w, h = row.bbox_xywh_px
            np.equal(self.instance[y : y + h, x : x + w], row.id, out=mask[y : y + h, x : x + w])
        return masks

    def rles(self) -> list[Rle]:
        """The visible mask of each of `labelled` as COCO's compressed RLE."""
        runs = ColumnRuns(self.instance, len(self._inspection.grouping.instances))
        return [Rle(size=runs.size_hw, counts=runs.counts(i.id)) for i in self.labelled]

    def boxes_xywh_px(self) -> NDArray[np.int64]:
        """(N, 4) int64: x, y, width, height of the mask of each of `labelled`, at pixel edges."""
        return np.array([i.bbox_xywh_px for i in self.labelled], np.int64).reshape(-1, 4)

    def _refuse_lens(self, what: str) -> None:
        if self._inspection.view.lens is not None:
            raise UsageError(
                f"a view through a distorting lens has no {what}",
                next_step="ask a view of the same camera without its lens",
            )

    @cached_property
    def amodal(self) -> Amodal:
        """Every instance of this view as if it were alone; drawn at the first question.

        Its `direct_occluders`, `order` (layers and cycles) and `silhouettes` are of all instances,
        by id.
        """
        self._refuse_lens("amodal masks")
        return self._inspection.view.amodal()

    def amodal_masks(self) -> NDArray[np.bool_]:
        """(N, H, W) bool: what the picture would show of each of `labelled` if it stood alone.

        Inside the frame; each contains its mask of `masks()`, and they may overlap. LegoWorldError
        where they are too large together.
        """
        return self.amodal.layers.masks([i.id for i in self.labelled])

    def visible_of_in_frame(self) -> NDArray[np.float64]:
        """(N,) float64 in (0, 1]: the share of each amodal mask that is visible, in that order."""
        return self._fractions("visible_of_in_frame")

    def in_frame_of_whole(self) -> NDArray[np.float64]:
        """(N,) float64: the share of each whole silhouette, on an infinite picture, in the frame.

        NaN where the instance crosses the near plane, or its silhouette is too large to be drawn.
        """
        return self._fractions("in_frame_of_whole")

    def visible_of_whole(self) -> NDArray[np.float64]:
        """(N,) float64: the product of the two, NaN where the second is."""
        return self._fractions("visible_of_whole")

    @check_arguments
    def boxes3d(self, *, kind: Kind = "gravity") -> list[Box3d]:
        """The box in space around all of each of `labelled`, in that order.

        In the camera frame (x right, y down, z forward), metres. kind: "gravity" is upright and
        turned so that its footprint is smallest, "object" along the axes of the instance's first
        surface, "world" along the scene's axes.
        """
        self._refuse_lens("boxes in space")
        return fit_boxes(self._inspection.view, [i.id for i in self.labelled], kind)

    @check_arguments
    def save_bop(self, folder: str | Path) -> None:
        """Write the instances with a label as a BOP dataset of one image; see `score_poses`.

        As `legoworld export --format bop` does, into a new folder. UsageError where it exists.
        """
        from legoworld.api.exporting import export

        export([self], folder, format="bop")

    @property
    def in_space(self) -> bool:
        """Whether the view's task is about boxes in space."""
        return self._protocol is not None and self._protocol.card.reads == BOXES_3D

    def _fractions(self, name: str) -> NDArray[np.float64]:
        made = self.amodal.silhouettes([i.id for i in self.labelled])
        return np.array([getattr(one, name) for one in made], np.float64)

    def occluders(self) -> dict[int, dict[int, int]]:
        """Who hides whom: of each instance id the ids that the picture shows instead, with pixels.

        Unlabelled instances are among them, and a holdout is -2. The pixels of one instance sum to
        its amodal area less its visible one.
        """
        return self.amodal.occluders.by_hidden()

    @check_arguments
    def panoptic(self, *, sky: str | None = None) -> tuple[NDArray[np.int32], list[dict[str, Any]]]:
        """(H, W) int32 segment ids, 0 for VOID, and `segments_info` of panopticapi.

        Each visible thing is a segment, and each stuff category one; without stuff in the task's
        vocabulary there are things alone. sky: the category of pixels without a hit, None for VOID.
        Raises UsageError for a view without a task's vocabulary, or for an unknown category.
        """
        image = self._categorised_image(sky)
        made = segment_map(image.view, image.instances, image.sky)
        return made.ids, json.loads(canonical(made.segments))

    @check_arguments
    def semantic(self, *, sky: str | None = None) -> NDArray[np.uint8]:
        """(H, W) uint8: the category id of what each pixel shows, 255 for none.

        Where the task's vocabulary has a category `background`, all that is of no other one is of
        it. sky, errors: as in `panoptic`.
        """
        image = self._categorised_image(sky)
        assert image.vocabulary is not None
        return category_map(image.view, image.instances, image.vocabulary, image.sky)

    def _categorised_image(self, sky: str | None) -> AnsweredImage:
        """The view as a readout takes it. UsageError without a task that has a vocabulary."""
        protocol = self._protocol
        if protocol is None or protocol.vocabulary is None:
            labelled = [task.name for task in known_tasks() if task.family.labelled]
            raise UsageError(
                "only a view of a task with a vocabulary has categories",
                found=f"task {protocol.task.name}" if protocol else "a view without a task",
                expected=f"view(task=...) of {', '.join(labelled)}",
            )
        return self._answered_image(sky=protocol.category(sky, "sky") if sky is not None else None)

    @check_arguments
    def predictions(self, image_id: int = 1) -> list[dict[str, Any]]:
        """The task's export of this view: COCO or LVIS results of one image, in `labelled` order.

        predictions.json of a run has the same results in another order, by category and payload.
        Raises UsageError without a task, and for depth, which is `depth_z_m`.
        """
        return [entry for _, entry in sorted(self._exports(image_id), key=lambda pair: pair[0])]

    def scored_answer(self, image_id: int = 1) -> list[dict[str, Any]] | NDArray[np.float32]:
        """What `score` takes: results, or `depth_z_m` (H, W) or `normals` (H, W, 3).

        Equal confidences are ranked by place, so results are in the order of predictions.json.
        """
        array = self._protocol.readout.array if self._protocol else None
        if array is not None:
            return array(self._answered_image(image_id))
        return [entry for _, entry in self._exports(image_id)]

    def _exports(self, image_id: int) -> list[tuple[int, dict[str, Any]]]:
        """Results in canonical order, each with the id of its instance."""
        protocol = self._protocol
        exporter = protocol.readout.exports if protocol else None
        if protocol is None or exporter is None:
            labelled = [task.name for task in known_tasks() if load_readout_family(task).exports]
            raise UsageError(
                "only a view of a task with boxes or masks has predictions",
                found=f"task {protocol.task.name}" if protocol else "a view without a task",
                expected=f"view(task=...) of {', '.join(labelled)}",
            )
        exports = exporter(protocol.card.reads, self._answered_image(image_id))
        entries = json.loads(canonical([prediction for prediction, _ in exports]))
        return [(i.id, entry) for (_, i), entry in zip(exports, entries, strict=True)]

    @overload
    def targets(
        self, form: Literal["torchvision"] = ..., *, image_id: int = ..., arrays: Arrays = ...
    ) -> TorchvisionTarget: ...
    @overload
    def targets(
        self, form: Literal["hf"], *, image_id: int = ..., arrays: Arrays = ...
    ) -> HfTarget: ...
    @check_arguments
    def targets(
        self,
        form: Literal["torchvision", "hf"] = "torchvision",
        *,
        image_id: int = 1,
        arrays: Arrays = "numpy",
    ) -> TorchvisionTarget | HfTarget:
        """Boxes, category ids and masks of `labelled` in one value, as training takes them.

        form: of torchvision's detectors, or of transformers' image processors. arrays: "torch"
        gives tensors to torchvision's. UsageError for a view without category ids.
        """
        if form == "hf":
            return hf_target(self.labelled, self.category_ids(), image_id)
        ids, masks = self.category_ids(), self.masks()
        return torchvision_target(self.labelled, ids, masks, image_id, arrays)

    def _answered_image(self, image_id: int = 1, sky: Category | None = None) -> AnsweredImage:
        return AnsweredImage(
            image_id=image_id,
            name=str(image_id),
            run=Path(),
            instances=self._inspection.grouping.instances,
            view=self._inspection.view,
            vocabulary=self._protocol.vocabulary if self._protocol else None,
            sky=sky,
        )

    @property
    def task_table(self) -> Table | None:
        """What the task says of this view in a table; None for a task that says nothing so."""
        if self._protocol is None or self._protocol.readout.table is None:
            return None
        return self._protocol.readout.table(self._protocol.card.reads, self._answered_image())

    def relations(self) -> FactBase:
        """What holds between the labelled and visible instances, each with a signed margin.

        At most the 100 largest; `facts.left_out` counts the others. `rows()` lists every relation
        of every pair: `pandas.DataFrame(view.relations().rows())`.
        """
        from legoworld.readouts.relation_facts import relation_facts
        from legoworld.readouts.relation_kinds import FactBase

        self._refuse_lens("relations between instances")
        inspection = self._inspection
        return FactBase(relation_facts(inspection.view, inspection.grouping.instances))

    @check_arguments
    def overlay(self, photo: Photo | None = None) -> NDArray[np.uint8]:
        """(H, W, 3) uint8 RGB: outlines, boxes and names over a photo of the same size.

        photo: a file or an (H, W, 3) uint8 RGB array; without one each instance has its own colour.
        Raises UsageError for a photo of a different size.
        """
        ground = self._ground(photo)
        if ground.shape != (*self.instance.shape, 3):
            raise UsageError(
                "the photo and the view have different sizes",
                found="x".join(map(str, ground.shape[1::-1])),
                expected="x".join(map(str, self.size_wh)),
                next_step="pass its width and height to view(size_wh=...)",
            )
        return pictures.overlay(ground, self.instance, self.instances)

    def _ground(self, photo: Photo | None) -> NDArray[np.uint8]:
        if photo is None:
            return pictures.instance_picture(self.instance)
        return photo if isinstance(photo, np.ndarray) else pictures.read_photo(Path(photo))

    def depth_picture(self) -> NDArray[np.uint8]:
        """(H, W, 3) uint8 RGB: colour-coded inverse depth; near is red, no hit dark grey."""
        return pictures.depth_picture(self.depth_z_m)

    @cached_property
    def table(self) -> list[dict[str, Any]]:
        """One row of plain values per instance: `pandas.DataFrame(view.table)`."""
        rows = []
        for instance in self.instances:
            x, y, w, h = instance.bbox_xywh_px
            row = as_json(instance) | {"objects": ", ".join(instance.objects)}
            del row["bbox_xywh_px"]
            rows.append(row | {"x_px": x, "y_px": y, "width_px": w, "height_px": h})
        return rows

    def to_dict(self) -> dict[str, Any]:
        """The document that `legoworld inspect --json` prints."""
        return {
            "instances": as_json(self.instances),
            "size_wh": list(self.size_wh),
            "warnings": list(self.warnings),
            "outside_vocabulary": self.outside_vocabulary,
            "nearest": self.nearest,
            "not_rendered": [list(owner) for owner in self.not_rendered],
            "snapshot_sha256": self._inspection.scene.snapshot_sha256,
            **self._task_rows(),
        }

    def _task_rows(self) -> dict[str, Any]:
        table = self.task_table
        return {} if table is None else {"table": [list(map(str, row)) for row in table.rows]}

    @check_arguments
    def save(self, folder: str | Path, photo: str | Path | None = None) -> None:
        """Write buffers.npz, instances.json, overlay.png (over the photo) and depth.png.

        Of a task of amodal masks also amodal.png, of label maps answer.png, of boxes in space
        boxes3d.png (over the photo) and plan.png (from above). Raises LegoWorldError for a photo of
        a different size.
        """
        if photo is not None:
            check_argument("folder", photo)
        write_inspection(self._inspection, Path(folder), None if photo is None else Path(photo))
        if self._protocol is not None and self._protocol.card.reads == AMODAL:
            ids = [i.id for i in self.instances if i.labelled and self.amodal.in_frame_px[i.id]]
            pairs = zip(self.amodal.layers.masks(ids), map(self.mask, ids), strict=True)
            picture = pictures.amodal_overlay(
                self._ground(photo), dict(zip(ids, pairs, strict=True))
            )
            pictures.write_png(Path(folder) / "amodal.png", picture)
        drawn = self._protocol.readout.picture if self._protocol else None
        if drawn is not None:
            pictures.write_png(Path(folder) / "answer.png", drawn(self._answered_image()))
        if self.in_space:
            boxes, view = self.boxes3d(), self._inspection.view
            lines = {b.instance_id: box_lines_px(b, view) for b in boxes}
            picture = pictures.boxes_overlay(self._ground(photo), lines)
            pictures.write_png(Path(folder) / "boxes3d.png", picture)
            plan = pictures.plan_picture({b.instance_id: b.corners_m for b in boxes}, _PLAN_PX)
            pictures.write_png(Path(folder) / "plan.png", plan)

    def compared_with(self, other: SceneView) -> SourceComparison:
        """The disagreements between this view (of scene.blend) and another (of scene.glb)."""
        return compare_sources(self._inspection, other._inspection)

    def __iter__(self) -> Iterator[InstanceRow]:
        """The instances, by id."""
        return iter(self.instances)

    def _repr_html_(self) -> str:
        """What a notebook shows: the overlay, and what is in the picture."""
        from legoworld.report.notebook import instances_text, picture_html

        seen = [i for i in self.instances if i.area_px]
        return picture_html(self.overlay(), f"{self!r}: {instances_text(seen)}")

    def __repr__(self) -> str:
        width, height = self.size_wh
        return (
            f"<SceneView {width}x{height}: {len(self.instances)} instances, "
            f"{len(self.labelled)} labelled and visible>"
        )
