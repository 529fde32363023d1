"""The picture of `dlokit identify`: how well actions were predicted, and what was believed after each."""

from collections.abc import Sequence
from pathlib import Path

from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from dlokit.skills.model.identification.history import Lesson


def write_picture(path: Path, lessons: Sequence[Lesson]) -> None:
    """Write a PNG with both plots."""
    figure = Figure(figsize=(9.0, 3.6), layout="constrained")
    FigureCanvasAgg(figure)
    left, right = figure.subplots(1, 2)
    _errors(left, lessons)
    _belief(right, lessons)
    figure.savefig(path, dpi=120)


def _errors(axes: Axes, lessons: Sequence[Lesson]) -> None:
    numbers = range(1, len(lessons) + 1)
    axes.plot(numbers, [lesson.configured_m * 1e3 for lesson in lessons], "o--", color="0.55", label="as configured")
    axes.plot(numbers, [lesson.learnt_m * 1e3 for lesson in lessons], "o-", color="C0", label="as learnt before it")
    axes.set_ylim(bottom=0.0)
    axes.set_xlabel("action")
    axes.set_ylabel("error of the prediction, mm")
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    axes.legend(frameon=False)


def _belief(axes: Axes, lessons: Sequence[Lesson]) -> None:
    numbers = list(range(1, len(lessons) + 1))
    beliefs = [lesson.belief.elastic_m3 for lesson in lessons]
    low, high = zip(*(figure.between() for figure in beliefs), strict=True)
    axes.fill_between(numbers, low, high, color="C0", alpha=0.2, linewidth=0.0, label="95 %")
    axes.plot(numbers, [figure.value for figure in beliefs], "o-", color="C0")
    for number, lesson in zip(numbers, lessons, strict=True):
        if lesson.belief.yield_curvature_1_m is not None:
            axes.annotate("set", (number, lesson.belief.elastic_m3.value), xytext=(0, 6), textcoords="offset points")
    axes.set_yscale("log")
    axes.set_xlabel("actions learnt from")
    axes.set_ylabel("EI / (μ w), m³")
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    axes.legend(frameon=False)
