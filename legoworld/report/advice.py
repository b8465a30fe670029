"""What an agent's author should know of one scene: what is wrong, and what to do about it."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Final

from msgspec.structs import replace

from legoworld.evaluation.detection.grid import HALF
from legoworld.evaluation.detection.protocols import detection_protocol
from legoworld.pluralize import plural
from legoworld.records.coco_file import ShownPrediction, TrueAnnotation
from legoworld.records.report_page import Advice, DrawnPrediction
from legoworld.records.run_rows import RunRow
from legoworld.report.detection_images import DetectionImage, SideImage
from legoworld.report.parts import Parts, lone_part, shared_truth_parts
from legoworld.report.shapes import drawn_predictions
from legoworld.report.tried import Gains, Shift, shift_words, try_steps

_ORDER: Final = ("bad", "warn", "note")
#: A pair under this IoU is worth tightening: it loses at half of AP's thresholds and more.
_LOOSE_IOU: Final = 0.75

#: Below it, a truth of another category is a neighbour, not what a prediction stands for.
_NEAR_IOU: Final = 0.3
_OUTLINE: Final = "its box fits, its mask does not: model its outline and holes, and what hides it"
#: Why a prediction is not counted, by its outcome.
_NOT_COUNTED: Final = {
    "unverified": ", in a category that is not annotated in this image",
    "ignored": ", which the evaluator ignores in this image",
    "over_cap": ", beyond the evaluator's cap",
}
#: What became of a labelled object without a pixel, by the readout's word, and what helps.
_UNSEEN: Final = {
    "no_area": "it has no surface: give it a mesh, or label the object that has one",
    "behind_camera": "it is behind the camera: move it, or turn the camera",
    "beyond_clip_end": "it lies outside the camera's clip range: change the clip range",
    "outside_view": "it is outside the picture: move it, or move the camera",
    "sub_pixel": "it covers no pixel centre: enlarge it, or bring it nearer",
    "hidden": "other surfaces cover it: move what stands in front",
    "holdout": "its material is a holdout: give it an ordinary material",
    "not_rendered": "it is not rendered: switch its render visibility on",
}


def sorted_advice(advice: Sequence[Advice]) -> tuple[Advice, ...]:
    """The costly first."""
    return tuple(sorted(advice, key=lambda a: _ORDER.index(a.level)))


def detection_advice(
    task: str,
    image: DetectionImage,
    side: SideImage,
    names: Mapping[int, str],
    shift: Shift | None = None,
    *,
    scene: bool,
) -> tuple[Advice, ...]:
    """Everything to say of one side's answer to a photo; what to do only where it is a scene.

    shift: its predictions with another camera, where that finds more.
    """
    advice = failure_advice(side.run_row)
    if not advice:
        advice += _camera(shift) if shift else []
        advice += _unknown_labels(side.run_row) if scene else []
        parts = shared_truth_parts(task, image, side)
        advice += _advise_missed(task, image, side, names, parts)
        advice += _parts(image, parts, names) + _false(task, image, side, names, parts)
        advice += _loose(task, image, side, names) + _advise_uncounted(side)
        if scene:
            advice += _labels(side.run_row)
    if not scene:
        advice = [replace(a, do="") for a in advice]
    advice += [Advice(level="warn", what=w) for w in side.run_row.warnings]
    return sorted_advice(advice)


def failure_advice(run_row: RunRow) -> list[Advice]:
    """Why there is no output at all; nothing when there is one."""
    if run_row.status == "ok":
        return []
    reason = run_row.reason or "the run gives no reason"
    what, _, do = reason.partition("; next: ")
    return [Advice(level="bad", what=f"no output ({run_row.status}): {what}", do=do)]


def _camera(shift: Shift) -> list[Advice]:
    """All predictions are off by the same pixels, which was tried."""
    what = (
        f"everything is displaced: {shift.n_found} objects are covered instead of "
        f"{shift.n_found_before} once moved {shift_words(shift.right_px, shift.down_px)}"
    )
    return [Advice(level="bad", what=what, do="turn or move the camera by as much")]


def _advise_missed(
    task: str,
    image: DetectionImage,
    side: SideImage,
    names: Mapping[int, str],
    parts: Sequence[Parts],
) -> list[Advice]:
    """Truths that nothing counted is near: covered by what is not counted, or not there at all."""
    covered = {p.truth for p in parts}
    advice: list[Advice] = []
    by_name: dict[str, list[int]] = {}
    for g, (truth, state) in enumerate(zip(image.truths, side.errors.truth, strict=True)):
        cover = side.errors.cover[g]
        if state != "missed" or g in covered:
            continue
        name = names[truth.category_id]
        if cover is None:
            by_name.setdefault(name, []).append(g)
        else:
            iou = side.errors.cover_iou[g] or 0.0
            one = _advise_covered(task, name, side.entries[cover], names, iou)
            advice.append(replace(one, truths=(g,), predictions=(cover,)))
    unlabelled = [u.name for u in side.run_row.unlabelled or ()]
    for name, missed in sorted(by_name.items(), key=lambda x: (-len(x[1]), x[0])):
        alike = [u for u in unlabelled if _alike(name, u)]
        written = [u.label for u in side.run_row.unmatched or () if _alike(name, u.label)]
        if written:
            do = f"the label {_quote_names(written)} is not in the vocabulary: write {name!r}"
        elif alike:
            do = f"{_quote_names(alike)} has no category: if that is it, set category = {name}"
        else:
            do = (
                "build it, or label the object that shows it (`legoworld inspect` lists objects "
                "without category)"
            )
        what = f"missed: {len(missed)} x {name}"
        advice.append(Advice(level="bad", what=what, do=do, truths=tuple(missed)))
    if not side.entries:
        advice.append(
            Advice(
                level="bad",
                what="nothing was exported from this scene",
                do="give objects the custom property `category` with a name of the vocabulary",
            )
        )
    return advice


def _advise_covered(
    task: str, name: str, entry: ShownPrediction, names: Mapping[int, str], iou: float
) -> Advice:
    """A missed truth where a prediction stands that the evaluator does not count."""
    other, why = names[entry.category_id], _NOT_COUNTED.get(entry.outcome_50, "")
    return Advice(
        level="bad",
        what=f"missed: 1 x {name}; {other} covers it (IoU {iou:.2f}){why}",
        do=f"it is built already: if it is a {name}, set {task}_category = {name} on it",
    )


def _parts(image: DetectionImage, parts: Sequence[Parts], names: Mapping[int, str]) -> list[Advice]:
    advice = []
    for p in parts:
        name = names[image.truths[p.truth].category_id]
        what = (
            f"{len(p.predictions)} x {name} are parts of one annotated {name}: together they "
            f"cover it (IoU {p.together_iou:.2f}, the best alone {p.best_iou:.2f})"
        )
        do = "label the whole once: the category on the parts' parent or collection, not on each"
        about = {"truths": (p.truth,), "predictions": tuple(p.predictions)}
        advice.append(Advice(level="bad", what=what, do=do, **about))
    return advice


def _false(
    task: str,
    image: DetectionImage,
    side: SideImage,
    names: Mapping[int, str],
    parts: Sequence[Parts],
) -> list[Advice]:
    """A finding of every false positive that is no part, the same ones together."""
    by_advice: dict[Advice, list[int]] = {}
    about: dict[Advice, list[int]] = {}
    advised = {d for p in parts for d in p.predictions}
    for d, p in enumerate(drawn_predictions(task, image, side)):
        if p.k is None or d in advised:
            continue
        t = p.t
        truth = None if t is None else image.truths[t]
        whole = lone_part(task, image, d, side) if p.k in ("background", "both") else None
        if whole is not None:
            one, t = _part_alone(names[p.c], side.errors.truth[whole]), whole
        else:
            one = _false_one(p, truth, names, _off(task, side.entries[d], p, truth))
            if t is not None and p.k == "localisation":
                one = replace(one, do=_how_to_fit(task, image, side, names, (d, t)))
            elif t is not None and p.k == "classification" and side.errors.truth[t] == "found":
                one = replace(one, do="that object is detected already: remove it or its category")
        by_advice.setdefault(one, []).append(d)
        about.setdefault(one, []).extend([] if t is None else [t])
    return [
        replace(
            a,
            what=f"{len(which)} x {a.what}" if len(which) > 1 else a.what,
            truths=tuple(about[a]),
            predictions=tuple(which),
        )
        for a, which in by_advice.items()
    ]


def _part_alone(name: str, state: str) -> Advice:
    """A small thing of a category inside a truth of it."""
    again = " that is detected already" if state == "found" else ""
    return Advice(
        level="bad",
        what=f"{name} is a small part of an annotated {name}{again}",
        do="label the whole object, not a part of it",
    )


def _false_one(
    prediction: DrawnPrediction, truth: TrueAnnotation | None, names: Mapping[int, str], off: str
) -> Advice:
    """off: how it differs from the truth."""
    name = names[prediction.c]
    if truth is None:
        return Advice(
            level="bad",
            what=f"{name} where nothing is annotated",
            do="not in the photo, or not annotated there: remove it or its category",
        )
    overlap = prediction.i or 0.0
    other, iou = names[truth.category_id], f"(IoU {overlap:.2f})"
    if prediction.k == "both" and overlap < _NEAR_IOU:
        return Advice(
            level="bad",
            what=f"{name} where nothing is annotated; nearest: {other} {iou}",
            do="not in the photo, or not annotated there: remove it or its category",
        )
    what, do = {
        "classification": (
            f"{name} stands where the annotation is {other} {iou}",
            f"if it is one, set category = {other} on it",
        ),
        "localisation": (
            f"{name} overlaps its object too little {iou}: {off}",
            "",
        ),
        "both": (
            f"{name} overlaps only an object of another category, {other} {iou}, too little: {off}",
            "",
        ),
        "duplicate": (
            f"a second {name} on an object that is detected already {iou}",
            "label the whole object once: a category on its parent or collection",
        ),
    }[str(prediction.k)]
    return Advice(level="bad", what=what, do=do)


def _off(
    task: str, entry: ShownPrediction, prediction: DrawnPrediction, truth: TrueAnnotation | None
) -> str:
    if truth is None:
        return ""
    difference = detection_protocol(task).payload.difference
    return difference(entry, truth) if difference else _edges(prediction.box, truth.bbox)


def _how_to_fit(
    task: str,
    image: DetectionImage,
    side: SideImage,
    names: Mapping[int, str],
    pair: tuple[int, int],
) -> str:
    """What was tried and helps a prediction that overlaps a truth of its category too little."""
    if side.errors.truth[pair[1]] == "found":
        return (
            "another one has that object already: if this is another object, move it to its place; "
            "if not, remove it"
        )
    return _step(try_steps(task, image, side, *pair), side, names)


def _step(gains: Gains, side: SideImage, names: Mapping[int, str]) -> str:
    if gains.parts_help:
        return _count_in(gains, side, names)
    if not gains.fit_helps:
        return _OUTLINE
    gain = f": IoU {gains.fitted_iou:.2f}" if gains.fitted_iou < 1 else ""
    return f"move or resize it to the photo{gain}"


def _count_in(gains: Gains, side: SideImage, names: Mapping[int, str]) -> str:
    listed = ", ".join(sorted({names[side.entries[d].category_id] for d in gains.given_back}))
    return (
        f"count {listed} in, if part of it: IoU {gains.together_iou:.2f} with it; a label cuts its "
        "object out of the one around it"
    )


def _loose(
    task: str, image: DetectionImage, side: SideImage, names: Mapping[int, str]
) -> list[Advice]:
    """What loses at AP's higher thresholds, the loosest first; what helps alike stands together."""
    if detection_protocol(task).grid.iou[-1] <= HALF:
        return []
    pairs = [
        (iou, names[image.truths[about].category_id], d, about)
        for d, (entry, about, iou) in enumerate(
            zip(side.entries, side.errors.about, side.errors.iou, strict=True)
        )
        if entry.outcome_50 == "tp" and about is not None and iou is not None
    ]
    by_step: dict[str, list[tuple[str, int]]] = {}
    for iou, name, d, truth in sorted(p for p in pairs if p[0] < _LOOSE_IOU):
        tried = try_steps(task, image, side, d, truth)
        do, then = _OUTLINE, ""
        if tried.parts_help:
            do = _count_in(tried, side, names)
        elif tried.fit_helps:
            do = "fit size and place to the photo: AP averages over IoU 0.50 to 0.95"
            then = f" (fitted {tried.fitted_iou:.2f})" if tried.fitted_iou < 1 else ""
        by_step.setdefault(do, []).append((f"{name} {iou:.2f}{then}", d))
    return [
        Advice(
            level="warn",
            what=f"detected, but with an IoU below {_LOOSE_IOU}: {', '.join(n for n, _ in some)}",
            do=do,
            predictions=tuple(d for _, d in some),
        )
        for do, some in by_step.items()
    ]


