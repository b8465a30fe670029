"""The evaluation folder: every task writes one through here. Private: it may hold truth."""

from __future__ import annotations

import hashlib
import json
import os
import platform
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from importlib import metadata
from pathlib import Path
from typing import Any, Final, Generic, TypeVar

from msgspec.structs import replace
from numpy.typing import NDArray

from legoworld.errors import ConfigurationMismatchError
from legoworld.files import (
    TEMPORARY_SUFFIX,
    Json,
    atomic_path,
    canonical_json,
    sha256_of_file,
    write_npz,
    write_text,
)
from legoworld.locks import held_folder
from legoworld.records.base import UNSET, Record, as_json, canonical, readable, short_json
from legoworld.records.detection import CategoryRow
from legoworld.records.evaluation import (
    EvaluationEvidence,
    ImageRow,
    Input,
    ScoreConfiguration,
    Summary,
)
from legoworld.records.folders.read_evaluation import (
    EVIDENCE,
    MATCHES,
    PER_CATEGORY,
    PER_IMAGE,
    SUMMARY,
    VIEW,
    EvaluationFolderError,
    read_evidence,
)
from legoworld.version import __version__

#: Packages a score can depend on; those that are installed are named in evidence.json.
_PACKAGES: Final = ("numpy", "scipy", "pycocotools", "lvis", "hotcoco", "OpenEXR")

#: Keys of run.json that its hash leaves out: two runs that differ in nothing else are the same
#: input, so that their evaluations and comparisons have the same bytes.
TIMES: Final = ("finished_at",)

S = TypeVar("S", bound=Summary)
E = TypeVar("E", bound=EvaluationEvidence)


@dataclass(frozen=True, kw_only=True)
class InputFile:
    """A file a score was computed from. role: truth, run, predictions, ... .

    recorded: its name in evidence.json; None for its path relative to the evaluation folder.
    without: keys of a JSON file that the hash and the size leave out.
    """

    role: str
    path: Path
    sha256: str
    size_bytes: int
    recorded: str | None = None
    without: tuple[str, ...] = ()


@dataclass(frozen=True, kw_only=True)
class Evaluation(Generic[S]):
    """Everything an evaluation folder holds; JSON values only, NaN and inf as None.

    per_image: ascending image_id, one row
    for every image of the track. matches: arrays of matches.npz. view: file name in view/ to
    JSON value. evidence: with the configuration; its inputs and files are filled in when the
    others are written.
    """

    summary: S
    evidence: EvaluationEvidence
    inputs: Sequence[InputFile]
    per_image: Sequence[ImageRow]
    per_category: Sequence[CategoryRow] = ()
    matches: Mapping[str, NDArray[Any]] | None = None
    view: Mapping[str, Any] = field(default_factory=dict)


def excluded_keys(role: str) -> tuple[str, ...]:
    """The keys that the hash of an input leaves out."""
    return TIMES if role == "run" else ()


def hash_and_size(path: Path, without: Sequence[str] = ()) -> tuple[str, int]:
    """sha256 and bytes of a file; of its canonical JSON without some keys where any are named.

    ValueError when such a file is no JSON object.
    """
    if not without:
        return sha256_of_file(path), path.stat().st_size
    document = json.loads(path.read_text(encoding="utf-8"))
    if not isinstance(document, dict):
        raise ValueError(f"not an object: {type(document).__name__}")
    kept = {key: value for key, value in document.items() if key not in without}
    content = canonical_json(kept).encode()
    return hashlib.sha256(content).hexdigest(), len(content)


def input_file(role: str, path: Path) -> InputFile:
    """Hash an input file; a run's own document without its time. EvaluationFolderError."""
    without = excluded_keys(role)
    try:
        sha256, size = hash_and_size(path, without)
    except (ValueError, RecursionError) as error:
        raise EvaluationFolderError(
            f"{path.name} cannot be put on record",
            found=f"{type(error).__name__}: {error}",
            expected="a file as legoworld writes it",
            next_step="make the run again",
        ) from error
    return InputFile(role=role, path=path, sha256=sha256, size_bytes=size, without=without)


def prepare_folder(
    folder: Path, *, configuration: ScoreConfiguration, inputs: Sequence[InputFile], overwrite: bool
) -> None:
    """Refuse early what `write_evaluation` would refuse; make the folder otherwise.

    configuration: what the result depends on besides the inputs' bytes. The same evaluation is
    written again over itself. ConfigurationMismatchError names what differs
    from an earlier one; with `overwrite` that one is replaced. A folder with other files in it is
    never touched.
    """
    folder.mkdir(parents=True, exist_ok=True)
    strangers = sorted(p.name for p in folder.iterdir() if not _is_ours(p.name))
    if strangers:
        raise ConfigurationMismatchError(
            "the output folder holds something that is not an evaluation",
            found=", ".join(strangers[:5]),
            expected="an empty folder or an earlier evaluation",
            next_step="choose another -o",
        )
    if not (folder / EVIDENCE).is_file() or overwrite:
        return
    earlier = read_evidence(folder)
    before = {**earlier.configuration, **_inputs_by_role(earlier.inputs)}
    now = {**as_json(configuration), **_inputs_by_role(_entries(inputs, folder))}
    changed = sorted(key for key in {*before, *now} if before.get(key) != now.get(key))
    if changed:
        raise ConfigurationMismatchError(
            "the output folder holds another evaluation",
            found="; ".join(
                f"{k}: {short_json(before.get(k))} -> {short_json(now.get(k))}" for k in changed
            ),
            expected="the same run, truth and options",
            next_step="choose another -o, or pass --overwrite",
        )


