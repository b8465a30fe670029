"""Zero-shot detectors: the vocabulary as prompts, held to transformers' own pipeline."""

from __future__ import annotations

import json

import numpy as np
import pytest
from baseline_programs.child import ask, defaults, importable, program, request
from PIL import Image

torch = pytest.importorskip("torch")
transformers = pytest.importorskip("transformers")
importable("hf-zero-shot")

import zero_shot_prompts  # noqa: E402
import zero_shot_selection  # noqa: E402
from legoworld_baseline import Refused  # noqa: E402
from zero_shot_networks import Pass, load_config, load_model  # noqa: E402

NAMES = ["cat", "traffic_light", "dog"]
CATEGORIES = [{"id": 10 * n, "name": name} for n, name in enumerate(NAMES, start=1)]
SIZE_WH = (53, 40)


def clip_tokenizer(folder):
    """Every printable character is a token of its own, as a byte-level tokenizer without merges."""
    characters = [chr(c) for c in range(33, 127)]
    tokens = ["!", *[c for c in characters if c != "!"], *[f"{c}</w>" for c in characters]]
    vocabulary = {t: n for n, t in enumerate([*tokens, "<|startoftext|>", "<|endoftext|>"])}
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "vocab.json").write_text(json.dumps(vocabulary))
    (folder / "merges.txt").write_text("#version: 0.2\n")
    return transformers.CLIPTokenizer.from_pretrained(folder, pad_token="!")


def owl(kind, folder):
    config, network, processor = {
        "owlvit": (
            transformers.OwlViTConfig,
            transformers.OwlViTForObjectDetection,
            transformers.OwlViTImageProcessorPil,
        ),
        "owlv2": (
            transformers.Owlv2Config,
            transformers.Owlv2ForObjectDetection,
            transformers.Owlv2ImageProcessorPil,
        ),
    }[kind]
    tokenizer = clip_tokenizer(folder / "text")
    part = {"hidden_size": 32, "intermediate_size": 32, "num_hidden_layers": 2}
    settings = config(
        text_config={
            **part,
            "num_attention_heads": 2,
            "vocab_size": len(tokenizer),
            "max_position_embeddings": 64,
            "eos_token_id": tokenizer.eos_token_id,
        },
        vision_config={**part, "num_attention_heads": 2, "image_size": 32, "patch_size": 8},
        projection_dim=32,
    )
    torch.manual_seed(0)
    return network(settings), processor(size={"height": 32, "width": 32}), tokenizer


def bert_tokenizer(folder):
    """The separators stand at BERT's own ids: Grounding DINO's masks are cut there."""
    words = ["cat", "traffic", "light", "dog", "a", "photo", "of", *"abcdefghijklmnopqrstuvwxyz"]
    words += [f"##{c}" for c in "abcdefghijklmnopqrstuvwxyz"]
    tokens = [f"[unused{n}]" for n in range(1100)]
    for place, token in {0: "[PAD]", 100: "[UNK]", 101: "[CLS]", 102: "[SEP]"}.items():
        tokens[place] = token
    tokens[1012], tokens[1029] = ".", "?"
    tokens[200 : 200 + len(words)] = words
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "vocab.txt").write_text("\n".join(dict.fromkeys(tokens)) + "\n")
    return transformers.BertTokenizer.from_pretrained(folder)


def grounding_dino(folder):
    tokenizer = bert_tokenizer(folder / "text")
    swin = transformers.SwinConfig(
        image_size=64,
        embed_dim=8,
        depths=[1, 1, 1, 1],
        num_heads=[1, 1, 2, 2],
        window_size=4,
        out_features=["stage2", "stage3", "stage4"],
    )
    text = transformers.BertConfig(
        vocab_size=1100,
        hidden_size=32,
        num_hidden_layers=1,
        num_attention_heads=2,
        intermediate_size=32,
    )
    config = transformers.GroundingDinoConfig(
        backbone_config=swin,
        text_config=text,
        d_model=32,
        encoder_layers=1,
        decoder_layers=2,
        encoder_attention_heads=2,
        decoder_attention_heads=2,
        encoder_ffn_dim=32,
        decoder_ffn_dim=32,
        num_queries=20,
        disable_custom_kernels=True,
    )
    torch.manual_seed(0)
    network = transformers.GroundingDinoForObjectDetection(config)
    size = {"shortest_edge": 64, "longest_edge": 128}
    return network, transformers.GroundingDinoImageProcessorPil(size=size), tokenizer


BUILD = {
    "owlvit": lambda folder: owl("owlvit", folder),
    "owlv2": lambda folder: owl("owlv2", folder),
    "grounding-dino": grounding_dino,
}


