"""Which baseline runs a model of transformers, for one that was given to another baseline."""

from __future__ import annotations

from typing import Any

from legoworld_baseline.protocol import Refused

_BY_AUTO_CLASS = (
    ("AutoModelForObjectDetection", "hf-detector"),
    ("AutoModelForZeroShotObjectDetection", "hf-zero-shot"),
    ("AutoModelForDepthEstimation", "hf-depth"),
)
_BY_TYPE = {
    "mask2former": "hf-segmenter",
    "maskformer": "hf-segmenter",
    "sam3": "sam3",
    "sam3_video": "sam3",
}
_IMPORT = (
    "no baseline runs this model: predict with its own code and pass the results to"
    " `legoworld baseline import`"
)


def wrong_kind(what: str, config: Any, *, expected: str) -> Refused:
    """The refusal of a model of another kind; its next step names the baseline that runs it."""
    return Refused(
        what,
        found=f"model_type {config.model_type!r}",
        expected=expected,
        next_step=next_step_for(config),
    )


def next_step_for(config: Any) -> str:
    """What to do with a model of this configuration, in words."""
    import transformers

    own = _BY_TYPE.get(config.model_type)
    for name, baseline in _BY_AUTO_CLASS:
        if own is None and type(config) in getattr(transformers, name)._model_mapping:
            own = baseline
    return f"run it with `legoworld baseline run {own}`" if own else _IMPORT
