"""Tracks of COCO-style annotations serve counts as they are."""

from legoworld.track_making.annotations import TRACK

__all__ = ["TRACK"]
