"""Run by a Python that has TRL and verl: their own code calls the rewards; JSON on the last line.

python trainers_check.py EMPTY_ROOM SCRATCH; dataset and command: LEGOWORLD_*.
"""

from __future__ import annotations

import json
import sys
from importlib.metadata import version
from pathlib import Path
from typing import Any

import torch  # pyright: ignore[reportMissingImports]
from datasets import Dataset  # pyright: ignore[reportMissingImports]
from legoworld_environments import rewards  # pyright: ignore[reportMissingImports]
from omegaconf import OmegaConf  # pyright: ignore[reportMissingImports]
from tokenizers import Tokenizer, models, pre_tokenizers  # pyright: ignore[reportMissingImports]
from transformers import (  # pyright: ignore[reportMissingImports]
    GPT2Config,
    GPT2LMHeadModel,
    PreTrainedTokenizerFast,
)
from trl import GRPOConfig, GRPOTrainer  # pyright: ignore[reportMissingImports]
from verl.trainer.ppo.reward import get_custom_reward_fn  # pyright: ignore[reportMissingImports]

WORDS = ("import", "bpy", "(", ")", "1", "=", "x", "[PAD]", "[EOS]")


def tiny() -> tuple[Any, Any]:
    """A network of two layers and nine words."""
    vocabulary = {word: number for number, word in enumerate(WORDS)}
    made = Tokenizer(models.WordLevel(vocabulary, unk_token="x"))
    made.pre_tokenizer = pre_tokenizers.Whitespace()
    words = PreTrainedTokenizerFast(tokenizer_object=made, pad_token="[PAD]", eos_token="[EOS]")
    shape = GPT2Config(vocab_size=len(WORDS), n_embd=8, n_layer=2, n_head=2, n_positions=64,
                       bos_token_id=8, eos_token_id=8, pad_token_id=7)  # fmt: skip
    torch.manual_seed(0)
    return GPT2LMHeadModel(shape), words


def trained(scratch: str) -> list[list[float]]:
    """The rewards that GRPO gets in one step."""
    got: list[list[float]] = []

    def lego_bench(completions: Any, image_id: Any, **columns: Any) -> Any:
        got.append(rewards.lego_bench_reward(completions, image_id, **columns))
        return got[-1]

    network, words = tiny()
    data = Dataset.from_list([{"prompt": "import bpy", "image_id": 1}] * 2)
    settings = GRPOConfig(
        output_dir=scratch, per_device_train_batch_size=2, num_generations=2, max_steps=1,
        max_completion_length=4, report_to=[], use_cpu=True, save_strategy="no", logging_steps=1,
    )  # fmt: skip
    trainer = GRPOTrainer(model=network, reward_funcs=lego_bench, args=settings,
                          train_dataset=data, processing_class=words)  # fmt: skip
    trainer.train()
    logged = [row["reward"] for row in trainer.state.log_history if "reward" in row]
    return [*got, logged]


def main() -> None:
    room, scratch = Path(sys.argv[1]).read_text("utf-8"), sys.argv[2]
    config = OmegaConf.create(
        {"reward": {"custom_reward_function": {"path": rewards.__file__, "name": "compute_score"}}}
    )
    score = get_custom_reward_fn(config)
    assert score is not None
    found = {
        "trl": version("trl"),
        "verl": version("verl"),
        "grpo": trained(scratch),
        "ppo": score("lego-bench", f"```python\n{room}```", "1", None),
    }
    print("\n" + json.dumps(found))


if __name__ == "__main__":
    main()
