"""`report.html`: a self-contained page about one run.

This module prepares the content of `templates/report.html`.
"""

import base64
import math
from collections.abc import Callable
from datetime import timedelta
from functools import cache
from pathlib import Path

import jinja2
from markupsafe import Markup

from dlokit.app.report import figures
from dlokit.app.shape.outcome_text import (
    ACTION_COLUMNS,
    NONE,
    explain_outcome,
    explain_recoveries,
    millimetres,
    when_true,
)
from dlokit.decision.records import CorrectionRecord
from dlokit.decision.steps.act import NOT_WORTH_IT
from dlokit.recording.disk import write_synced
from dlokit.recording.views import to_jpeg
from dlokit.system.results.run_result import REPORT_FILE, RunRecord
from dlokit.types.arrays import UInt8Array
from dlokit.types.feasibility import Standing
from dlokit.types.passing import TURNS, Passing, PostPassing, SideAnswer

FILE_NAME = REPORT_FILE


def write_report(folder: Path, page: str) -> Path:
    """Write a page as `report.html` into a run's folder and return its path. Raises `OSError`."""
    path = folder / FILE_NAME
    write_synced(path, page.encode())
    return path


def report_html(record: RunRecord) -> str:
    """The page as HTML, with styles, figures and pictures embedded and without scripts."""
    result = record.result
    return _page().render(
        record=record,
        title=_title(record),
        ran=_ran(record),
        result=result,
        converged=result.outcome.is_success,
        outcome=explain_outcome(result),
        when_true=when_true(result),
        recoveries=explain_recoveries(result),
        pace=result.sim_time_s / result.wall_time_s if result.wall_time_s > 0.0 else 0.0,
        projected_mm=_projected(record),
        figures=_figures(record),
        pictures=[("before", _picture(record.image_before)), ("after", _picture(record.image_after))],
        columns=ACTION_COLUMNS,
        passed=_passed(result.passing),
        truly_passed=_passed(result.true_passing),
        turns={**TURNS, 0: NONE},
        controlled=[row for row in result.history if row.control_end],
        not_worth_it=NOT_WORTH_IT,
        quick=_quick_steps(record),
        quick_s=figures.QUICK_S,
        machine={
            **record.machine,
            "dlokit": result.version,
            "seed": result.seed,
            "configuration": result.config_hash,
            "planning time": f"{result.planning_time_s:.2f} s",
        },
    )


@cache
def _page() -> jinja2.Template:
    page = jinja2.Environment(
        loader=jinja2.PackageLoader("dlokit.app.report"),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    filters: dict[str, Callable[..., object]] = {
        "mm": millimetres,
        "moved_m": _moved_m,
        "degrees": math.degrees,
        "words": _words,
    }
    page.filters |= filters
    return page.get_template("report.html")


def _figures(record: RunRecord) -> dict[str, Markup | None]:
    """The figures as SVG, by name; None for figures that do not apply to this run."""
    history, verdict = record.result.history, record.verdict
    predicted = any(action.expected_world is not None for action in record.actions)
    springs = verdict is not None and verdict.standing is not Standing.HOLDS
    corrected = any(row.control_end and row.corrections for row in history)
    drawn = {
        "overlay": figures.overlay(record),
        "error_curve": figures.error_curve(record) if history or record.result.start_rmse_m is not None else None,
        "spring_back": figures.spring_back(verdict, record.fixtures) if verdict is not None and springs else None,
        "expected_shapes": figures.expected_shapes(record) if predicted else None,
        "expected_errors": figures.expected_errors(record) if predicted else None,
        "control_errors": figures.control_errors(record) if corrected else None,
        "timing_bars": figures.timing_bars(record.timings) if record.timings else None,
    }
    # Markup is not escaped, because Matplotlib has escaped the texts of its SVG.
    return {name: None if svg is None else Markup(svg) for name, svg in drawn.items()}


def _passed(found: Passing | None) -> dict[str, tuple[PostPassing, SideAnswer | None]]:
    """How each post is passed, and the answer to the wish, by the post's name."""
    posts = () if found is None else (one for one in found.fixtures if isinstance(one, PostPassing))
    answers = {} if found is None else {one.name: one for one in found.answers}
    return {one.name: (one, answers.get(one.name)) for one in posts}


def _title(record: RunRecord) -> str:
    """The name of the run; of one that takes several tasks, the task and its goal."""
    result = record.result
    if result.task is None:
        return record.name
    task = f"to {result.goal}" if result.goal else "no goal"
    if not result.tasks:
        return f"Task {result.task}: {task}"
    return f"{record.name}: task {result.task} of {len(result.tasks)}, {task}"


def _ran(record: RunRecord) -> str:
    """When the task ran, e.g. ``"2026-11-29, 16:41:02 to 16:42:05"``; empty where it is not known."""
    if record.began is None:
        return ""
    ended = record.began + timedelta(seconds=record.result.wall_time_s)
    return f"{record.began:%Y-%m-%d, %H:%M:%S} to {ended:%H:%M:%S}"


def _projected(record: RunRecord) -> str | None:
    """Error to the requested goal at the end of a run that pursued the nearest feasible shape instead."""
    result = record.result.goal_verdict
    if record.verdict is None or result is None or not result.projected or result.asked_rmse_m is None:
        return None
    return millimetres(result.asked_rmse_m)


def _picture(image: UInt8Array | None) -> str | None:
    # Camera noise would make a PNG seven times as large.
    return None if image is None else base64.b64encode(to_jpeg(image)).decode("ascii")


def _quick_steps(record: RunRecord) -> list[str]:
    return [
        f"{_words(name)} ({timing.calls}×)"
        for name, timing in record.timings.items()
        if timing.sim_time_s + timing.wall_time_s < figures.QUICK_S
    ]


def _moved_m(done: CorrectionRecord) -> float:
    return math.hypot(done.x_m, done.y_m, done.z_m)


def _words(name: str) -> str:
    return name.replace("_", " ")
