"""What a page draws of amodal masks: the outline of all of it, and the hidden part."""

from __future__ import annotations

from evaluation.amodal_runs import decoded, random_stacks
from evaluation.detection_runs import evaluate_detections, write_run, write_truth

from legoworld.evaluation.stored import read_evaluation
from legoworld.records.base import UNSET
from legoworld.report.detection_images import detection_images
from legoworld.report.shapes import drawn_predictions, drawn_truths


def test_hidden_parts_are_drawn_of_both_sides(tmp_path):
    truth, predictions = random_stacks(3, images=4)
    del predictions[-1]["visible_mask"]
    run = write_run(tmp_path / "run", "amodal", truth, predictions)
    file = write_truth(tmp_path / "truth.json", truth)
    evaluate_detections(run, file, tmp_path / "eval", draws=3)
    images = list(detection_images([read_evaluation(tmp_path / "eval")]))
    drawn = [shape for image in images for shape in drawn_truths("amodal", image)]
    for shape, annotation in zip(drawn, truth["annotations"], strict=True):
        amodal, visible = (decoded(annotation[k]) for k in ("segmentation", "visible_mask"))
        assert shape.rle == annotation["segmentation"]["counts"]
        hidden = decoded({"size": [90, 120], "counts": shape.h})
        assert (hidden == (amodal & ~visible)).all()
    # One prediction lacks its visible mask, so none is kept: the hidden part is unknown.
    answers = [p for image in images for p in drawn_predictions("amodal", image, image.sides[0])]
    assert {p.h for p in answers} == {UNSET}
