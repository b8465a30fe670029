"""A model's image processor on one backend: what else is installed must not change the numbers.

transformers takes torchvision where it is installed and Pillow elsewhere, and the two resize
differently. Which one ran is on record, so a run is not resumed across it.
"""

from __future__ import annotations

import json
from importlib import metadata
from pathlib import Path
from typing import Any

from legoworld_baseline.protocol import Refused

BACKENDS = ("pil", "torchvision")
_FILES = ("preprocessor_config.json", "processor_config.json")
#: Of the torch that the baselines pin.
_TORCHVISION = "torchvision==0.28.0"


def description(folder: Path) -> dict[str, Any]:
    """What a model's folder says of its preprocessing. Refused when it says nothing."""
    for name in _FILES:
        path = folder / name
        if path.is_file():
            values = json.loads(path.read_text(encoding="utf-8"))
            own = values.get("image_processor", values if name == _FILES[0] else None)
            if isinstance(own, dict):
                return own
    raise Refused(
        "the model's folder does not describe its preprocessing",
        found=", ".join(sorted(p.name for p in folder.iterdir())[:8]) or "an empty folder",
        expected=f"{_FILES[0]} beside config.json",
        next_step=f"download {_FILES[0]} of the same model, or save its processor with"
        " save_pretrained into the folder",
    )


def load_processor(folder: Path, backend: str = "pil") -> Any:
    """The image processor of a model's folder, on this backend and on no other.

    Refused when the folder does not describe it, when transformers has none for this backend, and
    when torchvision is asked for and not installed.
    """
    import transformers

    description(folder)
    if backend == "torchvision":
        _check_torchvision()
    try:
        processor = transformers.AutoImageProcessor.from_pretrained(
            folder, backend=backend, local_files_only=True
        )
    except (ValueError, OSError, ImportError, KeyError, RecursionError) as error:
        reason = " ".join(f"{type(error).__name__}: {error}".split())[:280]
        if backend == "pil" and "torchvision" in reason:
            raise _for_torchvision_only(folder) from error
        raise Refused(
            "the model's preprocessing cannot be used",
            found=reason,
            expected=f"{_FILES[0]} of an image processor that transformers knows",
            next_step="download the model again, or choose another one; see the README",
        ) from error
    if processor.backend != backend:  # transformers falls back to the other one by itself
        if backend == "pil":
            raise _for_torchvision_only(folder)
        raise Refused(
            "the model's image processor does not work on torchvision",
            found=f"{type(processor).__name__} on {processor.backend}",
            expected="a processor on torchvision",
            next_step="leave --option backend away",
        )
    return processor


def processor_record(processor: Any) -> dict[str, Any]:
    """For provenance: the processor's class, backend and every setting it has."""
    record: dict[str, Any] = {
        "class": type(processor).__name__,
        "backend": processor.backend,
        "settings": json.loads(processor.to_json_string()),
    }
    if processor.backend == "torchvision":
        record["torchvision"] = metadata.version("torchvision")
    return record


def _check_torchvision() -> None:
    try:
        import torchvision  # noqa: F401
    except (ImportError, RuntimeError, OSError) as error:
        raise Refused(
            "torchvision cannot be imported by this baseline's Python",
            found=" ".join(f"{type(error).__name__}: {error}".split())[:200],
            expected=f"{_TORCHVISION}, built for the same torch",
            next_step=f"`legoworld baseline install NAME --with {_TORCHVISION}`, or install it into"
            " the Python that --python names",
        ) from error


def _for_torchvision_only(folder: Path) -> Refused:
    kind = description(folder).get("image_processor_type")
    return Refused(
        "the model's image processor exists for torchvision only, and Pillow is the default here",
        found=f"image_processor_type {kind!r}",
        expected="a processor with a Pillow backend, or --option backend=torchvision",
        next_step=f"`legoworld baseline install NAME --with {_TORCHVISION}` and pass"
        " --option backend=torchvision, where this baseline has that option",
    )
