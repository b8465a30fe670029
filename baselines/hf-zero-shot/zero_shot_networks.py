"""OWL-ViT, OWLv2 and Grounding DINO of transformers, asked for a whole vocabulary."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import torch
import transformers
from legoworld_baseline import Refused
from legoworld_baseline.hugging_face import load_pretrained, read_config
from legoworld_baseline.image_processors import load_processor
from legoworld_baseline.model_kinds import wrong_kind
from numpy.typing import NDArray
from PIL import Image
from zero_shot_prompts import DEFAULT_TEMPLATES, Caption, captions


@dataclass(frozen=True, kw_only=True)
class Pass:
    """One pass of the network over a photo: q boxes, asked for the prompts `columns`.

    scores: (q, columns) float32; boxes_xyxy_px: (q, 4) float32 in the photo.
    """

    columns: tuple[int, ...]
    scores: NDArray[np.float32]
    boxes_xyxy_px: NDArray[np.float32]


@dataclass(frozen=True, kw_only=True)
class Question:
    """What one pass is asked.

    texts: the text encoder's inputs; score: the network's probabilities (q, tokens or prompts) to
    (q, columns).
    """

    columns: tuple[int, ...]
    texts: Any
    score: Callable[[torch.Tensor], torch.Tensor]


@dataclass(frozen=True, kw_only=True)
class Model:
    """A network with its image processor and what it is asked. record: for provenance."""

    network: Any
    processor: Any
    questions: tuple[Question, ...]
    record: dict[str, Any]


def load_config(folder: Path) -> Any:
    """The model's configuration. Refused when it is no zero-shot detector that is run here."""
    config = read_config(folder)
    if config.model_type not in DEFAULT_TEMPLATES:
        raise wrong_kind(
            "this zero-shot detector is not supported",
            config,
            expected=", ".join(DEFAULT_TEMPLATES),
        )
    return config


def load_model(
    folder: Path, asked: Sequence[str], *, device: str, dtype: str, caption: str
) -> Model:
    """The network of a folder, ready to be asked for these phrases. Refused when it cannot be."""
    config = load_config(folder)
    processor = load_processor(folder)
    tokenizer = _tokenizer(folder)
    network = load_pretrained(
        transformers.AutoModelForZeroShotObjectDetection, folder, device=device, dtype=dtype
    )
    if config.model_type in ("owlvit", "owlv2"):
        most_tokens = int(config.text_config.max_position_embeddings)
        questions = [_owl_question(tokenizer, asked, most_tokens)]
        score = "sigmoid of the similarity of box and prompt"
    elif caption == "single":
        questions = [_single_question(tokenizer, n, phrase) for n, phrase in enumerate(asked)]
        score = "highest probability of any token of the prompt's own caption"
    else:
        questions = _joint_questions(tokenizer, asked, int(config.max_text_len))
        score = "mean probability of the prompt's tokens"
    return Model(
        network=network,
        processor=processor,
        questions=tuple(questions),
        record={"score": score, "passes_per_photo": len(questions)},
    )


@torch.inference_mode()
def detect(model: Model, photo: NDArray[np.uint8]) -> Iterator[Pass]:
    """Every pass over a photo (H, W, 3). ArithmeticError when a number is not finite."""
    network = model.network
    pixels = model.processor(images=Image.fromarray(photo), return_tensors="pt")
    inputs = {name: tensor.to(network.device) for name, tensor in pixels.items()}
    inputs["pixel_values"] = inputs["pixel_values"].to(network.dtype)
    for question in model.questions:
        out = network(**question.texts.to(network.device), **inputs)
        scores = question.score(out.logits[0].float().sigmoid().cpu())
        boxes = out.pred_boxes[0].float().cpu()
        if not (scores.isfinite().all() and boxes.isfinite().all()):
            raise ArithmeticError("the network's output contains NaN or infinity")
        yield Pass(
            columns=question.columns,
            scores=scores.numpy(),
            boxes_xyxy_px=_in_photo(model.processor, boxes, (photo.shape[0], photo.shape[1])),
        )


def _owl_question(tokenizer: Any, asked: Sequence[str], most_tokens: int) -> Question:
    """Every prompt in one pass. Refused for one that has more tokens than are read."""
    lengths = [len(ids) for ids in tokenizer(list(asked))["input_ids"]]
    long = [p for p, n in zip(asked, lengths, strict=True) if n > most_tokens]
    if long:
        raise Refused(
            "prompts exceed the text encoder's limit",
            found=f"{long[0]!r}, {len(long)} in all",
            expected=f"at most {most_tokens} tokens",
            next_step="pass a shorter --option template",
        )
    texts = tokenizer(
        list(asked), padding="max_length", max_length=most_tokens, return_tensors="pt"
    )
    return Question(columns=tuple(range(len(asked))), texts=texts, score=lambda shares: shares)


def _single_question(tokenizer: Any, column: int, phrase: str) -> Question:
    """One prompt alone, as transformers' pipeline asks."""
    return Question(
        columns=(column,),
        texts=tokenizer(phrase, return_tensors="pt"),
        score=lambda shares: shares.max(dim=-1, keepdim=True).values,
    )


def _joint_questions(tokenizer: Any, asked: Sequence[str], most_tokens: int) -> list[Question]:
    """Every prompt, as many in a caption as fit; a score is the mean over a prompt's tokens.

    So its authors evaluate COCO (create_positive_map_from_span of IDEA-Research/GroundingDINO).
    """
    alone = [len(tokenizer(p, add_special_tokens=False)["input_ids"]) for p in asked]
    if max(alone) + 3 > most_tokens or min(alone) == 0:
        raise Refused(
            "a prompt does not fit the text encoder",
            found=f"{asked[int(np.argmax(alone))]!r}",
            expected=f"1 to {most_tokens - 3} tokens",
            next_step="pass a shorter --option template",
        )
    return [_joint_question(tokenizer, c) for c in captions(asked, alone, most_tokens)]


def _joint_question(tokenizer: Any, caption: Caption) -> Question:
    texts = tokenizer(caption.text, return_tensors="pt", return_offsets_mapping=True)
    begins, ends = texts.pop("offset_mapping")[0].T
    inside = [(begins >= b) & (ends <= e) & (ends > begins) for b, e in caption.spans]
    own = torch.stack(inside).float()
    weights = (own / own.sum(dim=1, keepdim=True)).T
    return Question(
        columns=caption.columns,
        texts=texts,
        score=lambda shares: shares[:, : len(weights)] @ weights,
    )


def _in_photo(processor: Any, boxes: torch.Tensor, size_hw: tuple[int, int]) -> NDArray[np.float32]:
    """The processor's own way from its boxes to photo pixels: OWLv2 pads photos to squares."""
    every = SimpleNamespace(logits=torch.zeros(1, len(boxes), 1), pred_boxes=boxes[None])
    (found,) = processor.post_process_object_detection(
        every, threshold=-1.0, target_sizes=torch.tensor([size_hw])
    )
    return np.asarray(found["boxes"].numpy(), np.float32)


def _tokenizer(folder: Path) -> Any:
    try:
        return transformers.AutoTokenizer.from_pretrained(folder, local_files_only=True)
    except (ValueError, OSError, KeyError, TypeError) as error:
        raise Refused(
            "the model's tokenizer cannot be used",
            found=" ".join(f"{type(error).__name__}: {error}".split())[:280],
            expected="tokenizer.json, or the vocabulary's files, beside the weights",
            next_step="download the model again, with its tokenizer",
        ) from error
