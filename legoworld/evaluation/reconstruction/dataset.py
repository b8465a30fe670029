"""Both halves of a bench as `evaluate` reads them: they must belong together, by hash.

Errors of the dataset stop an evaluation, a run's do not.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Final, TypeVar

from legoworld import exit_codes
from legoworld.errors import LegoWorldError, cause
from legoworld.files import sha256_of_file
from legoworld.records.base import RecordError, decode
from legoworld.records.bench_dataset import BenchImage, BenchTrackFile, BenchTruth, BenchTruthFile


class BenchTruthError(LegoWorldError):
    """The private or public half of a bench cannot be used, or is another dataset's."""

    code = "bench_truth"


class SubmissionFileError(LegoWorldError):
    """A file of the run is not what the run wrote: that case is scored zero."""

    code = "submission_file"


class BenchUnseenError(LegoWorldError):
    """A machine of the cluster does not see the files that the command sees."""

    code = "bench_unseen"
    exit_code = exit_codes.BLOCKED


TRUTH: Final = "truth.json"
T = TypeVar("T")


@dataclass(frozen=True, kw_only=True)
class BenchCase:
    """One image: what is public of it, and what is not."""

    image: BenchImage
    truth: BenchTruth

    @property
    def stem(self) -> str:
        """The image's name without its extension, folders kept."""
        return str(PurePosixPath(self.file_name).with_suffix(""))

    @property
    def file_name(self) -> str:
        """The image's name below public/images."""
        return str(self.image.file_name)

    @property
    def size_wh(self) -> tuple[int, int]:
        """The picture's size."""
        return self.image.width, self.image.height


@dataclass(frozen=True, kw_only=True)
class BenchFolders:
    """DATASET/private, and DATASET/public beside it."""

    private: Path

    @property
    def public(self) -> Path:
        """The public half."""
        return self.private.parent / "public"

    @property
    def track(self) -> Path:
        """The public half's list of images."""
        return self.public / "track.json"

    def reference(self, case: BenchCase) -> Path:
        """The picture that the agent saw."""
        return self.public / "images" / case.file_name

    def arrays(self, kind: str, case: BenchCase) -> Path:
        """An .npz of the private half. kind: raster, depth or instances."""
        return self.private / kind / f"{case.stem}.npz"


@dataclass(frozen=True, kw_only=True)
class BenchDataset:
    """Both halves, read. cases: by image id."""

    folders: BenchFolders
    truth: BenchTruthFile
    track_sha256: str
    cases: dict[int, BenchCase]


def read_dataset(private: Path) -> BenchDataset:
    """Read truth.json and the track beside it. BenchTruthError when the halves are not one's."""
    truth = read_record(BenchTruthFile, private / TRUTH, "DATASET/private, with truth.json in it")
    folders = BenchFolders(private=private)
    track = read_record(
        BenchTrackFile,
        folders.track,
        "DATASET/public beside DATASET/private, as `bench make` wrote",
    )
    digest = sha256_of_file(folders.track)
    if digest != truth.track_sha256:
        raise BenchTruthError(
            "the private half is of another dataset, or its track was edited",
            found=f"public/track.json {digest[:12]}",
            expected=f"{truth.track_sha256[:12]}, as private/{TRUTH} has on record",
            next_step="use both halves of one `legoworld bench make`, unchanged",
        )
    unknown = {str(image.id) for image in track.images} ^ set(truth.images)
    if unknown:
        raise BenchTruthError(
            "the halves list different images",
            found=f"image {sorted(unknown)[0]} in one alone",
            expected="every image in both",
        )
    cases = {i.id: BenchCase(image=i, truth=truth.images[str(i.id)]) for i in track.images}
    return BenchDataset(folders=folders, truth=truth, track_sha256=digest, cases=cases)


def check_run(
    dataset: BenchDataset,
    name: str,
    track_sha256: str | None,
    ids: list[int],
    second_sha256: str | None = None,
) -> None:
    """BenchTruthError when a run is of another track than the dataset's.

    second_sha256: of the second card's track, where the run is of that.
    """
    strangers = [i for i in ids if i not in dataset.cases]
    expected = second_sha256 or dataset.track_sha256
    if track_sha256 == expected and not strangers:
        return
    raise BenchTruthError(
        f"the run in {name} is of another dataset",
        found=f"track {str(track_sha256)[:12]}" + (f", image {strangers[0]}" if strangers else ""),
        expected=f"track {expected[:12]}",
        next_step="pass the private half of the dataset whose public half the readout was given",
    )


def read_record(kind: type[T], path: Path, expected: str) -> T:
    """A file of a half as its record. BenchTruthError."""
    try:
        return decode(kind, path.read_bytes())
    except (OSError, RecordError, LegoWorldError) as error:
        raise BenchTruthError(
            f"{path} cannot be read",
            found=cause(error),
            expected=expected,
            next_step="`legoworld bench make` wrote DATASET/private and DATASET/public beside it: "
            "`bench serve` takes DATASET, `evaluate --truth` DATASET/private",
        ) from error
