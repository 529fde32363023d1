"""The part of a report on control: what was corrected while the DLO was held, and what came of it."""

import math
from html import escape

from dlokit.app import report_action_figures
from dlokit.decision.steps.choosing_control import NOT_WORTH_IT
from dlokit.system.run_record import RunRecord
from dlokit.system.run_result import ActionResult, CorrectionResult

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
    figure = report_action_figures.control_errors(record) if any(row.corrections for row in controlled) else ""
    return (
        f"<section><h2>Control while the DLO was held</h2>{words}"
        f'<div class="columns"><div>{table}</div><div>{figure}</div></div></section>'
    )


def _rows(row: ActionResult) -> str:
    corrections = "".join(_row(row.action, number, done) for number, done in enumerate(row.corrections, start=1))
    why = escape((row.control_end or "").replace("_", " "))
    how = "planned alone, control was" if row.control_end == NOT_WORTH_IT else "ended:"
    return f'{corrections}<tr><td>{row.action}</td><td class="text" colspan="{len(_HEADS) - 1}">{how} {why}</td></tr>'


def _row(action: int, number: int, done: CorrectionResult) -> str:
    moved_m = math.hypot(done.x_m, done.y_m, done.z_m)
    return (
        f"<tr><td>{action}</td><td>{number}</td><td>{_mm(moved_m)}</td><td>{math.degrees(done.yaw_rad):.1f}°</td>"
        f"<td>{_mm(done.before_m)}</td><td>{_mm(done.predicted_m)}</td><td>{_mm(done.seen_m)}</td></tr>"
    )


def _mm(value_m: float | None) -> str:
    return "–" if value_m is None else f"{value_m * 1000:.1f} mm"
