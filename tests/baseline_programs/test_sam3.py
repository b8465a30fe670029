"""SAM 3: phrases, one encoding for many of them, cuts, masks, and the process end to end."""

from __future__ import annotations

import json
import shutil

import numpy as np
import pytest
from baseline_programs.child import (
    ROOT,
    ask_here,
    defaults,
    importable,
    program,
    refusal,
    request,
    resized_by_hand,
)
from PIL import Image

torch = pytest.importorskip("torch")
transformers = pytest.importorskip("transformers")
coco_mask = pytest.importorskip("pycocotools.mask")
importable("sam3")

import sam3_loading  # noqa: E402
import sam3_network  # noqa: E402
import sam3_selection  # noqa: E402
from baseline_programs.tiny_sam3 import QUERIES, SIDE, save_tiny  # noqa: E402
from legoworld_baseline import Refused  # noqa: E402
from sam3_options import Limits  # noqa: E402
from sam3_prompts import prompt_strings  # noqa: E402

CATEGORIES = [
    {"id": 3, "name": "car_(automobile)"},
    {"id": 7, "name": "bow_(weapon)"},
    {"id": 8, "name": "bow_(decorative_ribbons)"},
    {"id": 20, "name": "sofa"},
    {"id": 21, "name": "cat"},
]
PHRASES = ["car", "bow (weapon)", "bow (decorative ribbons)", "sofa", "cat"]


@pytest.fixture(scope="module")
def checkpoint(tmp_path_factory):
    """A checkpoint in the image model's own layout."""
    return save_tiny(tmp_path_factory.mktemp("sam3") / "tiny")


@pytest.fixture(scope="module")
def network(checkpoint):
    return transformers.Sam3Model.from_pretrained(checkpoint).eval()


@pytest.fixture(scope="module")
def tokenizer(checkpoint):
    return transformers.CLIPTokenizer.from_pretrained(checkpoint)


@pytest.fixture(scope="module")
def photo(tmp_path_factory):
    path = tmp_path_factory.mktemp("photos") / "photo.jpg"
    Image.open(ROOT / "examples/astronaut/final.png").convert("RGB").save(path)
    return path


@pytest.fixture(scope="module")
def everything(checkpoint, tmp_path_factory, photo):
    """What is said when every category is asked for; the process is baselines/test_by_name's."""
    return ask_here("sam3", lvis_request(checkpoint, tmp_path_factory.mktemp("run"), [photo]))


def pixels(width=60, height=40, seed=0):
    return np.random.default_rng(seed).integers(0, 256, (height, width, 3), np.uint8)


def lvis_request(checkpoint, output, photos, options=None, prompts=None):
    return request(
        "lvis",
        checkpoint,
        output,
        photos,
        categories=CATEGORIES,
        options={**defaults("sam3"), **(options or {})},
        prompts=prompts,
    )


# Phrases


def test_bare_names_keep_their_parenthesis_where_two_would_be_one():
    assert prompt_strings([c["name"] for c in CATEGORIES], "bare") == PHRASES


def test_qualified_names_keep_every_parenthesis():
    names = ["car_(automobile)", "first-aid_kit"]
    assert prompt_strings(names, "qualified") == ["car (automobile)", "first-aid kit"]


def test_every_lvis_category_has_a_phrase_of_its_own():
    path = ROOT / "datasets/lvis/categories.json"
    names = [c["name"] for c in json.loads(path.read_text(encoding="utf-8"))]
    phrases = prompt_strings(names, "bare")
    assert len({p.casefold() for p in phrases}) == len(names) == 1203
    assert {p for p in phrases if "(" in p} == {
        "bow (weapon)",
        "bow (decorative ribbons)",
        "fish (food)",
        "octopus (food)",
        "octopus (animal)",
        "pan (for cooking)",
        "pan (metal container)",
        "salmon (fish)",
        "salmon (food)",
    }
    assert "monitor" in phrases  # "monitor_(computer_equipment) computer_monitor"


# The network


def test_a_photo_is_resized_like_pillow_does_it():
    photo = pixels(200, 90)
    found = sam3_network.pixel_values(photo, SIDE)[0].permute(1, 2, 0).numpy()
    picture = Image.fromarray(photo).resize((SIDE, SIDE), Image.Resampling.BILINEAR)
    expected = (np.asarray(picture, np.float32) / 255 - 0.5) / 0.5
    assert np.abs(found - expected).max() <= 2 / 255 + 1e-6  # one level of 255, twice as wide


