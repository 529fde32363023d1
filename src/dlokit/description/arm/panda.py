"""The Franka Emika Panda as plain data that needs no simulator: published numbers, and capsules around its links.

Kinematics, limits and the hand: Franka Control Interface documentation, "Robot and interface specifications"
(Denavit-Hartenberg parameters in Craig's convention). Inertias: C. Gaz, M. Cognetti, A. Oliva, P. Robuffo
Giordano, A. De Luca, "Dynamic identification of the Franka Emika Panda robot with retrieval of feasible parameters
using penalty-based optimization", IEEE RA-L 4(4), 2019; hand and fingers from Franka's data sheet.

Link frames are Franka's: the frame of a link is the one of the joint that moves it, z along the joint axis. The
hand frame stands 0.107 m beyond link 7, turned by -45°; y is the direction in which the fingers open. Each finger's
frame is carried along with the finger, its y pointing away from the other finger, so that both are alike.
"""

import importlib.util
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from dlokit.errors import MachineError
from dlokit.types.robot import JointLimits

PANDA_LINKS = (
    *("link0", "link1", "link2", "link3", "link4", "link5", "link6", "link7"),
    *("hand", "left_finger", "right_finger"),
)
"""Every link with a shape, from the base to the fingers."""


@dataclass(frozen=True, kw_only=True)
class DenavitHartenberg:
    """One joint by Craig: turn by `alpha_rad` about x, go `a_m` along x, turn by q about z, go `d_m` along z."""

    a_m: float
    alpha_rad: float
    d_m: float


_RIGHT = float(np.pi / 2)
PANDA_DH = (
    DenavitHartenberg(a_m=0.0, alpha_rad=0.0, d_m=0.333),
    DenavitHartenberg(a_m=0.0, alpha_rad=-_RIGHT, d_m=0.0),
    DenavitHartenberg(a_m=0.0, alpha_rad=_RIGHT, d_m=0.316),
    DenavitHartenberg(a_m=0.0825, alpha_rad=_RIGHT, d_m=0.0),
    DenavitHartenberg(a_m=-0.0825, alpha_rad=-_RIGHT, d_m=0.384),
    DenavitHartenberg(a_m=0.0, alpha_rad=_RIGHT, d_m=0.0),
    DenavitHartenberg(a_m=0.088, alpha_rad=_RIGHT, d_m=0.0),
)
PANDA_FLANGE_M = 0.107
"""From the frame of link 7 to the flange and the hand, along z [m]."""
PANDA_HAND_YAW_RAD = float(-np.pi / 4)
"""How the hand is turned on the flange [rad]."""
PANDA_FINGER_M = 0.0584
"""From the hand to the fingers' frames, along z [m]."""
PANDA_TCP_M = 0.1034
"""From the hand to the tool centre point, along z [m]; the TCP has the hand's orientation."""
PANDA_FINGERTIP_BELOW_TCP_M = 0.0089
"""How far the fingertips reach beyond the tool centre point [m]."""
PANDA_GRASP_HEIGHT_M = 0.011
"""Height of the tool centre point over a table on which it grasps [m]: the fingertips are 2 mm clear of the table.

A 4 mm rod on the table is then held 7 mm below the tool centre point, well on the fingertips, and lies on the table
again when the tool comes down to this height.
"""
PANDA_OPEN_WIDTH_M = 0.08
"""Largest distance between the fingertips [m]."""
PANDA_GRIP_FORCE_N = 70.0
"""Largest continuous force of the fingers [N]."""
PANDA_FINGER_SPEED_M_S = 0.05
"""Speed of each finger [m/s]."""

PANDA_LIMITS = JointLimits(
    position_lower_rad=np.array([-2.8973, -1.7628, -2.8973, -3.0718, -2.8973, -0.0175, -2.8973]),
    position_upper_rad=np.array([2.8973, 1.7628, 2.8973, -0.0698, 2.8973, 3.7525, 2.8973]),
    velocity_rad_s=np.array([2.1750, 2.1750, 2.1750, 2.1750, 2.6100, 2.6100, 2.6100]),
    acceleration_rad_s2=np.array([15.0, 7.5, 10.0, 12.5, 15.0, 20.0, 20.0]),
    jerk_rad_s3=np.array([7500.0, 3750.0, 5000.0, 6250.0, 7500.0, 10000.0, 10000.0]),
)
PANDA_TORQUE_NM = (87.0, 87.0, 87.0, 87.0, 12.0, 12.0, 12.0)
"""Largest torque of each joint [N·m]."""

