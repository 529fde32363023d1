"""The settings of perception."""

from dataclasses import dataclass, field

from dlokit.skills.perception.box import BoxConfig
from dlokit.skills.perception.brightness import BrightnessConfig
from dlokit.skills.perception.cloud import CloudConfig
from dlokit.skills.perception.hand_sight import HandSightConfig
from dlokit.skills.perception.segmentations import AnySegmentation
from dlokit.skills.perception.selffilter import SelfFilterConfig
from dlokit.skills.perception.stereo import StereoConfig
from dlokit.skills.perception.table import TableConfig


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
