"""Small multiples: start, goal and end of every case, several dozen per page."""

import re
from collections.abc import Callable, Sequence
from pathlib import Path

from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure as Picture

from dlokit.app.report.drawing import draw_fixtures
from dlokit.description.scene import Fixture
from dlokit.description.table import TABLE_X_M, TABLE_Y_M
from dlokit.extras.bench.shaping.cases import CaseResult, ShapingCase, judged_by_truth
from dlokit.extras.bench.shaping.metrics import falsely_converged
from dlokit.types.arrays import Float64Array
from dlokit.types.flow import RunOutcome

COLUMNS, ROWS = 6, 8
_PANEL_IN = 2.0
_MARGIN_M = 0.03
_NAME_PT = 4.0

FixturesOf = Callable[[ShapingCase], Sequence[Fixture]]
"""The believed fixtures of a case."""


def draw(results: Sequence[CaseResult], folder: Path, fixtures_of: FixturesOf = lambda case: ()) -> list[Path]:
    """Draw pages of panels, one method after the other; failed cases have no panel."""
    paths: list[Path] = []
    seen = "" if judged_by_truth(results) else "; as estimated by the system itself"
    rank = {name: at for at, name in enumerate(dict.fromkeys(done.case.experiment.name for done in results))}
    for method in dict.fromkeys(done.case.method.name for done in results):
        shown = [done for done in results if done.case.method.name == method and done.shapes is not None]
        shown.sort(key=lambda done: (rank[done.case.experiment.name], done.case.seed))
        stem = re.sub(r"[^A-Za-z0-9]+", "-", method)
        pages = [shown[first : first + COLUMNS * ROWS] for first in range(0, len(shown), COLUMNS * ROWS)]
        for number, page in enumerate(pages, start=1):
            title, path = f"{method}: start dashed, goal wide, end{seen}", folder / f"cases-{stem}-{number}.png"
            paths.append(_page(page, title, path, fixtures_of))
    return paths


def _page(results: Sequence[CaseResult], title: str, path: Path, fixtures_of: FixturesOf) -> Path:
    rows = -(-len(results) // COLUMNS)
    picture = Picture(figsize=(COLUMNS * _PANEL_IN, 0.4 + rows * (_PANEL_IN + 0.3)), layout="constrained")
    FigureCanvasAgg(picture)
    picture.suptitle(title, fontsize="medium")
    panels = picture.subplots(rows, COLUMNS, squeeze=False)
    for index, axes in enumerate(panels.flat):
        if index < len(results):
            _panel(axes, results[index], fixtures_of(results[index].case))
        else:
            axes.axis("off")
    picture.savefig(path, dpi=80)
    return path


def _panel(axes: Axes, done: CaseResult, fixtures: Sequence[Fixture]) -> None:
    """One case from above, as the camera sees it: the robot on the right."""
    assert done.shapes is not None
    result, shapes = done.result, done.shapes
    good = result.outcome is RunOutcome.CONVERGED and not falsely_converged(result)
    draw_fixtures(axes, fixtures, "0.9", "0.4", _NAME_PT)
    _line(axes, shapes.goal_world, color="0.8", linewidth=6, solid_capstyle="round")
    _line(axes, shapes.start_world, color="0.5", linewidth=0.8, linestyle="--")
    _line(axes, shapes.final_world, color="C0" if good else "C3", linewidth=1.6)
    (x0, x1), (y0, y1) = TABLE_X_M, TABLE_Y_M
    axes.set_xlim(x1 + _MARGIN_M, x0 - _MARGIN_M)
    axes.set_ylim(y1 + _MARGIN_M, y0 - _MARGIN_M)
    axes.set_aspect("equal")
    axes.set_xticks([])
    axes.set_yticks([])
    error = "" if result.rmse_m is None else f", {result.rmse_m * 1e3:.1f} mm own"
    if result.true_rmse_m is not None:
        error = f", {result.true_rmse_m * 1e3:.1f} mm"
    words = f"{done.case.experiment.name} · {done.case.seed}\n{result.outcome.value} {result.actions}{error}"
    axes.set_title(words, fontsize=6, color="black" if good else "C3")


def _line(axes: Axes, nodes: Float64Array, **style: object) -> None:
    axes.plot(nodes[:, 0], nodes[:, 1], **style)  # pyright: ignore[reportArgumentType]
