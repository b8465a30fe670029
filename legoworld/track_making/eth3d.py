"""Tracks of ETH3D, complete or its present scenes, and of other datasets in its layout."""

from __future__ import annotations

import hashlib
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path, PurePosixPath
from typing import Final

from legoworld.errors import CatalogError, UsageError
from legoworld.evaluation.depth.eth3d import (
    PHOTOS,
    find_calibration,
    find_files,
    parse_scene_name,
    photo_camera,
    scenes_below,
    training_images,
)
from legoworld.files import canonical_json, sha256_of_file
from legoworld.pluralize import plural
from legoworld.records.track import ImageInfo, Part
from legoworld.tasks.shipped import ETH3D
from legoworld.tracks.colmap import Calibration, CalibrationError, read_calibration
from legoworld.tracks.track import Source

_VERSION: Final = "training-dslr"


def eth3d_source(
    folder: Path, *, scenes: Sequence[str] | None = None, dataset: str | None = None
) -> Source:
    """The images of a folder in ETH3D's layout, from its calibration alone.

    scenes: the scenes to take, None for all present. dataset: the name of a dataset other than
    ETH3D; None if the folder has scenes with ETH3D's names. ETH3D images keep the ids of the
    shipped list; those of another dataset count from 1 in the order of their paths, over all
    present scenes. CatalogError without a scene, UsageError for one that is not there.
    """
    there = scenes_below(folder)
    if not there:
        raise CatalogError(
            f"{folder.name} contains no scene in ETH3D's layout",
            found="no calibration",
            expected="<scene>/dslr_calibration_jpg/{cameras,images}.txt",
            next_step="for a folder of depth maps named like the photos, pass --photos",
        )
    absent = [scene for scene in scenes or () if scene not in there]
    if absent or (scenes is not None and not scenes):
        raise UsageError(
            f"{folder.name} has no scene {absent[0]!r}" if absent else "no scene is named",
            found=", ".join(there[:20]),
            expected="scenes with <scene>/dslr_calibration_jpg/{cameras,images}.txt",
        )
    known = {parse_scene_name(entry.file_name) for entry in training_images()}
    if dataset is None and any(scene in known for scene in scenes or there):
        return _eth3d(folder, there, scenes)
    return _own_source(folder, there, scenes, dataset or folder.resolve().name)


def _eth3d(folder: Path, there: Sequence[str], scenes: Sequence[str] | None) -> Source:
    """The present scenes of ETH3D; the track records what is left out."""
    shipped = training_images()
    per_scene = Counter(str(parse_scene_name(entry.file_name)) for entry in shipped)
    strangers = [scene for scene in scenes or there if scene not in per_scene]
    if scenes is not None and strangers:
        raise UsageError(
            "a track covers one dataset",
            found=f"{strangers[0]!r} beside scenes of ETH3D",
            expected="only scenes of ETH3D, or none of them",
            next_step="make two tracks, or name the dataset with --dataset",
        )
    taken = sorted(scene for scene in scenes or there if scene in per_scene)
    calibrations = {scene: _calibration(folder, scene) for scene in taken}
    images: list[ImageInfo] = []
    unlisted: list[str] = []
    covered: Counter[str] = Counter()
    for entry in shipped:
        calibration = calibrations.get(str(parse_scene_name(entry.file_name)))
        if calibration is None:
            continue
        name = PurePosixPath(entry.file_name).name
        if not _lists(calibration, name):
            unlisted.append(entry.file_name)
            continue
        size_wh = photo_camera(calibration, name).size_wh
        images.append(_image(entry.id, entry.file_name, size_wh))
        covered[str(parse_scene_name(entry.file_name))] += 1
    empty = [scene for scene in taken if not covered[scene]]
    if empty:
        raise CatalogError(
            f"{empty[0]} lists none of ETH3D's photos of that scene",
            found=", ".join(sorted(calibrations[empty[0]].camera_ids)[:3]) or "no photo",
            expected=f"{PHOTOS}/DSC_....JPG as ETH3D has them",
            next_step="if this is a dataset of your own, name it with --dataset",
        )
    left_out = sorted(set(per_scene) - set(taken))
    return Source(
        name=folder.resolve().name,
        version=_VERSION,
        sha256=_hash(calibrations),
        images=tuple(images),
        part=Part(
            dataset=ETH3D.name,
            dataset_images=len(shipped),
            scenes={scene: covered[scene] for scene in taken},
            scenes_left_out={scene: per_scene[scene] for scene in left_out},
            photos_left_out=tuple(unlisted),
        ),
        notices=tuple(_coverage(taken, left_out, unlisted, strangers)),
    )


