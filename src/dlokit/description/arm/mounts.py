"""An arm by its name, and where it stands."""

from dataclasses import dataclass

from dlokit.description.arm.franka import PANDA
from dlokit.description.arm.model import ArmModel
from dlokit.errors import ConfigError
from dlokit.ranges import check_ranges
from dlokit.types.pose import Pose
from dlokit.types.robot import FIRST_ROBOT

OPPOSITE = "opposite"
"""Name of the second arm."""
ROBOTS = (FIRST_ROBOT, OPPOSITE)
"""Names of all arms that there may be; a run has the first of them."""


@dataclass(frozen=True, kw_only=True)
class WorkspaceBox:
    """The box that a tool centre point never leaves, in the world."""

    lower_m: tuple[float, float, float] = (-0.3, -0.9, 0.0)
    """Corner with the smallest x, y and z [m]."""
    upper_m: tuple[float, float, float] = (1.34, 0.9, 1.2)
    """The opposite corner [m]; by default the box holds what one arm, or two opposite arms, reach in front."""

    def __post_init__(self) -> None:
        check_ranges(self, "workspace")
        if not all(a < b for a, b in zip(self.lower_m, self.upper_m, strict=True)):
            raise ConfigError(
                f"the workspace of an arm has lower_m {self.lower_m} and upper_m {self.upper_m}; the first must be "
                "below the second in x, y and z."
            )


WORKSPACE = WorkspaceBox()


@dataclass(frozen=True, kw_only=True)
class ArmMount:
    """An arm by its name, and where it stands in the world."""

    robot: str
    model: ArmModel = PANDA
    T_world_base: Pose | None = None
    """None: at the world's origin."""
    workspace: WorkspaceBox = WORKSPACE

    @property
    def instance(self) -> str:
        """Which of its kind its component is, for `Skill.at` and `Topic.at`."""
        return instance_of(self.robot)

    @property
    def place_m(self) -> tuple[float, float]:
        """Where its base stands on the table (x, y) [m]."""
        if self.T_world_base is None:
            return (0.0, 0.0)
        x, y = self.T_world_base.position_m[:2].tolist()
        return (x, y)


FIRST_ALONE = (ArmMount(robot=FIRST_ROBOT),)
"""A Panda at the world's origin."""


def instance_of(robot: str) -> str:
    """The instance of the component `robot` that moves the robot of a name; empty for the first."""
    return "" if robot == FIRST_ROBOT else robot
