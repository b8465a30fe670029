"""Matching of results to photos: by file name if the results contain one, otherwise by id.

Exporters renumber images (FiftyOne, supervision), so ids are only used if nothing in the file
names the photo.
"""

from __future__ import annotations

from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import PurePosixPath
from typing import Final, Literal

from legoworld.baselines.foreign_results import Entry
from legoworld.errors import LegoWorldError
from legoworld.pluralize import in_another_folder, share, word_for
from legoworld.tracks.track import TrackImage

#: This many gap-free image ids are positions in a list, unless the track's ids are the same.
_FEWEST_POSITIONS: Final = 10
_IN_THE_FILE: Final = "the file's images"


class PhotosUnmatchedError(LegoWorldError):
    """Results are for photos outside the track, or do not identify their photo."""

    code = "photos_unmatched"


@dataclass(frozen=True, kw_only=True)
class MatchedResults:
    """Results with the track's image ids. by: how photos were matched; left_out: ignored ones."""

    entries: tuple[Entry, ...]
    by: Literal["file_names", "ids"]
    left_out: int


def place(
    entries: Sequence[Entry],
    infos: Mapping[Hashable, Entry],
    images: Sequence[TrackImage],
    *,
    subset: bool,
) -> MatchedResults:
    """Assign the track's image ids to results.

    infos: the file's own image entries by id; subset: results of other photos are ignored instead
    of refused. PhotosUnmatchedError names a contradiction. Entries that are not results are left to
    the next check.
    """
    photos = _Photos(images)
    places = _places(infos, photos)
    named = any(file_name(info) is not None for info in infos.values())
    kept, strangers, by_name = [], [], False
    for entry in entries:
        name = _name(entry, infos)
        by_name |= name is not None
        image_id = _image_id(entry, name, places, photos, named=named)
        if isinstance(image_id, _Outside):
            strangers.append(entry)
        else:
            kept.append(entry if image_id is None else {**entry, "image_id": image_id})
    if strangers and not by_name:
        _refuse_positions(entries, images)
    if strangers and (not subset or not kept):
        raise _strangers(strangers, len(entries), infos, images, some=bool(kept))
    by: Literal["file_names", "ids"] = "file_names" if by_name else "ids"
    return MatchedResults(entries=tuple(kept), by=by, left_out=len(strangers))


class _Outside:
    """Marks a photo that is not in the track."""


_OUTSIDE: Final = _Outside()


class _Photos:
    """The track's photos by path, and by base name if the folders do not contradict.

    Folders agree when one path ends in the other: "val2017/1.jpg" may be "1.jpg", and
    "b/1.jpg" is not "a/1.jpg".
    """

    def __init__(self, images: Sequence[TrackImage]) -> None:
        self.ids = {image.id for image in images}
        self.size_wh = {image.id: image.size_wh for image in images}
        self._by_path: dict[str, set[int]] = {}
        self._by_base: dict[str, set[tuple[int, tuple[str, ...]]]] = {}
        for image in images:
            path = PurePosixPath(image.file_name)
            for name in {image.file_name, str(path.with_suffix(""))}:
                self._by_path.setdefault(name, set()).add(image.id)
            for name in {path.name, path.stem}:
                self._by_base.setdefault(name, set()).add((image.id, path.parent.parts))

    def find(self, text: str) -> int | None:
        """The id of a photo's name, path or name without extension, or of an id as text."""
        path = PurePosixPath(text.replace("\\", "/"))
        for name in (str(path), str(path.with_suffix(""))):
            ids = self._by_path.get(name, set())
            if len(ids) == 1:
                return next(iter(ids))
        for name in (path.name, path.stem):
            based = self._by_base.get(name, set())
            ids = {i for i, folders in based if _agree(folders, path.parent.parts)}
            if len(ids) == 1:
                return next(iter(ids))
        as_id = int(text) if text.isascii() and text.isdigit() and len(text) < 20 else None
        return as_id if as_id in self.ids else None


def _agree(one: tuple[str, ...], other: tuple[str, ...]) -> bool:
    """Whether one folder path is a suffix of the other."""
    length = min(len(one), len(other))
    return not length or one[-length:] == other[-length:]


def _name(entry: Entry, infos: Mapping[Hashable, Entry]) -> str | None:
    """The photo name in the entry, if any."""
    if isinstance(entry.get("file_name"), str):
        return str(entry["file_name"])
    image_id = entry.get("image_id")
    info = infos.get(image_id) if isinstance(image_id, str | int | float) else None
    name = file_name(info) if info else None
    return image_id if name is None and isinstance(image_id, str) else name