PANDA_HOME_Q_RAD = np.array([0.0, -0.9, 0.0, -2.5, 0.0, 1.6, 0.785398])
"""Looking position: gripper down, folded back, so that the camera of the paper's rig sees the whole table.

The tool stands at (0.28, 0, 0.45) m.
"""


@dataclass(frozen=True, kw_only=True)
class Inertia:
    """Mass [kg], centre of mass in the link frame [m], and inertia about it (xx, yy, zz, xy, xz, yz) [kg·m²]."""

    mass_kg: float
    center_m: tuple[float, float, float]
    inertia_kg_m2: tuple[float, float, float, float, float, float]


_FINGER_INERTIA = Inertia(
    mass_kg=0.015, center_m=(0.0, 0.015, 0.03), inertia_kg_m2=(2.375e-6, 2.375e-6, 7.5e-7, 0.0, 0.0, 0.0)
)
PANDA_INERTIAS: dict[str, Inertia] = {
    "link0": Inertia(
        mass_kg=0.629769,
        center_m=(-0.041018, -0.00014, 0.049974),
        inertia_kg_m2=(0.00315, 0.00388, 0.004285, 8.2904e-7, 0.00015, 8.2299e-6),
    ),
    "link1": Inertia(
        mass_kg=4.970684,
        center_m=(0.003875, 0.002081, -0.1750),
        inertia_kg_m2=(0.70337, 0.70661, 0.009117, -0.000139, 0.006772, 0.019169),
    ),
    "link2": Inertia(
        mass_kg=0.646926,
        center_m=(-0.003141, -0.02872, 0.003495),
        inertia_kg_m2=(0.007962, 0.02811, 0.025995, -0.003925, 0.010254, 0.000704),
    ),
    "link3": Inertia(
        mass_kg=3.228604,
        center_m=(0.027518, 0.039252, -0.066502),
        inertia_kg_m2=(0.037242, 0.036155, 0.01083, -0.004761, -0.011396, -0.012805),
    ),
    "link4": Inertia(
        mass_kg=3.587895,
        center_m=(-0.05317, 0.104419, 0.027454),
        inertia_kg_m2=(0.025853, 0.019552, 0.028323, 0.007796, -0.001332, 0.008641),
    ),
    "link5": Inertia(
        mass_kg=1.225946,
        center_m=(-0.011953, 0.041065, -0.038437),
        inertia_kg_m2=(0.035549, 0.029474, 0.008627, -0.002117, -0.004037, 0.000229),
    ),
    "link6": Inertia(
        mass_kg=1.666555,
        center_m=(0.060149, -0.014117, -0.010517),
        inertia_kg_m2=(0.001964, 0.004354, 0.005433, 0.000109, -0.001158, 0.000341),
    ),
    "link7": Inertia(
        mass_kg=0.735522,
        center_m=(0.010517, -0.004252, 0.061597),
        inertia_kg_m2=(0.012516, 0.010027, 0.004815, -0.000428, -0.001196, -0.000741),
    ),
    "hand": Inertia(mass_kg=0.73, center_m=(-0.01, 0.0, 0.03), inertia_kg_m2=(0.001, 0.0025, 0.0017, 0.0, 0.0, 0.0)),
    "left_finger": _FINGER_INERTIA,
    "right_finger": _FINGER_INERTIA,
}


Vector = tuple[float, float, float]


@dataclass(frozen=True, kw_only=True)
class Capsule:
    """All points within `radius_m` of the segment from `start_m` to `end_m`, both in the frame of `link` [m]."""

    link: str
    start_m: Vector
    end_m: Vector
    radius_m: float


def _capsule(link: str, start: Vector, end: Vector, radius: float) -> Capsule:
    return Capsule(link=link, start_m=start, end_m=end, radius_m=radius)


