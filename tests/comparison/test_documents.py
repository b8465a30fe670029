"""What comparison.json and evidence.json hold, to the last key, and what is left alone."""

from __future__ import annotations

import json
import re

import numpy as np
import pytest
from comparison.evaluations import (
    bad,
    change_json,
    compare,
    depth_scene_and_baseline,
    evaluate,
    forge,
    row_of,
    scene_and_baseline,
)
from evaluation.detection_runs import random_predictions, random_truth

from legoworld.comparison import folder as comparison_folder
from legoworld.comparison.detections import restrict_table
from legoworld.comparison.folder import prepare_folder, read_document, write_comparison
from legoworld.comparison.make_comparison import join_folders
from legoworld.comparison.verdict import noun
from legoworld.comparison.verification import _agrees, verify_comparison
from legoworld.errors import LegoWorldError
from legoworld.evaluation.detection.matching import outcomes
from legoworld.evaluation.detection.scoring import AGREEMENT
from legoworld.evaluation.stored import read_evaluation
from legoworld.files import TEMPORARY_SUFFIX, sha256_of_file
from legoworld.records.base import decode
from legoworld.records.comparison import ComparisonEvidence
from legoworld.records.evaluation import AnyEvidence

NOTHING = AnyEvidence(kind="comparison", configuration={}, versions={}, inputs=(), files={})
COVERAGE = {"attempted": 12, "with_truth": 12, "scene_scored": 10, "baseline_scored": 11,
            "paired": 9}  # fmt: skip
INTERVAL = {"low", "high", "level", "unit", "draws", "undefined_draws"}
EVIDENCE = {"schema_version", "kind", "configuration", "versions", "inputs", "files"}
TABLES = {f"{table}.{form}" for table in ("table", "coverage") for form in ("md", "tex", "csv")}
READ = ["evidence.json", "summary.json", "per_image.jsonl", "per_category.jsonl", "matches.npz",
        "view/run.json"]  # fmt: skip


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """A folder with the comparisons coco and eth3d, what they compare, and both joined."""
    folder = tmp_path_factory.mktemp("made")
    compare(scene_and_baseline(folder / "c", "coco"), folder / "coco", draws=5, seed=3)
    compare(depth_scene_and_baseline(folder / "e"), folder / "eth3d", draws=5, seed=3)
    join_folders([folder / "eth3d", folder / "coco"], folder / "joined")
    return folder


def read(folder, name):
    return json.loads((folder / name).read_text())


def test_a_number_that_is_not_defined_has_no_interval(made):
    (pair,) = read(made / "coco", "comparison.json")["pairs"]
    measured = [row[side] for row in pair["rows"] for side in ("scene", "baseline")]
    undefined = [one for one in measured if one["value"] is None]
    assert undefined  # no annotation here is large
    assert [one["interval"] for one in undefined] == [None] * len(undefined)


def test_another_comparison_s_folder_is_refused_before_anything_is_computed(
    made, tmp_path, monkeypatch
):
    evaluations = scene_and_baseline(tmp_path / "c", "coco", seed=8)
    monkeypatch.setattr(
        "legoworld.comparison.make_comparison.compare", lambda *_: pytest.fail("computed")
    )
    with pytest.raises(LegoWorldError, match="another"):
        compare(evaluations, made / "eth3d", draws=5, seed=3)


def test_other_versions_of_a_package_are_noted(tmp_path):
    scene, baseline = scene_and_baseline(tmp_path, "coco")
    change_json(baseline / "evidence.json", lambda e: e["versions"].update(numpy="0.1"))
    document = compare([scene, baseline], tmp_path / "made", draws=5)
    version = read(scene, "evidence.json")["versions"]["numpy"]
    note = f"Evaluated with other versions of numpy: scene {version}, specialist 0.1."
    assert [n for n in document["notes"] if "other versions" in n] == [note]


