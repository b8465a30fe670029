"""A run's predictions on disk: one JSON list, or one .jsonl file for every N images.

Both hold the same lines in the same order, one prediction each, and nothing else of the package
knows the difference.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from itertools import chain, groupby, islice
from operator import attrgetter
from pathlib import Path
from typing import IO, Final, TypeVar

from legoworld.errors import LegoWorldError, cause
from legoworld.files import atomic_path, canonical_json, sha256_of_file, sha256_of_text
from legoworld.records.base import RecordError, as_json, decode, decode_lines
from legoworld.records.predictions import Prediction, Scored
from legoworld.records.run_file import ImageRecord

_P = TypeVar("_P", bound=Scored)

PREDICTIONS: Final = "predictions.json"
FOLDER: Final = "predictions"
#: Text that is parsed at once: enough that entries share their keys, little beside what they hold.
_BATCH_BYTES: Final = 1 << 20
#: What a results list is, in messages.
LIKE: Final = '[{"image_id", "category_id", "score", and "bbox" or "segmentation"}, ...]'


class PredictionsUnreadableError(LegoWorldError):
    """A file of predictions is absent, damaged, or holds something else."""

    code = "predictions_unreadable"


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


def stored_batches(files: Iterable[Path], kind: type[_P]) -> Iterator[list[_P]]:
    """Every prediction of these files in order, as a kind of prediction, some MiB at a time.

    PredictionsUnreadableError names the file that is absent, no JSON, or no list of results, and
    the place in it.
    """
    for path in files:
        try:
            with path.open("rb") as stream:
                read = _read_lines if path.suffix == ".jsonl" else _read_list
                yield from read(stream, kind)
        except (OSError, RecordError) as error:
            raise PredictionsUnreadableError(
                f"{path.parent.name}/{path.name} cannot be read",
                found=cause(error),
                expected=f"the predictions of a finished run of boxes or masks: {LIKE}",
                next_step="delete what is there of it and run the run's command again",
            ) from error


def read_image_predictions(
    image_ids: Iterable[int], files: Iterable[Path]
) -> Iterator[tuple[Prediction, ...]]:
    """The predictions of each of these images; ids and files ascend, as a run writes them.

    What is stored out of that order is left out: an image without all of its predictions differs
    from what its row says of them.
    """
    stored = chain.from_iterable(stored_batches(files, Prediction))
    groups = groupby(stored, key=attrgetter("image_id"))
    by_image = ((image_id, tuple(entries)) for image_id, entries in groups)
    at, predictions = next(by_image, (None, ()))
    for image_id in image_ids:
        while at is not None and at < image_id:
            at, predictions = next(by_image, (None, ()))
        yield predictions if at == image_id else ()


def predictions_sha256(predictions: Iterable[Prediction]) -> str:
    """Hash of an image's predictions, whatever number the image has in a track."""
    named = [as_json(p) for p in predictions]
    for entry in named:
        del entry["image_id"]
    return sha256_of_text(canonical_json(named))


def has_its_results(record: ImageRecord, folder: Path) -> bool:
    """Whether a stored record's predictions, or its files in the run, are those of its row."""
    if record.row.predictions_sha256:
        return record.row.predictions_sha256 == predictions_sha256(record.predictions)
    paths = ((folder / file.file, file.sha256) for file in record.row.files)
    return all(path.is_file() and sha256_of_file(path) == sha256 for path, sha256 in paths)


def write_predictions(
    folder: Path, images_per_file: int | None, images: Iterable[Sequence[str]], n_images: int
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


def _read_lines(stream: IO[bytes], kind: type[_P]) -> Iterator[list[_P]]:
    """Entries of a file with one a line. RecordError for any other."""
    done, parts = 0, list[bytes]()
    while block := stream.read(_BATCH_BYTES):
        at = block.rfind(b"\n") + 1
        if at:
            parts.append(block[:at])
            entries = _read_whole_lines(b"".join(parts), kind, done)
            yield entries
            done += len(entries)
            parts.clear()
        parts.append(block[at:])
    if rest := b"".join(parts):
        yield _read_whole_lines(rest + b"\n", kind, done)


def _read_whole_lines(data: bytes, kind: type[_P], before: int) -> list[_P]:
    entries = decode_lines(kind, data, first=before + 1)
    if len(entries) != data.count(b"\n"):
        raise RecordError("a line without a prediction")
    return entries


def _read_list(stream: IO[bytes], kind: type[_P]) -> Iterator[list[_P]]:
    """Entries of a JSON list. RecordError for any other text, with the place in all of it."""
    done, many = 0, list[kind]  # type: ignore[valid-type]
    try:
        for entries in _split_list(stream, kind):
            yield entries
            done += len(entries)
    except RecordError:
        stream.seek(0)
        yield decode(many, stream.read())[done:]


def _split_list(stream: IO[bytes], kind: type[_P]) -> Iterator[list[_P]]:
    """Parts of a JSON list, cut where a line ends in an object and a comma.

    A cut is right exactly when what comes before it is a whole list of its own. RecordError where
    it is not, as it can be in lists that others have indented.
    """
    many = list[kind]  # type: ignore[valid-type]
    opening, parts = b"", list[bytes]()
    while block := stream.read(_BATCH_BYTES):
        at = block.rfind(b"},\n")
        if at >= 0:
            yield decode(many, b"".join([opening, *parts, block[: at + 1], b"]"]))
            opening, parts, block = b"[", [], block[at + 3 :]
        parts.append(block)
    rest = decode(many, b"".join([opening, *parts]))
    if opening and not rest:
        raise RecordError("a comma before the end")
    yield rest