def _finger(link: str) -> tuple[Capsule, ...]:
    return (
        _capsule(link, (0.0, 0.0195, 0.008), (0.0, 0.0155, 0.020), 0.0125),
        _capsule(link, (0.0, 0.0125, 0.022), (0.0, 0.0105, 0.0454), 0.0085),
    )


PANDA_COLLISION: tuple[Capsule, ...] = (
    _capsule("link0", (-0.110, 0.0, 0.040), (-0.020, 0.0, 0.060), 0.085),
    _capsule("link0", (-0.005, -0.03, 0.050), (-0.005, 0.03, 0.050), 0.090),
    _capsule("link1", (0.0, 0.0, -0.160), (0.0, -0.020, -0.030), 0.068),
    _capsule("link1", (0.0, -0.020, 0.0), (0.0, -0.100, 0.0), 0.065),
    _capsule("link2", (0.0, -0.165, 0.0), (0.0, -0.040, 0.010), 0.068),
    _capsule("link2", (0.0, 0.0, 0.020), (0.0, 0.0, 0.100), 0.065),
    _capsule("link3", (0.0, 0.0, -0.090), (0.0, 0.0, -0.040), 0.065),
    _capsule("link3", (0.0, 0.0, -0.050), (0.0825, 0.050, -0.020), 0.060),
    _capsule("link3", (0.0825, 0.030, 0.0), (0.0825, 0.080, 0.0), 0.065),
    _capsule("link4", (0.0, 0.0, 0.030), (0.0, 0.0, 0.080), 0.065),
    _capsule("link4", (0.0, 0.0, 0.040), (-0.0825, 0.070, 0.020), 0.060),
    _capsule("link4", (-0.0825, 0.050, 0.0), (-0.0825, 0.095, 0.0), 0.065),
    _capsule("link5", (0.0, 0.0, -0.225), (0.0, 0.020, -0.200), 0.067),
    _capsule("link5", (0.0, 0.040, -0.210), (0.0, 0.075, -0.060), 0.047),
    _capsule("link5", (0.0, 0.055, 0.0), (0.0, 0.085, 0.0), 0.065),
    _capsule("link6", (0.0, 0.0, 0.0), (0.0, 0.0, 0.020), 0.060),
    _capsule("link6", (0.0, 0.0, 0.010), (0.088, 0.020, 0.0), 0.055),
    _capsule("link6", (0.085, -0.010, 0.0), (0.085, 0.035, 0.0), 0.062),
    _capsule("link7", (0.0, 0.0, 0.075), (0.0, 0.0, 0.085), 0.054),
    _capsule("link7", (0.025, 0.025, 0.080), (0.050, 0.050, 0.083), 0.040),
    _capsule("hand", (0.0, -0.080, 0.005), (0.0, 0.080, 0.005), 0.032),
    _capsule("hand", (0.0, -0.080, 0.040), (0.0, 0.080, 0.040), 0.032),
    *_finger("left_finger"),
    *_finger("right_finger"),
)
"""Capsules around every link; they enclose the visual meshes to within 1 cm (3 cm at the foot of the base)."""

PAD_CENTER_M: Vector = (0.0, 0.005, 0.045)
PAD_HALF_SIZE_M: Vector = (0.009, 0.005, PANDA_FINGERTIP_BELOW_TCP_M)
"""Fingertip as a box in the finger's frame, along z about the tool centre point; its inner face is at y = 0, so that
both meet when the hand is shut."""


def panda_mesh_file(link: str) -> Path:
    """The STL file with the visual mesh of `link`, in the link's frame, from the package ``rtb-data``.

    Raises `MachineError` when that package is not installed.
    """
    package = importlib.util.find_spec("rtbdata")
    if package is None or package.origin is None:
        raise MachineError(
            "The Panda's visual meshes are missing: they come with the package rtb-data; run: pip install rtb-data"
        )
    stem = "finger" if link.endswith("finger") else link
    return Path(package.origin).parent / "meshes" / "FRANKA-EMIKA" / "Panda" / f"{stem}.stl"