@pytest.mark.parametrize("at_once", [1, 2, 5])
def test_encoding_once_gives_what_asking_one_by_one_gives(network, tokenizer, at_once):
    photo = pixels()
    text = sam3_network.text_features(network, tokenizer, PHRASES, at_once)
    image = sam3_network.image_features(network, photo)
    said = list(sam3_network.answers(network, image, text, range(5), at_once))
    assert [row for rows, _ in said for row in rows] == [0, 1, 2, 3, 4]
    scores = torch.cat([a.scores for _, a in said])
    mask_logits = torch.cat([a.mask_logits for _, a in said])
    values = sam3_network.pixel_values(photo, SIDE)
    for row, phrase in enumerate(PHRASES):
        encoded = tokenizer([phrase], padding="max_length", max_length=32, return_tensors="pt")
        with torch.inference_mode():
            out = network(pixel_values=values, **encoded)
        expected = (out.pred_logits.sigmoid() * out.presence_logits.sigmoid())[0]
        assert torch.allclose(scores[row], expected, atol=1e-6)
        assert torch.allclose(mask_logits[row], out.pred_masks[0], atol=1e-4)
    assert (scores[0] - scores[3]).abs().max() > 1e-3  # the phrases do make a difference


# Cuts and masks


def brute_force(scores, category_ids, limits):
    everything = [
        (-scores[row, query], category_ids[row], query)
        for row in range(scores.shape[0])
        for query in range(scores.shape[1])
        if scores[row, query] >= limits.min_score
    ]
    kept = []
    for category_id in category_ids:
        own = sorted(entry for entry in everything if entry[1] == category_id)
        kept += own[: limits.per_category]
    return sorted(kept)[: limits.per_image]


@pytest.mark.parametrize("per_category", [2, 50])
@pytest.mark.parametrize("per_image", [5, 30, 1000])
@pytest.mark.parametrize("min_score", [0.0, 0.4])
def test_cuts_made_phrase_after_phrase_are_the_cut_over_everything(
    per_category, per_image, min_score
):
    generator = np.random.default_rng(3)
    scores = (generator.integers(0, 8, (12, 9)) / 8).astype(np.float32)  # many ties
    category_ids = [int(x) for x in generator.permutation(100)[:12]]
    limits = Limits(min_score=min_score, per_category=per_category, per_image=per_image)
    selection = sam3_selection.Selection(limits)
    for start in range(0, 12, 5):
        part = torch.from_numpy(scores[start : start + 5])
        marks = torch.arange(start * 9, start * 9 + part.numel()).reshape(*part.shape, 1, 1)
        answers = sam3_network.Answers(scores=part, mask_logits=marks.float())
        selection.add(category_ids[start : start + 5], answers)
    kept = selection.kept
    expected = brute_force(scores, category_ids, limits)
    found = list(zip(-kept.scores, kept.category_ids, kept.queries, strict=True))
    assert found == expected
    rows = [category_ids.index(category_id) for _, category_id, _ in expected]
    own = [row * 9 + query for row, (_, _, query) in zip(rows, expected, strict=True)]
    assert [mask.item() for mask in kept.mask_logits] == own  # every mask went with its score
    counts = selection.counts
    cut = counts["below_score"] + counts["cut_category"] + counts["cut_image"]
    assert counts["candidates"] == 108
    assert 108 - cut == len(expected)


class Counted:
    """Mask logits that count how many masks are taken out of them."""

    def __init__(self, mask_logits):
        self.mask_logits = mask_logits
        self.taken = 0

    def __getitem__(self, place):
        taken = self.mask_logits[place]
        self.taken += taken.numel() // self.mask_logits[0, 0].numel()
        return taken


def test_only_masks_that_pass_the_cut_are_copied():
    """1,203 phrases have 240,600 candidates; gathering them all took minutes a photo."""
    generator = np.random.default_rng(5)
    selection = sam3_selection.Selection(Limits(min_score=0.0, per_category=9, per_image=3))
    for category_id in range(20):
        scores = torch.from_numpy(generator.random((1, 9)).astype(np.float32))
        before = selection.kept.scores if selection.kept else np.empty(0, np.float32)
        masks = Counted(torch.zeros(1, 9, 4, 4))
        selection.add([category_id], sam3_network.Answers(scores=scores, mask_logits=masks))
        stayed = np.isin(selection.kept.scores, before).sum()
        assert masks.taken == len(selection.kept) - stayed
        assert all(m.untyped_storage().nbytes() == 64 for m in selection.kept.mask_logits)


