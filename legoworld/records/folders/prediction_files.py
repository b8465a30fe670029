"""A run's predictions on disk: one JSON list, or one .jsonl file for every N images.

Both hold the same lines in the same order, one prediction each, and nothing else of the package
knows the difference.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Sequence
from itertools import chain, groupby, islice
from pathlib import Path
from typing import IO, Any, Final

from legoworld.errors import LegoWorldError, one_line
from legoworld.files import atomic_path

PREDICTIONS: Final = "predictions.json"
FOLDER: Final = "predictions"
#: The configuration's key for N; absent where there is one file.
IMAGES_PER_FILE: Final = "images_per_file"
#: Text that is parsed at once: enough that entries share their keys, little beside what they hold.
_BATCH_BYTES: Final = 1 << 20

Prediction = dict[str, Any]


class PredictionsUnreadableError(LegoWorldError):
    """A file of predictions is absent, damaged, or holds something else."""

    code = "predictions_unreadable"


def with_division(configuration: dict[str, Any], images_per_file: int | None) -> dict[str, Any]:
    """The configuration of the same run with another division; None: one file."""
    others = {key: value for key, value in configuration.items() if key != IMAGES_PER_FILE}
    return others if images_per_file is None else {**others, IMAGES_PER_FILE: images_per_file}


def prediction_files(folder: Path, images_per_file: int | None, n_images: int) -> list[Path]:
    """The files that a run of n_images keeps its predictions in, in their order.

    File k of a divided run is of the images k * N up to (k + 1) * N, by ascending image id.
    """
    if images_per_file is None:
        return [folder / PREDICTIONS]
    n_files = -(-n_images // images_per_file)
    return [folder / FOLDER / f"{k:05}.jsonl" for k in range(n_files)]


def present_files(folder: Path) -> list[Path]:
    """Every file of predictions that a folder has, of whatever division."""
    whole = folder / PREDICTIONS
    return [*([whole] if whole.is_file() else []), *sorted((folder / FOLDER).glob("[0-9]*.jsonl"))]


def stored_entries(files: Iterable[Path]) -> Iterator[Any]:
    """Every entry of these files in order, read some MiB at a time, unchecked otherwise.

    PredictionsUnreadableError names the file that is absent, no JSON, or no list of results.
    """
    for path in files:
        try:
            with path.open("rb") as stream:
                batches = _of_lines(stream) if path.suffix == ".jsonl" else _of_list(stream)
                for batch in batches:
                    yield from batch
        except (OSError, ValueError, RecursionError) as error:
            raise PredictionsUnreadableError(
                f"{path.parent.name}/{path.name} cannot be read",
                found=getattr(error, "strerror", None) or str(error),
                expected="the predictions of a finished run of boxes or masks",
                next_step="delete what is there of it and run the run's command again",
            ) from error


def predictions_of(image_ids: Iterable[int], files: Iterable[Path]) -> Iterator[list[Prediction]]:
    """The predictions of each of these images; ids and files ascend, as a run writes them.

    What is stored out of that order is left out: an image without all of its predictions differs
    from what its row says of them.
    """
    groups = groupby(stored_entries(files), key=_image_id)
    found = ((image_id, list(entries)) for image_id, entries in groups)
    at, predictions = next(found, (None, []))
    for image_id in image_ids:
        while at is not None and at < image_id:
            at, predictions = next(found, (None, []))
        yield predictions if at == image_id else []


def _image_id(entry: Any) -> int:
    try:
        return int(entry["image_id"])
    except (KeyError, TypeError, ValueError) as error:
        raise PredictionsUnreadableError(
            "a file of predictions holds what is no prediction",
            found=one_line(repr(entry), 80),
            expected="an image_id in each",
            next_step="delete the file and run the run's command again",
        ) from error


def write_predictions(
    folder: Path,
    images_per_file: int | None,
    images: Iterable[Sequence[str]],
    n_images: int,
) -> None:
    """Write each image's predictions, by ascending image id; files of other divisions go.

    images: of each image its predictions, each as canonical JSON. A file is written whole or not
    at all.
    """
    files = prediction_files(folder, images_per_file, n_images)
    remaining = iter(images)
    for path in files:
        lines = chain.from_iterable(islice(remaining, images_per_file))
        with (
            atomic_path(path) as temporary,
            temporary.open("w", encoding="utf-8", newline="\n") as stream,
        ):
            if path.suffix == ".jsonl":
                stream.writelines(f"{line}\n" for line in lines)
            else:
                _write_list(stream, lines)
    delete_predictions(folder, keep=files)


def delete_predictions(folder: Path, *, keep: Sequence[Path] = ()) -> None:
    """Delete a run's files of predictions, whatever their division."""
    for path in present_files(folder):
        if path not in keep:
            path.unlink()
    divided = folder / FOLDER
    if divided.is_dir() and not any(divided.iterdir()):
        divided.rmdir()


def _write_list(stream: IO[str], lines: Iterable[str]) -> None:
    before = "[\n"
    for line in lines:
        stream.write(before + line)
        before = ",\n"
    stream.write("[]\n" if before == "[\n" else "\n]\n")


def _of_lines(stream: IO[bytes]) -> Iterator[list[Any]]:
    """Entries of a file with one a line. ValueError for any other."""
    while lines := stream.readlines(_BATCH_BYTES):
        entries: list[Any] = json.loads(f"[{b','.join(lines).decode('utf-8')}]")
        if len(entries) != len(lines):
            raise ValueError("a line with another number of predictions than one")
        yield entries


def _of_list(stream: IO[bytes]) -> Iterator[list[Any]]:
    """Entries of a JSON list. ValueError for any other text, with the place in all of it."""
    done = 0
    try:
        for entries in _cut(stream):
            yield entries
            done += len(entries)
    except ValueError:
        stream.seek(0)
        yield _list_in(stream.read().decode("utf-8"))[done:]


def _cut(stream: IO[bytes]) -> Iterator[list[Any]]:
    """Parts of a JSON list, cut where a line ends in an object and a comma.

    A cut is right exactly when what comes before it is a whole list of its own. ValueError where
    it is not, as it can be in lists that others have indented.
    """
    opening, held = "", list[bytes]()
    while lines := stream.readlines(_BATCH_BYTES):
        if len(lines) > 1 and lines[-2].endswith(b"},\n"):
            before = b"".join([*held, *lines[:-1]]).decode("utf-8")
            yield _list_in(f"{opening}{before[:-2]}]")
            opening, held = "[", lines[-1:]
        else:
            held += lines
    rest = _list_in(opening + b"".join(held).decode("utf-8"))
    if opening and not rest:
        raise ValueError("a comma before the end")
    yield rest


def _list_in(text: str) -> list[Any]:
    value = json.loads(text)
    if not isinstance(value, list):
        raise ValueError(f"not a list of results: {type(value).__name__}")
    return value
