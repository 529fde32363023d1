"""Which arms a cell may have, and where they stand.

The second stands opposite the first, as far from the middle of the usable table as that one: what one arm reaches and
hides from the camera, the other does turned by half a turn about the middle. Each reaches all of the table but the
corners far from it, which the other reaches.
"""

from dataclasses import dataclass, replace

from dlokit import geometry
from dlokit.description.arm.franka import PANDA
from dlokit.description.arm.model import ArmModel
from dlokit.description.shapes import CENTRE_M
from dlokit.types.pose import Pose
from dlokit.types.robot import FIRST_ROBOT

OPPOSITE = "opposite"
"""Name of the second arm."""


@dataclass(frozen=True, kw_only=True)
class ArmMount:
    """An arm by its name, and where it stands."""

    robot: str
    model: ArmModel = PANDA
    T_world_base: Pose | None = None
    """None: at the world's origin."""

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


ARMS: tuple[ArmMount, ...] = (
    ArmMount(robot=FIRST_ROBOT),
    ArmMount(
        robot=OPPOSITE,
        T_world_base=geometry.pose((2.0 * CENTRE_M[0], 2.0 * CENTRE_M[1], 0.0), (0.0, 0.0, 0.0, 1.0)),
    ),
)
"""Every arm that there may be, as Pandas; a cell has the first of them."""

FIRST_ALONE = ARMS[:1]


def arms_of(model: ArmModel, count: int) -> tuple[ArmMount, ...]:
    """The first `count` arms, all of one model."""
    return tuple(replace(mount, model=model) for mount in ARMS[:count])


def instance_of(robot: str) -> str:
    """The instance of the component `robot` that moves the robot of a name; empty for the first."""
    return "" if robot == FIRST_ROBOT else robot
