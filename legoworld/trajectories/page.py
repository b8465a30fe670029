"""A trial in lines, and trials as one page to scrub through."""

from __future__ import annotations

import base64
import json
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Final

import cv2
import numpy as np
from jinja2 import Environment, FileSystemLoader, select_autoescape
from markupsafe import Markup
from msgspec.structs import replace

from legoworld.errors import LegoWorldError
from legoworld.evaluation.reconstruction.judge_pairs import (
    SUBMITTED,
    TrajectoryScoresError,
    read_trajectories,
    trial_name,
)
from legoworld.files import write_text
from legoworld.readouts.pictures import read_photo
from legoworld.records.base import as_json
from legoworld.records.bench_results import JudgePair
from legoworld.records.evaluation import Interval
from legoworld.records.trajectories import (
    AgentTable,
    PageStep,
    PageTrial,
    ScoredScene,
    TrajectoryFile,
    TrajectoryScore,
)
from legoworld.report.page_file import THREE
from legoworld.report.page_script import SCRIPTS, page_script
from legoworld.report.photos import find_photo
from legoworld.report.scene_files import SceneFiles
from legoworld.scene.folder import GLB, PICTURE
from legoworld.scene.pictures import MOST_PHOTO_PX, MOST_PX
from legoworld.tables.html import html
from legoworld.tables.table import Cell, Number, Table, table
from legoworld.trajectories.curves import drops, moments
from legoworld.trajectories.folder import RecordedTrial
from legoworld.trajectories.score_checkpoints import slot_folder, tokens_until
from legoworld.version import __version__

_PAGE: Final = Path(__file__).with_name("page")
_LONGEST_PX: Final = 480
_CODE_CHARACTERS: Final = 6000


def calls_table(trial: RecordedTrial, score: TrajectoryScore | None) -> Table:
    """One row a call: number, seconds, command, status, checkpoint, Q, and what it said."""
    q = _scenes_by_call(score)
    rows = [
        (
            call.number,
            Number(value=call.at_s, digits=1),
            call.command,
            call.status,
            call.checkpoint or "",
            Number(value=q[call.number].Q) if call.number in q else "",
            call.said[:60],
        )
        for call in trial.calls
    ]
    return table(["call", "s", "command", "status", "checkpoint", "Q", "said"], rows)


def read_scores(folder: Path | None) -> TrajectoryFile | None:
    """`read_trajectories`; None without a folder."""
    return None if folder is None else read_trajectories(folder)


def find_score(scores: TrajectoryFile | None, trial: RecordedTrial) -> TrajectoryScore | None:
    """The score with a trial's image, agent and ending."""
    about = trial.about
    matching = [
        score
        for score in (scores.trials if scores else ())
        if (score.scene, score.agent, score.seconds)
        == (about.scene, about.agent, about.agent_seconds)
    ]
    return matching[0] if matching else None


def with_renders(
    pairs: Sequence[JudgePair], trials: Sequence[RecordedTrial], scores: Path
) -> list[JudgePair]:
    """Pairs with the evaluator's pictures of their scenes, which A was measured on.

    TrajectoryScoresError for a pair of a trial that is not given.
    """
    document, folders = read_trajectories(scores), {}
    for trial in trials:
        if score := find_score(document, trial):
            places = {
                str(c.ordinal): slot_folder(scores, trial, n) for n, c in enumerate(trial.live)
            }
            places[SUBMITTED] = slot_folder(scores, trial, None)
            picture = f"run/render/{trial.about.scene}.png"
            folders[trial_name(score)] = {
                name: (place.parent / picture).relative_to(scores).as_posix()
                for name, place in places.items()
            }
    missing = [pair.item for pair in pairs if pair.item not in folders]
    if missing:
        raise TrajectoryScoresError(
            f"{scores} has scores of a trial that is not below SCENES",
            found=missing[0],
            expected="the folders that were scored",
        )
    return [
        replace(pair, renders=(of_trial[pair.shown[0]], of_trial[pair.shown[1]]))
        for pair in pairs
        for of_trial in [folders[pair.item]]
    ]


def write_page(
    trials: Sequence[RecordedTrial],
    path: Path,
    *,
    photos: Path | None,
    scores: Path | None,
    report: str = "",
) -> None:
    """One HTML file: for each trial the photo, the render, Q and the code of every step.

    Renders are those of the scored checkpoints; without scores there is the submission's alone.
    report: the address of a report's page, for a link from each trial.
    """
    document = read_scores(scores)
    files = SceneFiles(folders=())
    shown = [_trial(trial, find_score(document, trial), photos, scores, files) for trial in trials]
    environment = Environment(
        loader=FileSystemLoader(_PAGE), autoescape=select_autoescape(default=True)
    )
    page = environment.get_template("page.html").render(
        data=json.dumps(as_json(shown)).replace("<", "\\u003c"),
        tables=[Markup(html(table)) for table in _tables(document)],
        style=Markup((SCRIPTS / "report.css").read_text(encoding="utf-8")),
        report=report,
        three=Markup((SCRIPTS / THREE).read_text(encoding="utf-8")) if files.glbs else "",
        in_3d=Markup(page_script("scene3d.js")) if files.glbs else "",
        glbs=[base64.b64encode(glb).decode("ascii") for glb in files.glbs],
        version=__version__,
    )
    write_text(path, page)


