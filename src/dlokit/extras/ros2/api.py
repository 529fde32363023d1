"""Skills of the component that is connected to ROS 2; the camera `ros2` calls them."""

from dlokit.communication.skill import Condition, Skill
from dlokit.types.image import DepthImage, StereoImages

NO_NODE, NO_PICTURES, CLOCK_JUMPED = "no_node", "no_pictures", "clock_jumped"
WITHIN = Condition("timeout_s is above 0 and at most 60", "bad_arguments", lambda timeout_s: 0.0 < timeout_s <= 60.0)


def _capture(timeout_s: float) -> StereoImages:
    """Wait at most `timeout_s` seconds for the next pair of pictures that is exposed after the call.

    Fails with: no_node, no_pictures, clock_jumped (the next pictures are stamped right again).
    """
    ...


def _capture_depth(timeout_s: float) -> DepthImage:
    """Wait at most `timeout_s` seconds for the next picture with depths that is exposed after the call.

    Fails with: no_node, no_pictures, clock_jumped (the next pictures are stamped right again).
    """
    ...


CAPTURE = Skill("ros", "capture", _capture, timeout_s=70.0, requires=(WITHIN,), ensures="both pictures are of a moment")
CAPTURE_DEPTH = Skill(
    "ros", "capture_depth", _capture_depth, timeout_s=70.0, requires=(WITHIN,), ensures="each depth is of its pixel"
)
