"""Answers of others to a track's questions: JSON Lines of {"id", "answer"}."""

from __future__ import annotations

from collections import defaultdict
from pathlib import Path
from typing import Any, Final

from msgspec.structs import replace

from legoworld.baselines.baseline_import import ImportRequest, import_images
from legoworld.baselines.family import BaselineFamily, ImportListener, ImportOptions
from legoworld.errors import CatalogError, UsageError, cause, one_line
from legoworld.files import sha256_of_file
from legoworld.pluralize import did_you_mean
from legoworld.readouts.relations import write_answers
from legoworld.records.base import RecordError, decode_lines
from legoworld.records.relations import AnswerFile, AnswerLine
from legoworld.records.run_file import ImageRecord, ImageSource, ImportedFrom
from legoworld.running.image_record import initial_row
from legoworld.running.readout_run import RunResult
from legoworld.tracks.track import TrackImage


def _import(
    request: ImportRequest, source: Path, options: ImportOptions, telling: ImportListener
) -> RunResult:
    answers = _answers(request, source, subset=bool(options.get("subset")))
    sha256 = sha256_of_file(source)

    def answer(image: TrackImage) -> ImageRecord:
        file = write_answers(request.run, image.scene, AnswerFile(answers=answers[image.id]))
        origin = ImageSource(source=ImportedFrom(file=source.name, sha256=sha256))
        return ImageRecord(row=replace(initial_row(image), answer=file), scene=origin)

    return import_images(request, source, answer, telling)


def _answers(request: ImportRequest, source: Path, *, subset: bool) -> dict[int, dict[str, Any]]:
    """The answers of each image by question. CatalogError, UsageError."""
    image_of = {question.id: question.image_id for question in request.track.questions}
    if not image_of:
        raise UsageError(
            "the track asks no questions",
            expected="questions in it",
            next_step=f"`legoworld track make --task {request.protocol.task.name}` makes one",
        )
    try:
        lines = decode_lines(AnswerLine, source.read_bytes())
    except (OSError, RecordError) as error:
        raise CatalogError(
            f"{source.name} cannot be read",
            found=cause(error),
            expected='JSON Lines of {"id": a question of the track, "answer": ...}',
        ) from error
    answers: dict[int, dict[str, Any]] = defaultdict(dict)
    for number, line in enumerate(lines, start=1):
        image = image_of.get(line.id)
        if image is None and subset:
            continue
        if image is None:
            raise CatalogError(
                f"{source.name} answers what the track does not ask",
                found=f"answer {number}: {one_line(repr(line.id), 60)}",
                expected=did_you_mean(line.id, list(image_of)).strip() or "a question of the track",
                next_step="pass --subset to ignore answers to other questions",
            )
        if answers[image].setdefault(line.id, line.answer) != line.answer:
            raise CatalogError(
                f"{source.name} answers a question twice",
                found=f"answer {number}: {line.id}",
                expected="one answer to each question",
            )
    return answers


BASELINE: Final = BaselineFamily(
    of_folder=False,
    what="JSON Lines of answers",
    options=frozenset({"subset"}),
    import_answers=_import,
)
