"""Franka's arms with Franka's hand, from published numbers: the Panda and the Franka Research 3.

Kinematics, limits and the hand: Franka Control Interface documentation, "Robot and interface specifications"
(Denavit-Hartenberg parameters in Craig's convention). Both arms have the same links; only their limits differ.
Inertias: C. Gaz, M. Cognetti, A. Oliva, P. Robuffo Giordano, A. De Luca, "Dynamic identification of the Franka Emika
Panda robot with retrieval of feasible parameters using penalty-based optimization", IEEE RA-L 4(4), 2019; hand and
fingers from Franka's data sheet.

The hand frame is 0.107 m beyond link 7, turned by -45°.
"""

from dataclasses import replace

import numpy as np

from dlokit.description.arm.model import (
    FINGER_LINKS,
    HAND,
    ArmModel,
    Capsule,
    FrankaDimensions,
    Gripper,
    Inertia,
    Joint,
    Surface,
    Vector,
)
from dlokit.types.arrays import Float64Array
from dlokit.types.robot import JointLimits, SlowNearLimits

_SHOULDER_HEIGHT_M = 0.333
_UPPER_ARM_M = 0.316
_FOREARM_M = 0.384
_ELBOW_OFFSET_M = 0.0825
_WRIST_OFFSET_M = 0.088
_FLANGE_M = 0.107
_RIGHT = float(np.pi / 2)


def _joint(number: int, a_m: float, alpha_rad: float, d_m: float, torque_nm: float, stiffness_nm_rad: float) -> Joint:
    """One joint by Craig: turn by `alpha_rad` about x, go `a_m` along x, turn by q about z, go `d_m` along z."""
    cosine, sine = np.cos(alpha_rad), np.sin(alpha_rad)
    T = np.array(
        [
            [1.0, 0.0, 0.0, a_m],
            [0.0, cosine, -sine, -sine * d_m],
            [0.0, sine, cosine, cosine * d_m],
            [0.0, 0.0, 0.0, 1.0],
        ]
    )
    return Joint(
        name=f"panda_joint{number}",
        link=f"link{number}",
        T_parent_link=T,
        torque_nm=torque_nm,
        stiffness_nm_rad=stiffness_nm_rad,
    )


def _turned(yaw_rad: float, z_m: float) -> Float64Array:
    cosine, sine = np.cos(yaw_rad), np.sin(yaw_rad)
    return np.array([[cosine, -sine, 0.0, 0.0], [sine, cosine, 0.0, 0.0], [0.0, 0.0, 1.0, z_m], [0.0, 0.0, 0.0, 1.0]])


def _capsule(link: str, start: Vector, end: Vector, radius: float) -> Capsule:
    return Capsule(link=link, start_m=start, end_m=end, radius_m=radius)


def _finger(link: str) -> tuple[Capsule, ...]:
    return (
        _capsule(link, (0.0, 0.0195, 0.008), (0.0, 0.0155, 0.020), 0.0125),
        _capsule(link, (0.0, 0.0125, 0.022), (0.0, 0.0105, 0.0454), 0.0085),
    )


_FINGER_INERTIA = Inertia(
    mass_kg=0.015, center_m=(0.0, 0.015, 0.03), inertia_kg_m2=(2.375e-6, 2.375e-6, 7.5e-7, 0.0, 0.0, 0.0)
)
_BEFORE_HAND = ("link5", "link6", "link7")
_GRIPPER = (HAND, *FINGER_LINKS)

FRANKA_HAND = Gripper(
    title="Franka hand",
    finger_m=0.0584,
    tcp_m=0.1034,
    tip_below_tcp_m=0.0089,
    pad_half_length_m=0.009,
    pad_half_thickness_m=0.005,
    open_width_m=0.08,
    force_n=70.0,
    finger_speed_m_s=0.05,
    closed_half_width_m=0.0175,
)

