"""The row of the component that is connected to ROS 2, in the table of components."""

from dlokit.extras.ros2.camera import Ros2CameraConfig
from dlokit.system.config import RunConfig
from dlokit.system.table import AGAIN, ComponentRow, ProcessRow


def with_ros(run: RunConfig) -> bool:
    """In runs that publish in ROS 2, or see by it."""
    return run.ros2.publish or isinstance(run.camera, Ros2CameraConfig)


def check(run: RunConfig) -> None:
    """Raise `InputError` when the node, or a topic of the camera, is not there."""
    from dlokit.extras.ros2.examination import check_before_start  # loads what only such a run needs

    check_before_start(run)


ROW = ComponentRow(
    name="ros",
    kind="dlokit.extras.ros2.component:RosComponent",
    api="dlokit.extras.ros2.api",
    process=ProcessRow(name="ros", components=(), essential=False, restart=AGAIN),
    when=with_ros,
    check=check,
    tracks=True,
)
