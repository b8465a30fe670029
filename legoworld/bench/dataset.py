"""`legoworld bench make`: reference scenes to a dataset of a public and a private half."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Final

from legoworld.bench.family import FamilyMaker, MadeFamily, MakeOptions, lost_family
from legoworld.bench.halves import PRIVATE, PUBLIC, TRACK, TRUTH, Halves, X
from legoworld.cards import load_card
from legoworld.conventions import SCHEMA_VERSION
from legoworld.errors import CatalogError, UsageError
from legoworld.files import sha256_of_text, write_text
from legoworld.records.base import as_json, readable, to_record
from legoworld.records.bench_dataset import BenchImage, BenchInfo, BenchTrackFile, BenchTruthFile
from legoworld.records.second_card import BenchXFile, BenchXImage, BenchXInfo
from legoworld.records.track import CategoryInfo
from legoworld.scene.blender_process import Limits
from legoworld.scene.folder import find_scene
from legoworld.tasks.shipped import BENCH, BENCH_X
from legoworld.tracks.track import make_folder_track
from legoworld.visibility.scoring_raster import POINT_CAP
from legoworld.workers.engines import ENGINES, EngineName, Job
from legoworld.workers.processors import usable_cores

_DESCRIPTION: Final = "LEGO-Bench: rebuild the scene of each picture"


@dataclass(frozen=True, kw_only=True)
class MakeRequest:
    """Inputs of a dataset. limit: only the first reference scenes."""

    scenes: Path
    options: MakeOptions
    limits: Limits
    engine: EngineName
    workers: int
    limit: int | None
    overwrite: bool


@dataclass(frozen=True, kw_only=True)
class MadeDataset:
    """A dataset that was written, or the reasons why nothing was. families: sorted by name."""

    families: tuple[MadeFamily, ...]
    track: BenchTrackFile | None
    truth: BenchTruthFile | None

    @property
    def refused_families(self) -> list[MadeFamily]:
        """Reference scenes that were refused."""
        return [family for family in self.families if not family.cases]


def make_dataset(
    request: MakeRequest,
    *,
    total: Callable[[int], None] = lambda _: None,
    progress: Callable[[MadeFamily], None],
) -> MadeDataset:
    """Make the cases of every reference scene below SCENES.

    total: called with the number of scenes; progress: with each that is done.

    A scene that is refused is in the result with its reason, and the others are made. The bytes do
    not depend on workers and engine. Raises CatalogError where there is no scene, and UsageError
    where the output holds something else.
    """
    _prepare(request)
    images = make_folder_track(request.scenes).images[: request.limit]
    folders = [find_scene(request.scenes, image.scene) for image in images]
    total(len(folders))
    options = request.options
    if request.engine == "local":  # one family alone may use every core
        threads = usable_cores() // max(1, min(request.workers, len(folders)))
        options = replace(options, threads=max(1, threads))
    job = Job(make=partial(FamilyMaker, options, request.limits), lost_result=lost_family)
    made: list[MadeFamily] = []
    with closing(ENGINES[request.engine](job, folders, request.workers)) as families:
        for family in families:
            progress(family)
            made.append(family)
    made.sort(key=lambda family: family.family)
    _refuse_equal_names(made)
    if not any(family.cases for family in made):
        return MadeDataset(families=tuple(made), track=None, truth=None)
    track, truth = _files(made, request.options)
    _write(track, truth, _second_card(track, truth, made), request.options.output)
    return MadeDataset(families=tuple(made), track=track, truth=truth)


def _prepare(request: MakeRequest) -> None:
    """Create the dataset folder, or remove a finished dataset from it; other files stay.

    What a run that ended early has left is continued: its renders are in the cache, and every file
    is written again.
    """
    output = request.options.output
    present = sorted(p.name for p in output.iterdir()) if output.is_dir() else []
    strangers = [name for name in present if name not in (PUBLIC, PRIVATE)]
    if strangers:
        raise UsageError(
            "the output folder is not empty and not a dataset",
            found=", ".join(strangers[:5]),
            expected="an empty folder or an earlier dataset",
            next_step="choose another -o",
        )
    finished = (Halves(output).public / TRACK).exists()
    if finished and not request.overwrite:
        raise UsageError(
            "there is a dataset in the output folder",
            found=", ".join(present),
            expected="an empty folder",
            next_step="choose another -o, or pass --overwrite to make it anew",
        )
    for name in present if request.overwrite else ():
        shutil.rmtree(output / name)
    output.mkdir(parents=True, exist_ok=True)


def _refuse_equal_names(families: Sequence[MadeFamily]) -> None:
    names = [family.family for family in families]
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise CatalogError(
            "two reference scenes are of one family",
            found=twice[0],
            expected="names that differ when / becomes -",
            next_step="rename one of the scene folders",
        )


def _files(
    families: Sequence[MadeFamily], options: MakeOptions
) -> tuple[BenchTrackFile, BenchTruthFile]:
    """The two halves' files; image ids count from 1 in the order of file names."""
    cases = sorted(
        ((case, family) for family in families for case in family.cases),
        key=lambda pair: pair[0].file_name,
    )
    images = tuple(
        BenchImage(
            id=number,
            file_name=case.file_name,
            width=options.size_wh[0],
            height=options.size_wh[1],
            hfov_deg=case.hfov_deg,
            family=family.family,
            environment=family.environment,
            theme=family.theme,
            split=family.split,
            tier=case.tier,
            view=case.view,
        )
        for number, (case, family) in enumerate(cases, start=1)
    )
    names = sorted({o.category for case, _ in cases for o in case.truth.scored})
    version = load_card(BENCH).version
    track = BenchTrackFile(
        info=BenchInfo(
            description=_DESCRIPTION, task=BENCH, card_version=version, picture=options.picture
        ),
        images=images,
        categories=tuple(CategoryInfo(id=i, name=name) for i, name in enumerate(names, start=1)),
    )
    truth = BenchTruthFile(
        schema_version=SCHEMA_VERSION,
        task=BENCH,
        card_version=version,
        track_sha256=sha256_of_text(readable(track)),
        point_cap=POINT_CAP,
        card=options.card,
        images={str(image.id): case.truth for image, (case, _) in zip(images, cases, strict=True)},
    )
    return track, truth


def _second_card(
    track: BenchTrackFile, truth: BenchTruthFile, families: Sequence[MadeFamily]
) -> BenchXFile:
    cases = {case.file_name: case for family in families for case in family.cases}
    images = tuple(
        to_record(
            BenchXImage,
            {**as_json(image), "probe": as_json(case.probe), "x": as_json(case.x)},
        )
        for image in track.images
        for case in (cases[str(image.file_name)],)
    )
    info = BenchXInfo(
        description="LEGO-Bench-X: private, never handed to whoever makes submissions",
        task=BENCH_X,
        card_version=load_card(BENCH_X).version,
        track_sha256=truth.track_sha256,
    )
    return BenchXFile(info=info, images=images, categories=track.categories)


def _write(track: BenchTrackFile, truth: BenchTruthFile, x: BenchXFile, output: Path) -> None:
    """Last of all, so that a dataset that was not finished is none; refused families' go first."""
    halves = Halves(output)
    stems = {Path(str(image.file_name)).stem for image in track.images}
    for path in [*halves.public.rglob("*"), *halves.private.rglob("*")]:
        if path.is_file() and path.stem not in stems:
            path.unlink()
    write_text(halves.private / X, readable(x))
    write_text(halves.private / TRUTH, readable(truth))
    write_text(halves.public / TRACK, readable(track))
