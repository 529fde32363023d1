"""Figures of a report that compare the expected with the achieved result of each action, as inline SVG."""

import math
from collections.abc import Sequence

from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from dlokit.app.report.drawing import (
    FINAL,
    FONT_PT,
    GOAL,
    GRID,
    INK,
    MUTED,
    TRUTH,
    as_svg,
    clear,
    draw_goal,
    draw_rope,
    draw_table,
    new_figure,
)
from dlokit.decision.records import ActionRecord
from dlokit.system.results.run_record import RunRecord
from dlokit.system.results.run_result import ActionResult
from dlokit.types.arrays import Float64Array

_MOST_VIEWS = 12
_WIDTH_IN = 7.4
_TALLER = 1.5  # ratio of the height of a table view to its width


def expected_shapes(record: RunRecord) -> str:
    """One small table view per action: expected and achieved shape, the goal and the path of the tool."""
    shown = record.actions[-_MOST_VIEWS:]
    rows = record.result.history[-len(shown) :]
    across = views_across(len(shown))
    down = math.ceil(len(shown) / across)
    # A single view would be taller than the figure beside it.
    height_in = 0.5 + down * min(5.7, 0.3 + _TALLER * _WIDTH_IN / across)
    figure = Figure(figsize=(_WIDTH_IN, height_in), layout="constrained")
    FigureCanvasSVG(figure)
    figure.patch.set_alpha(0.0)
    views = [figure.add_subplot(down, across, place) for place in range(1, len(shown) + 1)]
    for view, action, row in zip(views, shown, rows, strict=True):
        _view(view, record.goal_nodes_world, action, row)
    handles, labels = _named_once(views)
    figure.legend(
        handles, labels, loc="outside upper center", ncols=4, frameon=False, labelcolor=INK, fontsize=FONT_PT - 1
    )
    return as_svg(figure, "Expected and achieved shape of each action, from above")


def views_across(count: int) -> int:
    """Number of views in a row: a few large ones, or many small ones that fit the page."""
    if count <= 3:
        return max(1, count)
    return 3 if count <= 6 else 4


def _view(axes: Axes, goal_world: Float64Array, action: ActionRecord, row: ActionResult) -> None:
    """Draw one action: shapes and path on the table."""
    clear(axes)
    draw_table(axes)
    draw_goal(axes, goal_world, width=6.0, alpha=0.3)
    if action.path_world is not None:
        axes.plot(*action.path_world[:, :2].T, color=MUTED, linewidth=1.2, linestyle=":", label="tool")
    if action.expected_world is not None:
        draw_rope(axes, action.expected_world, TRUTH, 1.5, "expected", dashed=True)
    draw_rope(axes, action.nodes_world, FINAL, 2.0, "achieved")
    axes.set_xlabel("")
    axes.set_ylabel("")
    # The large view above has the axis labels.
    axes.tick_params(labelbottom=False, labelleft=False, length=0)
    axes.spines[:].set_visible(False)
    axes.set_title(f"{row.action}: {row.kind}", color=INK, fontsize=FONT_PT)


def _named_once(views: Sequence[Axes]) -> tuple[list[Artist], list[str]]:
    """The legend entries of all views, without duplicates."""
    named: dict[str, Artist] = {}
    for view in views:
        for handle, label in zip(*view.get_legend_handles_labels(), strict=True):
            named.setdefault(str(label), handle)
    return list(named.values()), list(named)


def expected_errors(record: RunRecord) -> str:
    """Expected versus achieved RMSE of each action, as SVG."""
    figure, axes = new_figure(_WIDTH_IN, 6.2)
    pairs = [
        (row.predicted_rmse_m * 1000.0, row.rmse_m * 1000.0, str(row.action))
        for row in record.result.history
        if row.predicted_rmse_m is not None
    ]
    top = 1.1 * max([1.0, *(max(expected, reached) for expected, reached, _ in pairs)])
    axes.plot((0.0, top), (0.0, top), color=GRID, linewidth=1.5, label="as expected")
    axes.plot(
        [pair[0] for pair in pairs],
        [pair[1] for pair in pairs],
        color=FINAL,
        linestyle="none",
        marker="o",
        label="an action, with its number",
    )
    for expected, reached, name in pairs:
        axes.annotate(name, (expected, reached), (6, 4), textcoords="offset points", color=INK, fontsize=FONT_PT - 1)
    axes.set_xlim(0.0, top)
    axes.set_ylim(0.0, top)
    axes.set_xlabel("expected RMSE [mm]")
    axes.set_ylabel("achieved RMSE [mm]")
    figure.legend(loc="outside upper center", ncols=2, frameon=False, labelcolor=INK, fontsize=FONT_PT - 1)
    return as_svg(figure, "Expected against achieved error of each action")


def control_errors(record: RunRecord) -> str:
    """The RMSE after each correction, predicted and observed, for each action, as SVG."""
    figure, axes = new_figure(_WIDTH_IN, 4.0)
    threshold_mm = record.result.threshold_m * 1000.0
    axes.axhline(threshold_mm, color=GOAL, linewidth=1.5, linestyle=(0, (5, 3)), label="threshold")
    first = 0
    for row in (row for row in record.result.history if row.corrections):
        places = range(first, first + len(row.corrections) + 1)
        seen = [row.corrections[0].before_m, *(done.seen_m for done in row.corrections)]
        known = [(place, value * 1000.0) for place, value in zip(places, seen, strict=True) if value is not None]
        promised = [(place, done.predicted_m * 1000.0) for place, done in zip(places[1:], row.corrections, strict=True)]
        label = "_nolegend_" if first else ""
        axes.plot(*zip(*known, strict=True), color=FINAL, linewidth=2.0, marker="o", label=label or "seen")
        axes.plot(
            *zip(*promised, strict=True),
            color=TRUTH,
            linestyle="none",
            marker="D",
            markersize=5,
            fillstyle="none",
            label=label or "predicted",
        )
        axes.annotate(
            f"action {row.action}", known[0], (0, 8), textcoords="offset points", color=INK, fontsize=FONT_PT - 2
        )
        first = places[-1] + 1
    axes.set_ylim(bottom=0.0)
    axes.margins(x=0.08, y=0.15)
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    axes.tick_params(axis="x", labelbottom=False, length=0)
    axes.set_xlabel("observations while held, one per correction")
    axes.set_ylabel("RMSE if released [mm]")
    axes.grid(axis="y", color=GRID, linewidth=0.8)
    figure.legend(loc="outside upper center", ncols=3, frameon=False, labelcolor=INK, fontsize=FONT_PT - 1)
    return as_svg(figure, "Error expected after a release, before and after each correction")
