"""What an action strategy is."""

from collections.abc import AsyncIterator, Awaitable, Callable, Sequence
from dataclasses import dataclass, field
from typing import ClassVar, Protocol, runtime_checkable

from dlokit.communication.port import Compute, InlineCompute
from dlokit.rod.believed import BelievedDlo
from dlokit.skills.planning.actions import ActionConfig, FeasibilityConfig
from dlokit.types.action import Action, Candidates, Marks
from dlokit.types.dlo import DloState, GoalShape
from dlokit.types.pose import Pose

Reachable = Callable[[Pose], bool]
"""Whether the robot can bring its tool to a pose within its joint limits."""


async def _tell_nobody(_: Candidates) -> None:
    """Ignores everything."""


class ActionStrategy(Protocol):
    """Chooses what to do to bring a shape to a goal."""

    def propose(self, shape: DloState, goal: GoalShape, marks: Marks) -> AsyncIterator[Action]:
        """Valid actions, best first, so that Fig. 6 can take the next best; may end without any.

        Both shapes have M nodes; nodes in `marks` were tried in vain and are left out. Every action says its
        velocity profile.
        """
        ...


@dataclass(frozen=True)
class SecondArm:
    """A further arm, with what planning needs to know of it."""

    robot: str
    reachable: Reachable
    place_m: tuple[float, float]
    """Where its base stands (x, y) [m]."""
    apart_m: Callable[[Sequence[Pose], Sequence[Pose]], float]
    """How near the arms come [m] from home to home, the first along its tool poses and the second along its own."""


@dataclass(frozen=True)
class PlanningTools:
    """What a strategy may use."""

    reachable: Reachable
    actions: ActionConfig
    model: BelievedDlo = field(default_factory=BelievedDlo)
    """The rod with which actions are simulated."""
    table: FeasibilityConfig = field(default_factory=FeasibilityConfig)
    """Where the rod may lie."""
    compute: Compute = field(default_factory=InlineCompute)
    """Where heavy work goes."""
    tell: Callable[[Candidates], Awaitable[None]] = _tell_nobody
    """Shows what is considered, and lets others have their turn."""
    stopwatch: Callable[[], float] | None = None
    """The machine's time [s], where a decision must end in time; None: work is counted, and runs repeat."""
    second: SecondArm | None = None
    """None: there is one arm."""


class StrategyConfig(Protocol):
    """The settings of a strategy, which know how to build it. Frozen dataclasses, one a strategy.

    Every process loads them, with the module in which they stand: large libraries and what is compiled are imported
    where they are called.
    """

    name: ClassVar[str]

    def build(self, tools: PlanningTools) -> ActionStrategy:
        """The strategy with these settings."""
        ...


@runtime_checkable
class Loaded(Protocol):
    """The settings of a strategy whose first decision would wait for a compiler."""

    def load(self) -> object:
        """Compile what the strategy needs, or load it where that was done before."""
        ...
