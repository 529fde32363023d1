"""What an action strategy is."""

from collections.abc import AsyncIterator, Awaitable, Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import ClassVar, Protocol, runtime_checkable

from dlokit.communication.port import Compute, InlineCompute
from dlokit.description.arm.franka import PANDA
from dlokit.description.arm.model import ArmModel
from dlokit.description.scene import NO_FIXTURES, Scene
from dlokit.rod.believed import BelievedDlo
from dlokit.skills.planning.actions import ActionConfig, FeasibilityConfig
from dlokit.skills.planning.room import HandRoom
from dlokit.types.action import Action, Candidates, Marks
from dlokit.types.dlo import DloState, GoalShape
from dlokit.types.pose import Pose

Reachable = Callable[[Pose], bool]
"""Whether the robot can bring its tool to a pose within its joint limits."""


async def _ignore(_: Candidates) -> None:
    """Ignores everything."""


class ActionStrategy(Protocol):
    """Chooses actions that bring a shape to a goal."""

    def propose(self, shape: DloState, goal: GoalShape, marks: Marks) -> AsyncIterator[Action]:
        """Valid actions, best first, so that Fig. 6 can take the next best; may end without any.

        Both shapes have M nodes; nodes in `marks` were tried without effect and are omitted. Every action has its
        velocity profile.
        """
        ...


@dataclass(frozen=True)
class SecondArm:
    """A further arm, with what planning needs to know of it."""

    robot: str
    arm: ArmModel
    reachable: Reachable
    place_m: tuple[float, float]
    """Position of its base (x, y) [m]."""
    apart_m: Callable[[Sequence[Pose], Sequence[Pose]], float]
    """Smallest distance of the arms [m] from home to home, each along its own tool poses."""


@dataclass(frozen=True)
class PlanningTools:
    """What a strategy may use."""

    reachable: Reachable
    """Whether the arm can bring its tool to a pose within its joint limits."""
    actions: ActionConfig
    """Settings of actions: heights, speeds, clearances."""
    arm: ArmModel = PANDA
    """The arm that moves the tool, and its gripper."""
    place_m: tuple[float, float] = (0.0, 0.0)
    """Position of its base (x, y) [m]."""
    model: BelievedDlo = field(default_factory=BelievedDlo)
    """The rod with which actions are simulated."""
    table: FeasibilityConfig = field(default_factory=FeasibilityConfig)
    """Where the rod may lie."""
    compute: Compute = field(default_factory=InlineCompute)
    """Where heavy work goes."""
    tell: Callable[[Candidates], Awaitable[None]] = _ignore
    """Publishes the considered candidates, and lets other components run."""
    stopwatch: Callable[[], float] | None = None
    """The machine's time [s], if decisions have a time limit; None: only rollouts are limited, and runs repeat."""
    second: SecondArm | None = None
    """None: there is one arm."""
    scene: Scene = NO_FIXTURES
    """The fixtures as the system believes them."""

    @property
    def of_second(self) -> "PlanningTools":
        """The same for the second arm, which must be there."""
        assert self.second is not None, "only pairs ask for the second arm"
        second = self.second
        return replace(self, reachable=second.reachable, arm=second.arm, place_m=second.place_m, second=None)

    @property
    def room(self) -> HandRoom:
        """The room of the arm's hand among the fixtures."""
        return HandRoom(self.arm, self.scene, self.model.radius_m)

    @property
    def grasp_height_m(self) -> float:
        """Height of the tool centre point over the table at grasp and release [m]."""
        return self.arm.gripper.grasp_height_m(self.actions.grasp.tip_clearance_m)


class StrategyConfig(Protocol):
    """Settings and factory of a strategy: a frozen dataclass for each strategy.

    Every process imports their module: large libraries and compiled code are imported
    where they are called.
    """

    name: ClassVar[str]

    def build(self, tools: PlanningTools) -> ActionStrategy:
        """The strategy with these settings."""
        ...


@runtime_checkable
class Loaded(Protocol):
    """Settings of a strategy that has code to compile."""

    def load(self) -> object:
        """Compile the strategy's code, or load it from the cache."""
        ...
