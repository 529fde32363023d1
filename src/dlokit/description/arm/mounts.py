"""An arm by its name, and where it stands."""

from dataclasses import dataclass

from dlokit.description.arm.franka import PANDA
from dlokit.description.arm.model import ArmModel
from dlokit.errors import ConfigError
from dlokit.ranges import check_ranges
from dlokit.types.pose import Pose
from dlokit.types.robot import FIRST_ROBOT

SECOND = "second"
"""Name of the second arm."""
ROBOTS = (FIRST_ROBOT, SECOND)
"""Names of all arms that there may be, unless the installation names them; a run has the first of them."""
INSTANCES = ("", SECOND)
"""Their addresses, for `Skill.at` and `Topic.at`: instances of the component `robot`, whatever the arms' names."""


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

    robot: str = FIRST_ROBOT
    """Its name, which messages carry."""
    instance: str = ""
    """Its address, one of `INSTANCES`."""
    model: ArmModel = PANDA
    T_world_base: Pose | None = None
    """None: at the world's origin."""
    workspace: WorkspaceBox = WORKSPACE

    @property
    def place_m(self) -> tuple[float, float]:
        """Where its base stands on the table (x, y) [m]."""
        if self.T_world_base is None:
            return (0.0, 0.0)
        x, y = self.T_world_base.position_m[:2].tolist()
        return (x, y)


FIRST_ALONE = (ArmMount(),)
"""A Panda at the world's origin."""
