"""The figures of a run report, as inline SVG that follows the page's colours in light and dark."""

import math
from collections.abc import Mapping, Sequence

import numpy as np
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
    START,
    STEP,
    TRUTH,
    as_svg,
    clear,
    draw_fixtures,
    draw_goal,
    draw_rope,
    draw_table,
    legend_beside,
    new_figure,
)
from dlokit.decision.records import ActionRecord
from dlokit.description.scene import Fixture
from dlokit.system.results.run_result import ActionResult, RunRecord, StepTiming
from dlokit.types.action import facts_of
from dlokit.types.feasibility import GoalVerdict

QUICK_S = 0.02
"""Steps that took less than this time in the whole run [s] are listed, not drawn."""


def overlay(record: RunRecord) -> str:
    """Start, goal and the shape after each action, seen from above, as SVG."""
    figure, axes = new_figure(5.4, 8.2)
    draw_table(axes)
    draw_fixtures(axes, record.fixtures)
    draw_goal(axes, record.goal_nodes_world)
    if record.start_nodes_world is not None:
        draw_rope(axes, record.start_nodes_world, START, 2.0, "start", dashed=True)
    between = record.actions[:-1]
    for number, action in enumerate(between, start=1):
        nodes = action.nodes_world
        label = "after each action" if number == 1 else "_nolegend_"
        shade = 0.4 + 0.5 * number / len(between)
        axes.plot(nodes[:, 0], nodes[:, 1], color=STEP, linewidth=1.3, alpha=shade, label=label)
    if record.actions:
        draw_rope(axes, record.actions[-1].nodes_world, FINAL, 3.0, "final")
        _moves(axes, record)
    figure.legend(
        loc="outside upper center", ncols=3, frameon=False, labelcolor=INK, fontsize=FONT_PT, columnspacing=1.2
    )
    return as_svg(figure, "Top view of the table: start, goal, and the shape after each action")


def spring_back(verdict: GoalVerdict, fixtures: Sequence[Fixture] = ()) -> str:
    """A goal, the shape after a release there, and the nearest feasible shape, as SVG."""
    figure, axes = new_figure(7.4, 6.4)
    draw_table(axes)
    draw_fixtures(axes, fixtures)
    draw_goal(axes, verdict.goal_world)
    for number, release in enumerate(verdict.releases):
        nodes, label = release.nodes_world, ("after release", "within uncertainty", "_nolegend_")[min(number, 2)]
        color, width = (TRUTH, 2.2) if number == 0 else (MUTED, 1.0)
        axes.plot(nodes[:, 0], nodes[:, 1], color=color, linewidth=width, label=label)
    if verdict.nearest_world is not None:
        draw_rope(axes, verdict.nearest_world, FINAL, 2.0, "nearest feasible shape", dashed=True)
    legend_beside(axes)
    return as_svg(figure, "Top view of the table: the goal, and the shape to which the DLO springs back")


def error_curve(record: RunRecord) -> str:
    """The error to the goal against the number of actions, with the threshold, as SVG."""
    figure, axes = new_figure(7.4, 4.4)
    result = record.result
    estimates = [(row.action, row.rmse_m * 1000.0) for row in result.history]
    if record.result.start_rmse_m is not None:
        estimates.insert(0, (0, record.result.start_rmse_m * 1000.0))
    truths = [(row.action, row.true_rmse_m * 1000.0) for row in result.history if row.true_rmse_m is not None]
    threshold_mm = result.threshold_m * 1000.0
    axes.axhline(
        threshold_mm, color=GOAL, linewidth=1.5, linestyle=(0, (5, 3)), label=f"threshold {threshold_mm:.4g} mm"
    )
    axes.axhspan(0.0, threshold_mm, color=GOAL, alpha=0.10, linewidth=0)
    if estimates:
        axes.plot(
            *zip(*estimates, strict=True), color=FINAL, linewidth=2.2, marker="o", markersize=5, label="estimated"
        )
    if truths:  # over the estimates, which it mostly equals
        axes.plot(
            *zip(*truths, strict=True),
            color=TRUTH,
            linewidth=1.4,
            linestyle=(0, (2, 2)),
            marker="D",
            markersize=8,
            markeredgewidth=1.6,
            fillstyle="none",
            label="true, 2 s after release",
        )
    grasps = [row for row in result.history if facts_of(row.kind).grasps]
    lost = [(row.action, row.rmse_m * 1000.0) for row in grasps if not row.grasp_ok]
    if lost:
        axes.plot(
            *zip(*lost, strict=True), color=INK, linestyle="none", marker="x", markersize=9, label="grasp not held"
        )
    axes.set_ylim(bottom=0.0)
    last = max(1, *(number for number, _ in estimates)) if estimates else 1
    axes.set_xlim(-0.25, last + 0.25)
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    axes.set_xlabel("actions")
    axes.set_ylabel("RMSE [mm]")
    axes.grid(axis="y", color=GRID, linewidth=0.8)
    axes.legend(frameon=False, labelcolor=INK, fontsize=FONT_PT)
    return as_svg(figure, "Error to the goal after each action, with the threshold")


