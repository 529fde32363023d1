"""The model of an arm with its gripper: joints, limits, home, tool, shapes. It needs no simulator.

Kinematics, the self-filter, the trajectory checks, the viewer and the simulated cell all use it. `mounts` names the
arms that dlokit includes; `arm_file` reads further arms.

The frame of a link is the one of the joint that moves it, z along the joint's axis. The hand is fixed to the last link;
its z axis is the direction of approach, and its fingers move apart along its y axis. Each finger's frame moves with the
finger, and its y axis points away from the other finger, so that both are alike.
"""

import importlib.util
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

import numpy as np

from dlokit.errors import MachineError, pip_command
from dlokit.geometry import homogeneous
from dlokit.types.arrays import Float64Array
from dlokit.types.robot import JointLimits, RobotReason

Vector = tuple[float, float, float]

HAND = "hand"
"""Link that carries the fingers."""
FINGER_LINKS = ("left_finger", "right_finger")
"""The links of the two fingers; the left one moves along y of the hand, the right one against it."""
TIP_CLEARANCE_M = 0.0021
"""Usual distance of the fingertips from the table while they grasp a DLO on it [m].

The pads of a common gripper then hold a DLO of 4 mm radius 7 mm below the tool centre point.
"""

_FASTEST_RAD_S = 50.0
_FARTHEST_RAD = 4.0 * np.pi
"""Limit of plausible joint speeds: the fastest arms reach 25 rad/s. Larger velocities, or angles beyond two turns in
either direction, are in degrees or mean no limit; `arm_file` reads the angles of joints of many turns."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Joint:
    """A revolute joint and the link that it turns about its z axis."""

    name: str
    """Its name in the robot's description, by which ROS knows it."""
    link: str
    T_parent_link: Float64Array  # (4, 4) at angle 0, in the frame of the link before
    torque_nm: float
    """Largest torque [N·m]."""
    stiffness_nm_rad: float
    """Stiffness with which the simulated arm's controller holds the joint [N·m/rad]."""


@dataclass(frozen=True, kw_only=True)
class Inertia:
    """Mass [kg], centre of mass in the link frame [m], and inertia about it (xx, yy, zz, xy, xz, yz) [kg·m²]."""

    mass_kg: float
    center_m: Vector
    inertia_kg_m2: tuple[float, float, float, float, float, float]


@dataclass(frozen=True, kw_only=True)
class Capsule:
    """All points within `radius_m` of the segment from `start_m` to `end_m`, both in the frame of `link` [m]."""

    link: str
    start_m: Vector
    end_m: Vector
    radius_m: float


def package_folder(package: str, wheel: str, missing: str) -> Path:
    """The folder of an importable package. Raises `MachineError`, which begins with `missing`, when it is not there."""
    found = importlib.util.find_spec(package)
    if found is None or found.origin is None:
        raise MachineError(f"{missing} with the package {wheel}; run: {pip_command(wheel)}")
    return Path(found.origin).parent


@dataclass(frozen=True, kw_only=True, eq=False)
class Surface:
    """A mesh file to draw a link, in the link's frame unless it has a transform."""

    file: str
    """Path, below the package's folder if there is a `package`."""
    package: str = ""
    """Importable package that carries the file."""
    wheel: str = ""
    """What to install for that package."""
    T_link_mesh: Float64Array = field(default_factory=lambda: np.eye(4))  # (4, 4)
    dark: bool = False
    """Whether it is drawn dark, as fingers are."""

    @property
    def path(self) -> Path:
        """The file. Raises `MachineError` when its package is not installed, or the file is missing."""
        folder = Path()
        if self.package:
            folder = package_folder(self.package, self.wheel, "The meshes of an arm are missing: they come")
        path = folder / self.file
        if not path.is_file():
            raise MachineError(f"The mesh {path} is missing; install its package again, or correct the arm's file.")
        return path


