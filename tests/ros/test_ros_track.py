"""`dlokit track` over real ROS 2: a cable from live topics and from a bag, and what is published of it."""

import csv
import os
import subprocess
import time
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cable_pictures import CAMERA, picture
from live_systems import DLOKIT, wait_until
from ros2_messages import Sent, image, info, tf, write_bag
from ros_feeder import LabCamera
from ros_lab import HANGS_S, RosEnvironment, RosNetwork

from dlokit.app.commands import execute
from dlokit.rod.believed import BelievedDlo
from dlokit.types.arrays import Float64Array
from dlokit.types.image import DepthImage

FRAMES = 24
PERIOD_S = 0.35
"""Time between two pictures [s]: longer than a busy machine needs for one, so that none is skipped."""
SINCE_1970_NS = time.time_ns() - time.monotonic_ns()
CLOUD, MARKERS = "sensor_msgs/msg/PointCloud2", "visualization_msgs/msg/MarkerArray"
STATUS = "diagnostic_msgs/msg/DiagnosticStatus"


RUNTIME = Path(os.environ["DLOKIT_RUNTIME_DIR"])
"""The folder in which dlokit and the node meet."""


def frame(number: int) -> DepthImage:
    """A picture of the cable, which moves to and fro."""
    return picture(0.002 * (number % 5))


def nodes_of(out: Path) -> dict[int, Float64Array]:
    """The nodes (M, 3) [m] of each frame, by its stamp, in order."""
    found: dict[int, list[list[float]]] = {}
    with (out / "nodes.csv").open(encoding="utf-8") as file:
        for row in csv.DictReader(file):
            found.setdefault(int(row["stamp_ns"]), []).append([float(row[axis]) for axis in ("x_m", "y_m", "z_m")])
    return {stamp_ns: np.array(nodes) for stamp_ns, nodes in found.items()}


def options(camera: LabCamera) -> list[str]:
    return ["--camera.colour", camera.colour, "--camera.depth", camera.depth]


@contextmanager
def tracking(log: Path, *arguments: str) -> Generator["subprocess.Popen[bytes]"]:
    """`dlokit track` beside the test, which is ended with it; `log` gets what it prints."""
    with log.open("wb") as output:
        command = (DLOKIT, "track", "--headless", *arguments)
        program = subprocess.Popen(command, stdout=output, stderr=subprocess.STDOUT)
    try:
        yield program
    finally:
        if program.poll() is None:
            program.terminate()
        program.wait(HANGS_S)


def bag_of(camera: LabCamera, pictures: list[tuple[int, DepthImage]]) -> list[Sent]:
    """The messages of pictures with their stamps [ns], as `LabCamera` publishes them."""
    sent = [Sent("/tf_static", tf((camera.base, camera.frame, CAMERA.T_world_camera)), pictures[0][0])]
    for stamp_ns, one in pictures:
        pixels = one.pixels if camera.encoding == "rgb8" else one.pixels[..., ::-1]
        messages = {
            camera.colour: image(pixels, camera.encoding, stamp_ns=stamp_ns, frame=camera.frame),
            camera.depth: image(camera.encoded(one), camera.depth_encoding, stamp_ns=stamp_ns, frame=camera.frame),
            camera.info: info(CAMERA, stamp_ns=stamp_ns, frame=camera.frame),
        }
        sent += [Sent(topic, message, stamp_ns) for topic, message in messages.items()]
    return sent


class Player:
    """Publishes the pictures of the cable, one after the other."""

    def __init__(self, lab: RosNetwork, camera: LabCamera) -> None:
        self.camera = camera
        self._program = lab.camera()
        camera.announce(self._program)
        camera.place(self._program, CAMERA)
        self.stamps_ns: list[int] = []

    def publish(self) -> None:
        """The next picture, stamped now."""
        time.sleep(PERIOD_S)
        self.camera.publish(self._program, frame(len(self.stamps_ns)), now_ns := time.time_ns())
        self.stamps_ns.append(now_ns)

    def nearest(self, stamp_ns: int) -> int:
        """The number of the picture that was stamped at a time [ns], to 20 ms."""
        number = min(range(len(self.stamps_ns)), key=lambda one: abs(self.stamps_ns[one] - stamp_ns))
        assert abs(self.stamps_ns[number] - stamp_ns) < 20_000_000
        return number


