"""Instance masks of photos by SAM 3, category by category, for `legoworld baseline run sam3`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from legoworld_baseline import Refused, hugging_face, library_versions, read_photo, serve
from legoworld_baseline.devices import check_dtype_on, device_type
from sam3_options import Options, read_options
from sam3_prompts import prompt_strings

TASKS = ("coco-masks", "lvis")
LIBRARIES = ("huggingface-hub", "numpy", "pycocotools", "tokenizers", "torch", "transformers")


@dataclass(frozen=True, kw_only=True)
class Model:
    """The network, the vocabulary's phrases encoded, and which of them each image is asked.

    prompts: image id to rows of the vocabulary; None asks all of them about every image.
    """

    network: Any
    dtype: str
    text: Any
    category_ids: tuple[int, ...]
    prompts: dict[int, tuple[int, ...]] | None
    options: Options


def load(request: dict[str, Any]) -> tuple[Model, dict[str, Any]]:
    """The network and the phrases, and what the masks depend on. Refused when not as asked."""
    if request["task"] not in TASKS:
        raise Refused(
            "SAM 3 predicts masks only",
            found=f"task {request['task']}",
            expected=" or ".join(f"task {task}" for task in TASKS),
        )
    options = read_options(request["options"])
    category_ids = tuple(c["id"] for c in request["categories"])
    prompts = _prompts(request, category_ids)
    phrases = prompt_strings([c["name"] for c in request["categories"]], options.prompt_names)
    files = hugging_face.resolve(request["weights"], offline=request["offline"])

    from sam3_loading import load_network, load_tokenizer, preprocessing
    from sam3_network import computing_in, text_features

    check_dtype_on(request["dtype"], request["device"])
    network = load_network(files.folder, request["device"])
    tokenizer = load_tokenizer(files.folder, phrases)
    with computing_in(request["dtype"], network):
        text = text_features(network, tokenizer, phrases, options.prompts_at_once)
    model = Model(
        network=network,
        dtype=request["dtype"],
        text=text,
        category_ids=category_ids,
        prompts=prompts,
        options=options,
    )
    provenance = {
        **files.provenance(),
        "libraries": library_versions(LIBRARIES),
        "device": device_type(request["device"]),
        "dtype": request["dtype"],
        "precision": "float32"
        if request["dtype"] == "float32"
        else "weights in float32, the network under autocast",
        "preprocessing": preprocessing(network),
        "masks": "logits resized to the photo (bilinear, float32), then > 0",
        "score": "sigmoid(logit) * sigmoid(presence)",
        "prompts": {
            "asked": "all" if prompts is None else "per_image",
            "names": options.prompt_names,
            "strings": dict(zip(map(str, category_ids), phrases, strict=True)),
        },
        "threshold": options.limits.min_score,
        "cap": {
            "per_category": options.limits.per_category,
            "per_image": options.limits.per_image,
            "order": ["score, highest first", "category id", "query of the network"],
        },
        "prompts_at_once": options.prompts_at_once,
        "seed": None,
    }
    return model, provenance


def predict(model: Model, image: dict[str, Any]) -> dict[str, Any]:
    """One photo's masks. The photo is encoded once, whatever the number of phrases."""
    from sam3_network import answers, computing_in, image_features
    from sam3_selection import Selection

    image_id, size_wh = image["image_id"], (image["width"], image["height"])
    photo = read_photo(image["path"], *size_wh)
    rows = range(len(model.category_ids)) if model.prompts is None else model.prompts[image_id]
    selection = Selection(model.options.limits)
    if rows:
        at_once = model.options.prompts_at_once
        with computing_in(model.dtype, model.network):
            encoded = image_features(model.network, photo)
            for asked, said in answers(model.network, encoded, model.text, rows, at_once):
                selection.add([model.category_ids[row] for row in asked], said)
    predictions = selection.predictions(image_id, size_wh)
    return {"predictions": predictions, "counts": {"prompts": len(rows), **selection.counts}}


def _prompts(
    request: dict[str, Any], category_ids: tuple[int, ...]
) -> dict[int, tuple[int, ...]] | None:
    """The request's prompts as rows of the vocabulary, ascending. Refused where one is not."""
    given = request["prompts"]
    if given is None:
        return None
    row_of = {category_id: row for row, category_id in enumerate(category_ids)}
    without = [i["image_id"] for i in request["images"] if str(i["image_id"]) not in given]
    if without:
        raise Refused("images have no prompts", found=f"image {without[0]}, {len(without)} in all")
    unknown = sorted({c for ids in given.values() for c in ids} - row_of.keys())
    if unknown:
        raise Refused(
            "prompts name categories that are not in the vocabulary",
            found=f"category {unknown[0]}, {len(unknown)} in all",
            expected="ids of the track's categories",
        )
    return {
        int(image_id): tuple(sorted({row_of[c] for c in ids})) for image_id, ids in given.items()
    }


if __name__ == "__main__":
    serve(load, predict)