def file_name(info: Entry) -> str | None:
    """The photo of an image entry: its file_name, or the last part of its coco_url."""
    for key in ("file_name", "coco_url"):
        if isinstance(info.get(key), str) and info[key]:
            return str(info[key])
    return None


def _image_id(
    entry: Entry, name: str | None, places: Mapping[str, int], photos: _Photos, *, named: bool
) -> int | _Outside | None:
    """The entry's photo; None if it has no plausible one.

    named: the file names its photos, so an id without a name is not the track's.
    """
    if name is not None:
        photo_id = places[name] if name in places else photos.find(name)
        return _OUTSIDE if photo_id is None else photo_id
    image_id = entry.get("image_id")
    if type(image_id) is not int:
        return None
    return image_id if image_id in photos.ids and not named else _OUTSIDE


def _places(infos: Mapping[Hashable, Entry], photos: _Photos) -> dict[str, int]:
    """Maps the file's photo names to the track's images; refuses duplicates and wrong sizes."""
    ids_by_name: dict[str, int] = {}
    taken: dict[int, str] = {}
    resized = []
    for info in infos.values():
        name = file_name(info)
        image_id = photos.find(name) if name is not None else None
        if name is None or image_id is None:
            continue
        if image_id in taken:
            raise PhotosUnmatchedError(
                f"two of {_IN_THE_FILE} are one photo of the track",
                found=f"{taken[image_id]!r} and {name!r} for image {image_id}",
                expected="one image entry for each photo",
                next_step="use the track's file names in the file",
            )
        ids_by_name[name] = image_id
        taken[image_id] = name
        size = (info.get("width"), info.get("height"))
        if all(type(side) is int for side in size) and photos.size_wh[image_id] not in (None, size):
            resized.append((name, size, photos.size_wh[image_id]))
    if resized:
        name, size, own = resized[0]
        raise PhotosUnmatchedError(
            f"{len(resized)} of {_IN_THE_FILE} have another size than the track's",
            found=f"{name!r} of {size[0]}x{size[1]}",
            expected=f"{own[0]}x{own[1]}, as in the track" if own else "the track's size",
            next_step="import results in pixels of the track's photos",
        )
    return ids_by_name


def _refuse_positions(entries: Sequence[Entry], images: Sequence[TrackImage]) -> None:
    """Refuse gap-free ids that miss some of the track's: they are positions in a list."""
    given = [entry.get("image_id") for entry in entries]
    ids = {i for i in given if type(i) is int}
    own = {image.id for image in images}
    first = min(ids)
    if first not in (0, 1) or len(ids) < _FEWEST_POSITIONS or own <= ids:
        return
    if ids != set(range(first, first + len(ids))):
        return
    raise PhotosUnmatchedError(
        "the image ids look like positions in a list, not like the track's ids",
        found=f"ids {first} to {first + len(ids) - 1} without a gap",
        expected=f"ids such as {', '.join(str(i) for i in sorted(own)[:3])}",
        next_step="pass the complete file with its images, or use file_name for image_id",
    )


def _strangers(
    strangers: Sequence[Entry],
    of: int,
    infos: Mapping[Hashable, Entry],
    images: Sequence[TrackImage],
    *,
    some: bool,
) -> PhotosUnmatchedError:
    first = strangers[0]
    name, image_id = _name(first, infos), first.get("image_id")
    parts = [f"image {image_id!r}"] if image_id is not None else []
    parts += [repr(name)] if name not in (None, image_id) else []
    shown = ", ".join(parts)
    predictions = share(len(strangers), of, "prediction", "predictions")
    are = word_for(len(strangers), "is", "are")
    what = f"{predictions} {are} of images outside the track"
    meant = in_another_folder(name, (i.file_name for i in images)) if name is not None else None
    if meant is not None:
        return PhotosUnmatchedError(
            what,
            found=shown,
            expected=f"{meant!r}, as the track has it in another folder",
            next_step="if it is that photo, write the track's folder or none into the results"
            + ("; if not, pass --subset to leave it out" if some else ""),
        )
    if some:
        next_step = "pass --subset to leave them out"
    elif name is not None:
        next_step = "import results of the track's photos, under the track's file names"
    else:
        next_step = "import results of the track's photos, with its image ids or file names"
    return PhotosUnmatchedError(
        what,
        found=shown,
        expected=f"one of the track's {len(images)} images, such as {images[0].id}, "
        f"{images[0].file_name!r}",
        next_step=next_step,
    )