@pytest.mark.parametrize("task", ["coco", "eth3d"])
def test_the_keys_of_a_comparison(task, made):
    document = read(made / task, "comparison.json")
    assert document.keys() == {
        "schema_version", "kind", "task", "dataset_version", "evaluator", "protocol", "bootstrap",
        "images", "methods", "pairs", "provenance", "notes",
    }  # fmt: skip
    assert (document["schema_version"], document["kind"], document["task"]) == (
        1, "comparison", task,
    )  # fmt: skip
    unit = {"coco": "image", "eth3d": "scene"}[task]
    assert document["bootstrap"] == {"draws": 5, "seed": 3, "level": 0.95, "unit": unit}
    for image in document["images"]:
        assert image.keys() == {"image_id", "file_name"}
    for method, role in zip(document["methods"], ("scene", "baseline"), strict=True):
        assert method.keys() == {
            "name", "role", "kind", "coverage", "not_scored", "used_truth", "camera_model",
            "max_side", "resampled", "provenance",
        }  # fmt: skip
        assert method["role"] == role == method["kind"]
        assert method["coverage"].keys() == {"attempted", "scored", "with_truth", "by_status"}
        assert len(method["not_scored"]) == (
            method["coverage"]["attempted"] - method["coverage"]["scored"]
        )
        for image in method["not_scored"]:
            assert image.keys() == {"image_id", "file_name", "status"}
            assert image["status"] != "ok"
    (pair,) = document["pairs"]
    assert pair.keys() == {
        "scene", "baseline", "coverage", "paired_image_ids", "dropped", "rows",
    }  # fmt: skip
    assert pair["coverage"].keys() == COVERAGE.keys()
    assert pair["coverage"]["paired"] == len(pair["paired_image_ids"])
    for row in pair["rows"]:
        assert row.keys() == {
            "metric", "policy", "images", "better", "level", "scene", "baseline", "difference",
        }  # fmt: skip
        assert row["difference"].keys() == {"value", "interval"}
        for side in (row["scene"], row["baseline"], row["difference"]):
            assert side.keys() >= {"value", "interval"}
            if side["interval"] is not None:
                centred = {"bootstrap_mean"} if task == "coco" else set()
                assert side["interval"].keys() == INTERVAL | centred


def test_what_a_comparison_of_boxes_says_of_its_runs(made):
    document = read(made / "coco", "comparison.json")
    scene, baseline = document["methods"]
    assert scene["coverage"]["by_status"] == {"missing": 1, "ok": 10, "timeout": 1}
    assert [image["status"] for image in scene["not_scored"]] == ["missing", "timeout"]
    assert [image["status"] for image in baseline["not_scored"]] == ["failed"]
    for method in (scene, baseline):
        assert [method[k] for k in ("camera_model", "max_side", "resampled", "used_truth")] == [
            None
        ] * 4
    assert document["protocol"] is None
    (pair,) = document["pairs"]
    statuses = [r for dropped in pair["dropped"] for r in dropped["reasons"]]
    assert {"scene: missing", "specialist: failed"} <= set(statuses)
    assert pair["coverage"]["attempted"] == 12
    assert pair["coverage"]["scene_scored"] == 10
    assert pair["coverage"]["baseline_scored"] == 11


def test_the_choices_of_a_depth_comparison(made):
    document = read(made / "eth3d", "comparison.json")
    assert document["protocol"].keys() == {
        "aggregate", "disparity_floor", "fit_pixels", "min_valid_px", "model", "policies",
        "primary", "resample", "resolution", "solver", "space", "valid_truth",
    }  # fmt: skip
    for method in document["methods"]:
        assert [method[k] for k in ("camera_model", "max_side", "resampled")] == ["none", None, 0]
    rows = document["pairs"][0]["rows"]
    assert {r["policy"] for r in rows} == {"error_1", "exclude", "far"}
    for row in rows:
        assert row["metric"].endswith("." + row["policy"])
        attempted = row["images"] == "attempted"
        assert row["scene"]["over"].keys() == {"images", *(["missing"] if attempted else [])}
        assert ("constant" in row["scene"]) == (not attempted)


def test_the_levels_policies_and_denominators_of_every_metric_of_boxes(made):
    rows = {
        row["metric"]: row
        for row in read(made / "coco", "comparison.json")["pairs"][0]["rows"]
        if row["images"] == "attempted"
    }
    by_level: dict[int, set[str]] = {1: set(), 2: set(), 3: set()}
    for name, row in rows.items():
        by_level[row["level"]].add(name)
        assert row["better"] == "higher"
    official = {"AP", "AP50", "AP75", "APs", "APm", "APl", "AR1", "AR10", "AR100", "ARs", "ARm",
                "ARl"}  # fmt: skip
    assert by_level[1] == {"AP", "AP50", "AP75", "equal_confidence.AP"}
    assert by_level[2] == {
        "APs", "APm", "APl", "AR100", "ARs", "ARm", "ARl", "tie_orders.AP",
        "class_aware.miou_gt_micro", "class_aware.miou_matched", "class_aware.f1_50",
    }  # fmt: skip
    free = {"miou_gt_micro", "miou_gt_macro", "miou_matched", "precision_50", "recall_50", "f1_50",
            "sq", "rq", "pq"}  # fmt: skip
    assert rows.keys() == {
        *official,
        *(f"equal_confidence.{name}" for name in official),
        "tie_orders.AP",
        *(f"class_aware.{name}" for name in free),
        *(f"class_agnostic.{name}" for name in {*free, "label_accuracy"}),
    }
    for name, row in rows.items():
        first, _, metric = name.rpartition(".")
        policy = {"": "own_scores", "class_aware": "score_free", "class_agnostic": "score_free"}
        assert row["policy"] == policy.get(first, first)
        over = {"images", "categories", "truths"}
        if row["policy"] == "score_free":
            over = {"images", "truths", "predictions"}
            over |= {"categories"} if metric == "miou_gt_macro" else set()
            over |= {"pairs"} if metric in ("miou_matched", "label_accuracy") else set()
        for side in ("scene", "baseline"):
            assert row[side]["over"].keys() == over
            ties = {"sd", "worst", "best"} if row["policy"] == "tie_orders" else set()
            assert row[side].keys() == {"value", "interval", "over"} | ties
    ties = rows["tie_orders.AP"]["scene"]
    assert ties["worst"] <= ties["value"] <= ties["best"]
    assert ties["worst"] < ties["best"]


