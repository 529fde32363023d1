"""Where the time of a lockstep run goes, part by part: physics, rendering, perception, observer, model.

    python benchmarks/simulation.py
    python benchmarks/simulation.py --repeats 5 --cell.dlo wire_a --json parts.json

Every part is timed on the same scene, an S on the table with the arm at home, on one thread, for both kinds of DLO
physics; the physics also with eight posts along the S. Prints the median, smallest and largest time of each part. All
settings of a run are flags.
"""

from dlokit.app.environment import prepare_environment
from dlokit.description.arm.franka import PANDA
from dlokit.motion.forward_kinematics import PosedArm

prepare_environment()  # before anything below imports MuJoCo or NumPy's linear algebra

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated

import numpy as np
import tyro
from rich.console import Console
from rich.table import Table

from dlokit import geometry
from dlokit.description.scene import Post
from dlokit.description.shapes import builtin_shape
from dlokit.errors import ConfigError
from dlokit.extras.bench.report import BenchFigure, figure
from dlokit.extras.bench.statistics import median
from dlokit.functional.cell.config import PHYSICS, TICK_S
from dlokit.functional.cell.world import Cell
from dlokit.skills.model.tracking import PdTracker
from dlokit.skills.observer.anchored import chain
from dlokit.skills.observer.following import followed
from dlokit.skills.observer.initialise.first_shape import initial_targets
from dlokit.skills.perception.pipeline import perceive
from dlokit.system.config import RunConfig
from dlokit.types.arrays import Float64Array
from dlokit.types.dlo import DloState
from parts.command import check_json, run_study, write_figures


@dataclass(frozen=True, kw_only=True)
class Args:
    """Measure where the time of a lockstep run goes: physics, rendering, perception, observer, model."""

    repeats: int = 20
    """Repetitions of each part."""
    json: Path | None = None
    """Also write every figure to this file."""
    run: Annotated[RunConfig, tyro.conf.arg(name="")] = field(default_factory=RunConfig)
    """Settings of the parts."""


def run(args: Args) -> int:
    """Measure and print; exit code 0."""
    if args.repeats < 1:
        raise ConfigError(f"--repeats {args.repeats} must be at least 1.")
    check_json(args.json)
    console = Console()
    with console.status("measuring") as status:
        said = status.update if console.is_terminal else console.print
        timings = measure(args.run, args.repeats, said)
    table = Table(title="one thread", caption="median (smallest to largest)")
    for heading in ("part", "time ms", "per"):
        table.add_column(heading, justify="right" if heading == "time ms" else "left")
    for timing in timings:
        taken_ms = [value * 1e3 for value in timing.seconds]
        shown = f"{median(taken_ms).value:.1f} ({min(taken_ms):.1f} to {max(taken_ms):.1f})"
        table.add_row(timing.part, shown, timing.per)
    console.print(table)
    write_figures(args.json, "simulation", _figures(timings), args.run, console)
    return 0


def _figures(timings: "Sequence[Timing]") -> list[BenchFigure]:
    return [
        figure(timing.part, "dlokit", f"median time a {timing.per}", median(timing.seconds), "s") for timing in timings
    ]


@dataclass(frozen=True, kw_only=True)
class Timing:
    """How long one part takes."""

    part: str
    seconds: tuple[float, ...]
    """Of each repetition [s]."""
    per: str
    """Of what, e.g. ``"look"``."""


def measure(config: RunConfig, repeats: int, said: Callable[[str], object]) -> list[Timing]:
    """Time every part on the same scene: an S on the table, the arm at home; both physics of the DLO."""
    posts = {"": config.cell.fixtures, f" among {POSTS} posts": posts_along(_start(config))}
    cells = {
        f"{name}{among}": Cell(replace(config.cell, physics=kind(), fixtures=fixtures), seed=config.seed)
        for name, kind in PHYSICS.items()
        for among, fixtures in posts.items()
    }
    cell = cells[config.cell.physics.name]
    try:
        return _measure(_physics(cells, config) + _parts(cell, config), repeats, said)
    finally:
        cell.close()


