"""The part of a report that says whether the goal could hold, and how far it springs back where it does not."""

from html import escape

from dlokit.app import report_figures
from dlokit.system.run_record import RunRecord
from dlokit.types.feasibility import GoalVerdict, Release, Standing


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
    return f"<div>{report_figures.spring_back(verdict)}</div>"
