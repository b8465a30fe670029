"""The published lvis package on current NumPy, without its drawing dependencies.

lvis 0.5.3 uses np.float (removed in NumPy 1.24), imports cv2 and matplotlib for drawing, and calls
logging.basicConfig on the root logger. None of its code is copied or changed: its drawing module
is replaced while it is imported, and its evaluation module is given a numpy that has `float`.
"""

from __future__ import annotations

import importlib
import importlib.util
import logging
import sys
import types
import warnings
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from types import ModuleType
from typing import Any, Final

import numpy as np

from legoworld import exit_codes
from legoworld.errors import LegoWorldError
from legoworld.files import Json

PACKAGE: Final = "lvis"
HOW_TO_INSTALL = "pip install --no-deps lvis==0.5.3"


class LvisMissingError(LegoWorldError):
    """The official LVIS evaluator is not installed."""

    code = "lvis_missing"
    exit_code = exit_codes.BLOCKED


def is_installed() -> bool:
    """Whether the official LVIS evaluator is installed."""
    return importlib.util.find_spec(PACKAGE) is not None


def load() -> ModuleType:
    """The lvis package, ready to score. LvisMissingError if it is not installed."""
    if not is_installed():
        raise LvisMissingError(
            "the official LVIS evaluator is not installed",
            found="no package lvis",
            expected="lvis 0.5.3",
            next_step=f"{HOW_TO_INSTALL}, or score with --evaluator fast",
        )
    package = sys.modules.get(PACKAGE) or _import()
    evaluation = importlib.import_module("lvis.eval")
    if not isinstance(evaluation.np, _NumpyWithFloat):
        evaluation.np = _NumpyWithFloat()  # type: ignore[attr-defined]
    return package


def dataset(package: ModuleType, document: Mapping[str, Json]) -> Any:
    """An lvis.LVIS of a document; its own constructor only takes a path."""
    made = package.LVIS.__new__(package.LVIS)
    return _fill_instance(made, document)


def results(package: ModuleType, truth: Any, entries: Sequence[Mapping[str, Json]]) -> Any:
    """An lvis.LVISResults; also of an empty list, which its own constructor cannot read."""
    if entries:
        return package.LVISResults(truth, entries)
    made = package.LVISResults.__new__(package.LVISResults)
    return _fill_instance(made, {**truth.dataset, "annotations": []})


@contextmanager
def quiet() -> Iterator[None]:
    """Suppress lvis's log messages, which concern things already checked."""
    logger = logging.getLogger(PACKAGE)
    before = logger.disabled, logger.level
    logger.setLevel(logging.CRITICAL)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", DeprecationWarning)  # logger.warn
            yield
    finally:
        logger.disabled, logger.level = before


class _NumpyWithFloat:
    """numpy with the name `float`, which lvis.eval uses for Python's own."""

    float = float

    def __getattr__(self, name: str) -> Any:
        return getattr(np, name)


def _fill_instance(made: Any, document: Mapping[str, Json]) -> Any:
    made.logger = logging.getLogger("lvis.lvis")
    made.dataset = document
    made._create_index()
    return made


def _import() -> ModuleType:
    """Import lvis with a stand-in for its drawing module and without its logging set-up."""
    stub = types.ModuleType("lvis.vis")
    stub.LVISVis = type("LVISVis", (), {})  # type: ignore[attr-defined]
    set_up, logging.basicConfig = logging.basicConfig, lambda **_: None
    sys.modules["lvis.vis"] = stub
    try:
        return importlib.import_module(PACKAGE)
    finally:
        logging.basicConfig = set_up
        del sys.modules["lvis.vis"]