def _trial(
    trial: RecordedTrial,
    score: TrajectoryScore | None,
    photos: Path | None,
    scores: Path | None,
    files: SceneFiles,
) -> PageTrial:
    about = trial.about
    lowered = {edit.call: edit for edit in (drops(score) if score else ())}
    scenes = _scenes_by_call(score)
    steps: list[PageStep] = []
    render, shown = None, None
    numbers = {checkpoint.call: n for n, checkpoint in enumerate(trial.live)}
    whens = moments(
        [call.at_s + call.seconds for call in trial.calls],
        [call.number for call in trial.calls],
        seconds=about.agent_seconds,
        n_calls=len(trial.calls),
        tokens=tokens_until(trial.trajectory),
    )
    for call, when in zip(trial.calls, whens, strict=True):
        if call.number in numbers and scores is not None:
            folder = slot_folder(scores, trial, numbers[call.number])
            render = _picture(folder / about.scene / PICTURE)
            shown = call.number
        scene, edit = scenes.get(call.number), lowered.get(call.number)
        steps.append(
            PageStep(
                number=call.number,
                at_s=call.at_s,
                command=call.command,
                status=call.status,
                code=(call.code or "")[:_CODE_CHARACTERS],
                said=call.said,
                Q=scene.Q if scene else None,
                R=scene.R if scene else None,
                A=scene.A if scene else None,
                reason=scene.reason if scene else "",
                drop=_worst(edit.cause) if edit else None,
                lost=edit.d_q if edit else None,
                shares=(when.calls_share, when.wall_share, when.tokens_share),
                render=render,
                shown=shown,
            )
        )
    found = None if photos is None else find_photo(photos, about.file_name)
    photo = None if found is None else _picture(found, MOST_PHOTO_PX)
    glb_file = trial.folder / GLB
    glb, said = files.add_glb(glb_file) if glb_file.is_file() else (None, f"there is no {GLB}")
    return PageTrial(
        scene=about.scene,
        agent=about.agent,
        status=about.status,
        ended=about.ended,
        seconds=about.agent_seconds,
        photo=photo,
        final=_picture(trial.folder / PICTURE),
        glb=glb,
        glb_said=said,
        final_q=score.final_q if score else None,
        regret=score.regret if score else None,
        steps=tuple(steps),
    )


def _scenes_by_call(score: TrajectoryScore | None) -> dict[int, ScoredScene]:
    """The scored checkpoint that a call left, by the call."""
    return {s.call: s for s in score.scenes if s.ordinal is not None} if score else {}


def _worst(cause: Mapping[str, float]) -> str:
    return min(cause, key=lambda name: cause[name])


def _tables(document: TrajectoryFile | None) -> list[Table]:
    if document is None:
        return []
    named = [agents_table(document.agents, title="All images")]
    if document.common is not None:
        title = f"The {len(document.common_images)} common images"
        named.append(agents_table(document.common, title=title))
    return named


def _picture(path: Path, most_px: int = MOST_PX) -> str | None:
    """A picture as a data URL, at most `_LONGEST_PX` long; None where there is none."""
    if not path.is_file():
        return None
    try:
        picture = read_photo(path, most_px=most_px)
    except (LegoWorldError, OSError):
        return None
    height, width = picture.shape[:2]
    shrink = min(1.0, _LONGEST_PX / max(height, width))
    size = max(1, round(width * shrink)), max(1, round(height * shrink))
    small = cv2.resize(picture, size, interpolation=cv2.INTER_AREA).astype(np.uint8)
    done, data = cv2.imencode(".webp", small[:, :, ::-1], [cv2.IMWRITE_WEBP_QUALITY, 75])
    return "data:image/webp;base64," + base64.b64encode(data.tobytes()).decode() if done else None


def agents_table(agents: Sequence[AgentTable], *, title: str = "") -> Table:
    """The means of agents side by side, one row a measure."""
    rows: list[list[Cell]] = [
        [name, *(_number(agent.means[name].value, agent.means[name].interval) for agent in agents)]
        for name in (agents[0].means if agents else ())
    ]
    return table(["mean over trials", *(agent.agent for agent in agents)], rows, title=title)


def _number(value: float | None, interval: Interval | None) -> Number:
    return Number(value=value, ends=interval.ends if interval else None, digits=3)


def final_scores(document: TrajectoryFile) -> Callable[[str, int | None], float | None]:
    """Q of a scene's checkpoint, or of its submission for None; None where it has none."""
    known = {
        (trial.scene, scene.ordinal): scene.Q or 0.0
        for trial in document.trials
        for scene in trial.scenes
    }
    return lambda scene, ordinal: known.get((scene, ordinal))