def test_a_score_that_is_not_a_number_fails_the_image():
    answers = sam3_network.Answers(
        scores=torch.tensor([[0.5, float("nan")]]), mask_logits=torch.zeros(1, 2, 4, 4)
    )
    limits = Limits(min_score=0.0, per_category=2, per_image=2)
    with pytest.raises(ValueError, match="not finite"):
        sam3_selection.Selection(limits).add([1], answers)


def test_masks_and_their_run_lengths_are_those_of_a_plain_loop():
    generator = np.random.default_rng(4)
    logits = generator.normal(size=(19, 8, 8)).astype(np.float32)
    logits[5] = -1.0  # a mask without a pixel
    answers = sam3_network.Answers(
        scores=torch.linspace(0.9, 0.1, 19)[None], mask_logits=torch.from_numpy(logits)[None]
    )
    selection = sam3_selection.Selection(Limits(min_score=0.0, per_category=19, per_image=19))
    selection.add([4], answers)
    entries = selection.predictions(11, (23, 14))
    assert selection.counts["empty"] == 1
    assert len(entries) == 18
    for number, entry in zip([n for n in range(19) if n != 5], entries, strict=True):
        assert (entry["image_id"], entry["category_id"]) == (11, 4)
        assert entry["score"] == float(answers.scores[0, number])
        assert entry["segmentation"]["size"] == [14, 23]
        assert isinstance(entry["segmentation"]["counts"], str)
        by_hand = resized_by_hand(logits[number].astype(np.float64), 14, 23)
        sure = np.abs(by_hand) > 1e-5
        mask = coco_mask.decode(entry["segmentation"]).astype(bool)
        assert np.array_equal(mask[sure], (by_hand > 0)[sure])
        assert sure.mean() > 0.99


# The process


def check(said, photo, n_kept):
    result = said.results[1]
    predictions, counts = result["predictions"], result["counts"]
    assert counts["prompts"] == 5
    assert counts["candidates"] == 5 * QUERIES
    assert counts["cut_image"] == 5 * QUERIES - n_kept
    assert len(predictions) == n_kept - counts["empty"] > 0
    scores = [p["score"] for p in predictions]
    assert scores == sorted(scores, reverse=True)
    with Image.open(photo) as picture:
        size_hw = [picture.height, picture.width]
    for entry in predictions:
        assert entry.keys() == {"image_id", "category_id", "segmentation", "score"}
        assert entry["category_id"] in {c["id"] for c in CATEGORIES}
        assert entry["segmentation"]["size"] == size_hw
        assert coco_mask.area(entry["segmentation"]) > 0


def test_end_to_end(everything, photo):
    check(everything, photo, 5 * QUERIES)
    provenance = everything.provenance
    assert provenance["prompts"]["asked"] == "all"
    assert provenance["prompts"]["strings"]["8"] == "bow (decorative ribbons)"
    assert provenance["cap"]["per_image"] == 300
    assert [f["name"] for f in provenance["weight_files"]] == ["model.safetensors"]
    assert provenance["libraries"]["torch"] == torch.__version__


@pytest.mark.real_data
def test_end_to_end_on_a_real_photo(checkpoint, tmp_path, real_data):
    photo = real_data / "coco/val2017/000000000139.jpg"
    options = {"per_image": 12, "prompts_at_once": 2}
    check(ask_here("sam3", lvis_request(checkpoint, tmp_path, [photo], options)), photo, 12)


def test_coco_masks_are_the_same_masks(everything, checkpoint, tmp_path, photo):
    run = program("sam3")
    asked = {**lvis_request(checkpoint, tmp_path, [photo]), "task": "coco-masks"}
    model, _ = run.load(asked)
    found = run.predict(model, asked["images"][0])["predictions"]
    assert found == everything.results[1]["predictions"]


def test_half_precision_is_autocast_over_float32_weights(checkpoint, tmp_path, photo):
    run = program("sam3")
    found = {}
    for dtype in ("float32", "bfloat16"):
        asked = {**lvis_request(checkpoint, tmp_path, [photo]), "dtype": dtype}
        model, provenance = run.load(asked)
        assert provenance["dtype"] == dtype
        assert ("autocast" in provenance["precision"]) == (dtype == "bfloat16")
        assert {p.dtype for p in model.network.parameters()} == {torch.float32}
        found[dtype] = [p["score"] for p in run.predict(model, asked["images"][0])["predictions"]]
    assert found["float32"] != found["bfloat16"]
    n = min(map(len, found.values()))
    assert n > 10
    assert np.allclose(found["float32"][:n], found["bfloat16"][:n], atol=0.02)