Part = tuple[str, str, Callable[[], object]]
"""Name, of what the time is told, and the function that is timed."""


def _physics(cells: Mapping[str, Cell], config: RunConfig) -> list[Part]:
    """A second of each physics, lying still and while it comes to rest."""
    start = _start(config)
    parts: list[Part] = []
    for name, cell in cells.items():

        def second(cell: Cell = cell) -> None:
            for _ in range(round(1.0 / TICK_S)):
                cell.step(TICK_S)

        def second_after_laying(cell: Cell = cell, second: Callable[[], None] = second) -> None:
            cell.place_dlo(start, settle=False)
            second()

        cell.place_dlo(start)
        parts.append((f"cell: physics, {name}, lying still", "simulated second", second))
        parts.append((f"cell: physics, {name}, just laid down", "simulated second", second_after_laying))
    return parts


POSTS = 8
POST_M = 0.01  # their diameter
_CLOSE_M = 0.0005  # between the surfaces of DLO and post: an S that springs back touches the posts


def _start(config: RunConfig) -> Float64Array:
    dlo = config.cell.dlo
    return builtin_shape("S", dlo.length_m, 101, radius_m=dlo.radius_m)


def posts_along(curve_world: Float64Array) -> tuple[Post, ...]:
    """Posts beside a curve (K, 3) [m] on the table, on alternate sides."""
    posts: list[Post] = []
    for number in range(POSTS):
        name, at = f"P{number}", round((number + 0.5) / POSTS * (len(curve_world) - 1))
        along = geometry.tangents(curve_world)[at]
        aside_m = (-1) ** number * (curve_world[at, 2] + POST_M / 2.0 + _CLOSE_M)
        x, y = (float(place) for place in curve_world[at, :2] + aside_m * np.array([-along[1], along[0]]))
        posts.append(Post(name=name, position_m=(x, y, 0.0), diameter_m=POST_M))
    return tuple(posts)


def _parts(cell: Cell, config: RunConfig) -> list[Part]:
    """All else."""
    images, arm = cell.capture(), (PosedArm(PANDA, cell.arm_state()),)
    look = perceive(images, arm, config.perception, config.perception.segmentation, config.model.radius_m).observation
    targets = initial_targets(look, config.model.nodes, config.model.length_m)
    prior = DloState(
        stamp_ns=0,
        nodes_world=targets.nodes_world,
        topology=chain(config.model.nodes, config.model.length_m),
    )
    strategy = config.observer.strategy.build(config.model)
    tracker = PdTracker(config.model)
    tracker.place(targets.nodes_world)
    return [
        ("cell: stereo pair rendered", "look", cell.capture),
        (
            "perception: pictures to points",
            "look",
            lambda: perceive(images, arm, config.perception, config.perception.segmentation, config.model.radius_m),
        ),
        ("observer: points to targets", "look", lambda: followed(strategy, look, prior, config.observer).targets),
        ("model: PD tracking", "look", lambda: tracker.track(targets.nodes_world, targets.visible, ())),
    ]


def _measure(parts: Sequence[Part], repeats: int, said: Callable[[str], object]) -> list[Timing]:
    """Every part in turn, over and over, so that what else the machine does falls on all of them alike."""
    taken: list[list[float]] = [[] for _ in parts]
    for round_ in range(1 + repeats):
        said(f"{len(parts)} parts, repetition {round_} of {repeats}")
        for times, (_, _, function) in zip(taken, parts, strict=True):
            began = time.perf_counter()
            function()
            if round_ > 0:  # the first call loads and allocates
                times.append(time.perf_counter() - began)
    return [
        Timing(part=part, seconds=tuple(times), per=per) for times, (part, per, _) in zip(taken, parts, strict=True)
    ]


if __name__ == "__main__":
    run_study(Args, run, __doc__)
