"""`report.html`: a run on one page that needs nothing else, for people who were not there."""

import base64
import math
from html import escape
from pathlib import Path

from dlokit.app.report import action_figures, figures
from dlokit.app.shape.outcome_words import outcome_in_words
from dlokit.app.shape.terminal import grip_in_words
from dlokit.decision.steps.act import NOT_WORTH_IT
from dlokit.system.results.run_record import RunRecord
from dlokit.system.results.run_result import ActionResult, CorrectionResult
from dlokit.types.arrays import UInt8Array
from dlokit.types.feasibility import GoalVerdict, Release, Standing
from dlokit.types.flow import RunOutcome

CSS = """
:root {
  color-scheme: light dark;
  --page: #f6f7f9; --card: #ffffff; --ink: #1b2230; --muted: #5d6778; --grid: #d9dee6; --table: #f3efe6;
  --goal: #12995a; --start: #8a93a3; --final: #1f5fd6; --step: #7fa6ec; --truth: #c2680c;
  --good: #0d7a45; --good-soft: #e2f5ea; --bad: #a8430f; --bad-soft: #fdeee4;
}
@media (prefers-color-scheme: dark) {
  :root {
    --page: #11151c; --card: #1a202b; --ink: #e7ebf2; --muted: #9aa5b6; --grid: #333d4d; --table: #222a36;
    --goal: #35c27f; --start: #8b95a7; --final: #6aa0ff; --step: #6d93d2; --truth: #f0a04b;
    --good: #58d69a; --good-soft: #15362a; --bad: #f4a36f; --bad-soft: #3d2518;
  }
}
* { box-sizing: border-box; }
body { margin: 0; background: var(--page); color: var(--ink);
  font: 15px/1.5 system-ui, -apple-system, "Segoe UI", Roboto, "Helvetica Neue", Arial, sans-serif; }
main { max-width: 1180px; margin: 0 auto; padding: 28px 20px 60px; }
header { display: flex; flex-wrap: wrap; gap: 8px 16px; align-items: baseline; margin-bottom: 4px; }
h1 { font-size: 26px; margin: 0; letter-spacing: -0.01em; }
h2 { font-size: 16px; margin: 0 0 10px; }
.badge { border-radius: 999px; padding: 3px 12px; font-weight: 600; font-size: 14px; }
.badge.good { color: var(--good); background: var(--good-soft); }
.badge.bad { color: var(--bad); background: var(--bad-soft); }
.words { color: var(--muted); margin: 0 0 18px; max-width: 80ch; }
.cards { display: grid; grid-template-columns: repeat(auto-fit, minmax(150px, 1fr)); gap: 12px; margin-bottom: 16px; }
.card, section { background: var(--card); border: 1px solid var(--grid); border-radius: 10px; }
.card { padding: 12px 14px; }
.card b { display: block; font-size: 22px; font-variant-numeric: tabular-nums; }
.card span { color: var(--muted); font-size: 13px; }
.columns { display: grid; grid-template-columns: repeat(auto-fit, minmax(min(480px, 100%), 1fr)); gap: 16px; }
section { padding: 16px 18px; margin-bottom: 16px; min-width: 0; }
svg { width: 100%; height: auto; display: block;
  font-family: system-ui, -apple-system, "Segoe UI", Roboto, "Helvetica Neue", Arial, sans-serif; }
figure { margin: 0; } figure img { width: 100%; border-radius: 6px; display: block; }
figcaption { color: var(--muted); font-size: 13px; margin-top: 6px; }
.columns > * { min-width: 0; }
/* A plot scaled to a telephone cannot be read: there it keeps its size, and its section scrolls. */
@media (max-width: 600px) { section { overflow-x: auto; padding: 12px; } section svg { width: 720px; } }
.scroll { overflow-x: auto; }
table { border-collapse: collapse; width: 100%; font-variant-numeric: tabular-nums; }
th, td { text-align: right; padding: 5px 10px; border-bottom: 1px solid var(--grid); white-space: nowrap; }
th:first-child, td:first-child, td.text { text-align: left; }
th { color: var(--muted); font-weight: 600; font-size: 13px; }
tr.met td:not(.no) { color: var(--good); font-weight: 600; }
td.no { color: var(--bad); }
pre { margin: 0; padding: 12px; overflow-x: auto; font-size: 12.5px; background: var(--page); border-radius: 6px; }
details { margin-top: 12px; }
details summary { cursor: pointer; font-weight: 600; }
details[open] summary { margin-bottom: 10px; }
.empty { color: var(--muted); }
@media print { body { background: none; } section, .card { break-inside: avoid; } }
"""


