"""How to repeat a page's numbers: commands, hashes, versions, licences. No path, no time."""

from __future__ import annotations

import json
import shlex
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from pathlib import PurePosixPath
from typing import Final, NotRequired, TypedDict, cast

from legoworld.evaluation.family import load_evaluation_family
from legoworld.evaluation.stored import StoredEvaluation
from legoworld.files import Json
from legoworld.records.base import as_json, canonical
from legoworld.records.comparison import Comparison
from legoworld.records.report_page import Facts
from legoworld.records.report_tables import SideOrigin
from legoworld.shipped import catalog
from legoworld.tables.table import Table, Text, table
from legoworld.tracks.vocabulary import find_dataset

#: Licences of what a score is computed with, by package.
_LICENCES: Final = {
    "OpenEXR": "BSD-3-Clause",
    "bpy": "GPL-3.0",
    "hotcoco": "MIT",
    "legoworld": "Apache-2.0",
    "lvis": "BSD-2-Clause",
    "numpy": "BSD-3-Clause",
    "pycocotools": "BSD-2-Clause (FreeBSD)",
    "python": "PSF-2.0",
    "scipy": "BSD-3-Clause",
}


def provenance(side: StoredEvaluation) -> SideOrigin:
    """What the page says of where one side's numbers come from."""
    return SideOrigin(
        label=side.name,
        folder=side.folder.name,
        commands=(_made_run(side, _cards()), _describe_evaluation(side)),
        partial=side.summary.partial,
        tables=tuple(_tables(side, _cards())),
    )


def _tables(side: StoredEvaluation, cards: Sequence[DatasetCard]) -> Iterator[Table]:
    evidence, run = side.evidence, side.run
    inputs = [
        (
            i.role,
            _find_shipped(cards, i.sha256) or PurePosixPath(i.path).name,
            i.bytes or "",
            i.sha256,
        )
        for i in evidence.inputs
    ]
    yield table(("role", "file", "bytes", "sha256"), inputs, title="Inputs")
    outputs = sorted(evidence.files.items())
    yield table(("file", "sha256"), outputs, title="The evaluation's files")
    versions = sorted({**(run.versions or {}), **evidence.versions}.items())
    licences = [
        *((Text(text=n), v, _LICENCES.get(n, "see the package")) for n, v in versions),
        *_data_licence(side, cards),
        *_model_licence(side),
    ]
    yield table(("what", "version", "licence"), licences, title="Versions and licences")
    chosen = [
        (f"{kind}: {key}", value)
        for kind, values in (
            ("run", json.loads(canonical(run.configuration))),
            ("evaluation", as_json(evidence.configuration)),
        )
        for key, value in _flat(values)
    ]
    yield table(("option", "value"), chosen, title="Configuration")


class CardFile(TypedDict):
    """A file that a dataset's card lists."""

    pattern: str
    sha256: NotRequired[str]
    shipped: NotRequired[bool]


class DatasetCard(TypedDict):
    """A dataset's card.toml, as far as a page tells of it."""

    name: str
    title: str
    licence: str
    files: NotRequired[Sequence[CardFile]]


def compare_command(comparison: Comparison, sides: Sequence[StoredEvaluation]) -> str:
    """The command that made a comparison of these evaluations."""
    bootstrap = comparison.bootstrap
    names = [side.folder.name for side in sides] or ["EVAL_SCENE", "EVAL_BASELINE"]
    words = ["legoworld", "compare", *names]
    words += ["--draws", str(bootstrap.draws), "--seed", str(bootstrap.seed)]
    return shlex.join([*words, "-o", "COMPARISON"])


def _made_run(side: StoredEvaluation, cards: Sequence[DatasetCard]) -> str:
    configuration = side.run.configuration
    run = _run_name(side)
    track = _find_shipped(cards, configuration.track_sha256 or "") or "TRACK.json"
    if not side.is_scene:
        name = configuration.baseline or "NAME"
        verb = "import FILE_OR_DIR" if configuration.imported else f"run {_word(name)}"
        return (
            f"legoworld baseline {verb} --task {side.task} --track {_word(track)} -o {_word(run)}"
        )
    words = ["legoworld", "readout", "SCENES", "--task", side.task]
    if configuration.track_sha256:
        words += ["--track", track]
    if configuration.source:
        words += ["--source", configuration.source]
    if configuration.max_side:
        words += ["--max-side", str(configuration.max_side)]
    if configuration.variant and configuration.variant != "geometric":
        words += ["--variant", configuration.variant]
    if configuration.require_frozen:
        words.append("--require-frozen")
    return shlex.join([*words, "-o", run])


def _describe_evaluation(side: StoredEvaluation) -> str:
    configuration = as_json(side.evidence.configuration)
    truths = [i.path for i in side.evidence.inputs if i.role == "truth"]
    truth = (
        PurePosixPath(truths[0]).name
        if truths and load_evaluation_family(side.task).truth_is_file
        else "TRUTH"
    )
    words = ["legoworld", "evaluate", _run_name(side), "--truth", truth]
    for option in ("evaluator", "camera_model", "draws", "seed"):
        if option in configuration:
            words += [f"--{option.replace('_', '-')}", str(configuration[option])]
    return shlex.join([*words, "-o", side.folder.name])


def _run_name(side: StoredEvaluation) -> str:
    path = next(i.path for i in side.evidence.inputs if i.role == "run")
    return PurePosixPath(path).parent.name


def _data_licence(
    side: StoredEvaluation, cards: Sequence[DatasetCard]
) -> list[tuple[Text, str, str]]:
    """The dataset cards that know the truth by its hash, else the task's usual one."""
    truths = {i.sha256 for i in side.evidence.inputs if i.role == "truth"}
    known = [c for c in cards if any(f.get("sha256") in truths for f in c.get("files", ()))]
    said = "this truth, by its hash"
    if not known:
        known = [c for c in cards if c["name"] == find_dataset(side.task)]
        said = "the usual dataset of this task: no card knows this truth by its hash"
    return [(Text(text=c["title"], below=said), c["name"], c["licence"]) for c in known]


def _model_licence(side: StoredEvaluation) -> list[tuple[Text, str, str]]:
    """The specialist's own licence, as its card has it."""
    baseline = side.run.baseline
    if baseline is None or not baseline.licence:
        return []
    title = Text(text=baseline.title or "", below="the specialist")
    return [(title, baseline.name or "", baseline.licence)]


def _cards() -> list[DatasetCard]:
    paths = sorted(catalog.folder("datasets").glob("*/card.toml"))
    return [cast("DatasetCard", tomllib.loads(path.read_text(encoding="utf-8"))) for path in paths]


def _find_shipped(cards: Sequence[DatasetCard], sha256: str) -> str | None:
    """Where a shipped file of this hash lies, as datasets/<card>/<file>."""
    for card in cards:
        for file in card.get("files", ()):
            if sha256 and file.get("sha256") == sha256 and file.get("shipped"):
                return f"datasets/{card['name']}/{file['pattern']}"
    return None


def _flat(values: Mapping[str, Json]) -> Facts:
    return tuple((key, _text(value)) for key, value in sorted(values.items()))


def _text(value: Json) -> str:
    return "-" if value is None else str(value).lower() if isinstance(value, bool) else str(value)


def _word(value: Json) -> str:
    return shlex.quote(str(value))
