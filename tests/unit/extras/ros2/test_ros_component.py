"""The component that is connected to ROS 2: what it does not publish, and what it says of its skills."""

from typing import Any

import pytest

from dlokit.communication.memory import MemoryTransport
from dlokit.communication.timing import virtual_time
from dlokit.errors import ConfigError, HardwareError
from dlokit.extras.ros2.camera import Ros2CameraConfig
from dlokit.extras.ros2.component import RosComponent, differing
from dlokit.extras.ros2.definitions import definitions_of
from dlokit.extras.ros2.published.outgoing import DLO, PUBLISHED
from dlokit.extras.ros2.row import ROW
from dlokit.system.build import Wiring, build_component
from dlokit.system.config import Ros2Config, RunConfig
from dlokit.system.table import components_of_run, trackers_of_run

CAMERA = Ros2CameraConfig(colour="/colour", depth="/depth")


def test_a_topic_whose_type_differs_at_the_node_is_named_and_left_out() -> None:
    jazzy = definitions_of("jazzy")
    same = {row.kind: jazzy.hash_of(row.kind) for row in PUBLISHED}
    assert differing(PUBLISHED, same, jazzy) == {}
    assert differing(PUBLISHED, {}, jazzy) == {}  # Humble has no hashes
    found = differing(PUBLISHED, {**same, DLO.kind: "RIHS01_0"}, jazzy)
    assert "another definition of sensor_msgs/msg/PointCloud2 than ROS 2 jazzy" in found["~/dlo"]
    assert set(found) == {row.topic for row in PUBLISHED if row.kind == DLO.kind}


@pytest.mark.parametrize(
    ("run", "expected"),
    [
        (RunConfig(), False),
        (RunConfig(ros2=Ros2Config(publish=True)), True),
        (RunConfig(camera=CAMERA, runtime="live"), True),
    ],
)
def test_it_is_part_of_runs_that_publish_in_ros_or_see_by_it(run: RunConfig, *, expected: bool) -> None:
    assert ("ros" in components_of_run(run)) is expected
    assert (ROW in trackers_of_run(run)) is expected
    assert isinstance(build_component("ros", run, Wiring()), RosComponent)


def test_a_camera_without_its_process_says_so() -> None:
    async def main() -> None:
        camera = CAMERA.build(MemoryTransport())
        with camera, pytest.raises(HardwareError, match="the call to the process ros ended as"):
            await camera.capture(1.0)

    virtual_time.run(main())


@pytest.mark.parametrize(
    ("topics", "says"),
    [
        ({}, "are none"),
        ({"colour": "/c"}, r"are --camera\.colour; name"),
        ({"colour": "/c", "depth": "/d", "cloud": "/p"}, r"--camera\.colour and --camera\.depth and --camera\.cloud"),
    ],
)
def test_topics_that_make_no_camera_are_refused_with_those_that_do(topics: dict[str, Any], says: str) -> None:
    with pytest.raises(ConfigError, match=says):
        Ros2CameraConfig(**topics).build(MemoryTransport())