def test_prompts_of_an_image_give_the_same_masks_for_their_categories(
    everything, checkpoint, tmp_path, photo
):
    prompts = {"1": [20, 3], "2": []}
    some = ask_here("sam3", lvis_request(checkpoint, tmp_path, [photo, photo], prompts=prompts))
    assert some.provenance["prompts"]["asked"] == "per_image"
    assert some.results[1]["counts"]["prompts"] == 2
    assert some.results[2]["predictions"] == []
    found = some.results[1]["predictions"]
    own = [p for p in everything.results[1]["predictions"] if p["category_id"] in (3, 20)]
    assert len(found) == len(own) > 0
    for one, other in zip(found, own, strict=True):
        assert one["category_id"] == other["category_id"]
        assert one["score"] == pytest.approx(other["score"], abs=1e-6)
        overlap = coco_mask.iou([one["segmentation"]], [other["segmentation"]], [0])
        assert overlap[0, 0] > 0.999


def test_the_published_layout_gives_the_same_masks(everything, checkpoint, tmp_path, photo):
    """facebook/sam3 is the video model: its detector's keys and settings sit one level down."""
    folder = change_checkpoint(checkpoint, tmp_path, detector_of_video)
    config = json.loads((checkpoint / "config.json").read_text())
    outer = {"model_type": "sam3_video", "architectures": ["Sam3VideoModel"]}
    (folder / "config.json").write_text(json.dumps({**outer, "detector_config": config}))
    said = ask_here("sam3", lvis_request(folder, tmp_path, [photo]))
    assert said.results[1]["predictions"] == everything.results[1]["predictions"]


# Refusals


def detector_of_video(weights):
    inner = {f"detector_model.{key}": value for key, value in weights.items()}
    return {**inner, "tracker_model.something": torch.zeros(2)}


def without_a_projection(weights):
    return {k: v for k, v in weights.items() if k != "text_projection.weight"}


def change_checkpoint(checkpoint, tmp_path, change):
    """A copy of the checkpoint with other weights."""
    from safetensors.torch import load_file, save_file

    folder = tmp_path / "changed"
    shutil.copytree(checkpoint, folder)
    weights = change(load_file(checkpoint / "model.safetensors"))
    save_file(weights, folder / "model.safetensors", metadata={"format": "pt"})
    return folder


def test_a_checkpoint_with_a_missing_parameter_is_refused(checkpoint, tmp_path, photo):
    folder = change_checkpoint(checkpoint, tmp_path, without_a_projection)
    words = refusal("sam3", lvis_request(folder, tmp_path, [photo]))
    assert "text_projection.weight" in words["found"]


@pytest.mark.parametrize(
    ("file", "content", "found"),
    [
        ("config.json", {"model_type": "sam2"}, "sam2"),
        ("preprocessor_config.json", {"image_mean": [0.485, 0.456, 0.406]}, "0.485"),
        ("processor_config.json", {"image_processor": {"size": {"height": 64}}}, "64"),
    ],
)
def test_another_model_or_preprocessing_is_refused(checkpoint, tmp_path, file, content, found):
    folder = tmp_path / "other"
    shutil.copytree(checkpoint, folder)
    (folder / file).write_text(json.dumps(content))
    with pytest.raises(Refused) as caught:
        sam3_loading.load_network(folder, "cpu")
    assert found in caught.value.reason["found"]


def test_names_longer_than_the_text_encoder_reads_are_refused(checkpoint):
    name = "a name of clearly more than thirty tokens"
    with pytest.raises(Refused, match="exceed the text encoder"):
        sam3_loading.load_tokenizer(checkpoint, ["cat", name])


@pytest.mark.parametrize(
    ("more", "found"),
    [
        ({"prompts": {"1": [999]}}, "category 999"),
        ({"prompts": {"2": [3]}}, "image 1"),
        ({"task": "coco"}, "task coco"),
        ({"options": {**defaults("sam3"), "per_image": 0}}, "per_image=0"),
        ({"options": {**defaults("sam3"), "min_score": 1.5}}, "min_score=1.5"),
    ],
)
def test_what_was_asked_wrongly_is_refused(checkpoint, tmp_path, photo, more, found):
    asked = {**lvis_request(checkpoint, tmp_path, [photo]), **more}
    assert found in refusal("sam3", asked)["found"]
