"""The least a baseline needs, and every way it can go wrong."""

from __future__ import annotations

import contextlib
import os
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
from legoworld_baseline import (
    Refused,
    hash_files,
    match_labels,
    protocol,
    read_photo,
    serve,
    write_depth,
)

print("an import that prints", end="")
Request = dict[str, Any]


def load(request: Request) -> tuple[Request, dict[str, Any]]:
    weights = Path(request["weights"])
    how = request["options"]["how"]
    if how == "refuse":
        raise Refused("the checkpoint is another model's", found="resnet", expected="fake")
    if how == "die_loading":
        sys.exit("no module named nothing")
    if how == "hang_loading":
        time.sleep(600)
    if how in ("chatter", "silent", "twice", "stranger", "huge"):
        say_otherwise(how, request["options"]["at"])
    if how == "die_at_the_end":
        die_instead_of_ending()
    labels = match_labels(request, ["Dog", "cat", "N/A"], every_category=False)
    provenance = {"model": "fake", "weights": hash_files([weights]), "labels": labels}
    return request, provenance


def misbehave(request: Request, image: dict[str, Any]) -> None:
    how, marker = request["options"]["how"], Path(request["weights"]).with_suffix(".crashed")
    time.sleep(request["options"]["sleep_s"])
    if how == "print":
        print('{"image_id": 1, "predictions": []}')
        os.system("echo from a library in C")
    if image["image_id"] != request["options"]["at"]:
        return
    if how == "child":
        note_process(request, subprocess.Popen(["sleep", "600"]).pid)
    if how == "hang":
        note_process(request, os.getpid())
        time.sleep(600)
    if how in ("crash", "child") or (how == "crash_once" and not marker.exists()):
        print("going down", file=sys.stderr, flush=True)
        with contextlib.suppress(OSError):  # the weights' folder is not there to write to
            marker.touch()
        os.kill(os.getpid(), 9)
    if how == "raise":
        raise RuntimeError("out of\nmemory")


def note_process(request: Request, pid: int) -> None:
    with (
        contextlib.suppress(OSError),
        Path(request["weights"]).with_suffix(".pids").open("a") as stream,
    ):
        stream.write(f"{pid}\n")


def predict(request: Request, image: dict[str, Any]) -> dict[str, Any]:
    misbehave(request, image)
    photo = read_photo(image["path"], image["width"], image["height"])
    brightness = photo.mean(axis=2)
    if request["task"] in ("eth3d", "camera"):
        result = write_depth(request, image, (brightness + 1).astype(np.float32), "depth", None)
        if wrong(request, image, "lie"):
            result["depth"]["sha256"] = "0" * 64
        return result | camera(request, image)
    ids = (request["prompts"] or {}).get(str(image["image_id"])) or [
        c["id"] for c in request["categories"]
    ]
    found: list[Any] = [entry(request, image, brightness, ids[k % len(ids)], k) for k in range(3)]
    if wrong(request, image, "surrogate"):
        return {"failed": "\ud800"}
    for how, levels in (("deep", 200), ("too_deep", 100_000)):
        if wrong(request, image, how):
            for _ in range(levels):
                found = [found]
    return {"predictions": found, "counts": {"considered": 3}}


def camera(request: Request, image: dict[str, Any]) -> dict[str, Any]:
    """A field of view of 90 degrees; none for a run of depth, which ignores it."""
    if request["task"] != "camera" or wrong(request, image, "no_camera"):
        return {}
    focal, skew = image["width"] / 2, 1.1 if wrong(request, image, "skewed") else 1.0
    said = {"fx": focal * skew, "fy": focal, "cx": focal, "cy": image["height"] / 2}
    return {"camera": {"width": image["width"], "height": image["height"], **said}}


def entry(
    request: Request, image: dict[str, Any], brightness: Any, category_id: int, k: int
) -> dict[str, Any]:
    x, y = int(brightness.argmax(axis=1)[k]), k
    w, h = min(10 + k, image["width"] - x), 20
    made: dict[str, Any] = {
        "image_id": image["image_id"],
        "category_id": 999 if wrong(request, image, "category") else category_id,
        "score": float("nan") if wrong(request, image, "nan") else round(0.9 - k / 10, 3),
    }
    if request["task"] == "coco":
        made["bbox"] = [x + 0.25, y + 0.5, -5.0 if wrong(request, image, "extent") else w, h]
    else:
        size = [image["height"], image["width"]]
        start = x * size[0] + y
        made["segmentation"] = {"size": size, "counts": [start, h, size[0] * size[1] - start - h]}
    return made


def wrong(request: Request, image: dict[str, Any], how: str) -> bool:
    options = request["options"]
    return bool(options["how"] == how and image["image_id"] == options["at"])


def say_otherwise(how: str, at: int) -> None:
    """Lines that `serve` does not say, or not when it does."""
    say = protocol._say

    def otherwise(channel: Any, line: dict[str, Any]) -> None:
        if how == "silent" and "working_on" in line:
            time.sleep(600)
        while how == "chatter" and line.get("working_on") == [at]:
            say(channel, line)
            time.sleep(0.01)
        if how == "stranger" and line.get("image_id") == at:
            line = {**line, "image_id": 99}
        if how == "huge" and line.get("image_id") == at:
            channel.write(f'{{"image_id": {at}, "predictions": [{"9" * 5000}]}}\n')
            return channel.flush()
        for _ in range(2 if how == "twice" and line.get("image_id") == at else 1):
            say(channel, line)
        return None

    protocol._say = otherwise


def die_instead_of_ending() -> None:
    """The process is killed between its last answer and its last line."""
    say = protocol._say

    def say_or_die(channel: Any, line: dict[str, Any]) -> None:
        if "done" in line:
            os.kill(os.getpid(), 9)
        say(channel, line)

    protocol._say = say_or_die


if __name__ == "__main__":
    serve(load, predict)
