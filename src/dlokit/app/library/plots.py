"""Drawings of `plot()`: shapes on the table from above, and the error of a run."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from dlokit.app.report.drawing import draw_fixtures
from dlokit.description.scene import Fixture
from dlokit.system.results.run_result import RunResult
from dlokit.types.arrays import BoolArray, Float64Array, Int64Array

GOAL, START, BETWEEN, FINAL, TRUE = "#e8a33d", "#8a8f98", "#7fa7d6", "#1f5fa8", "#b3403a"


def new_figure(columns: int) -> tuple[Figure, Sequence[Axes]]:
    """A figure with axes side by side. Without pyplot, so that it works on any thread; notebooks show it as well."""
    figure = Figure(figsize=(5.5 * columns, 4.8), layout="constrained", dpi=110)
    FigureCanvasAgg(figure)
    return figure, [figure.add_subplot(1, columns, number) for number in range(1, columns + 1)]


def saved(figure: Figure, path: Path | str | None) -> Figure:
    """The figure, also saved to a file if `path` is given."""
    if path is not None:
        figure.savefig(path)
    return figure


def draw_shapes(
    axes: Axes,
    *,
    goal: Float64Array | None,
    start: Float64Array | None,
    shapes: Sequence[Float64Array],
    fixtures: Sequence[Fixture] = (),
) -> None:
    """Goal, start and the shapes after it, (M, 3) [m] each, seen from above; a dot marks node 0."""
    draw_fixtures(axes, fixtures, "0.85", "0.4")
    if goal is not None:
        axes.plot(goal[:, 0], goal[:, 1], color=GOAL, linewidth=9, alpha=0.4, solid_capstyle="round", label="goal")
    if start is not None:
        _rope(axes, start, START, "start", "--")
    for number, nodes in enumerate(shapes[:-1], start=1):
        _rope(axes, nodes, BETWEEN, "between" if number == 1 else "_nolegend_", "-")
    if shapes:
        _rope(axes, shapes[-1], FINAL, "final", "-")
    axes.set_aspect("equal", adjustable="datalim")
    axes.set_xlabel("x [m]")
    axes.set_ylabel("y [m]")
    axes.grid(alpha=0.3)
    axes.legend(frameon=False)


def draw_nodes(
    axes: Axes, nodes: Float64Array, visible: BoolArray, edges: Int64Array, across: int = 0, up: int = 1
) -> None:
    """The tracked nodes (M, 3) [m] with the edges (E, 2) that join them; hidden ones in red, a circle around node 0."""
    for a, b in edges:
        axes.plot(nodes[[a, b], across], nodes[[a, b], up], color="tab:blue", linewidth=1)
    axes.scatter(nodes[visible, across], nodes[visible, up], s=12, color="tab:blue", zorder=3, label="visible node")
    axes.scatter(nodes[~visible, across], nodes[~visible, up], s=12, color="tab:red", zorder=3, label="hidden node")
    axes.scatter(nodes[:1, across], nodes[:1, up], s=60, facecolors="none", edgecolors="black", label="node 0")
    axes.set_aspect("equal", adjustable="datalim")
    axes.set_xlabel(f"{'xyz'[across]} in the world [m]")
    axes.set_ylabel(f"{'xyz'[up]} in the world [m]")


def draw_errors(axes: Axes, result: RunResult) -> None:
    """The error to the goal [mm] after each action, with the threshold."""
    threshold_mm = result.threshold_m * 1000.0
    axes.axhline(threshold_mm, color=GOAL, linestyle="--", label=f"threshold {threshold_mm:.4g} mm")
    start = [] if result.start_rmse_m is None else [(0, result.start_rmse_m)]
    estimated = np.array([*start, *((row.action, row.rmse_m) for row in result.history)]).reshape(-1, 2)
    true = np.array([(row.action, row.true_rmse_m) for row in result.history if row.true_rmse_m is not None]).reshape(
        -1, 2
    )
    axes.plot(estimated[:, 0], estimated[:, 1] * 1000.0, color=FINAL, marker="o", label="estimated")
    if len(true):
        axes.plot(true[:, 0], true[:, 1] * 1000.0, color=TRUE, marker="D", label="true, 2 s after the release")
    axes.set_ylim(bottom=0.0)
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    axes.set_xlabel("actions")
    axes.set_ylabel("RMSE [mm]")
    axes.grid(alpha=0.3)
    axes.legend(frameon=False)


def _rope(axes: Axes, nodes: Float64Array, color: str, label: str, style: str) -> None:
    axes.plot(nodes[:, 0], nodes[:, 1], style, color=color, linewidth=2, label=label)
    axes.plot(nodes[0, 0], nodes[0, 1], "o", color=color, markersize=5)