def write_evaluation(folder: Path, evaluation: Evaluation[S], *, overwrite: bool) -> None:
    """Write every file of an evaluation, each whole or not at all, evidence.json last.

    Two that end at the same time are written one after the other, and the second one's check
    finds the first.
    """
    with held_folder(folder):
        prepare_folder(
            folder,
            configuration=evaluation.evidence.configuration,
            inputs=evaluation.inputs,
            overwrite=overwrite,
        )
        _write(folder, evaluation)


def _write(folder: Path, evaluation: Evaluation[S]) -> None:
    _delete_earlier(folder)
    write_text(folder / PER_IMAGE, _lines(evaluation.per_image))
    if evaluation.per_category:
        write_text(folder / PER_CATEGORY, _lines(evaluation.per_category))
    if evaluation.matches is not None:
        write_npz(folder / MATCHES, evaluation.matches, compressed=True)
    for name, value in sorted(evaluation.view.items()):
        _write_json(folder / VIEW / name, value)
    write_text(folder / SUMMARY, readable(evaluation.summary))
    written = sorted(p for p in folder.rglob("*") if p.is_file())
    evidence = replace(
        evaluation.evidence,
        inputs=tuple(_entries(evaluation.inputs, folder)),
        files={p.relative_to(folder).as_posix(): sha256_of_file(p) for p in written},
    )
    write_text(folder / EVIDENCE, readable(evidence))


def installed_versions(*more: str) -> dict[str, str]:
    """Versions of everything a score can depend on; packages that are absent are left out.

    more: packages that only the caller's task depends on.
    """
    versions = {"legoworld": __version__, "python": platform.python_version()}
    for name in (*_PACKAGES, *more):
        try:
            versions[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            continue
    return versions


def make_evidence(
    kind: type[E], summary: Summary, configuration: ScoreConfiguration, *packages: str, **own: Any
) -> E:
    """An evaluation's evidence: `own`, and each field that the summary has under the same name.

    packages: that only this family's scores depend on.
    """
    shared = {*kind.__struct_fields__} & {*summary.__struct_fields__} - {"kind", *own}
    return kind(
        versions=installed_versions(*packages),
        inputs=(),
        files={},
        configuration=configuration,
        **{name: getattr(summary, name) for name in shared},
        **own,
    )


def _entries(inputs: Sequence[InputFile], folder: Path) -> list[Input]:
    """Inputs as evidence.json lists them."""
    return [
        Input(
            role=i.role,
            path=i.recorded or _relative(i.path, folder),
            sha256=i.sha256,
            bytes=i.size_bytes,
            without=i.without or UNSET,
        )
        for i in inputs
    ]


def _relative(path: Path, folder: Path) -> str:
    return Path(os.path.relpath(path.resolve(), folder.resolve())).as_posix()


def _inputs_by_role(entries: Sequence[Input]) -> dict[str, Any]:
    """Hashes by role: the same bytes are the same input wherever they lie."""
    by_role: dict[str, list[str]] = {}
    for entry in entries:
        by_role.setdefault(f"input {entry.role}", []).append(entry.sha256)
    return dict(by_role)


def _is_ours(name: str) -> bool:
    known = (SUMMARY, PER_IMAGE, PER_CATEGORY, MATCHES, EVIDENCE, VIEW)
    return name in known or (name.startswith(".") and name.endswith(TEMPORARY_SUFFIX))


def _delete_earlier(folder: Path) -> None:
    """Remove an earlier evaluation, evidence.json first: half of one is never taken for whole."""
    for name in (EVIDENCE, SUMMARY, PER_IMAGE, PER_CATEGORY, MATCHES):
        (folder / name).unlink(missing_ok=True)
    for leftover in folder.glob(f".*{TEMPORARY_SUFFIX}"):
        leftover.unlink()
    view = folder / VIEW
    for path in sorted(view.rglob("*"), reverse=True) if view.is_dir() else ():
        path.rmdir() if path.is_dir() else path.unlink()


def _write_json(path: Path, value: Json) -> None:
    """Canonical JSON and a newline, whole or not at all; a list's text is never all in memory."""
    items = value if isinstance(value, list) else None
    with atomic_path(path) as temporary, temporary.open("wb") as stream:
        if items is None:
            stream.write(canonical(value).encode())
        else:
            for index, item in enumerate(items):
                stream.write(f"{',' if index else '['}{canonical(item)}".encode())
            stream.write(b"]" if items else b"[]")
        stream.write(b"\n")


def _lines(rows: Sequence[Record]) -> str:
    return "".join(canonical(row) + "\n" for row in rows)