@pytest.fixture(scope="module")
def folder_of(tmp_path_factory):
    """A kind's folder on disk, as save_pretrained writes it; made once."""
    made = {}

    def folder(kind):
        if kind not in made:
            made[kind] = tmp_path_factory.mktemp("models") / f"tiny-{kind}"
            for part in BUILD[kind](made[kind]):
                part.save_pretrained(made[kind])
        return made[kind]

    return folder


@pytest.fixture(scope="module")
def photo(tmp_path_factory):
    path = tmp_path_factory.mktemp("photos") / "photo.png"
    rgb = np.random.default_rng(0).integers(0, 256, (SIZE_WH[1], SIZE_WH[0], 3))
    Image.fromarray(rgb.astype(np.uint8)).save(path)
    return path


def zero_shot_request(folder, photo, categories=CATEGORIES, **options):
    options = {**defaults("hf-zero-shot"), **options}
    return request("coco", folder, "unused", [photo], categories=categories, options=options)


def answered(asked):
    run = program("hf-zero-shot")
    loaded, provenance = run.load(asked)
    return provenance, run.predict(loaded, asked["images"][0])


def pipeline_says(folder, photo, prompts):
    """(score, prompt, box as whole numbers), best first, of transformers' own pipeline."""
    pipeline = transformers.pipeline(
        "zero-shot-object-detection",
        model=transformers.AutoModelForZeroShotObjectDetection.from_pretrained(folder),
        image_processor=transformers.AutoImageProcessor.from_pretrained(folder, backend="pil"),
        tokenizer=transformers.AutoTokenizer.from_pretrained(folder),
        device="cpu",
    )
    said = pipeline(str(photo), candidate_labels=prompts, threshold=0.0)
    return [(s["score"], s["label"], list(s["box"].values())) for s in said]


@pytest.mark.parametrize(
    ("kind", "options", "template"),
    [
        ("owlvit", {}, "a photo of a {}"),
        ("owlv2", {}, "a photo of a {}"),
        ("owlv2", {"template": "{}"}, "{}"),
        ("grounding-dino", {"caption": "single"}, "{}"),
    ],
)
def test_scores_and_boxes_are_those_of_the_pipeline(folder_of, photo, kind, options, template):
    folder = folder_of(kind)
    provenance, answer = answered(zero_shot_request(folder, photo, **options))
    prompts = [template.replace("{}", name.replace("_", " ")) for name in NAMES]
    assert provenance["prompts"]["strings"] == dict(zip(["10", "20", "30"], prompts, strict=True))
    expected = pipeline_says(folder, photo, prompts)
    found = answer["predictions"]
    assert len(found) == min(len(expected), 300) > 40
    by_id = {10 * n: prompt for n, prompt in enumerate(prompts, start=1)}
    rows = []
    for entry in found:
        x, y, w, h = entry["bbox"]
        corners = [x, y, x + w, y + h]
        rows.append((entry["score"], by_id[entry["category_id"]], corners))
    for (score, prompt, corners), (p_score, p_prompt, p_box) in zip(
        sorted(rows, key=lambda r: (r[1], -r[0])),
        sorted(expected, key=lambda r: (r[1], -r[0])),
        strict=True,
    ):
        assert prompt == p_prompt
        assert score == pytest.approx(p_score, rel=2e-5)
        assert corners == pytest.approx(p_box, abs=1.001)  # the pipeline cuts boxes to integers
    assert len({prompt for _, prompt, _ in rows}) == 3
    assert [entry["score"] for entry in found] == sorted((r[0] for r in rows), reverse=True)


def test_one_caption_is_a_plain_loop_over_tokens(folder_of, photo):
    folder = folder_of("grounding-dino")
    _, answer = answered(zero_shot_request(folder, photo))
    network = transformers.AutoModelForZeroShotObjectDetection.from_pretrained(folder).eval()
    tokenizer = transformers.AutoTokenizer.from_pretrained(folder)
    processor = transformers.AutoImageProcessor.from_pretrained(folder, backend="pil")
    text = tokenizer("cat. traffic light. dog.", return_tensors="pt")
    tokens = tokenizer.convert_ids_to_tokens(text["input_ids"][0].tolist())
    assert tokens == ["[CLS]", "cat", ".", "traffic", "light", ".", "dog", ".", "[SEP]"]
    with Image.open(photo) as picture, torch.inference_mode():
        out = network(**text, **processor(images=picture, return_tensors="pt"))
    shares = out.logits[0].sigmoid()
    expected = []
    for query in range(20):
        for category_id, places in ((10, [1]), (20, [3, 4]), (30, [6])):
            score = sum(shares[query, place].item() for place in places) / len(places)
            expected.append((score, category_id, query))
    expected.sort(key=lambda e: (-e[0], e[1], e[2]))
    found = answer["predictions"]
    assert [e["category_id"] for e in found] == [e[1] for e in expected]
    assert [e["score"] for e in found] == pytest.approx([e[0] for e in expected], rel=1e-5)
    for entry, (_, _, query) in zip(found, expected, strict=True):
        cx, cy, w, h = out.pred_boxes[0, query].tolist()
        box = [(cx - w / 2) * SIZE_WH[0], (cy - h / 2) * SIZE_WH[1], w * SIZE_WH[0], h * SIZE_WH[1]]
        assert entry["bbox"] == pytest.approx(box, abs=1e-3)


