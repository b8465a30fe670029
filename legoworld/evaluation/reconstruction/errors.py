"""What can be wrong with the files of a bench: the dataset's stop an evaluation, a run's do not."""

from __future__ import annotations

from legoworld import exit_codes
from legoworld.errors import LegoWorldError


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
