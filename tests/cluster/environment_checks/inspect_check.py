"""Run by a Python that has inspect_ai: an evaluation of the task, as JSON on the last line.

python inspect_check.py EMPTY_ROOM LOGS; dataset and command: LEGOWORLD_DATASET, LEGOWORLD_COMMAND.
"""

from __future__ import annotations

import json
import sys
from importlib.metadata import entry_points, version
from pathlib import Path
from typing import Any

from inspect_ai import eval as evaluate  # pyright: ignore[reportMissingImports]
from inspect_ai.model import ModelOutput, ModelUsage, get_model  # pyright: ignore[reportMissingImports]


def said(text: str) -> Any:
    """A model's output that says how many tokens it took: nothing is fetched to count them."""
    output = ModelOutput.from_content("mockllm", text)
    output.usage = ModelUsage(input_tokens=1, output_tokens=1, total_tokens=2)
    return output


def main() -> None:
    room, logs = Path(sys.argv[1]).read_text("utf-8"), sys.argv[2]
    answers = [said(f"Here it is.\n```python\n{room}```"), said("I cannot.")]
    model = get_model("mockllm/model", custom_outputs=answers)
    (log,) = evaluate(
        "legoworld/photo_to_blender", model=model, limit=2, max_samples=1, log_dir=logs,
        task_args={"render": False, "tier": "easy"}, display="none",
    )  # fmt: skip
    found = {
        "inspect_ai": version("inspect_ai"),
        "entry_points": [one.value for one in entry_points(group="inspect_ai")],
        "status": log.status,
        "error": str(log.error),
        "metrics": {
            score.name: {name: metric.value for name, metric in score.metrics.items()}
            for score in log.results.scores
        } if log.results else {},
        "samples": [
            {
                "id": sample.id,
                "content": [one.type for one in sample.input[0].content],
                **sample.scores["lego_bench"].value,
                "why": sample.scores["lego_bench"].explanation,
            }
            for sample in log.samples or []
        ],
    }  # fmt: skip
    print("\n" + json.dumps(found))


if __name__ == "__main__":
    main()
