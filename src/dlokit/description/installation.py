"""The installation in a lab: poses of table, arms, camera and fixtures, as people measure them.

All places of an installation are in one frame, which the person who measures them chooses: the base of an arm, a corner
of the table, a mark on the floor; its z axis points up. The world frame, in which dlokit works, is on the table: its
origin is a point of the table's top, z is the normal of the top, and DLOs rest at z = radius (decision 23). By default
both frames are the same, in the base of the first arm. Fixtures stand on the table and are measured there, in the
world.
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from dlokit import geometry
from dlokit.description.arm.mounts import INSTANCES, ROBOTS, WORKSPACE, ArmMount, WorkspaceBox, arm_model
from dlokit.description.dlo import GRAVITY_M_S2
from dlokit.description.scene import Fixture, check_fixtures
from dlokit.description.shapes import CENTRE_M
from dlokit.description.table import Table
from dlokit.errors import ConfigError
from dlokit.ranges import check_ranges
from dlokit.types.arrays import Float64Array
from dlokit.types.pose import Pose


@dataclass(frozen=True, kw_only=True)
class Place:
    """A pose as people measure it."""

    position_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Its origin in the installation's frame [m]."""
    rpy_deg: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Roll, pitch, yaw: turns about the x, the y, then the z axis of the installation's frame [°]."""

    def __post_init__(self) -> None:
        check_ranges(self, "installation")

    @property
    def pose(self) -> Pose:
        """The same as position and quaternion: ``T_installation_place``."""
        return geometry.pose_from_angles(self.position_m, self.rpy_deg)


@dataclass(frozen=True, kw_only=True)
class InstalledTable(Place, Table):
    """The table. `position_m` is a point of its top, the origin of the world; `rpy_deg` inclines and turns it."""


@dataclass(frozen=True, kw_only=True)
class InstalledArm(Place):
    """An arm with its gripper. `position_m` and `rpy_deg` are the pose of its base."""

    name: str = ""
    """Its name in messages; empty: first or second, by its order in the file."""
    model: str = "panda"
    """panda, fr3, ur5e, or a .toml file, which also describes its tool and gripper."""
    home_deg: tuple[float, ...] = ()
    """Joint angles at which it occludes no part of the table [°]; empty: the model's home."""
    workspace: WorkspaceBox = WORKSPACE
    """Box in the world that its tool centre point never leaves."""


_FACING = InstalledArm(position_m=(2.0 * CENTRE_M[0], 2.0 * CENTRE_M[1], 0.0), rpy_deg=(0.0, 0.0, 180.0))
"""The second arm of the default cell faces the first, at the same distance from the middle of the usable table. Its
reach and its occlusions are the first arm's, turned by half a turn about the middle. Each arm reaches all of the table
except the corners far from it, which the other arm reaches."""


_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_-]{0,29}")


def _check_names(robots: Sequence[str]) -> None:
    for number, robot in enumerate(robots):
        if not _NAME.fullmatch(robot):
            raise ConfigError(
                f"the name of an arm is {robot!r}; use up to 30 letters, digits, - and _, and a letter first."
            )
        if robot in robots[:number] or robot in set(ROBOTS) - {ROBOTS[number]}:
            raise ConfigError(f"two arms could be called {robot!r}: give arm {number + 1} another name.")


@dataclass(frozen=True, kw_only=True)
class Installation:
    """Poses of table, arms, camera and fixtures; the default is the simulated cell of the paper."""

    table: InstalledTable = field(default_factory=InstalledTable)
    arms: tuple[InstalledArm, ...] = (InstalledArm(), _FACING)
    """The arms, the one that is used alone first."""
    fixtures: tuple[Fixture, ...] = ()
    """Posts and boxes on the table, in the world."""
    camera: Place | None = None
    """The camera (x right, y down, z forward); None: a simulated camera is at the pose of the paper's camera in this
    frame, any other at the pose from its driver or its calibration."""

    def __post_init__(self) -> None:
        if not 1 <= len(self.arms) <= len(ROBOTS):
            raise ConfigError(f"an installation has {len(self.arms)} [[arms]]; one or {len(ROBOTS)} are allowed.")
        _check_names(self.robots)
        check_fixtures(self.fixtures, self.table)

    @property
    def robots(self) -> tuple[str, ...]:
        """The names of the arms."""
        return tuple(arm.name or usual for arm, usual in zip(self.arms, ROBOTS, strict=False))

    @cached_property
    def T_world_installation(self) -> Pose | None:
        """None: the world's frame is the installation's."""
        table = self.table.pose
        return None if _is_identity(table) else geometry.inverse(table)

    def in_world(self, T_installation_place: Pose) -> Pose:
        """Convert a pose from the installation's frame to the world."""
        T = self.T_world_installation
        return T_installation_place if T is None else geometry.compose(T, T_installation_place)

    def camera_in_world(self, T_installation_camera: Pose) -> Pose:
        """The camera's pose in the world, from the file, or else from a given pose in the installation."""
        return self.in_world(T_installation_camera if self.camera is None else self.camera.pose)

    @cached_property
    def gravity_world(self) -> Float64Array:
        """Acceleration by gravity (3,) [m/s²]; on an inclined table it is not along z."""
        down = np.array([0.0, 0.0, -GRAVITY_M_S2])
        T = self.T_world_installation
        return down if T is None else geometry.rotation(T) @ down

    def mounts(self, count: int, model: str = "") -> tuple[ArmMount, ...]:
        """The first `count` arms; `model` replaces the installed one, with its own home.

        Raises `ConfigError` if there are fewer, or a home does not fit its arm, and as `arm_model` does.
        """
        if count > len(self.arms):
            raise ConfigError(f"--arms is {count}, and the installation has {len(self.arms)}: describe another there.")
        return tuple(self._mount(number, model) for number in range(count))

    def _mount(self, number: int, model: str) -> ArmMount:
        arm = self.arms[number]
        replaced = model not in ("", arm.model)
        base = self.in_world(arm.pose)
        return ArmMount(
            robot=self.robots[number],
            instance=INSTANCES[number],
            model=arm_model(model or arm.model, () if replaced else tuple(np.radians(arm.home_deg).tolist())),
            T_world_base=None if _is_identity(base) else base,
            workspace=arm.workspace,
        )


PAPERS_CELL = Installation()
"""The simulated cell, with the paper's camera; its second arm is used by runs with two arms."""


def _is_identity(T: Pose) -> bool:
    return not np.any(T.position_m) and T.wxyz[0] == 1.0