def test_denominators_count_what_there_is(made):
    """Against the truth file: what each size has, and what was matched."""
    truth = read(made / "c" / "scene", "truth.json")
    predictions = read(made / "c" / "scene" / "eval", "view/predictions.json")
    document = read(made / "coco", "comparison.json")
    counted = [a for a in truth["annotations"] if not a["iscrowd"]]
    of_size = {
        "s": [a for a in counted if a["area"] < 32**2],
        "m": [a for a in counted if 32**2 <= a["area"] < 96**2],
        "l": [a for a in counted if a["area"] >= 96**2],
        "": counted,
    }
    for size, some in of_size.items():
        over = row_of(document, f"AP{size}", "attempted")["scene"]["over"]
        assert over == {
            "images": 12,
            "categories": len({a["category_id"] for a in some}),
            "truths": len(some),
        }
    over = row_of(document, "class_aware.miou_gt_macro", "attempted")["scene"]["over"]
    assert over["truths"] == len(counted)
    assert over["predictions"] <= len(predictions)
    assert over["categories"] == len({a["category_id"] for a in counted})
    paired = set(document["pairs"][0]["paired_image_ids"])
    some = [a for a in counted if a["image_id"] in paired]
    over = row_of(document, "AP", "paired")["scene"]["over"]
    assert over == {
        "images": len(paired),
        "categories": len({a["category_id"] for a in some}),
        "truths": len(some),
    }


@pytest.mark.parametrize("task", ["coco", "eth3d"])
def test_the_evidence_of_a_comparison(task, made):
    evidence = read(made / task, "evidence.json")
    assert evidence.keys() == {*EVIDENCE, "task", "methods", "pairs"}
    assert (evidence["schema_version"], evidence["kind"], evidence["task"]) == (
        1, "comparison", task,
    )  # fmt: skip
    assert evidence["configuration"] == {"draws": 5, "seed": 3, "allow_truth_prompts": False}
    assert evidence["files"] == {
        name: sha256_of_file(made / task / name) for name in {*TABLES, "comparison.json"}
    }
    sides = [made / task[0] / name / "eval" for name in ("scene", "baseline")]
    expected = [
        {
            "role": f"evaluation {place}",
            "path": f"../{task[0]}/{side.parent.name}/eval/{name}",
            "sha256": sha256_of_file(side / name),
            "bytes": (side / name).stat().st_size,
        }
        for place, side in enumerate(sides)
        for name in READ
        if (side / name).is_file()
    ]
    by_path = sorted(evidence["inputs"], key=lambda entry: entry["path"])
    assert by_path == sorted(expected, key=lambda entry: entry["path"])
    assert len(expected) == (12 if task == "coco" else 8)
    for method, side in zip(evidence["methods"], sides, strict=True):
        own = read(side, "evidence.json")
        kept = {"evaluator", "configuration", "protocol"}
        kept |= {"raw", "equal_confidence", "run"} if task == "coco" else {"metrics"}
        assert method.keys() == {"name", "inputs", *kept}
        for key in kept:
            assert method[key] == own[key]
        for entry, theirs in zip(method["inputs"], own["inputs"], strict=True):
            assert entry == {"role": theirs["role"], "sha256": theirs["sha256"]}
    document = read(made / task, "comparison.json")
    for found, pair in zip(evidence["pairs"], document["pairs"], strict=True):
        assert found.keys() == {
            "scene", "baseline", "coverage", "paired_image_ids", "dropped", "paired_metrics",
        }  # fmt: skip
        for key in found.keys() - {"paired_metrics"}:
            assert found[key] == pair[key]
        assert found["paired_metrics"] == {
            row["metric"]: {
                side: row[side]["value"] for side in ("scene", "baseline", "difference")
            }
            for row in pair["rows"]
            if row["images"] == "paired"
        }