def _image(number: int, file_name: str, size_wh: tuple[int, int]) -> ImageInfo:
    return ImageInfo(id=number, file_name=file_name, width=size_wh[0], height=size_wh[1])


def _coverage(
    taken: Sequence[str], left_out: Sequence[str], unlisted: Sequence[str], strangers: Sequence[str]
) -> Iterable[str]:
    """The parts of ETH3D that are not in the track."""
    if left_out:
        of = len(taken) + len(left_out)
        yield f"{len(taken)} of ETH3D's {of} scenes; not covered: {', '.join(left_out)}"
    if unlisted:
        photos = plural(len(unlisted), "photo is", "photos are")
        yield f"{photos} in no images.txt and left out, such as {unlisted[0]}"
    if strangers:
        scenes = plural(len(strangers), "scene is", "scenes are")
        yield f"{scenes} not ETH3D's and left out: {', '.join(strangers[:5])}"


def _own_source(
    folder: Path, there: Sequence[str], scenes: Sequence[str] | None, dataset: str
) -> Source:
    """A user's dataset: every photo with a camera and a measured depth."""
    calibrations = {scene: _calibration(folder, scene) for scene in there}
    sizes_wh: dict[str, tuple[int, int]] = {}
    without_depth: list[str] = []
    elsewhere: list[str] = []
    for scene, calibration in calibrations.items():
        for listed in sorted(calibration.camera_ids):
            name = listed.removeprefix(f"{PHOTOS}/")
            file_name = f"{scene}/images/{PHOTOS}/{name}"
            if "/" in name:
                elsewhere.append(f"{scene}/images/{listed}")
            elif find_files(folder, file_name) is None:
                without_depth.append(file_name)
            else:
                sizes_wh[file_name] = photo_camera(calibration, name).size_wh
    per_scene = Counter(str(parse_scene_name(name)) for name in sizes_wh)
    taken = sorted(set(scenes or there))
    chosen = tuple(
        _image(number, name, size_wh)
        for number, (name, size_wh) in enumerate(sorted(sizes_wh.items()), start=1)
        if parse_scene_name(name) in taken
    )
    if not chosen:
        raise CatalogError(
            f"{folder.name} has no photo with a measured depth",
            found=f"nothing for {without_depth[0]}" if without_depth else "no photo in images.txt",
            expected=f"<scene>/ground_truth_depth/{PHOTOS}/<photo>, raw float32",
        )
    notices = [
        f"{plural(len(names), 'photo', 'photos')} {why}, such as {names[0]}"
        for names, why in (
            (without_depth, "without a measured depth left out"),
            (elsewhere, f"not below {PHOTOS}/ left out"),
        )
        if names
    ]
    return Source(
        name=folder.resolve().name,
        version="custom",
        sha256=_hash(calibrations),
        images=chosen,
        part=Part(
            dataset=dataset,
            dataset_images=len(sizes_wh),
            scenes={scene: per_scene[scene] for scene in taken},
            scenes_left_out={s: per_scene[s] for s in there if s not in taken},
            photos_left_out=(*without_depth, *elsewhere),
        ),
        notices=tuple(notices),
    )


def _calibration(folder: Path, scene: str) -> Calibration:
    """A scene's calibration; CatalogError names the scene if it cannot be read."""
    place = find_calibration(folder, scene)
    assert place is not None
    try:
        return read_calibration(place)
    except CalibrationError as error:
        raise CatalogError(
            f"the calibration of {scene} cannot be read: {error.what}",
            found=error.found,
            expected=error.expected,
            next_step="download the scene's files again, or select other scenes with --scenes",
        ) from error


def _lists(calibration: Calibration, name: str) -> bool:
    return f"{PHOTOS}/{name}" in calibration.camera_ids or name in calibration.camera_ids


def _hash(calibrations: Mapping[str, Calibration]) -> str:
    lines = (
        canonical_json([scene, path.name, sha256_of_file(path)])
        for scene, calibration in sorted(calibrations.items())
        for path in calibration.files
    )
    return hashlib.sha256("".join(f"{line}\n" for line in lines).encode()).hexdigest()
