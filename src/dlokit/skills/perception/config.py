"""The settings of perception."""

from dataclasses import dataclass, field

import numpy as np

from dlokit.skills.perception.brightness import BrightnessConfig
from dlokit.skills.perception.segmentations import AnySegmentation

Point = tuple[float, float, float]


@dataclass(frozen=True, kw_only=True)
class BoxConfig:
    """The part of the world in which the DLO may be."""

    lower_world: Point = (0.20, -0.50, -0.02)
    """Corner with the smallest coordinates [m]."""
    upper_world: Point = (0.95, 0.45, 0.25)
    """Corner with the largest coordinates [m]."""

    def __post_init__(self) -> None:
        lower, upper = np.array(self.lower_world), np.array(self.upper_world)
        if lower.shape != (3,) or upper.shape != (3,) or not np.all(lower < upper):
            raise ValueError(
                f"box from {self.lower_world} to {self.upper_world} m: each coordinate of lower_world must be smaller "
                "than that of upper_world"
            )


@dataclass(frozen=True, kw_only=True)
class StereoConfig:
    """Semi-global matching."""

    block_px: int = 5
    """Side of the matched block [px], odd; about the width of the DLO in the picture."""
    penalty_small: float = 8.0
    """P1 for a disparity step of one, per pixel of the block."""
    penalty_large: float = 32.0
    """P2 for larger steps, per pixel of the block."""
    uniqueness_percent: int = 0
    """How much better than the second best a match must be [%]. A plain DLO along the rows is ambiguous by nature."""
    left_right_px: int = 2
    """Largest difference between matching left to right and right to left [px]."""
    lowest_m: float = -0.02
    """Lowest height above the table that is searched [m]."""
    highest_m: float = 0.25
    """Greatest height above the table that is searched [m]; a lower one is faster."""
    smoothing_px: int = 9
    """Side of the window in which disparities of the mask are averaged [px], odd; 1 leaves them as they are."""
    surroundings: float = 0.25
    """Share of the brightness, from 0 to 1, that everything but the DLO keeps. The table's texture would draw a
    lifted DLO that runs along the rows down to the table; without any of it, nothing holds one that lies there."""
    largest_spread_px: float = 1.0
    """Pixels in whose window the disparities spread more than this (standard deviation) lie at an edge [px]."""


@dataclass(frozen=True, kw_only=True)
class SelfFilterConfig:
    """Removal of the robot's own points by its known shape."""

    picture_margin_m: float = 0.006
    """How much wider than its capsules the robot is taken to be in the picture [m]."""
    space_margin_m: float = 0.006
    """Points nearer to the robot's capsules than this are the robot's [m]."""
    occlusion_scale: int = 8
    """Camera pixels a cell of the published occlusion map, along each side."""


@dataclass(frozen=True, kw_only=True)
class CloudConfig:
    """From disparities to the cloud."""

    voxel_m: float = 0.004
    """Side of the cubes of which each keeps the mean of its points [m]; 0 keeps all points."""
    outlier_radius_m: float = 0.012
    """Points are outliers that have fewer than `outlier_neighbours` others within this distance [m]."""
    outlier_neighbours: int = 4
    """See `outlier_radius_m`; 0 keeps all points."""


@dataclass(frozen=True, kw_only=True)
class TableConfig:
    """The table: what it says of the camera's pose, and that nothing can be in it."""

    supports: bool = True
    """Whether the DLO cannot be below its top; turn it off for a DLO that may hang over the edge."""
    correct_pose: bool = True
    """Whether to correct the believed camera pose by it. The table needs texture, and must be level."""
    every_looks: int = 50
    """The table is looked for in the first look, and again after so many."""
    largest_angle_rad: float = 0.02
    """A correction above this is not believed [rad]; then the pose stays as calibrated."""
    largest_height_m: float = 0.03
    """A correction of the camera's height above this is not believed [m]."""
    least_share: float = 0.5
    """Share of the table's pixels that must agree in both pictures."""
    least_texture: float = 2.0
    """Standard deviation of the table's brightness, 0 to 255, below which it has too little texture."""


@dataclass(frozen=True, kw_only=True)
class HandSightConfig:
    """The camera's place, from a look at the robot's own hand."""

    largest_offset_m: float = 0.02
    """A correction along the table above this is not believed [m]."""
    largest_yaw_rad: float = 0.02
    """A turn about the vertical above this is not believed [rad]."""
    least_points: int = 300
    """Points of the arm's outline, over all pictures, below which too little is seen of it."""
    largest_scatter_m: float = 0.0005
    """Above this the pictures disagree too much after the correction (root mean square) [m]."""
    tilt_sigma_rad: float = 0.0026
    """How level the table is, as a standard deviation about each axis [rad]."""
    height_sigma_m: float = 0.0015
    """How exact the camera's height over the table is, as a standard deviation [m]."""
    hand_sigma_m: float = 0.001
    """How far the hand may be beside where its model has it, as a standard deviation along each axis [m]."""


@dataclass(frozen=True, kw_only=True)
class PerceptionConfig:
    """From a pair of pictures to the DLO's points."""

    segmentation: AnySegmentation = field(default_factory=BrightnessConfig)
    """Which pixels are DLO."""
    box: BoxConfig = field(default_factory=BoxConfig)
    """Where in the world the DLO may be."""
    stereo: StereoConfig = field(default_factory=StereoConfig)
    """Matching of the two pictures."""
    self_filter: SelfFilterConfig = field(default_factory=SelfFilterConfig)
    """Removal of the robot's own points."""
    cloud: CloudConfig = field(default_factory=CloudConfig)
    """From disparities to the cloud."""
    table: TableConfig = field(default_factory=TableConfig)
    """What the table says."""
    hand_sight: HandSightConfig = field(default_factory=HandSightConfig)
    """What the robot's own hand says of the camera's place."""
    smallest_patch_px: int = 20
    """Patches of the mask with fewer pixels than this are noise."""
    capture_timeout_s: float = 2.0
    """The camera counts as lost when a pair takes longer [s]."""
    tracking_rate_hz: float = 0.0
    """Looks a second while tracking, until changed by a skill call; 0: only on demand."""
