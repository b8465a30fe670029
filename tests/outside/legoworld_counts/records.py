"""The files of an evaluation of counts."""

from functools import partial

from legoworld.records.base import Record, decode_lines
from legoworld.records.evaluation import (
    EvaluationEvidence,
    EvaluationRow,
    Interval,
    MetricValue,
    RecordFamily,
    ScoreConfiguration,
    Summary,
)


class CountsRow(EvaluationRow, frozen=True, kw_only=True):
    """One image. error: the mean absolute error over the categories of truth or answer."""

    n_truth: int
    error: float | None

    @property
    def has_score(self):
        return self.error is not None

    @property
    def has_truth(self):
        return self.n_truth > 0


class Mae(Record, frozen=True, kw_only=True):
    """The mean over scored images, with its interval over images."""

    value: float | None
    interval: Interval | None


class CountsSummary(Summary, frozen=True, kw_only=True):
    """Of counts."""

    mae: Mae

    def metric_values(self):
        yield MetricValue("mae", None, self.mae.value, self.mae.interval)


class CountsEvidence(EvaluationEvidence, frozen=True, kw_only=True):
    """Of counts."""

    configuration: ScoreConfiguration
    mae: float | None


RECORDS = RecordFamily(
    summary=CountsSummary, rows=partial(decode_lines, CountsRow), evidence=CountsEvidence
)
