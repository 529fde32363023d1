"""`dlokit bench simulation`: where the time of a lockstep run goes, part by part, on this machine."""

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

from dlokit.description.shapes import builtin_shape
from dlokit.functional.cell.config import TICK_S
from dlokit.functional.cell.dlo_physics import PHYSICS
from dlokit.functional.cell.world import Cell
from dlokit.skills.model.tracking import Tracker
from dlokit.skills.observer.anchored import chain
from dlokit.skills.observer.following import follow
from dlokit.skills.observer.initialise.first_shape import initial_targets
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
    """Time every part on the same scene: an S on the table, the arm at home; both physics of the DLO."""
    cells = {name: Cell(replace(config.cell, physics=kind()), seed=config.seed) for name, kind in PHYSICS.items()}
    cell = cells[config.cell.physics.name]
    try:
        return _measure(_physics(cells, config) + _parts(cell, config), repeats)
    finally:
        cell.close()


Part = tuple[str, str, Callable[[], object]]
"""Name, of what the time is told, and the function that is timed."""


def _physics(cells: Mapping[str, Cell], config: RunConfig) -> list[Part]:
    """A second of each physics, lying still and while it comes to rest."""
    dlo = config.cell.dlo
    start = builtin_shape("S", dlo.length_m, 101, radius_m=dlo.radius_m)
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


def _parts(cell: Cell, config: RunConfig) -> list[Part]:
    """All else."""
    images, arm = cell.capture(), (cell.arm_state(),)
    look = perceive(images, arm, config.perception, config.perception.segmentation, config.model.radius_m).observation
    targets = initial_targets(look, config.model.nodes, config.model.length_m, config.observer.initialise)
    prior = DloState(
        stamp_ns=0,
        nodes_world=targets.nodes_world,
        topology=chain(config.model.nodes, config.model.length_m),
    )
    strategy = config.observer.strategy.build(config.model)
    tracker = Tracker(config.model)
    tracker.place(targets.nodes_world)
    return [
        ("cell: stereo pair rendered", "look", cell.capture),
        (
            "perception: pictures to points",
            "look",
            lambda: perceive(images, arm, config.perception, config.perception.segmentation, config.model.radius_m),
        ),
        ("observer: points to targets", "look", lambda: follow(strategy, look, prior, config.observer)),
        ("model: PD tracking", "look", lambda: tracker.track(targets.nodes_world, targets.visible, ())),
    ]


def _measure(parts: Sequence[Part], repeats: int) -> list[Timing]:
    """Every part in turn, over and over, so that what else the machine does falls on all of them alike."""
    taken: list[list[float]] = [[] for _ in parts]
    for round_ in range(1 + repeats):
        for times, (_, _, function) in zip(taken, parts, strict=True):
            began = time.perf_counter()
            function()
            if round_ > 0:  # the first call loads and allocates
                times.append(time.perf_counter() - began)
    return [
        Timing(part=part, seconds=tuple(times), per=per) for times, (part, per, _) in zip(taken, parts, strict=True)
    ]
