"""Settings of the first shape: of the skeleton, of the order of its pieces, and of the curve along them."""

from dataclasses import dataclass, field

from dlokit.skills.observer.curve_config import CurveConfig
from dlokit.skills.observer.visibility_config import VisibilityConfig


@dataclass(frozen=True, kw_only=True)
class SkeletonConfig:
    """How a cloud becomes pieces of line."""

    voxel_m: float = 0.004
    """Points are first averaged over cubes of this edge [m]."""
    radius_m: float = 0.011
    """Points within this distance draw one another to their common line [m]."""
    rounds: int = 3
    """How often they do."""
    least_share: float = 0.2
    """A place on the line around which less than this share of the usual number of points lies is none."""
    spacing_m: float = 0.004
    """Distance of the points kept along the line [m]."""
    most_points: int = 1500
    """A line of more points than this is none but an area; a rod of 5 m has 1000."""
    spur_m: float = 0.008
    """Side branches shorter than this are noise [m]."""
    junction_m: float = 0.006
    """So much of the line is cut out around a place where it branches [m]."""
    corner_m: float = 0.012
    """Over this length to both sides of a point its bend is measured [m]."""
    sharpest_rad: float = 1.4
    """A line that turns by more than this there [rad] is taken for two that meet."""
    ahead_m: float = 0.03
    """A piece that another points at from so near is split there [m]: they may be parts of one rod that crosses."""
    meet_m: float = 0.006
    """It points at a piece when the line ahead comes so near to it [m]."""
    least_m: float = 0.004
    """Pieces shorter than this are left out [m]."""


@dataclass(frozen=True, kw_only=True)
class OrderingConfig:
    """What an order of pieces costs. The unit is that of bending energy, ∫ κ² ds [1/m]."""

    tangent_m: float = 0.02
    """The direction of an end is that of its last piece of this length [m]."""
    bend_m: float = 0.04
    """The curvature of an end is that of its last piece of this length [m]."""
    inertia: float = 0.7
    """How much a rod goes on bending as it did: 0 weighs the bend of a link, 1 its difference from the bend before."""
    gap_share: float = 0.14
    """A link may lead over a gap of at most this share of the rod's length."""
    support_m: float = 0.006
    """A place on a link with a point so near is seen [m]."""
    unseen_per_m: float = 300.0
    """Cost of a link for each metre that is not seen [1/m²]."""
    left_out_per_m: float = 1200.0
    """Cost of each metre of pieces that are not part of the way [1/m²]."""
    length_cost: float = 16.0
    """Cost of a length that is off by `length_sigma`; it grows with the square [1/m]."""
    length_sigma: float = 0.03
    """The length of a way is right to about this share."""
    sharpest_rad: float = 2.1
    """A link that turns by more than this at one of its ends is none [rad]."""
    facing_m: float = 0.025
    """Two tips that point at each other from so near may be no tips [m]: a ring could be cut anywhere."""
    most_steps: int = 20_000
    """The search ends after so many steps, with the best way so far."""


def _first_curve() -> CurveConfig:
    # The skeleton ends where the rod does: a longer reach would catch what another part of the rod lies beyond it.
    return CurveConfig(reach_m=0.006, iterations=2)


@dataclass(frozen=True, kw_only=True)
class InitialiseConfig:
    """How the first cloud is ordered."""

    least_points: int = 60
    """Fewer points than this are no DLO."""
    lone_radius_m: float = 0.01
    """A point with less than a quarter of the usual number of points in this radius is an outlier [m]."""
    most_pieces: int = 24
    """A skeleton of more pieces than this is no rod, but an area or many things."""
    branch_m: float = 0.03
    """Pieces that no order of the rod has room for may together be so long [m]; longer ones are no outliers."""
    ambiguity: float = 6.0
    """Two orders whose costs differ by less than this cannot be told apart [1/m]; see `ordering`."""
    same_order_m: float = 0.01
    """Two orders whose curves differ by less than this are the same [m], root mean square."""
    length_tolerance: float = 0.06
    """The curve may be shorter or longer than the rod by this share."""
    skeleton: SkeletonConfig = field(default_factory=SkeletonConfig)
    """How the cloud becomes pieces of line."""
    ordering: OrderingConfig = field(default_factory=OrderingConfig)
    """What an order of these pieces costs."""
    curve: CurveConfig = field(default_factory=_first_curve)
    """The fit of the centre line."""
    visibility: VisibilityConfig = field(default_factory=VisibilityConfig)
    """What tells that an end lies at the border of the picture or behind the robot, and which nodes lie in a gap."""