def test_what_a_joined_comparison_holds(made):
    document = read(made / "joined", "comparison.json")
    assert document.keys() == {
        "schema_version", "kind", "comparisons", "common_images", "provenance", "notes",
    }  # fmt: skip
    assert (document["schema_version"], document["kind"]) == (1, "joined_comparison")
    evidence = read(made / "joined", "evidence.json")
    assert evidence.keys() == EVIDENCE
    assert evidence["kind"] == "joined_comparison"
    assert evidence["configuration"] == {}
    assert evidence["inputs"] == [
        {
            "role": f"comparison {task}",
            "path": f"../{task}/{name}",
            "sha256": sha256_of_file(made / task / name),
            "bytes": (made / task / name).stat().st_size,
        }
        for task in ("coco", "eth3d")
        for name in ("comparison.json", "evidence.json")
    ]
    for folder in ("coco", "eth3d", "joined"):
        versions = read(made / folder, "evidence.json")["versions"]
        assert {"legoworld", "python", "numpy", "scipy", "pycocotools", "hotcoco"} <= set(versions)


@pytest.mark.parametrize("name", [".hidden", f"comparison.json{TEMPORARY_SUFFIX}", "table.txt"])
def test_a_folder_with_other_files_is_left_alone(name, tmp_path):
    (tmp_path / name).write_text("mine")
    for more in "abcdef":
        (tmp_path / more).write_text("")
    shown = ", ".join(sorted([name, *"abcdef"])[:5])
    with pytest.raises(LegoWorldError, match=re.escape(f"found: {shown}; expected")):
        prepare_folder(tmp_path, NOTHING, overwrite=True)


def test_what_an_interrupted_write_left_is_no_stranger(tmp_path):
    (tmp_path / f".table.md{TEMPORARY_SUFFIX}").write_text("half")
    (tmp_path / "table.md").write_text("without evidence")
    prepare_folder(tmp_path, NOTHING, overwrite=False)
    prepare_folder(tmp_path / "new" / "er", NOTHING, overwrite=False)
    assert (tmp_path / "new" / "er").is_dir()


def test_a_side_without_predictions_has_no_score_free_numbers_and_no_intervals(tmp_path):
    truth = random_truth("coco", seed=5)
    nothing = evaluate(tmp_path / "scene", "coco", truth, [])
    found = random_predictions("coco", truth, seed=6)
    something = evaluate(tmp_path / "b", "coco", truth, found, kind="baseline")
    document = compare([nothing, something], tmp_path / "out", draws=5)
    for metric in ("miou_matched", "precision_50", "sq"):
        row = row_of(document, f"class_aware.{metric}", "attempted")
        assert (row["scene"]["value"], row["scene"]["interval"]) == (None, None), metric
        assert row["baseline"]["interval"] is not None
        assert row["difference"] == {"value": None, "interval": None}
    row = row_of(document, "class_agnostic.label_accuracy", "attempted")
    assert row["scene"]["over"]["pairs"] == 0
    assert row_of(document, "class_aware.recall_50", "attempted")["scene"]["value"] == 0.0


def test_the_matches_of_some_images_are_those_rows_of_every_column(made):
    side = read_evaluation(made / "c" / "baseline" / "eval")
    table = outcomes.table_from(side.matches, outcomes.OWN)
    kept = np.arange(len(table.image_ids)) % 3 != 1
    some = restrict_table(table, kept)
    rows, cells = kept[table.image], kept[table.truth_image]
    assert 0 < rows.sum() < len(rows)
    number = np.cumsum(kept) - 1
    assert some.image_ids.tolist() == table.image_ids[kept].tolist()
    assert some.image.tolist() == number[table.image[rows]].tolist()
    assert some.truth_image.tolist() == number[table.truth_image[cells]].tolist()
    for name in ("category", "score", "rank", "entry"):
        assert getattr(some, name).tolist() == getattr(table, name)[rows].tolist(), name
    assert some.truth_category.tolist() == table.truth_category[cells].tolist()
    assert some.state.tolist() == table.state[:, :, rows].tolist()
    assert some.n_truths.tolist() == table.n_truths[:, cells].tolist()
    assert some.category_ids.tolist() == table.category_ids.tolist()