@dataclass(frozen=True, kw_only=True)
class Gripper:
    """Two parallel fingers that open symmetrically."""

    title: str
    finger_m: float
    """From the hand to the fingers' frames, along z [m]."""
    tcp_m: float
    """From the hand to the tool centre point, along z [m]; the TCP has the hand's orientation."""
    tip_below_tcp_m: float
    """Distance from the tool centre point to the ends of the fingertips, wide open [m]."""
    pad_half_length_m: float
    """Half the extent of a fingertip along x, along the grasped DLO [m]."""
    pad_half_thickness_m: float
    """Half the thickness of a fingertip along y; its inner face is at y = 0 of the finger's frame [m]."""
    open_width_m: float
    """Largest distance between the fingertips [m]."""
    force_n: float
    """Largest continuous force of the fingers [N]."""
    finger_speed_m_s: float
    """Speed of each finger [m/s]."""
    closed_half_width_m: float | None = None
    """Half the extent of both fingertips along y when they are closed, the width with which they push [m]; None: as
    wide as their pads."""
    tip_drop: tuple[tuple[float, float], ...] = ()
    """Pairs of width and drop [m]: the height that the fingertips lose at a width compared with wide open, for tips
    that move along an arc. Widths grow; between them the drop is interpolated. Empty: the tips move straight."""

    def tip_drop_m(self, width_m: float) -> float:
        """Drop of the fingertips at a width, compared with wide open [m]."""
        if not self.tip_drop:
            return 0.0
        widths_m, drops_m = zip(*self.tip_drop, strict=True)
        return float(np.interp(width_m, widths_m, drops_m))

    @property
    def lowest_width_m(self) -> float:
        """The width at which the fingertips are lowest [m]; wide open where they move straight."""
        return max(self.tip_drop, key=lambda pair: pair[1], default=(self.open_width_m, 0.0))[0]

    @property
    def largest_tip_drop_m(self) -> float:
        """The drop at that width [m]."""
        return self.tip_drop_m(self.lowest_width_m)

    def refusal(self, width_m: float, force_n: float) -> tuple[RobotReason, str] | None:
        """Why the fingers cannot move to a width and press with a force, or None if they can."""
        if not 0.0 <= width_m <= self.open_width_m:
            return RobotReason.BAD_WIDTH, f"{width_m} m; the fingers open between 0 and {self.open_width_m} m"
        if not 0.0 < force_n <= self.force_n:
            return RobotReason.BAD_FORCE, f"{force_n} N; the hand presses with up to {self.force_n} N"
        return None

    def grasp_height_m(self, tip_clearance_m: float = TIP_CLEARANCE_M) -> float:
        """Height of the tool centre point over the table with the fingertips clear of it [m], to the micrometre.

        They are clear of it at every width, because the fingers close there.
        """
        return round(self.tip_below_tcp_m + self.largest_tip_drop_m + tip_clearance_m, 6)

    @property
    def pushing_half_width_m(self) -> float:
        """Half the extent along y of closed fingers that push [m]."""
        return 2.0 * self.pad_half_thickness_m if self.closed_half_width_m is None else self.closed_half_width_m

    def errors(self) -> Iterator[str]:
        """A text that describes an impossible size: of 0, in millimetres, or tips that drop farther than a finger."""
        sizes = ("finger_m", "tcp_m", "tip_below_tcp_m", "pad_half_length_m", "pad_half_thickness_m", "open_width_m")
        for name, most in {**dict.fromkeys((*sizes, "finger_speed_m_s"), 1.0), "force_n": 10_000.0}.items():
            if not 0.0 < getattr(self, name) <= most:
                yield f"{name} is {getattr(self, name)}; it must be above 0 and at most {most:g}"
        if self.closed_half_width_m is not None and not 0.0 < self.closed_half_width_m <= 1.0:
            yield f"closed_half_width_m is {self.closed_half_width_m}; it must be above 0 and at most 1"
        if self.finger_m >= self.tcp_m:
            yield f"finger_m is {self.finger_m}; it must be below tcp_m, {self.tcp_m}"
        if self.tip_drop and self.tip_drop_m(self.open_width_m) != 0.0:
            yield "tip_drop is not 0 at open_width_m: it is measured against the tips wide open, as tip_below_tcp_m is"
        if self.largest_tip_drop_m >= self.tcp_m - self.finger_m + self.tip_below_tcp_m:
            yield f"tip_drop has {self.largest_tip_drop_m} m, more than the length of a finger"


@dataclass(frozen=True, kw_only=True)
class FrankaDimensions:
    """Lengths of an arm of Franka's kind [m], with which a gripper that points down has a closed solution."""

    shoulder_height_m: float
    upper_arm_m: float
    forearm_m: float
    elbow_offset_m: float
    wrist_offset_m: float