def _advise_uncounted(side: SideImage) -> list[Advice]:
    row = side.row
    advice = []
    if row.n_unverified:
        are = plural(row.n_unverified, "prediction is", "predictions are")
        what = f"{are} of categories that are not annotated in this image"
        advice.append(Advice(level="note", what=f"{what}: LVIS does not count them"))
    if row.n_lost_to_cap:
        are = plural(row.n_lost_to_cap, "prediction is", "predictions are")
        what = f"{are} beyond the evaluator's cap"
        advice.append(Advice(level="warn", what=what, do="export fewer objects"))
    return advice


def _unknown_labels(run_row: RunRow) -> list[Advice]:
    """Labels outside the vocabulary; a name of it in another spelling costs its objects."""
    return [
        Advice(
            level="bad" if any(_alike(name, u.label) for name in u.nearest) else "warn",
            what=f"the label {u.label!r} ({u.count} x) is not in the vocabulary",
            do=f"nearest names: {', '.join(u.nearest)}" if u.nearest else "",
        )
        for u in run_row.unmatched or ()
    ]


def _labels(run_row: RunRow) -> list[Advice]:
    advice: list[Advice] = []
    for one in run_row.unexported or ():
        what = f"{one.name} ({one.category}) is labelled but has no pixel: {one.reason}"
        advice.append(Advice(level="warn", what=what, do=_UNSEEN.get(one.reason, "")))
    nested = run_row.nested
    if nested and nested.instances:
        are = plural(nested.instances, "instance is", "instances are")
        what = f"{are} nested in another: {nested.px} px"
        advice.append(Advice(level="note", what=f"{what} are cut out of the outer one"))
    return advice


def _edges(box: Sequence[float], truth: Sequence[float]) -> str:
    """How far each edge is from the truth's: pixels outside (+) or inside (-) of it."""
    left, top = truth[0] - box[0], truth[1] - box[1]
    right = box[0] + box[2] - truth[0] - truth[2]
    bottom = box[1] + box[3] - truth[1] - truth[3]
    named = zip(("left", "top", "right", "bottom"), (left, top, right, bottom), strict=True)
    return "edges out (+) or in (-): " + ", ".join(f"{n} {v:+.0f} px" for n, v in named)


def _alike(category: str, name: str) -> bool:
    """Whether a name holds a word of a category's, or the category written in one or other words.

    Case, plurals, digits and what stands between words make no difference.
    """
    wanted, found = _words(category), _words(name)
    words = {word for word in wanted if len(word) > 2}
    return bool(words & {*found}) or "".join(wanted) in {*found, "".join(found)}


def _words(name: str) -> list[str]:
    words = re.findall(r"[^\W\d_]+", name.partition("(")[0].casefold())
    return [w.removesuffix("s") if len(w) > 3 else w for w in words]


def _quote_names(names: Sequence[str]) -> str:
    return ", ".join(repr(n) for n in names[:3])