@pytest.mark.parametrize("camera", [LabCamera(), LabCamera(encoding="bgr8", depth_encoding="32FC1")])
def test_live_topics_and_a_bag_of_them_give_the_same_nodes(
    lab: RosNetwork, tmp_path: Path, tf: None, camera: LabCamera
) -> None:
    lab.bridge(RUNTIME)
    player, live = Player(lab, camera), tmp_path / "live"
    with tracking(tmp_path / "log", "--camera", "ros2", *options(camera), "--out", str(live)) as program:

        def tracked() -> bool:
            player.publish()
            return (live / "nodes.csv").exists() and len(nodes_of(live)) > FRAMES

        wait_until(tracked, program)
    of_topics = dict(list(nodes_of(live).items())[:FRAMES])
    bag = tmp_path / "bag"
    followed = [player.nearest(stamp_ns + SINCE_1970_NS) for stamp_ns in of_topics]
    write_bag(bag, bag_of(camera, [(player.stamps_ns[number], frame(number)) for number in followed]))
    arguments = ["track", "--headless", "--camera", "recorded", "--camera.path", str(bag), *options(camera)]

    assert execute([*arguments, "--out", str(tmp_path / "played"), "--rate-hz", "1000"]) == 0

    of_bag = list(nodes_of(tmp_path / "played").values())
    assert len(of_bag) == FRAMES
    assert max(np.abs(one - other).max() for one, other in zip(of_topics.values(), of_bag, strict=True)) < 1e-4


def test_what_is_tracked_is_published_also_for_late_subscribers(lab: RosNetwork, tmp_path: Path, tf: None) -> None:
    lab.bridge(RUNTIME)
    camera = LabCamera()
    player, listener, live = Player(lab, camera), lab.listener(), tmp_path / "live"
    listener.order("subscribe", topic="/dlokit/dlo", type=CLOUD)
    with tracking(tmp_path / "log", "--camera", "ros2", *options(camera), "--out", str(live)) as program:
        received: list[dict[str, Any]] = []

        def heard() -> bool:
            player.publish()
            received.extend(listener.heard("message", topic="/dlokit/dlo"))
            return len(received) > 3

        wait_until(heard, program)
        late = lab.listener("late")
        for topic, kind in (("/dlokit/markers", MARKERS), ("/dlokit/status", STATUS)):
            late.order("subscribe", topic=topic, type=kind, transient_local=True, depth=1)
        late.order("subscribe", topic="/tf_static", type="tf2_msgs/msg/TFMessage", transient_local=True, depth=10)
        markers, status = late.hear("message", topic="/dlokit/markers"), late.hear("message", topic="/dlokit/status")
        frames = {
            one["child_frame_id"]: one["header"]["frame_id"]
            for _ in range(2)  # the lab's, and dlokit's
            for one in late.hear("message", topic="/tf_static")["fields"]["transforms"]
        }
    assert markers["fields"]["markers"]
    assert status["fields"]["name"] == "dlokit: run"
    assert frames["dlokit_world"] == "base_link"
    assert frames[camera.frame] == "base_link"
    newest = received[-1]
    assert newest["fields"]["width"] == BelievedDlo.nodes
    player.nearest(newest["stamp_ns"])


def test_without_a_node_the_command_to_start_it_is_named(ros_environment: RosEnvironment) -> None:
    camera = LabCamera()
    done = subprocess.run(
        (DLOKIT, "track", "--headless", "--camera", "ros2", *options(camera)),
        capture_output=True,
        text=True,
        timeout=HANGS_S,
        check=False,
    )
    assert done.returncode == 2
    assert "ros2 run dlokit_ros bridge" in done.stderr
