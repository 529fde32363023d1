"""Settings that the stages of the MAP observer share."""

from dataclasses import dataclass, field

from dlokit.skills.observer.cpd import CpdConfig, pliable
from dlokit.skills.observer.visibility import VisibilityConfig


@dataclass(frozen=True, kw_only=True)
class ChainPriors:
    """How much a rod may differ from what it was, whatever the cloud says."""

    length_m: float = 0.0001
    """Standard deviation of an edge from its rest length [m]: a rod hardly stretches."""
    strain_per_m05: float = 8.0
    """Incoherence: nodes s apart move differently by this times sqrt(s), times the way since then [m^-0.5]."""
    bend_per_m15: float = 15.0
    """Change of bend: a stretch s leaves its old shape by this times s^1.5, times the way since then [m^-1.5]."""
    straight_per_m05: float = 20.0
    """The rod's own bend: a stretch s leaves a straight line by about this times s^1.5 [m^-0.5]; weak."""
    place_m: float = 0.3
    """A node stays within this of where it was [m]; so weak that it only decides where nothing else does."""
    pin_m: float = 0.0001
    """Standard deviation of a held node from its gripper [m]."""
    tip_m: float = 0.001
    """Standard deviation of a seen tip from the end of the cloud, along the rod [m]."""
    table_m: float = 0.0001
    """How far a node may sink into the table [m]."""


@dataclass(frozen=True, kw_only=True)
class TipConfig:
    """When the end of a cloud is a tip of the rod."""

    length_tolerance: float = 0.06
    """Both ends are tips when the cloud is shorter or longer than the rod by at most this share."""
    snap_m: float = 0.12
    """An end of a cloud that nothing hides is a tip when it lies so near to one [m]."""
    snap_blind_m: float = 0.03
    """The same where nobody knows what hides the rod [m]."""
    bin_m: float = 0.005
    """Length of rod over which points are counted [m]."""
    gap_m: float = 0.02
    """A longer stretch without points is a gap [m]."""
    reach_m: float = 0.08
    """How far past the ends of the rod the cloud is searched [m]; about the longest way between two clouds."""


@dataclass(frozen=True, kw_only=True)
class TrustConfig:
    """How sure the observer says it is; set on sequences with known truth."""

    independent_points: float = 1.0
    """The points of a segment say as much as this many independent ones: they share the error of the model."""
    remembered: float = 0.9
    """Share of a node's variance before that the shape before hands on to it, as long as the cloud does not show it."""
    forgotten_m: float = 0.5
    """A rod that went so far may have any shape [m]: what the cloud alone says of a node is found with this way."""
    unknown: float = 0.4
    """How much a node without points counts as missing when nothing tells what hides it."""
    usual_share: float = 0.85
    """Health does not suffer while at least this share of the points lies on the rod: others are outliers."""
    missing: float = 5.0
    """Factor on the share of missing nodes in health, where the picture tells that nothing hides them."""
    present_least: float = 0.6
    """Health falls to no less than this for missing nodes alone: something that nobody knows may hide them."""
    tip: float = 0.88
    """Factor on health for each tip that should be seen and is not."""
    half_m: float = 0.05
    """Health is halved where the root mean square of the stated standard deviations is so large [m]."""


@dataclass(frozen=True, kw_only=True)
class MapSettings:
    """What the most probable rod is found with."""

    priors: ChainPriors = field(default_factory=ChainPriors)
    """What a rod is held to, besides the cloud."""
    tips: TipConfig = field(default_factory=TipConfig)
    """When the end of a cloud is a tip."""
    trust: TrustConfig = field(default_factory=TrustConfig)
    """How sure it says it is."""
    visibility: VisibilityConfig = field(default_factory=VisibilityConfig)
    """When a node counts as seen."""
    widest_m: float = 0.05
    """Width of the soft assignment at the start, at most [m]; about the largest motion between two clouds."""
    longest_edge_m: float = 0.02
    """Chains with longer edges are refined [m]."""
    least_way_m: float = 0.005
    """The rod is taken to have moved at least so far since the last cloud [m]."""
    narrowest_m: float = 0.008
    """Width of the soft assignment at its end [m]; about a node spacing."""
    narrowing: float = 0.75
    """Factor on the width from one coarse step to the next."""
    coarse_points: int = 300
    """The coarse steps take at most so many points of the cloud."""
    fine_points: int = 1000
    """The fine steps take at most so many points of the cloud."""
    fine_steps: int = 4
    """Steps with points assigned to segments."""
    noise_m: float = 0.002
    """Standard deviation of the cloud's points from the rod [m]."""
    outlier_limit: float = 3.5
    """Beyond so many standard deviations a point is rather an outlier."""
    outlier_ratio: float = 0.1
    """Density of outliers in the coarse steps, as a share of the peak of a node's Gaussian."""
    most_points: float = 20.0
    """More points than this on a segment say no more than so many."""
    window_m: float = 0.05
    """A point's place along the rod changes by at most this during the fine steps [m]."""
    free_space_m: float = 0.01
    """Pull of a node in open view without points to the nearest shade or point, as a standard deviation [m]."""
    free_space_reach_m: float = 0.05
    """A point farther than this hardly pulls [m]."""
    below_table_m: float = 0.02
    """What lies so far below the table shows that there is none [m]; ten times the noise."""
    share_below_table: float = 0.1
    """If it is a larger share of the points than this; outliers, a fifth of a cloud, lie above and below."""
    cpd: CpdConfig = field(default_factory=pliable)
    """The registration of DLOs that are not one chain."""
