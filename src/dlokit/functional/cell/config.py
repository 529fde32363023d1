"""Settings of the cell, with the two physics of its DLO: an elastic rod, and a chain that takes a set.

Every process loads the settings, so the methods import the libraries of the physics when they are called.
"""

from dataclasses import dataclass, field
from typing import Annotated, Any, ClassVar, Literal, Protocol, get_args

import tyro
from msgspec import Meta
from numpy.typing import ArrayLike

from dlokit.description.dlo import SOFT_ROPE, DloPreset
from dlokit.description.scene import Fixture
from dlokit.ranges import NotNegative, Positive, check_ranges
from dlokit.types.arrays import Float64Array


class DloBody(Protocol):
    """The DLO in a compiled model. It is visible to cameras and collides with fingers like any other body."""

    @property
    def nodes_world(self) -> Float64Array:
        """Nodes (M, 3) [m], equally far apart on the centre line, world frame. Kinematics must be up to date."""
        ...

    def place(self, nodes_world: ArrayLike) -> None:
        """Place the DLO, unloaded before, along `nodes_world` (M, 3) [m], at rest."""
        ...

    def set_friction(self, friction: ArrayLike) -> None:
        """Set the coefficient of sliding friction on the table at each node, (M,)."""
        ...


@dataclass(frozen=True, kw_only=True)
class ElasticRod:
    """A discrete elastic rod: it always springs back."""

    name: ClassVar[str] = "rod"

    def add(self, spec: Any, dlo: DloPreset, nodes: int) -> None:
        """Add the DLO to `spec` (MjSpec)."""
        from dlokit.rod.elastic import add_rod

        add_rod(spec, dlo, nodes, hangs=True)

    def take_over(self, model: Any, data: Any, dlo: DloPreset) -> DloBody:
        """The DLO that `add` has added, in the compiled model."""
        from dlokit.rod.elastic import RodBody

        return RodBody(model, data)


@dataclass(frozen=True, kw_only=True)
class ElastoplasticChain:
    """A chain of capsules on ball joints: bending beyond the DLO's yield curvature is permanent."""

    name: ClassVar[str] = "chain"

    def add(self, spec: Any, dlo: DloPreset, nodes: int) -> None:
        """Add the DLO to `spec` (MjSpec)."""
        from dlokit.rod.chain import add_chain

        add_chain(spec, dlo, nodes)

    def take_over(self, model: Any, data: Any, dlo: DloPreset) -> DloBody:
        """The DLO that `add` has added, in the compiled model."""
        from dlokit.rod.chain import Chain

        return Chain(model, data, dlo.curl_1_m)


DloPhysics = ElasticRod | ElastoplasticChain
"""The available physics of the DLO, the default first."""

PHYSICS: dict[str, type[DloPhysics]] = {kind.name: kind for kind in get_args(DloPhysics)}
"""The same by name."""

TICK_S = 0.01
"""Grid of the cell's time [s]: physics and clock advance by ticks."""
PictureSize = Annotated[int, Meta(ge=64)]
Factor = Literal["friction", "friction_regions", "stiffness", "weight", "curl", "hand_eye", "table_tilt", "light",
                 "color", "fixtures"]  # fmt: skip
"""A property of the cell that can be drawn from the seed."""
EVERY_FACTOR: tuple[Factor, ...] = get_args(Factor)


@dataclass(frozen=True, kw_only=True)
class CellBoard:
    """A calibration board in the cell."""

    held: bool = True
    """Whether the first arm holds the board; otherwise it is on the table."""


@dataclass(frozen=True, kw_only=True)
class CellConfig:
    """The simulated cell: the DLO on the table, and the errors of the camera."""

    dlo: DloPreset = field(default_factory=lambda: SOFT_ROPE)
    """The DLO on the table."""
    physics: DloPhysics = field(default_factory=ElasticRod)
    """How the DLO behaves: as an elastic rod, or as a chain that takes a set."""
    randomised: Annotated[tuple[Factor, ...], tyro.conf.arg(metavar="FACTOR ...")] = ()
    """Properties that are drawn from the seed, within the ranges of `docs/reference/dlos.md`; the rest keep their
    nominal value. Any of friction, friction_regions, stiffness, weight, curl, hand_eye, table_tilt, light, color and
    fixtures; `--randomised` draws all."""
    settle_s: NotNegative = 2.0
    """Time the DLO is given to come to rest before the run starts [s]. Larger: more at rest, a longer start."""
    width_px: PictureSize = 640
    """Width of each picture [px]; the focal length scales with it. Larger: finer points, slower looks."""
    height_px: PictureSize = 560
    """Height of each picture [px]."""
    image_noise_sigma: NotNegative = 1.5
    """Standard deviation of each pixel's noise [grey levels of 255]."""
    camera_error_m: NotNegative = 0.003
    """Distance of the believed camera position from the true one [m]."""
    camera_error_deg: NotNegative = 0.2
    """Angle between the believed camera orientation and the true one [°]."""
    lens_distortion: bool = False
    """Whether the lenses distort the pictures, by up to 7 px; perception rectifies them by the calibration."""
    separate_cameras: bool = False
    """Whether the stereo camera is two cameras on a bracket, toed in by 3° and rolled by 1.5°, each with its own lens
    and focal length; perception rectifies them by the calibration."""
    camera_late_s: NotNegative = 0.0
    """Time from an exposure to the arrival of its picture [s]. The camera's driver does not correct for it, so the
    stamps of the pictures are late by this time. `dlokit calibrate latency` measures it."""
    camera_drift_ppm: float = 0.0
    """Excess speed of the camera's clock over the cell's [millionths]; below 0: slower."""
    shadows: bool = False
    """Whether the arm casts shadows; rendering then takes several times as long."""
    real_time_factor: Positive = 1.0
    """Fastest pace of the cell's clock in a live run: cell seconds per machine second. Lockstep ignores it."""

    fixtures: tyro.conf.Suppress[tyro.conf.Fixed[tuple[Fixture, ...] | None]] = None
    """The fixtures that stand in the cell, before their errors are drawn; None: those of the installation. With it a
    test or a bench moves, exchanges, removes or adds fixtures without the system's knowledge."""
    board: tyro.conf.Suppress[tyro.conf.Fixed[CellBoard | None]] = None
    """The board of `dlokit calibrate`; None: no board."""

    def __post_init__(self) -> None:
        check_ranges(self, "cell")