def timing_bars(timings: Mapping[str, StepTiming]) -> str:
    """Time on the run's clock and wall time of each step of the flow, as SVG. Short steps are omitted."""
    shown = [name for name, timing in timings.items() if timing.sim_time_s + timing.wall_time_s >= QUICK_S]
    names = sorted(shown, key=lambda name: timings[name].sim_time_s + timings[name].wall_time_s)
    figure, axes = new_figure(13.0, 0.9 + 0.5 * len(names))
    rows = np.arange(len(names))
    for offset, color, label, seconds in (
        (0.2, FINAL, "run's clock", [timings[name].sim_time_s for name in names]),
        (-0.2, TRUTH, "wall time", [timings[name].wall_time_s for name in names]),
    ):
        bars = axes.barh(rows + offset, seconds, height=0.36, color=color, label=label)
        axes.bar_label(bars, fmt="%.2f s", padding=4, color=MUTED, fontsize=FONT_PT - 2)
    axes.set_yticks(rows, [f"{name.replace('_', ' ')} ({timings[name].calls}×)" for name in names])
    axes.tick_params(axis="y", length=0, colors=INK)
    axes.set_xlim(right=1.14 * max(*axes.get_xlim(), 1e-9))
    axes.grid(axis="x", color=GRID, linewidth=0.8)
    axes.set_axisbelow(True)
    axes.legend(frameon=False, labelcolor=INK, fontsize=FONT_PT, loc="lower right")
    return as_svg(figure, "Time by step of the flow")


def _moves(axes: Axes, record: RunRecord) -> None:
    """Draw one numbered arrow per action, from the old to the new position of the grasped node."""
    before = record.start_nodes_world
    axes.plot([], [], color=MUTED, linewidth=0.9, marker=">", markersize=5, label="action, with its number")
    for row, action in zip(record.result.history, record.actions, strict=True):
        if before is not None:
            (x0, y0), (x1, y1) = before[row.grasp_node, :2], action.nodes_world[row.grasp_node, :2]
            style = {"arrowstyle": "-|>", "color": MUTED, "linewidth": 0.9, "shrinkA": 0, "shrinkB": 0}
            axes.annotate("", xy=(x1, y1), xytext=(x0, y0), arrowprops=style)
            axes.annotate(
                str(row.action),
                xy=(x0, y0),
                xytext=(4, 4),
                textcoords="offset points",
                color=INK,
                fontsize=FONT_PT - 1,
            )
        before = action.nodes_world


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
        _view(view, record, action, row)
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


def _view(axes: Axes, record: RunRecord, action: ActionRecord, row: ActionResult) -> None:
    """Draw one action: shapes and path on the table."""
    clear(axes)
    draw_table(axes)
    draw_fixtures(axes, record.fixtures, size_pt=FONT_PT - 4)
    draw_goal(axes, record.goal_nodes_world, width=6.0, alpha=0.3)
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
    figure, axes = new_figure(_WIDTH_IN, 4.6)
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
