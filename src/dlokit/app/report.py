"""`report.html`: a run on one page that needs nothing else, for people who were not there."""

import base64
from html import escape
from pathlib import Path

from dlokit.app import report_figures
from dlokit.app.outcome_words import outcome_in_words
from dlokit.app.report_actions import expected_section
from dlokit.app.report_control import control_section
from dlokit.app.report_style import CSS
from dlokit.app.report_verdict import verdict_section
from dlokit.app.terminal import grip_in_words
from dlokit.system.run_record import RunRecord
from dlokit.system.run_result import ActionResult
from dlokit.types.arrays import UInt8Array
from dlokit.types.flow import RunOutcome

FILE_NAME = "report.html"


def write_report(folder: Path, record: RunRecord) -> Path:
    """Write `report.html` into a run's folder and return its path."""
    path = folder / FILE_NAME
    path.write_text(report_html(record), encoding="utf-8")
    return path


def report_html(record: RunRecord) -> str:
    """The page: styles, figures and pictures are inside it, and there is no script."""
    name = escape(record.name)
    return "\n".join(
        [
            "<!doctype html>",
            f'<html lang="en"><head><meta charset="utf-8"><title>{name}: dlokit run</title>',
            '<meta name="viewport" content="width=device-width, initial-scale=1">',
            f"<style>{CSS}</style></head><body><main>",
            _head(record),
            verdict_section(record),
            _figures(record),
            _pictures(record),
            _actions(record),
            expected_section(record),
            control_section(record),
            _timings(record),
            _setup(record),
            "</main></body></html>\n",
        ]
    )


def _head(record: RunRecord) -> str:
    result = record.result
    kind = "good" if result.outcome is RunOutcome.CONVERGED else "bad"
    pace = result.sim_time_s / result.wall_time_s if result.wall_time_s > 0.0 else 0.0
    cards = [
        (_millimetres(result.rmse_m), "RMSE to the goal, estimated"),
        (_millimetres(result.true_rmse_m), "RMSE, true, 2 s after release"),
        (f"{result.threshold_m * 1000:.4g} mm", "threshold"),
        (str(result.actions), "actions"),
        (f"{result.sim_time_s:.0f} s", "on the cell's clock"),
        (f"{result.wall_time_s:.0f} s", f"wall time ({pace:.1f}× real time)"),
    ]
    items = "".join(f'<div class="card"><b>{value}</b><span>{label}</span></div>' for value, label in cards)
    return (
        f'<header><h1>{escape(record.name)}</h1><span class="badge {kind}">{result.outcome.value}</span></header>'
        f'<p class="words">{escape(outcome_in_words(result))}</p><div class="cards">{items}</div>{_camera(record)}'
    )


def _camera(record: RunRecord) -> str:
    """What was said of the camera's place."""
    said = record.result.camera
    return "" if said is None else f'<p class="words">{escape(said.text[:1].upper() + said.text[1:])}.</p>'


def _figures(record: RunRecord) -> str:
    return (
        '<div class="columns">'
        f"<section><h2>Shapes on the table, from above</h2>{report_figures.overlay(record)}</section>"
        f"<section><h2>Error against actions</h2>{report_figures.error_curve(record)}</section></div>"
    )


def _pictures(record: RunRecord) -> str:
    pairs = [("Before", record.image_before), ("After", record.image_after)]
    figures = "".join(
        f"<section><h2>{title}</h2>{_picture(image, f'{title} the run, left camera')}</section>"
        for title, image in pairs
    )
    return f'<div class="columns">{figures}</div>'


def _picture(image: UInt8Array | None, caption: str) -> str:
    if image is None:
        return '<p class="empty">No picture was taken.</p>'
    data = base64.b64encode(report_figures.picture_jpeg(image)).decode("ascii")
    return (
        f'<figure><img alt="{caption}" src="data:image/jpeg;base64,{data}"><figcaption>{caption}</figcaption></figure>'
    )


def _actions(record: RunRecord) -> str:
    result = record.result
    if not result.history:
        return '<section><h2>Actions</h2><p class="empty">The run ended without any action.</p></section>'
    rows = "".join(_action_row(row, result.threshold_m) for row in result.history)
    heads = ("action", "kind", "grasp node", "grasp", "expected RMSE", "RMSE after", "true RMSE after", "duration")
    head = "".join(f"<th>{text}</th>" for text in heads)
    return (
        '<section><h2>Actions</h2><div class="scroll"><table>'
        f"<thead><tr>{head}</tr></thead><tbody>{rows}</tbody></table></div></section>"
    )


def _action_row(row: ActionResult, threshold_m: float) -> str:
    grip = grip_in_words(row)
    kind = ' class="met"' if row.rmse_m < threshold_m else ""
    cells = (
        f"<td>{row.action}</td><td>{escape(row.kind)}</td><td>{row.grasp_node}</td>",
        f"<td>{grip}</td>" if grip in ("held", "pushed") else f'<td class="no">{escape(grip)}</td>',
        f"<td>{_millimetres(row.predicted_rmse_m)}</td>",
        f"<td>{_millimetres(row.rmse_m)}</td><td>{_millimetres(row.true_rmse_m)}</td>",
        f"<td>{row.duration_s:.1f} s</td>",
    )
    return f"<tr{kind}>{''.join(cells)}</tr>"


def _timings(record: RunRecord) -> str:
    if not record.timings:
        return ""
    quick = [
        f"{name.replace('_', ' ')} ({timing.calls}×)"
        for name, timing in record.timings.items()
        if timing.sim_time_s + timing.wall_time_s < report_figures.QUICK_S
    ]
    note = f'<p class="empty">Below {report_figures.QUICK_S} s in all: {escape(", ".join(quick))}.</p>' if quick else ""
    bars = report_figures.timing_bars(record.timings)
    return f"<section><h2>Time by step of the flow</h2>{bars}{note}</section>"


def _setup(record: RunRecord) -> str:
    result = record.result
    facts = {
        "dlokit": result.version,
        "seed": str(result.seed),
        "configuration": result.config_hash,
        "planning time": f"{result.planning_time_s:.2f} s",
        **record.machine,
    }
    rows = "".join(f"<tr><td>{escape(key)}</td><td>{escape(value)}</td></tr>" for key, value in facts.items())
    command = f"<h2>Run it again</h2><pre>{escape(record.command)}</pre>" if record.command else ""
    config = '<p class="empty">No configuration was recorded.</p>'
    if record.config_toml:
        title = "The whole configuration (config.toml)"
        config = f"<details><summary>{title}</summary><pre>{escape(record.config_toml)}</pre></details>"
    return (
        f'<div class="columns"><section><h2>Set-up</h2><div class="scroll"><table>{rows}</table></div></section>'
        f"<section>{command}{config}</section></div>"
    )


def _millimetres(value_m: float | None) -> str:
    return "–" if value_m is None else f"{value_m * 1000:.1f} mm"
