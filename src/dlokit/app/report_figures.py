"""The figures of a run report, as inline SVG that follows the page's colours in light and dark."""

import io
import math
import re
from collections.abc import Mapping

import cv2
import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from matplotlib.ticker import MaxNLocator

from dlokit.description import shapes
from dlokit.system.run_record import RunRecord, StepTiming
from dlokit.types.arrays import Float64Array, UInt8Array
from dlokit.types.feasibility import GoalVerdict

# Stand-ins that are written into the SVG and replaced there by the page's own colour variables.
_VARIABLES = {
    "#010101": "var(--ink)",
    "#020202": "var(--muted)",
    "#030303": "var(--grid)",
    "#040404": "var(--goal)",
    "#050505": "var(--start)",
    "#060606": "var(--final)",
    "#070707": "var(--step)",
    "#080808": "var(--truth)",
    "#090909": "var(--table)",
}
_INK, _MUTED, _GRID, _GOAL, _START, _FINAL, _STEP, _TRUTH, _TABLE = _VARIABLES
_FONT_PT = 12
_MOST_VIEWS = 12

QUICK_S = 0.02
"""Steps that took less than this over the whole run [s] are named rather than drawn."""


def overlay(record: RunRecord) -> str:
    """Start, goal and the shape after each action, seen from above, as SVG."""
    figure, axes = _figure(7.4, 6.4)
    _table(axes)
    goal = record.goal_nodes_world
    axes.plot(goal[:, 0], goal[:, 1], color=_GOAL, linewidth=9, alpha=0.35, solid_capstyle="round", label="goal")
    if record.start_nodes_world is not None:
        _rope(axes, record.start_nodes_world, _START, 2.0, "start", dashed=True)
    between = record.actions[:-1]
    for number, action in enumerate(between, start=1):
        nodes = action.nodes_world
        label = "after each action" if number == 1 else "_nolegend_"
        shade = 0.4 + 0.5 * number / len(between)
        axes.plot(nodes[:, 0], nodes[:, 1], color=_STEP, linewidth=1.3, alpha=shade, label=label)
    if record.actions:
        _rope(axes, record.actions[-1].nodes_world, _FINAL, 3.0, "final")
        _moves(axes, record)
    axes.legend(
        loc="upper left",
        bbox_to_anchor=(1.02, 1.0),
        frameon=False,
        labelcolor=_INK,
        fontsize=_FONT_PT,
        handlelength=2.5,
    )
    return _svg(figure, "Top view of the table: start, goal, and the shape after each action")


def spring_back(verdict: GoalVerdict) -> str:
    """A goal, where the DLO comes to rest when it is released there, and the nearest shape that holds, as SVG."""
    figure, axes = _figure(7.4, 6.4)
    _table(axes)
    goal = verdict.goal_world
    axes.plot(goal[:, 0], goal[:, 1], color=_GOAL, linewidth=9, alpha=0.35, solid_capstyle="round", label="goal")
    for number, release in enumerate(verdict.releases):
        nodes, label = release.nodes_world, ("released there", "in doubt", "_nolegend_")[min(number, 2)]
        color, width = (_TRUTH, 2.2) if number == 0 else (_MUTED, 1.0)
        axes.plot(nodes[:, 0], nodes[:, 1], color=color, linewidth=width, label=label)
    if verdict.nearest_world is not None:
        _rope(axes, verdict.nearest_world, _FINAL, 2.0, "nearest that holds", dashed=True)
    axes.legend(loc="upper left", bbox_to_anchor=(1.02, 1.0), frameon=False, labelcolor=_INK, fontsize=_FONT_PT)
    return _svg(figure, "Top view of the table: the goal, and where the DLO springs back to")


def error_curve(record: RunRecord) -> str:
    """The error to the goal against the number of actions, with the threshold, as SVG."""
    figure, axes = _figure(7.4, 6.2)
    result = record.result
    estimates = [(row.action, row.rmse_m * 1000.0) for row in result.history]
    if record.start_rmse_m is not None:
        estimates.insert(0, (0, record.start_rmse_m * 1000.0))
    truths = [(row.action, row.true_rmse_m * 1000.0) for row in result.history if row.true_rmse_m is not None]
    threshold_mm = result.threshold_m * 1000.0
    axes.axhline(
        threshold_mm, color=_GOAL, linewidth=1.5, linestyle=(0, (5, 3)), label=f"threshold {threshold_mm:.4g} mm"
    )
    axes.axhspan(0.0, threshold_mm, color=_GOAL, alpha=0.10, linewidth=0)
    if truths:
        axes.plot(
            *zip(*truths, strict=True),
            color=_TRUTH,
            linewidth=1.4,
            marker="D",
            markersize=4,
            label="true, 2 s after release",
        )
    if estimates:
        axes.plot(
            *zip(*estimates, strict=True), color=_FINAL, linewidth=2.2, marker="o", markersize=5, label="estimated"
        )
    lost = [(row.action, row.rmse_m * 1000.0) for row in result.history if not row.grasp_ok and row.kind != "push"]
    if lost:
        axes.plot(
            *zip(*lost, strict=True), color=_INK, linestyle="none", marker="x", markersize=9, label="grasp not held"
        )
    axes.set_ylim(bottom=0.0)
    last = max(1, *(number for number, _ in estimates)) if estimates else 1
    axes.set_xlim(-0.25, last + 0.25)
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    axes.set_xlabel("actions", color=_MUTED, fontsize=_FONT_PT - 1)
    axes.set_ylabel("RMSE [mm]", color=_MUTED, fontsize=_FONT_PT - 1)
    axes.grid(axis="y", color=_GRID, linewidth=0.8)
    axes.legend(frameon=False, labelcolor=_INK, fontsize=_FONT_PT)
    return _svg(figure, "Error to the goal after each action, with the threshold")


