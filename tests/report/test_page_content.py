"""What a page says is what the evaluations hold: numbers, denominators, failures, foreign names."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from evaluation.detection_runs import random_truth
from report.pages import (
    HOSTILE,
    Tables,
    document_of,
    embedded_json,
    evaluate,
    page_of,
    write,
    write_photos,
)

from legoworld import cli
from legoworld.evaluation.detection.protocols import detection_protocol
from legoworld.evaluation.stored import EvaluationChangedError
from legoworld.records.base import as_json
from legoworld.report import page_file
from legoworld.report.page_file import script_json
from legoworld.report.photos import find_photo
from legoworld.report.sources import ReportInputError, read_sources

STATUSES = {10: "failed", 13: "missing", 16: "timeout"}


@pytest.fixture(scope="module")
def both(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """A scene with failures beside a baseline with scores, over one truth."""
    folder = tmp_path_factory.mktemp("both")
    scene = evaluate(folder, "lvis", statuses=STATUSES)
    other = evaluate(folder, "lvis", levels=None, kind="baseline", baseline="random-masks")
    return scene, other


@pytest.fixture(scope="module")
def page(both: tuple[Path, Path], tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("page")
    photos = write_photos(folder / "photos", "lvis")
    (photos / "val2017" / "003.jpg").unlink()
    return page_of(folder / "report.html", *both, photos=photos)


def summary_of(evaluation: Path) -> dict:
    return json.loads((evaluation / "summary.json").read_text())


def rows_of(evaluation: Path, name: str = "per_image.jsonl") -> list[dict]:
    return [json.loads(line) for line in (evaluation / name).read_text().splitlines()]


def test_every_official_number_stands_with_its_interval_and_denominator(
    both: tuple[Path, Path], page: Path
) -> None:
    tables = Tables(page)
    for metric in detection_protocol("lvis").metrics:
        cells = tables.row(metric.name)
        for k, evaluation in enumerate(both):
            summary = summary_of(evaluation)
            value = summary["metrics"][metric.name]
            shown, spread, over = cells[3 * k : 3 * k + 3]
            assert shown == ("-" if value is None else f"{value:.4f}")
            counts = summary["counts"]
            group = (
                counts["frequency_groups"][metric.frequency]
                if metric.frequency
                else counts["areas"][metric.area]
            )
            assert "12 images" in over
            assert f"{group['truth_instances']} annotation" in over
            interval = summary["intervals"][metric.name]
            if value is not None and interval["low"] is not None:
                assert spread == f"[{interval['low']:.4f}, {interval['high']:.4f}]"


def test_the_plot_s_intervals_are_those_of_the_summary(both: tuple[Path, Path]) -> None:
    (section,) = document_of(*both).sections
    rows = {row.name: row for row in section.first.forest}
    for k, evaluation in enumerate(both):
        summary = summary_of(evaluation)
        equal = summary["equal_confidence"]
        known = summary["intervals"]["AP"] if equal["already_equal"] else {"low": None}
        of = {
            "AP": (summary["metrics"]["AP"], summary["intervals"]["AP"]),
            "AP, equal confidence": (equal["metrics"]["AP"], known),
            "recall at IoU 0.5": (
                summary["matched"]["class_aware"]["recall_50"],
                summary["intervals"]["class_aware.recall_50"],
            ),
        }
        for name, (value, interval) in of.items():
            span = rows[name].sides[k]
            assert span is not None
            assert (span.value, span.low) == (value, interval["low"]), name


def test_score_free_numbers_and_coverage(both: tuple[Path, Path], page: Path) -> None:
    tables = Tables(page)
    for k, evaluation in enumerate(both):
        summary = summary_of(evaluation)
        aware = summary["matched"]["class_aware"]
        assert tables.row("class_aware.recall_50")[3 * k] == f"{aware['recall_50']:.4f}"
        assert f"{aware['n_gt']} annotations" in tables.row("class_aware.recall_50")[3 * k + 2]
        for name in ("attempted", "scored", "with truth"):
            assert tables.row(name)[k] == str(summary["coverage"][name.replace(" ", "_")])
    assert tables.row("status failed") == ["1", "0"]
    assert tables.row("scored") == ["9", "12"]


def test_error_counts_add_up_to_the_evaluator_s_own(both: tuple[Path, Path]) -> None:
    (section,) = document_of(*both).sections
    for evaluation, errors in zip(both, section.errors, strict=True):
        rows = rows_of(evaluation)
        false = sum(r["greedy_50"]["fp"] for r in rows)
        unfound = sum(r["n_truth"] - r["greedy_50"]["tp"] for r in rows)
        counts = dict(errors.counts)
        missed = counts.pop("missed")
        assert sum(counts.values()) == false
        assert missed + errors.reached == unfound
        assert false > 0
        assert unfound > 0


def test_the_histogram_has_every_true_positive_and_the_low_pairs(both: tuple[Path, Path]) -> None:
    (section,) = document_of(*both).sections
    assert section.plots is not None
    for evaluation, shown, errors in zip(both, section.plots.iou, section.errors, strict=True):
        found = sum(r["greedy_50"]["tp"] for r in rows_of(evaluation))
        assert sum(shown.tp) == found > 0
        assert sum(shown.low) == dict(errors.counts)["localisation"] > 0
        below = [n for n, edge in zip(shown.tp, shown.edges, strict=False) if edge < 0.5]
        assert sum(below) == 0


def test_category_rows_are_the_evaluation_s(both: tuple[Path, Path], page: Path) -> None:
    tables = Tables(page)
    for k, evaluation in enumerate(both):
        for row in rows_of(evaluation, "per_category.jsonl"):
            cells = tables.row(row["name"])
            assert cells[0] == row["frequency"]
            assert cells[1] == str(row["n_truth"])
            mine = cells[3 + 6 * k : 9 + 6 * k]
            assert mine[0] == ("-" if row["AP"] is None else f"{row['AP']:.3f}")
            assert mine[3] == str(row["n_predictions"])
            assert mine[4] == f"{row['greedy_50']['tp']} of {row['n_truth']}"
            assert mine[5] == str(row["greedy_50"]["fp"])


def test_the_tie_picture_is_of_the_summary_s_own_draws(both: tuple[Path, Path]) -> None:
    (section,) = document_of(*both).sections
    own, scored, equal = section.ties
    assert summary_of(both[0])["equal_confidence"]["already_equal"]
    ties = summary_of(both[0])["ties"]
    assert as_json(own.ties) == ties
    drawn = sum(int(bar.text.split()[0]) for bar in own.drawing.bars)
    assert drawn == ties["draws"] == 20
    x = own.drawing.x
    assert x["worst"] <= x["expected"] <= x["best"]
    assert x["worst"] <= x["ap"] <= x["best"]
    assert scored.drawing is None, "distinct scores leave no order open"
    assert as_json(equal.ties) == summary_of(both[1])["equal_confidence"]["ties"]


def test_the_worst_photo_comes_first_and_failures_are_among_them(both: tuple[Path, Path]) -> None:
    (section,) = document_of(*both).sections
    qualities = [row.cells[0].quality for row in section.images]
    known = [q for q in qualities if q is not None]
    assert known == sorted(known)
    assert qualities[len(known) :] == [None] * (len(qualities) - len(known))
    by_id = {row.id: row for row in section.images}
    for image_id, status in STATUSES.items():
        assert by_id[image_id].cells[0].status == status
        if by_id[image_id].n_truth:
            assert by_id[image_id].cells[0].quality == 0.0


def test_each_photo_s_cells_count_as_the_evaluation_does(both: tuple[Path, Path]) -> None:
    images = document_of(*both).sections[0].images
    for k, evaluation in enumerate(both):
        rows = {r["image_id"]: r for r in rows_of(evaluation)}
        for row in images:
            known = rows[row.id]
            assert row.cells[k].fn == known["n_truth"] - known["greedy_50"]["tp"]
            assert row.cells[k].fp == known["greedy_50"]["fp"]


def test_quality_over_all_photos_is_the_panoptic_quality(both: tuple[Path, Path]) -> None:
    for k, evaluation in enumerate(both):
        images = document_of(*both).sections[0].images
        rows = {r["image_id"]: r["class_aware"] for r in rows_of(evaluation)}
        total = sum(r["n_gt"] + r["n_dt"] for r in rows.values())
        weighted = sum(
            (row.cells[k].quality or 0.0) * (rows[row.id]["n_gt"] + rows[row.id]["n_dt"])
            for row in images
        )
        pq = summary_of(evaluation)["matched"]["class_aware"]["pq"]
        assert weighted / total == pytest.approx(pq, abs=1e-12)


def test_a_failed_scene_says_why_and_every_finding_is_there(both: tuple[Path, Path]) -> None:
    views = {view.id: view for view in document_of(*both).views}
    (advice,) = views[10].sides[0].advice
    assert advice.level == "bad"
    assert advice.what.startswith("no output (failed)")
    said = [a.what for v in views.values() for s in v.sides for a in s.advice]
    for words in ("missed:", "overlaps its object", "stands where", "nothing is annotated"):
        assert any(words in what for what in said), words
    baseline = [a.do for v in views.values() for a in v.sides[1].advice]
    assert set(baseline) == {""}, "a specialist is not told how to build a scene"


def test_missing_photos_are_said_and_never_fatal(
    page: Path, both: tuple[Path, Path], tmp_path: Path
) -> None:
    text = page.read_text()
    assert "the photo 003.jpg was not found" in text
    assert "<summary>1 of 12 views has no photo</summary>" in text
    assert text.count('<script type="text/plain" id="photo-') == 11
    without = page_of(tmp_path / "r.html", *both).read_text()
    assert "no folder of photos was given" in without
    assert "<summary>12 of 12 views have no photo</summary>" in without


#: What file systems and annotations allow, and one that no file system takes.
NAMES = ["qu\"ot'e.png", "\U0001f408 cat.png", "<b>&amp;.png", "a\u2028b.png",
         "%2e%2e.png", "x" * 296 + ".png"]  # fmt: skip


def test_photos_of_any_name_are_shown_and_one_too_long_is_said(tmp_path: Path) -> None:
    truth = random_truth("coco", seed=1, images=len(NAMES))
    (tmp_path / "photos").mkdir()
    for image, name in zip(truth["images"], NAMES, strict=True):
        image["file_name"] = name
        if len(name) < 255:
            picture = np.zeros((image["height"], image["width"], 3), np.uint8)
            path = tmp_path / "photos" / name
            path.write_bytes(cv2.imencode(".png", picture)[1].tobytes())
    folder = evaluate(tmp_path, "coco", truth=truth)
    document = document_of(folder, photos=tmp_path / "photos")
    photos = {view.file_name: view.photo for view in document.views}
    assert {name for name, photo in photos.items() if photo is None} == {NAMES[-1]}
    page = tmp_path / "page.html"
    arguments = ["report", str(folder), "--photos", str(tmp_path / "photos"), "-o", str(page)]
    assert cli.run(arguments) == 0
    text = page.read_text(encoding="utf-8")
    assert "<b>&amp;.png" not in text
    assert f"the photo {NAMES[-1]} was not found" in text
    assert {view["file_name"] for view in embedded_json(page, "view")} == set(NAMES)


def test_a_photo_of_another_size_or_no_photo_at_all_is_not_drawn_on(
    both: tuple[Path, Path], tmp_path: Path
) -> None:
    cv2.imwrite(str(tmp_path / "000.jpg"), np.zeros((45, 60, 3), np.uint8))
    (tmp_path / "001.jpg").write_text("no picture")
    views = document_of(*both, photos=tmp_path).views
    assert views[0].photo is None
    assert "is 60x45, its truth 120x90" in views[0].said
    assert "could not be read" in views[1].said


def test_photos_are_found_below_the_folder_and_never_outside(tmp_path: Path) -> None:
    for name in ("a.jpg", "train2017/b.jpg", "val2017/c.jpg"):
        path = tmp_path / "photos" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(b"")
    (tmp_path / "secret.jpg").write_bytes(b"")
    photos = tmp_path / "photos"
    for name in "abc":
        assert find_photo(photos, f"{name}.jpg") is not None
    assert find_photo(photos, "../secret.jpg") is None
    assert find_photo(photos, str(tmp_path / "secret.jpg")) is None


def test_the_same_inputs_give_the_same_bytes(
    both: tuple[Path, Path], page: Path, tmp_path: Path
) -> None:
    again = page_of(tmp_path / "other.html", *both, photos=page.parent / "photos")
    assert again.read_bytes() == page.read_bytes()


def test_commands_hashes_versions_and_licences(both: tuple[Path, Path], page: Path) -> None:
    text = page.read_text()
    for evaluation in both:
        evidence = json.loads((evaluation / "evidence.json").read_text())
        for entry in evidence["inputs"]:
            assert entry["sha256"] in text
        for version in evidence["versions"].values():
            assert version in text
    assert "legoworld evaluate run-lvis-scene --truth truth-lvis.json" in text
    assert "--evaluator official --draws 20 --seed 0 -o eval-lvis-scene" in text
    assert "legoworld baseline run random-masks --task lvis" in text
    assert "BSD-2-Clause" in text
    assert "no card knows this truth by its hash" in text
    assert str(page.parent) not in text, "no path of this machine"
    origin = document_of(both[0]).sections[0].provenance[0]
    assert [(table.title, table.header) for table in origin.tables] == [
        ("Inputs", ("role", "file", "bytes", "sha256")),
        ("The evaluation's files", ("file", "sha256")),
        ("Versions and licences", ("what", "version", "licence")),
        ("Configuration", ("option", "value")),
    ]
    roles = [row[0] for row in origin.tables[0].rows]
    evidence = json.loads((both[0] / "evidence.json").read_text())
    assert roles == [entry["role"] for entry in evidence["inputs"]]
    chosen = dict(origin.tables[3].rows)
    assert (chosen["run: task"], chosen["evaluation: draws"]) == ("lvis", "20")
    assert (origin.folder, origin.partial) == (both[0].name, False)


def test_one_side_alone_says_that_no_specialist_was_run(tmp_path: Path) -> None:
    alone = page_of(tmp_path / "r.html", evaluate(tmp_path, "coco"))
    text = alone.read_text()
    assert text.count("<td>no specialist was run</td>") == 3
    assert "<b>no specialist was run</b>" in text


def test_nothing_predicted(tmp_path: Path) -> None:
    evaluation = evaluate(tmp_path, "coco", predictions=[])
    path = page_of(tmp_path / "r.html", evaluation)
    assert Tables(path).row("AP")[0] == f"{summary_of(evaluation)['metrics']['AP']:.4f}"
    views = document_of(evaluation).views
    with_truth = next(v for v in views if v.truths)
    assert any("nothing was exported" in a.what for a in with_truth.sides[0].advice)
    assert summary_of(evaluation)["metrics"]["AP"] == 0.0


def test_names_from_scenes_are_text_wherever_they_stand(tmp_path: Path) -> None:
    path = page_of(tmp_path / "r.html", evaluate(tmp_path, "coco", hostile=True))
    text = path.read_text(encoding="utf-8")
    assert "<img" not in text
    assert "alert(1)" in text
    assert text.count("</script>") == text.count("<script"), "no name ends a script element"
    (data,) = embedded_json(path, "data")
    assert HOSTILE in data["sections"][0]["names"].values()
    views = embedded_json(path, "view-")
    tables = [t for v in views for s in v["sides"] for t in s["tables"]]
    assert {t["title"] for t in tables} == {
        "Objects without a category, the largest first",
        "Labels outside the vocabulary",
        "Labelled objects without a pixel",
        "Labels matched by synonym",
    }
    assert {t["title"].split()[0]: t["head"] for t in tables} == {
        "Objects": ["object", "pixels", "of the view"],
        "Labels": ["label", "taken for"],
        "Labelled": ["object", "category", "reason"],
    }
    outside = next(t for t in tables if t["title"] == "Labels outside the vocabulary")
    assert outside["head"] == ["label", "objects", "nearest names"]
    listed = next(t for t in tables if t["title"].startswith("Objects without"))
    assert listed["rows"] == [[HOSTILE, "1080", "10.0%"]]
    said = [a for v in views for s in v["sides"] for a in s["advice"]]
    assert any(a["do"] == f"nearest names: thing 1, {HOSTILE}" for a in said)
    assert any("outside the picture" in a["do"] for a in said)


def test_json_in_a_script_element_survives_and_never_ends_it() -> None:
    value = {"a": [HOSTILE, "<!--", "]]>", "\u2029"]}
    text = script_json(value)
    assert json.loads(text) == value
    assert not set("<>&\u2028\u2029") & set(text)


def test_many_views_lie_beside_the_page(
    both: tuple[Path, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(page_file, "EMBEDDED_VIEWS", 5)
    photos = write_photos(tmp_path / "photos", "lvis")
    path = page_of(tmp_path / "r.html", *both, photos=photos)
    beside = tmp_path / "r_files"
    assert len(list(beside.glob("view-*.js"))) == len(list(beside.glob("photo-*.webp"))) == 12
    assert embedded_json(path, "view-") == []
    assert "<code>r_files/</code> beside it" in path.read_text()
    page_of(path, both[0], photos=photos)
    (beside / "mine.txt").write_text("keep me")
    assert cli.run(["report", *map(str, both), "-o", str(path)]) == 2
    assert (beside / "mine.txt").is_file()


@pytest.mark.parametrize(("most", "beside"), [(0, False), (-1, True)])
def test_bytes_count_as_base64_spells_them(
    both: tuple[Path, Path],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    most: int,
    beside: bool,
) -> None:
    document = document_of(*both, photos=write_photos(tmp_path / "photos", "lvis"))
    photos = sum(len(p) * 4 // 3 for kind in document.pictures.values() for p in kind)
    views = sum(len(script_json(view)) for view in document.views)
    monkeypatch.setattr(page_file, "EMBEDDED_BYTES", photos + views + most)
    write(document, tmp_path / "r.html")
    assert (tmp_path / "r_files").is_dir() == beside
    three = (b"three" * 6, b"3d")
    document = replace(document, scenes=replace(document.scenes, glbs=three))
    monkeypatch.setattr(page_file, "EMBEDDED_BYTES", 1 << 30)
    monkeypatch.setattr(page_file, "EMBEDDED_SCENE_BYTES", 32 * 4 // 3 + most)
    write(document, tmp_path / "s.html")
    assert (tmp_path / "s_files").is_dir() == beside


def test_another_file_is_never_written_over(both: tuple[Path, Path], tmp_path: Path) -> None:
    mine = tmp_path / "thesis.html"
    mine.write_text("<!doctype html><p>mine")
    assert cli.run(["report", str(both[0]), "-o", str(mine)]) == 2
    assert mine.read_text() == "<!doctype html><p>mine"


def test_sections_of_one_task_are_numbered_in_links(tmp_path: Path) -> None:
    folders = [evaluate(tmp_path / name, "coco", images=3, seed=k)
               for k, name in enumerate(("a", "b", "c"), start=1)]  # fmt: skip
    assert [s.key for s in read_sources(folders)] == ["coco", "coco-2", "coco-3"]
    document = document_of(*folders)
    assert {view.section for view in document.views} == {"coco", "coco-2", "coco-3"}


def test_changed_or_foreign_folders_are_refused(tmp_path: Path) -> None:
    evaluation = evaluate(tmp_path, "coco")
    other = evaluate(tmp_path / "other", "coco", images=3, seed=1)
    path = evaluation / "view" / "predictions.json"
    path.write_text(path.read_text().replace("tp", "fp"))
    with pytest.raises(
        EvaluationChangedError, match=r"view/predictions.json is not what was written"
    ):
        document_of(evaluation)
    (other / "summary.json").write_text("{}")
    with pytest.raises(EvaluationChangedError, match=r"summary.json is not what was written"):
        read_sources([other])
    assert cli.run(["report", str(tmp_path / "run-coco-scene"), "-o", str(tmp_path / "r")]) == 2


def test_evaluations_of_different_truths_are_different_sections(tmp_path: Path) -> None:
    one = evaluate(tmp_path / "a", "coco")
    two = evaluate(tmp_path / "b", "coco", seed=2)
    three = evaluate(tmp_path / "a", "lvis")
    keys = [s.key for s in document_of(three, one, two, one).sections]
    assert keys == ["coco", "coco-2", "lvis"]


def test_a_task_that_no_page_shows_is_refused_in_a_line(
    both: tuple[Path, Path], tmp_path: Path
) -> None:
    folder = tmp_path / "evals" / "dance"
    folder.mkdir(parents=True)
    (folder / "summary.json").write_text('{"schema_version": 1, "task": "dance", "cases": []}')
    (folder / "evidence.json").write_text('{"kind": "evaluation", "task": "dance"}')
    with pytest.raises(ReportInputError, match=r"dance cannot be shown in a report"):
        read_sources([both[0], folder])
    assert cli.run(["report", str(folder), "-o", str(tmp_path / "r.html")]) == 2