@pytest.mark.parametrize(
    ("task", "expected"),
    [("coco", "Scene boxes"), ("coco-masks", "Scene masks"), ("lvis", "Scene masks (LVIS)"),
     ("eth3d", "Scene depth"), ("bench", "Scenes"), ("other", "scene")],
)  # fmt: skip
def test_the_subject_of_a_verdict(task, expected):
    assert noun(task, "scene") == expected
    assert noun(task, "YOLOX") == "YOLOX"


NOT_RECORDED = (
    "How the scenes were made (agent, prompts, camera given, metric feedback) is not recorded."
)


def test_the_notes_of_boxes_and_of_depth_to_the_last_word(made):
    assert read(made / "coco", "comparison.json")["notes"] == [
        "Differences are scene minus the other method.",
        "Official metrics: specialist ranked by own scores, scene equally confident in everything "
        "and ordered canonically. Those of equal_confidence and tie_orders: no method ranks.",
        NOT_RECORDED,
    ]
    scene, baseline = read(made / "eth3d", "comparison.json")["methods"]
    assert read(made / "eth3d", "comparison.json")["notes"] == [
        f"Differences are {scene['name']} minus the other method.",
        "Images scored: each method over its own, so their differences are of other images.",
        NOT_RECORDED,
    ]
    assert baseline["camera_model"] == "none"


@pytest.mark.parametrize(
    ("computed", "recorded", "said"),
    [
        ({"a": [1.0, {"b": 0.0}]}, {"a": [1.0, {"b": AGREEMENT}]}, "ok 1.0e-12 at .a[1].b"),
        ({"a": 0.0}, {"a": 2e-12}, "DIFFERS 2.0e-12 at .a"),
        ({"a": 3}, {"a": 3.0}, "ok 0.0e+00"),
        ({"a": 0.5}, {"a": None}, "DIFFERS inf at .a"),
        ({"a": None}, {"a": 0}, "DIFFERS inf at .a"),
        ({"a": True}, {"a": False}, "DIFFERS inf at .a"),
        ({"a": float("nan")}, {"a": 0.5}, "DIFFERS inf at .a"),
        ({"a": 0.5}, {"a": float("nan")}, "DIFFERS inf at .a"),
        ({"a": "x"}, {"a": "y"}, "DIFFERS inf at .a"),
        ({"a": 1}, {"b": 1}, "DIFFERS inf"),
        ({"a": [1]}, {"a": [1, 2]}, "DIFFERS inf at .a"),
        ([1], {"a": 1}, "DIFFERS inf"),
        ({"a": 1, "b": 1}, {"a": None, "b": None}, "DIFFERS inf at .a"),
        ([], [], "ok 0.0e+00"),
    ],
)
def test_two_documents_agree_up_to_rounding(computed, recorded, said):
    check = _agrees("numbers", computed, recorded)
    assert check.what == "numbers"
    assert f"{check.status} {check.found}".replace("largest difference ", "") == said


def test_a_write_that_fails_leaves_no_evidence_of_the_earlier_one(made, tmp_path, monkeypatch):
    document = read_document(made / "coco")
    evidence = decode(ComparisonEvidence, (made / "coco" / "evidence.json").read_bytes())
    write_comparison(tmp_path, document, evidence, overwrite=False)
    assert (tmp_path / "evidence.json").read_bytes() == (made / "coco/evidence.json").read_bytes()

    def full(path, text):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(comparison_folder, "write_text", full)
    with pytest.raises(OSError, match="No space"):
        write_comparison(tmp_path, document, evidence, overwrite=True)
    assert not (tmp_path / "evidence.json").exists()


def test_the_worst_of_several_differences_is_the_one_that_is_named(made, tmp_path):
    sides = [made / "c" / name / "eval" for name in ("scene", "baseline")]
    compare(sides, tmp_path / "out", draws=5)

    def differ(document):
        rows = document["pairs"][0]["rows"]
        rows[0]["scene"]["value"] += 1e-6
        rows[1]["scene"]["value"] += 1e-14

    forge(tmp_path / "out", "comparison.json", lambda path: change_json(path, differ))
    checks = bad(verify_comparison(tmp_path / "out", None))
    assert {c.status for c in checks} == {"DIFFERS"}
    said = {c.what: c.found for c in checks}["numbers from the evaluations"]
    assert said == "largest difference 1.0e-06 at .pairs[0].rows[0].scene.value"

    def shorter(document):
        document["pairs"][0]["rows"].pop()

    forge(tmp_path / "out", "comparison.json", lambda path: change_json(path, shorter))
    found = {c.what: c.found for c in bad(verify_comparison(tmp_path / "out", None))}
    assert found["numbers from the evaluations"] == "largest difference inf at .pairs[0].rows"