def expected_shapes(record: RunRecord) -> str:
    """One small view of the table an action: what was expected, what became of it, the goal and the tool's path."""
    shown = record.actions[-_MOST_VIEWS:]
    figure = Figure(figsize=(7.4, 3.3 * math.ceil(len(shown) / 2)), layout="constrained")
    FigureCanvasSVG(figure)
    figure.patch.set_alpha(0.0)
    for place, action in enumerate(shown, start=1):
        row = record.result.history[len(record.actions) - len(shown) + place - 1]
        axes = figure.add_subplot(math.ceil(len(shown) / 2), 2, place)
        _clear(axes)
        _table(axes)
        goal = record.goal_nodes_world
        axes.plot(goal[:, 0], goal[:, 1], color=_GOAL, linewidth=6, alpha=0.3, solid_capstyle="round", label="goal")
        if action.path_world is not None:
            axes.plot(*action.path_world[:, :2].T, color=_MUTED, linewidth=1.0, linestyle=":", label="tool")
        if action.expected_world is not None:
            _rope(axes, action.expected_world, _TRUTH, 1.5, "expected", dashed=True)
        _rope(axes, action.nodes_world, _FINAL, 2.0, "achieved")
        axes.set_xlabel("")
        axes.set_ylabel("")
        axes.set_title(f"{row.action}: {row.kind}", color=_INK, fontsize=_FONT_PT)
        if place == 1:
            axes.legend(frameon=False, labelcolor=_INK, fontsize=_FONT_PT - 3)
    return _svg(figure, "Expected and achieved shape of each action, from above")


def expected_errors(record: RunRecord) -> str:
    """The RMSE that was expected of each action against the one that was reached, as SVG."""
    figure, axes = _figure(7.4, 6.2)
    pairs = [
        (row.predicted_rmse_m * 1000.0, row.rmse_m * 1000.0, str(row.action))
        for row in record.result.history
        if row.predicted_rmse_m is not None
    ]
    top = 1.1 * max([1.0, *(max(expected, reached) for expected, reached, _ in pairs)])
    axes.plot((0.0, top), (0.0, top), color=_GRID, linewidth=1.5, label="as expected")
    axes.plot(
        [pair[0] for pair in pairs],
        [pair[1] for pair in pairs],
        color=_FINAL,
        linestyle="none",
        marker="o",
        label="action",
    )
    for expected, reached, name in pairs:
        axes.annotate(name, (expected, reached), (6, 4), textcoords="offset points", color=_INK, fontsize=_FONT_PT - 1)
    axes.set_xlim(0.0, top)
    axes.set_ylim(0.0, top)
    axes.set_xlabel("expected RMSE [mm]", color=_MUTED, fontsize=_FONT_PT - 1)
    axes.set_ylabel("achieved RMSE [mm]", color=_MUTED, fontsize=_FONT_PT - 1)
    axes.legend(frameon=False, labelcolor=_INK, fontsize=_FONT_PT, loc="upper left")
    return _svg(figure, "Expected against achieved error of each action")


def timing_bars(timings: Mapping[str, StepTiming]) -> str:
    """Time on the cell's clock and computing time of each step of the flow, as SVG. Quick steps are left out."""
    shown = [name for name, timing in timings.items() if timing.sim_time_s + timing.wall_time_s >= QUICK_S]
    names = sorted(shown, key=lambda name: timings[name].sim_time_s + timings[name].wall_time_s)
    figure, axes = _figure(13.0, 0.9 + 0.5 * len(names))
    rows = np.arange(len(names))
    for offset, color, label, seconds in (
        (0.2, _FINAL, "cell time", [timings[name].sim_time_s for name in names]),
        (-0.2, _TRUTH, "computing", [timings[name].wall_time_s for name in names]),
    ):
        bars = axes.barh(rows + offset, seconds, height=0.36, color=color, label=label)
        axes.bar_label(bars, fmt="%.2f s", padding=4, color=_MUTED, fontsize=_FONT_PT - 2)
    axes.set_yticks(rows, [f"{name.replace('_', ' ')} ({timings[name].calls}×)" for name in names])
    axes.tick_params(axis="y", length=0, colors=_INK)
    axes.set_xlim(right=1.14 * max(*axes.get_xlim(), 1e-9))
    axes.grid(axis="x", color=_GRID, linewidth=0.8)
    axes.set_axisbelow(True)
    axes.legend(frameon=False, labelcolor=_INK, fontsize=_FONT_PT, loc="lower right")
    return _svg(figure, "Time by step of the flow")