PANDA = ArmModel(
    name="panda",
    title="Franka Emika Panda with its hand",
    base="link0",
    joints=(
        _joint(1, 0.0, 0.0, _SHOULDER_HEIGHT_M, 87.0, 4500.0),
        _joint(2, 0.0, -_RIGHT, 0.0, 87.0, 4500.0),
        _joint(3, 0.0, _RIGHT, _UPPER_ARM_M, 87.0, 3500.0),
        _joint(4, _ELBOW_OFFSET_M, _RIGHT, 0.0, 87.0, 3500.0),
        _joint(5, -_ELBOW_OFFSET_M, -_RIGHT, _FOREARM_M, 12.0, 2000.0),
        _joint(6, 0.0, _RIGHT, 0.0, 12.0, 2000.0),
        _joint(7, _WRIST_OFFSET_M, _RIGHT, 0.0, 12.0, 2000.0),
    ),
    limits=JointLimits(
        position_lower_rad=np.array([-2.8973, -1.7628, -2.8973, -3.0718, -2.8973, -0.0175, -2.8973]),
        position_upper_rad=np.array([2.8973, 1.7628, 2.8973, -0.0698, 2.8973, 3.7525, 2.8973]),
        velocity_rad_s=np.array([2.1750, 2.1750, 2.1750, 2.1750, 2.6100, 2.6100, 2.6100]),
        acceleration_rad_s2=np.array([15.0, 7.5, 10.0, 12.5, 15.0, 20.0, 20.0]),
        jerk_rad_s3=np.array([7500.0, 3750.0, 5000.0, 6250.0, 7500.0, 10000.0, 10000.0]),
    ),
    # The tool is at (0.28, 0, 0.45) m.
    home_q_rad=np.array([0.0, -0.9, 0.0, -2.5, 0.0, 1.6, 0.785398]),
    T_last_hand=_turned(float(-np.pi / 4), _FLANGE_M),
    gripper=FRANKA_HAND,
    inertias={
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
        HAND: Inertia(mass_kg=0.73, center_m=(-0.01, 0.0, 0.03), inertia_kg_m2=(0.001, 0.0025, 0.0017, 0.0, 0.0, 0.0)),
        **dict.fromkeys(FINGER_LINKS, _FINGER_INERTIA),
    },
    # They enclose the visual meshes to within 1 cm (3 cm at the foot of the base).
    capsules=(
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
        _capsule(HAND, (0.0, -0.080, 0.005), (0.0, 0.080, 0.005), 0.032),
        _capsule(HAND, (0.0, -0.080, 0.040), (0.0, 0.080, 0.040), 0.032),
        *_finger(FINGER_LINKS[0]),
        *_finger(FINGER_LINKS[1]),
    ),
    may_meet=(
        *((low, high) for low in ("link0", "link1", "link2") for high in (*_BEFORE_HAND, *_GRIPPER)),
        *(("link3", high) for high in ("link7", *_GRIPPER)),
        *(("link4", high) for high in ("link7", *_GRIPPER)),
        *(("link5", high) for high in _GRIPPER),
    ),
    above_table=frozenset(("link2", "link3", "link4", *_BEFORE_HAND, *_GRIPPER)),
    roomiest_yaw_rad=0.785,  # the hand is mounted 45° off the middle of joint 7
    surfaces={
        link: (
            Surface(
                file=f"meshes/FRANKA-EMIKA/Panda/{'finger' if link in FINGER_LINKS else link}.stl",
                package="rtbdata",
                wheel="rtb-data",
                dark=link in FINGER_LINKS,
            ),
        )
        for link in ("link0", "link1", "link2", "link3", "link4", *_BEFORE_HAND, *_GRIPPER)
    },
    franka=FrankaDimensions(
        shoulder_height_m=_SHOULDER_HEIGHT_M,
        upper_arm_m=_UPPER_ARM_M,
        forearm_m=_FOREARM_M,
        elbow_offset_m=_ELBOW_OFFSET_M,
        wrist_offset_m=_WRIST_OFFSET_M,
    ),
)

FR3 = replace(
    PANDA,
    name="fr3",
    title="Franka Research 3 with its hand",
    joints=tuple(replace(joint, name=f"fr3_joint{number}") for number, joint in enumerate(PANDA.joints, 1)),
    limits=JointLimits(
        position_lower_rad=np.array([-2.7437, -1.7837, -2.9007, -3.0421, -2.8065, 0.5445, -3.0159]),
        position_upper_rad=np.array([2.7437, 1.7837, 2.9007, -0.1518, 2.8065, 4.5169, 3.0159]),
        velocity_rad_s=np.array([2.62, 2.62, 2.62, 2.62, 5.26, 4.18, 5.26]),
        acceleration_rad_s2=np.full(7, 10.0),
        jerk_rad_s3=np.full(7, 5000.0),
        slow_near=SlowNearLimits(
            lower_rad=np.array([-2.7501, -1.7918, -2.9065, -3.0481, -2.8101, 0.54092, -3.0196]),
            upper_rad=np.array([2.7501, 1.7918, 2.9065, -0.1458, 2.8101, 4.5205, 3.0196]),
            deceleration_rad_s2=np.array([6.0, 2.585, 3.5, 4.0, 17.0, 5.5, 17.0]),
            offset_rad_s=np.array([0.30, 0.20, 0.20, 0.30, 0.35, 0.35, 0.35]),
        ),
    ),
)
"""Its limits are from the data sheet, the strictest published limits: newer firmware allows wider ranges."""