def test_captions_hold_what_fits():
    found = list(zero_shot_prompts.captions(["Cat", "Traffic Light", "dog"], [1, 2, 1], 8))
    assert [(c.text, c.columns) for c in found] == [
        ("cat. traffic light.", (0, 1)),
        ("dog.", (2,)),
    ]
    assert [[c.text[b:e] for b, e in c.spans] for c in found] == [["cat", "traffic light"], ["dog"]]


def test_a_long_vocabulary_is_asked_in_several_captions(folder_of, photo):
    categories = [{"id": n, "name": f"{'cat ' * 30}{chr(96 + n)}"} for n in range(1, 20)]
    asked = [c["name"] for c in categories]
    model = load_model(
        folder_of("grounding-dino"), asked, device="cpu", dtype="float32", caption="joint"
    )
    assert [len(q.columns) for q in model.questions] == [7, 7, 5]
    provenance, answer = answered(zero_shot_request(folder_of("grounding-dino"), photo, categories))
    assert provenance["prompts"]["passes_per_photo"] == 3
    assert answer["counts"]["candidates"] == 20 * 19


def test_the_cut_is_a_plain_sort():
    generator = np.random.default_rng(1)
    scores = generator.integers(0, 5, (6, 3)).astype(np.float32) / 4
    boxes = generator.random((6, 4)).astype(np.float32)
    passes = [
        Pass(columns=(0, 1, 2), scores=scores, boxes_xyxy_px=boxes),
        Pass(columns=(3,), scores=scores[:, :1], boxes_xyxy_px=boxes + 1),
    ]
    ids = [30, 10, 20, 40]
    found, counts = zero_shot_selection.results(passes, ids, 5, per_image=9, min_score=0.5)
    everything = [(-float(scores[q, c]), ids[c], q, 0) for q in range(6) for c in range(3)] + [
        (-float(scores[q, 0]), 40, q, 1) for q in range(6)
    ]
    kept = sorted(e for e in everything if -e[0] >= 0.5)
    assert [(-e["score"], e["category_id"]) for e in found] == [e[:2] for e in kept[:9]]
    for entry, (_, _, query, add) in zip(found, kept, strict=False):
        x0, y0, x1, y1 = (boxes[query] + np.float32(add)).astype(float)
        assert entry["bbox"] == pytest.approx([x0, y0, x1 - x0, y1 - y0])
    assert counts == {
        "candidates": 24,
        "below_score": 24 - len(kept),
        "cut_image": len(kept) - 9,
    }


def test_end_to_end(folder_of, photo, tmp_path):
    asked = zero_shot_request(folder_of("owlv2"), photo)
    said = ask("hf-zero-shot", asked)
    _, here = answered(asked)
    assert said.results[1]["predictions"] == here["predictions"]
    assert said.provenance["preprocessing"]["class"] == "Owlv2ImageProcessorPil"
    assert said.provenance["network"] == "Owlv2ForObjectDetection"


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"template": "a photo"}, "no placeholder for the name"),
        ({"template": "{} " * 2}, "no placeholder for the name"),
        ({"template": "text " * 16 + "{}"}, "exceed the text encoder"),
        ({"per_image": 0}, "out of range"),
    ],
)
def test_prompts_that_are_refused(folder_of, photo, options, words):
    with pytest.raises(Refused, match=words) as refusal:
        program("hf-zero-shot").load(zero_shot_request(folder_of("owlvit"), photo, **options))
    assert all(refusal.value.reason.values())


def test_another_kind_of_model_is_sent_where_it_belongs(tmp_path):
    (tmp_path / "config.json").write_text(json.dumps({"model_type": "detr"}))
    with pytest.raises(Refused, match="zero-shot detector is not supported") as refusal:
        load_config(tmp_path)
    assert "hf-detector" in refusal.value.reason["next_step"]
