"""What is compared: who sees and who chooses, by name."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

from dlokit.skills.observer.strategies import OBSERVERS
from dlokit.skills.planning.strategies import PLANNERS
from dlokit.system.config import RunConfig

IDEAL = "ideal"
"""The observer's place in a run whose state is taken from the cell's truth."""


@dataclass(frozen=True, kw_only=True)
class Method:
    """Who sees and who chooses, by the names of the strategies."""

    observer: str
    planner: str

    @property
    def name(self) -> str:
        """As tables call it."""
        return f"{self.planner}, {self.observer}"

    @property
    def sees_truth(self) -> bool:
        """Whether the state is the cell's truth."""
        return self.observer == IDEAL


def methods_of(config: RunConfig, observers: Sequence[str], planners: Sequence[str]) -> tuple[Method, ...]:
    """Every planner with every observer; where none is named, the configuration's."""
    return tuple(
        Method(observer=observer, planner=planner)
        for planner in planners or (config.planning.strategy.name,)
        for observer in observers or (config.observer.strategy.name,)
    )


def with_method(config: RunConfig, method: Method) -> RunConfig:
    """The configuration with a method's strategies, those that it had with their settings, others with their defaults.

    Raises `ConfigError` for a name that is not known.
    """
    observer, planning = config.observer, config.planning
    if method.observer != observer.strategy.name and not method.sees_truth:
        observer = replace(observer, strategy=OBSERVERS.named(method.observer, "--observer")())
    if method.planner != planning.strategy.name:
        planning = replace(planning, strategy=PLANNERS.named(method.planner, "--planner")())
    # The truth needs no camera, whose place could be checked.
    task = replace(config.task, check_camera=config.task.check_camera and not method.sees_truth)
    return replace(config, observer=observer, planning=planning, task=task)