def picture_jpeg(image: UInt8Array) -> bytes:
    """A picture (height, width, 3) RGB as JPEG: the camera's noise would make a PNG seven times as large."""
    done, encoded = cv2.imencode(".jpg", cv2.cvtColor(image, cv2.COLOR_RGB2BGR), [cv2.IMWRITE_JPEG_QUALITY, 90])
    if not done:
        raise ValueError(f"a picture of shape {image.shape} and type {image.dtype} cannot be written as JPEG")
    return encoded.tobytes()


def _figure(width_in: float, height_in: float) -> tuple[Figure, Axes]:
    """An empty figure without pyplot, which keeps global state and is not made for threads."""
    figure = Figure(figsize=(width_in, height_in), layout="constrained")
    FigureCanvasSVG(figure)
    figure.patch.set_alpha(0.0)
    axes = figure.add_subplot()
    _clear(axes)
    return figure, axes


def _clear(axes: Axes) -> None:
    """Axes in the page's colours, without a frame."""
    axes.patch.set_alpha(0.0)
    axes.tick_params(colors=_MUTED, labelsize=_FONT_PT - 1)
    for side, spine in axes.spines.items():
        spine.set_color(_GRID)
        spine.set_visible(side in {"left", "bottom"})


def _table(axes: Axes) -> None:
    """The table from above, turned as the camera's pictures are: the robot on the right, far from the camera on top."""
    (x0, x1), (y0, y1) = shapes.TABLE_X_M, shapes.TABLE_Y_M
    axes.add_patch(Rectangle((x0, y0), x1 - x0, y1 - y0, facecolor=_TABLE, edgecolor=_GRID, linewidth=1.0))
    margin_m = 0.015
    axes.set_xlim(x1 + margin_m, x0 - margin_m)
    axes.set_ylim(y1 + margin_m, y0 - margin_m)
    axes.set_aspect("equal")
    axes.set_xlabel("x [m], robot on the right", color=_MUTED, fontsize=_FONT_PT - 1)
    axes.set_ylabel("y [m]", color=_MUTED, fontsize=_FONT_PT - 1)
    axes.grid(color=_GRID, linewidth=0.6, alpha=0.7)
    axes.set_axisbelow(True)


def _rope(axes: Axes, nodes: Float64Array, color: str, width: float, label: str, *, dashed: bool = False) -> None:
    """A shape (M, 3) [m], with a dot at node 0."""
    style = (0, (4, 2)) if dashed else "-"
    axes.plot(
        nodes[:, 0], nodes[:, 1], color=color, linewidth=width, linestyle=style, solid_capstyle="round", label=label
    )
    axes.plot(nodes[0, 0], nodes[0, 1], color=color, marker="o", markersize=3.0 + width)


def _moves(axes: Axes, record: RunRecord) -> None:
    """An arrow an action, numbered: from where the grasped node lay to where it came to lie."""
    before = record.start_nodes_world
    for row, action in zip(record.result.history, record.actions, strict=True):
        if before is not None:
            (x0, y0), (x1, y1) = before[row.grasp_node, :2], action.nodes_world[row.grasp_node, :2]
            style = {"arrowstyle": "-|>", "color": _MUTED, "linewidth": 0.9, "shrinkA": 0, "shrinkB": 0}
            axes.annotate("", xy=(x1, y1), xytext=(x0, y0), arrowprops=style)
            axes.annotate(
                str(row.action),
                xy=(x0, y0),
                xytext=(4, 4),
                textcoords="offset points",
                color=_INK,
                fontsize=_FONT_PT - 1,
            )
        before = action.nodes_world


def _svg(figure: Figure, title: str) -> str:
    """A figure as an SVG element that scales with the page and takes its colours from it."""
    buffer = io.StringIO()
    # Text stays text, in the page's own font; the salt makes equal runs give equal files.
    with mpl.rc_context({"svg.fonttype": "none", "svg.hashsalt": "dlokit"}):
        figure.savefig(buffer, format="svg", metadata={"Date": None, "Creator": None})
    text = buffer.getvalue()
    text = text[text.index("<svg") :]
    for stand_in, variable in _VARIABLES.items():
        text = text.replace(stand_in, variable)
    text = re.sub(r"<metadata>.*?</metadata>", "", text, flags=re.DOTALL)
    text = re.sub(r"font: (\d[\w.]*) [^;\"]*", r"font-size: \1", text)
    # A page holds several figures: their ids must not meet.
    prefix = re.sub(r"\W+", "-", title.lower())[:24]
    text = re.sub(r'id="([^"]+)"', rf'id="{prefix}-\1"', text)
    text = re.sub(r'(href="#|url\(#)', rf"\1{prefix}-", text)
    box = re.search(r'viewBox="[^"]+"', text)
    names = 'xmlns="http://www.w3.org/2000/svg" xmlns:xlink="http://www.w3.org/1999/xlink"'
    opening = f'<svg {names} {box.group() if box else ""} role="img" aria-label="{title}">'
    return re.sub(r"<svg[^>]*>", opening, text, count=1)