def expected_section(record: RunRecord) -> str:
    """Expected against achieved, as shapes and as errors; empty where no action was predicted."""
    if not any(action.expected_world is not None for action in record.actions):
        return ""
    views, errors = action_figures.expected_shapes(record), action_figures.expected_errors(record)
    return (
        '<div class="columns">'
        f"<section><h2>Expected and achieved, action by action</h2>{views}</section>"
        f"<section><h2>Expected against achieved error</h2>{errors}</section></div>"
    )


def verdict_section(record: RunRecord) -> str:
    """The verdict, each trial, and where the DLO came to rest; empty when no goal was judged."""
    verdict = record.verdict
    if verdict is None:
        return ""
    kind = "good" if verdict.standing is Standing.HOLDS else "bad"
    rows = "".join(_row(release) for release in verdict.releases)
    heads = ("EI / (μ w)", "springs back, RMSE", "farthest", "at node")
    head = "".join(f"<th>{text}</th>" for text in heads)
    table = (
        f'<div class="scroll"><table><thead><tr>{head}</tr></thead><tbody>{rows}</tbody></table></div>'
        if rows
        else '<p class="empty">It was not released in the model: it would lie across itself.</p>'
    )
    return (
        f'<section><h2>Can the goal hold? <span class="badge {kind}">{verdict.standing.value}</span></h2>'
        f'<p class="words">{escape(verdict.text)}{_instead(record)}</p>'
        f'<div class="columns"><div>{table}</div>{_figure(verdict)}</div></section>'
    )


def _instead(record: RunRecord) -> str:
    result = record.result.goal_verdict
    if result is None or not result.projected or result.asked_rmse_m is None:
        return ""
    return (
        " The run went for that shape; all other figures here are to it. The rope ended "
        f"{result.asked_rmse_m * 1000:.1f} mm (RMSE) from the goal that was asked for."
    )


def _row(release: Release) -> str:
    return (
        f"<tr><td>{release.elastic_factor:.2f} ×</td>"
        f"<td>{release.rmse_m * 1000:.1f} mm</td><td>{release.largest_m * 1000:.1f} mm</td><td>{release.node}</td></tr>"
    )


def _figure(verdict: GoalVerdict) -> str:
    if verdict.standing is Standing.HOLDS:
        return ""
    return f"<div>{figures.spring_back(verdict)}</div>"


_HEADS = ("action", "no.", "moved", "turned", "before", "predicted", "seen")


def control_section(record: RunRecord) -> str:
    """Every correction with the errors before and after it, and where there was none why; empty without control."""
    controlled = [row for row in record.result.history if row.control_end]
    if not controlled:
        return ""
    rows = "".join(_rows(row) for row in controlled)
    head = "".join(f"<th>{text}</th>" for text in _HEADS)
    table = f'<div class="scroll"><table><thead><tr>{head}</tr></thead><tbody>{rows}</tbody></table></div>'
    words = '<p class="words">What the tool moved, and the error to expect if the DLO were let go.</p>'
    figure = action_figures.control_errors(record) if any(row.corrections for row in controlled) else ""
    return (
        f"<section><h2>Control while the DLO was held</h2>{words}"
        f'<div class="columns"><div>{table}</div><div>{figure}</div></div></section>'
    )


def _rows(row: ActionResult) -> str:
    corrections = "".join(
        _correction_row(row.action, number, done) for number, done in enumerate(row.corrections, start=1)
    )
    why = escape((row.control_end or "").replace("_", " "))
    how = "planned alone, control was" if row.control_end == NOT_WORTH_IT else "ended:"
    return f'{corrections}<tr><td>{row.action}</td><td class="text" colspan="{len(_HEADS) - 1}">{how} {why}</td></tr>'


def _correction_row(action: int, number: int, done: CorrectionResult) -> str:
    moved_m = math.hypot(done.x_m, done.y_m, done.z_m)
    return (
        f"<tr><td>{action}</td><td>{number}</td><td>{_mm(moved_m)}</td><td>{math.degrees(done.yaw_rad):.1f}°</td>"
        f"<td>{_mm(done.before_m)}</td><td>{_mm(done.predicted_m)}</td><td>{_mm(done.seen_m)}</td></tr>"
    )


def _mm(value_m: float | None) -> str:
    return "–" if value_m is None else f"{value_m * 1000:.1f} mm"


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
        f"<section><h2>Shapes on the table, from above</h2>{figures.overlay(record)}</section>"
        f"<section><h2>Error against actions</h2>{figures.error_curve(record)}</section></div>"
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
    data = base64.b64encode(figures.picture_jpeg(image)).decode("ascii")
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
        if timing.sim_time_s + timing.wall_time_s < figures.QUICK_S
    ]
    note = f'<p class="empty">Below {figures.QUICK_S} s in all: {escape(", ".join(quick))}.</p>' if quick else ""
    bars = figures.timing_bars(record.timings)
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
