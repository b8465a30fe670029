"""The baseline of one's own in docs/baselines.md, run as it is printed there."""

from __future__ import annotations

import re
import textwrap

import pytest
from baseline_programs.child import ROOT, ask, some_photo
from PIL import Image

torch = pytest.importorskip("torch")


class TwoBoxes(torch.nn.Module):
    """A person over the left half of the photo, and a car that is not worth showing."""

    def forward(self, photo: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
        height, width = photo.shape[1], photo.shape[2]
        boxes = torch.tensor([[0.0, 0.0, width / 2.0, float(height)], [3.0, 4.0, 10.0, 12.0]])
        return boxes, torch.tensor([0.5, 0.01]), torch.tensor([0, 1])


def indented_block(first: str) -> str:
    """The page's indented block that begins with a text."""
    page = (ROOT / "docs" / "baselines.md").read_text(encoding="utf-8")
    blocks = re.findall(r"(?:^(?: {4}.*)?\n)+", page, re.MULTILINE)
    found = [text for block in blocks if (text := textwrap.dedent(block).strip()).startswith(first)]
    assert len(found) == 1
    return found[0] + "\n"


@pytest.mark.filterwarnings("ignore:.torch.jit.script. is deprecated:DeprecationWarning")
def test_it_runs_as_printed(tmp_path):
    mine = tmp_path / "mine"
    mine.mkdir()
    (mine / "card.toml").write_text(indented_block("schema_version = 1\nname = "))
    (mine / "run.py").write_text(indented_block("from legoworld_baseline import"))
    assert 'name = "mine"' in (mine / "card.toml").read_text()
    torch.jit.script(TwoBoxes()).save(tmp_path / "net.pt")
    photo = some_photo()
    with Image.open(photo) as picture:
        width, height = picture.size
    request = {
        "schema_version": 1,
        "task": "coco",
        "images": [
            {"image_id": 7, "path": str(photo), "width": width, "height": height, "batch": 0}
        ],
        "categories": [{"id": 1, "name": "person"}, {"id": 18, "name": "dog"}],
        "label_map": {},
        "weights": str(tmp_path / "net.pt"),
        "device": "cpu",
        "batch_size": 1,
        "options": {"threshold": 0.05},
    }
    said = ask(mine, request)
    lines = said.lines
    assert said.exit_code == 0, said.log[-2000:]
    assert lines[0]["provenance"]["weights"][0]["name"] == "net.pt"
    box = {"image_id": 7, "category_id": 1, "bbox": [0.0, 0.0, width / 2, height], "score": 0.5}
    assert lines[2] == {"image_id": 7, "predictions": [box]}
    assert lines[3] == {"done": True}
