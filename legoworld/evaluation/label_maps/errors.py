"""Errors of label maps: one in ground truth ends scoring, one in an answer is its row."""

from __future__ import annotations

from legoworld import exit_codes
from legoworld.errors import LegoWorldError


class MapTruthError(LegoWorldError):
    """The ground truth is missing, unreadable or contradicts the run: nothing can be scored."""

    code = "label_map_truth"


class MapInvalidError(LegoWorldError):
    """A label map, or its list of segments, cannot be scored."""

    code = "label_map"
    status = "invalid"


class MapUnseenError(LegoWorldError):
    """A machine of the cluster does not see the same files as the command."""

    code = "label_map_unseen"
    exit_code = exit_codes.BLOCKED
