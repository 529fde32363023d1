"""The plot of the error against the number of actions."""

import numpy as np
import viser
from viser import uplot

from dlokit.skills.viewer import palette
from dlokit.skills.viewer.state import ErrorHistory

_MM_PER_M = 1000.0


class ErrorPlot:
    """RMSE after each action, and the threshold that ends the task."""

    def __init__(self, gui: viser.GuiApi, threshold_m: float) -> None:
        self._threshold_mm = threshold_m * _MM_PER_M
        state = palette.css(palette.STATE.color)
        self._plot = gui.add_uplot(
            data=self._data(ErrorHistory()),
            series=(
                uplot.Series(label="action"),
                uplot.Series(
                    label="RMSE [mm]",
                    stroke=state,
                    width=2,
                    points=uplot.Series_Points(show=True, size=7, fill=state),
                ),
                uplot.Series(
                    label="threshold [mm]",
                    stroke=palette.css(palette.GOAL.color),
                    width=1.5,
                    dash=(6.0, 4.0),
                    points=uplot.Series_Points(show=False),
                ),
            ),
            axes=(uplot.Axis(incrs=(1.0, 2.0, 5.0, 10.0)), uplot.Axis()),  # actions are whole numbers
            title="Error after each action",
            scales={"x": uplot.Scale(time=False, auto=True), "y": uplot.Scale(auto=True)},
            height=160,
        )

    def draw(self, history: ErrorHistory) -> None:
        """Bring the plot up to date."""
        self._plot.data = self._data(history)

    def _data(self, history: ErrorHistory) -> tuple[np.ndarray, ...]:
        actions, rmse_m = history.arrays()
        if len(actions) < 2:  # a plot of one number has no scale
            actions, rmse_m = np.array([0.0, 1.0]), np.array([*rmse_m, np.nan, np.nan])[:2]
        return actions, rmse_m * _MM_PER_M, np.full(len(actions), self._threshold_mm)