@dataclass(frozen=True, kw_only=True, eq=False)
class ArmModel:
    """An arm on its base link, with J revolute joints in a chain, a hand and two fingers."""

    name: str
    """Name or file that `mounts.arm_model` takes; a pickled arm contains only this and its home."""
    title: str
    """Its name for people."""
    base: str
    """The link that does not move."""
    joints: tuple[Joint, ...]
    limits: JointLimits
    home_q_rad: Float64Array  # (J,) [rad]
    """Looking position: gripper down, folded back, so that the camera sees the whole table."""
    T_last_hand: Float64Array  # (4, 4)
    """Pose of the hand on the last link."""
    gripper: Gripper
    inertias: Mapping[str, Inertia]
    capsules: tuple[Capsule, ...]
    """Capsules around every link that may collide."""
    may_meet: tuple[tuple[str, str], ...]
    """Pairs of links that can collide within the joint limits; neighbours overlap at their joint and are not listed."""
    above_table: frozenset[str]
    """Links that could touch the table."""
    roomiest_yaw_rad: float
    """Yaw of a tool that points down, relative to its bearing from the base, at which the wrist has the most room
    [rad]."""
    surfaces: Mapping[str, tuple[Surface, ...]] = field(default_factory=dict[str, tuple[Surface, ...]])
    """Meshes by link; a link without any is drawn as its capsules."""
    franka: FrankaDimensions | None = None
    """None: its inverse kinematics is solved by steps alone."""
    moved_home: bool = False
    """Whether `home_q_rad` comes from an installation."""

    def __repr__(self) -> str:
        """Its name alone: signatures that have an arm as a default stay readable."""
        return f"<ArmModel {self.name}>"

    @cached_property
    def links(self) -> tuple[str, ...]:
        """Every link with a shape, from the base to the fingers: the order of `forward_kinematics`."""
        return (self.base, *(joint.link for joint in self.joints), HAND, *FINGER_LINKS)

    @cached_property
    def radii_m(self) -> Float64Array:
        """Radii (C,) [m] of the capsules, in their order."""
        return np.array([capsule.radius_m for capsule in self.capsules])

    @cached_property
    def meeting_capsules(self) -> tuple[tuple[int, ...], tuple[int, ...]]:
        """Indices of the capsules that can collide, the first and the second of each pair."""
        of_link = {
            link: [index for index, capsule in enumerate(self.capsules) if capsule.link == link] for link in self.links
        }
        pairs = [(i, j) for a, b in self.may_meet for i in of_link[a] for j in of_link[b]]
        return tuple(i for i, _ in pairs), tuple(j for _, j in pairs)

    @cached_property
    def T_last_tcp(self) -> Float64Array:
        """Pose of the tool centre point on the last link, (4, 4)."""
        return self.T_last_hand @ homogeneous(np.eye(3), (0.0, 0.0, self.gripper.tcp_m))

    def limit_errors(self, names: Sequence[str] = ()) -> Iterator[str]:
        """A text that describes an impossible value: limits without a range, not above 0 or in degrees, a home outside.

        `names` are the joints' names; by default their links' names.
        """
        limits, joints = self.limits, names or [joint.link for joint in self.joints]
        for name, values, most in (
            ("velocity_rad_s", limits.velocity_rad_s, _FASTEST_RAD_S),
            ("acceleration_rad_s2", limits.acceleration_rad_s2, np.inf),
            ("jerk_rad_s3", limits.jerk_rad_s3, np.inf),
            ("torque_nm", np.array([joint.torque_nm for joint in self.joints]), np.inf),
        ):
            for joint, value in zip(joints, values.tolist(), strict=True):
                if not (0.0 < value <= most and np.isfinite(value)):
                    bound = "finite" if most == np.inf else f"at most {most:g} rad/s"
                    yield f"{name} of {joint} is {value}; it must be above 0 and {bound}"
        ranges = np.column_stack([limits.position_lower_rad, limits.position_upper_rad, self.home_q_rad]).tolist()
        for joint, (lower, upper, home) in zip(joints, ranges, strict=True):
            turns = f"the joint {joint} turns from {lower:g} to {upper:g} rad"
            if not lower < upper:
                yield f"{turns}, which is no range; set position_lower_rad and position_upper_rad"
            elif max(-lower, upper) > _FARTHEST_RAD:
                yield f"{turns}; set position_lower_rad and position_upper_rad in radians, at most {_FARTHEST_RAD:.4g}"
            elif not lower < home < upper:
                yield f"home_q_rad of {joint} is {home:g}, and {turns}"
