"""Common parts of the report's figures: the page's colours, the top view of the table, and inline SVG."""

import io
import re
from collections.abc import Sequence

import matplotlib as mpl
from matplotlib.axes import Axes
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure
from matplotlib.patches import Polygon, Rectangle

from dlokit.description.scene import Fixture, outline_xy
from dlokit.description.table import TABLE_X_M, TABLE_Y_M
from dlokit.types.arrays import Float64Array

# Placeholders in the SVG that are replaced by the page's own colour variables.
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
INK, MUTED, GRID, GOAL, START, FINAL, STEP, TRUTH, TABLE = _VARIABLES
FONT_PT = 12


def new_figure(width_in: float, height_in: float) -> tuple[Figure, Axes]:
    """An empty figure without pyplot, which has global state and is not thread-safe."""
    figure = Figure(figsize=(width_in, height_in), layout="constrained")
    FigureCanvasSVG(figure)
    figure.patch.set_alpha(0.0)
    axes = figure.add_subplot()
    clear(axes)
    return figure, axes


def clear(axes: Axes) -> None:
    """Axes in the page's colours, without a frame."""
    axes.patch.set_alpha(0.0)
    axes.tick_params(colors=MUTED, labelsize=FONT_PT - 1)
    for axis in (axes.xaxis, axes.yaxis):
        axis.label.set(color=MUTED, fontsize=FONT_PT - 1)
    for side, spine in axes.spines.items():
        spine.set_color(GRID)
        spine.set_visible(side in {"left", "bottom"})


def draw_table(axes: Axes) -> None:
    """Draw the table from above, oriented as the camera's pictures: robot on the right, far side on top."""
    (x0, x1), (y0, y1) = TABLE_X_M, TABLE_Y_M
    axes.add_patch(Rectangle((x0, y0), x1 - x0, y1 - y0, facecolor=TABLE, edgecolor=GRID, linewidth=1.0))
    margin_m = 0.015
    axes.set_xlim(x1 + margin_m, x0 - margin_m)
    axes.set_ylim(y1 + margin_m, y0 - margin_m)
    axes.set_aspect("equal")
    axes.set_xlabel("x [m], robot on the right")
    axes.set_ylabel("y [m]")
    axes.grid(color=GRID, linewidth=0.6, alpha=0.7)
    axes.set_axisbelow(True)


def draw_fixtures(
    axes: Axes, fixtures: Sequence[Fixture], face: str = GRID, ink: str = MUTED, size_pt: float = FONT_PT - 2
) -> None:
    """Draw the outlines of fixtures with their names into a view of the table from above."""
    for fixture in fixtures:
        outline = outline_xy(fixture)
        axes.add_patch(Polygon(outline, facecolor=face, edgecolor=ink, linewidth=0.8))
        x, y = outline.mean(axis=0)
        below = (0.0, -2.0 - size_pt)
        axes.annotate(fixture.name, (x, y), below, textcoords="offset points", ha="center", color=ink, fontsize=size_pt)


def draw_goal(axes: Axes, goal: Float64Array, width: float = 9.0, alpha: float = 0.35) -> None:
    """Draw a goal (M, 3) [m] as a broad band, on which shapes are drawn."""
    axes.plot(goal[:, 0], goal[:, 1], color=GOAL, linewidth=width, alpha=alpha, solid_capstyle="round", label="goal")


def legend_beside(axes: Axes) -> None:
    """The legend, to the right of a top view."""
    axes.legend(
        loc="upper left", bbox_to_anchor=(1.02, 1.0), frameon=False, labelcolor=INK, fontsize=FONT_PT, handlelength=2.5
    )


def draw_rope(axes: Axes, nodes: Float64Array, color: str, width: float, label: str, *, dashed: bool = False) -> None:
    """Draw a shape (M, 3) [m], with a dot at node 0."""
    style = (0, (4, 2)) if dashed else "-"
    axes.plot(
        nodes[:, 0], nodes[:, 1], color=color, linewidth=width, linestyle=style, solid_capstyle="round", label=label
    )
    axes.plot(nodes[0, 0], nodes[0, 1], color=color, marker="o", markersize=3.0 + width)


def as_svg(figure: Figure, title: str) -> str:
    """A figure as an SVG element that scales with the page and takes its colours from it."""
    buffer = io.StringIO()
    # Text stays text in the page's font; a fixed salt makes equal runs give equal files.
    with mpl.rc_context({"svg.fonttype": "none", "svg.hashsalt": "dlokit"}):
        figure.savefig(buffer, format="svg", metadata={"Date": None, "Creator": None})
    text = buffer.getvalue()
    text = text[text.index("<svg") :]
    for stand_in, variable in _VARIABLES.items():
        text = text.replace(stand_in, variable)
    text = re.sub(r"<metadata>.*?</metadata>", "", text, flags=re.DOTALL)
    text = re.sub(r"font: (\d[\w.]*) [^;\"]*", r"font-size: \1", text)
    # A page holds several figures, so their ids must differ.
    prefix = re.sub(r"\W+", "-", title.lower())[:24]
    text = re.sub(r'id="([^"]+)"', rf'id="{prefix}-\1"', text)
    text = re.sub(r'(href="#|url\(#)', rf"\1{prefix}-", text)
    box = re.search(r'viewBox="[^"]+"', text)
    names = 'xmlns="http://www.w3.org/2000/svg" xmlns:xlink="http://www.w3.org/1999/xlink"'
    opening = f'<svg {names} {box.group() if box else ""} role="img" aria-label="{title}">'
    return re.sub(r"<svg[^>]*>", opening, text, count=1)
