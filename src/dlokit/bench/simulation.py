"""`dlokit bench simulation`: where the time of a lockstep run goes, part by part, on this machine."""

import time
from collections.abc import Callable
from dataclasses import dataclass

from dlokit.description.shapes import builtin_shape
from dlokit.functional.cell.config import TICK_S
from dlokit.functional.cell.world import Cell
from dlokit.skills.model.tracking import Tracker
from dlokit.skills.observer.anchored import chain
from dlokit.skills.observer.component import follow
from dlokit.skills.observer.initialise import initial_targets
from dlokit.skills.perception.pipeline import perceive
from dlokit.system.config import RunConfig
from dlokit.types.dlo import DloState


@dataclass(frozen=True, kw_only=True)
class Timing:
    """How long one part takes."""

    part: str
    seconds: tuple[float, ...]
    """Of each repetition [s]."""
    per: str
    """Of what, e.g. ``"look"``."""


def measure(config: RunConfig, repeats: int) -> list[Timing]:
    """Time every part on the same scene: an S on the table, the arm at home."""
    cell = Cell(config.cell, seed=config.seed)
    try:
        cell.place_dlo(builtin_shape("S", config.cell.dlo.length_m, 101, radius_m=config.cell.dlo.radius_m))
        return _measure(cell, config, repeats)
    finally:
        cell.close()


def _measure(cell: Cell, config: RunConfig, repeats: int) -> list[Timing]:
    images, arm = cell.capture(), (cell.arm_state(),)
    look = perceive(images, arm, config.perception, config.perception.segmentation).observation
    targets = initial_targets(look, config.model.nodes, config.model.length_m, config.observer.initialise)
    prior = DloState(
        stamp_ns=0,
        nodes_world=targets.nodes_world,
        topology=chain(config.model.nodes, config.model.length_m),
    )
    strategy = config.observer.strategy.build()
    tracker = Tracker(config.model)
    tracker.place(targets.nodes_world)

    def second_of_physics() -> None:
        for _ in range(round(1.0 / TICK_S)):
            cell.step(TICK_S)

    parts: list[tuple[str, str, Callable[[], object]]] = [
        ("cell: physics", "simulated second", second_of_physics),
        ("cell: stereo pair rendered", "look", cell.capture),
        (
            "perception: pictures to points",
            "look",
            lambda: perceive(images, arm, config.perception, config.perception.segmentation),
        ),
        ("observer: points to targets", "look", lambda: follow(strategy, look, prior, config.observer)),
        ("model: PD tracking", "look", lambda: tracker.track(targets.nodes_world, targets.visible, ())),
    ]
    return [Timing(part=part, seconds=_times(function, repeats), per=per) for part, per, function in parts]


def _times(function: Callable[[], object], repeats: int) -> tuple[float, ...]:
    function()  # the first call loads and allocates
    taken: list[float] = []
    for _ in range(repeats):
        began = time.perf_counter()
        function()
        taken.append(time.perf_counter() - began)
    return tuple(taken)
