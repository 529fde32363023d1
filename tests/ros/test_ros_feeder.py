"""The lab's camera publishes what the cell of a running system sees, in ROS time."""

import subprocess
import time
from itertools import pairwise
from pathlib import Path

from live_systems import DLOKIT, wait_until
from ros_feeder import LabCamera, feeding
from ros_lab import RosNetwork

RATE_HZ = 5.0


def test_the_pictures_of_a_running_cell_are_published_in_ros_time(lab: RosNetwork, tf: None, tmp_path: Path) -> None:
    camera, listener, how = lab.camera(), lab.listener(), LabCamera()
    for topic in (how.colour, how.depth, how.info):
        kind = "CameraInfo" if topic == how.info else "Image"
        listener.order("subscribe", topic=topic, type=f"sensor_msgs/msg/{kind}")
    with feeding(camera, how, rate_hz=RATE_HZ) as feeder:
        grey = listener.hear("message", topic=how.colour)
        assert abs(grey["stamp_ns"] - time.time_ns()) < 10e9
        shape = (DLOKIT, "shape", "--runtime", "live", "--headless", "--out", str(tmp_path / "run"))
        with (tmp_path / "said").open("wb") as said, subprocess.Popen(shape, stdout=said, stderr=said) as run:
            wait_until(lambda: feeder.published >= 10, run)
            run.send_signal(2)
            run.wait()
    pictures, seen = [grey], 0
    while seen < 10:
        pictures.append(listener.hear("message", topic=how.colour))
        seen += pictures[-1]["fields"]["data"] != grey["fields"]["data"]
    assert all(earlier["stamp_ns"] < later["stamp_ns"] for earlier, later in pairwise(pictures))
    depths = [listener.hear("message", topic=how.depth) for _ in pictures]
    assert [one["stamp_ns"] for one in depths] == [one["stamp_ns"] for one in pictures]
    assert depths[-1]["fields"]["encoding"] == "16UC1"
    assert depths[-1]["fields"]["data"] != depths[0]["fields"]["data"]
    listener.order("subscribe", topic="/tf_static", type="tf2_msgs/msg/TFMessage", transient_local=True)
    (placed,) = listener.hear("message", topic="/tf_static")["fields"]["transforms"]
    assert (placed["header"]["frame_id"], placed["child_frame_id"]) == (how.base, how.frame)
