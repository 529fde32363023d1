"""The Panda's shape: capsules that enclose each link, and where the visual meshes lie."""

import importlib.util
from dataclasses import dataclass
from pathlib import Path

from dlokit.errors import MachineError

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
PAD_HALF_SIZE_M: Vector = (0.009, 0.005, 0.0089)
"""Fingertip as a box in the finger's frame; its inner face is at y = 0, so that both meet when the hand is shut."""


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
