"""Bags and real rclpy: what rclpy has serialised is tracked from a bag, and rclpy reads what an export has written."""

import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cable_pictures import CAMERA, picture
from live_systems import HANGS_S, background, eventually
from ros_lab import LabProgram, RosNetwork
from rosbags.rosbag2 import Reader, StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore
from test_ros_definitions import told

from dlokit.app.commands import execute
from dlokit.extras.ros2.definitions import definitions_of
from dlokit.extras.ros2.link import frames
from dlokit.extras.ros2.link.node_link import NodeLink, link_socket, listening

RUNTIME = Path(os.environ["DLOKIT_RUNTIME_DIR"])
REFERENCE = Path(__file__).parents[1] / "replay" / "references" / "farthest.mcap"
IMAGE, INFO, TF = "sensor_msgs/msg/Image", "sensor_msgs/msg/CameraInfo", "tf2_msgs/msg/TFMessage"
LOOKS, PERIOD_NS = 8, 33_000_000
REALSENSE = {
    "colour": "/camera/camera/color/image_raw",
    "depth": "/camera/camera/aligned_depth_to_color/image_raw",
    "info": "/camera/camera/color/camera_info",
}
ZED = {
    "colour": "/zed/zed_node/rgb/color/rect/image",
    "depth": "/zed/zed_node/depth/depth_registered",
    "info": "/zed/zed_node/rgb/color/rect/camera_info",
}


def publish(camera: LabProgram, topics: dict[str, str], *, zed: bool) -> None:
    """The pictures of a cable in the layout of the driver, with the camera's place in /tf_static."""
    place = CAMERA.T_world_camera
    xyzw = np.roll(place.wxyz, -1).tolist()
    transform = {"position_m": place.position_m.tolist(), "xyzw": xyzw, "stamp_ns": 0, "static": True}
    camera.order("transform", parent="base_link", child="optical", **transform)
    k = [CAMERA.fx_px, 0.0, CAMERA.cx_px, 0.0, CAMERA.fy_px, CAMERA.cy_px, 0.0, 0.0, 1.0]
    for number in range(LOOKS):
        one = picture(0.002 * number)
        every = {"stamp_ns": 1_000_000_000 + number * PERIOD_NS, "frame": "optical", "width": 640, "height": 480}
        pixels = np.dstack([one.pixels[..., ::-1], np.full((480, 640), 255, np.uint8)]) if zed else one.pixels
        depth = np.where(one.depth_m > 0, one.depth_m, np.nan) if zed else np.rint(one.depth_m * 1e3)
        depth = depth.astype(np.float32 if zed else np.uint16)
        encodings = ("bgra8", "32FC1") if zed else ("rgb8", "16UC1")
        for topic, data, encoding in zip((topics["colour"], topics["depth"]), (pixels, depth), encodings, strict=True):
            step = data[0].nbytes
            camera.order("image", data.tobytes(), topic=topic, encoding=encoding, step=step, **every)
        camera.order("info", topic=topics["info"], model="plumb_bob", d=[0.0] * 5, k=k, **every)


def recorded(lab: RosNetwork, topics: dict[str, str], *, zed: bool) -> list[tuple[str, str, bytes]]:
    """The messages of the topics as real rclpy has serialised them: topic, type, CDR bytes."""
    heard: list[tuple[str, str, bytes]] = []

    def hear(header: frames.FromNode, payload: bytes) -> None:
        if isinstance(header, frames.RosMessage):
            heard.append((header.topic, header.type, payload))

    pictures = {topics["colour"]: IMAGE, topics["depth"]: IMAGE, topics["info"]: INFO}
    link = NodeLink(lambda hello: None, hear)
    lab.bridge(RUNTIME)
    camera = lab.camera()
    for topic, kind in pictures.items():
        camera.order("topic", topic=topic, type=kind, depth=100)

    async def subscribe() -> None:
        assert await link.wait_node(HANGS_S) is not None
        for topic, kind in {**pictures, "/tf_static": TF}.items():
            link.send(frames.Subscribe(topic=topic, type=kind, depth=100))

    with background() as loop, loop.entered(listening(link, link_socket("dlokit"))):
        loop.run(subscribe())
        for topic in pictures:
            camera.order("await", topic=topic, count=1)
            camera.hear("matched", topic=topic)
        publish(camera, topics, zed=zed)
        loop.run(eventually(lambda: len(heard) == 3 * LOOKS + 1))
    return heard


def written(path: Path, distribution: str, messages: list[tuple[str, str, bytes]], storage: StoragePlugin) -> Path:
    """A bag of messages as they were serialised."""
    store = get_typestore(Stores(f"ros2_{distribution}"))
    with Writer(path, version=9, storage_plugin=storage) as writer:
        connections: dict[str, Any] = {}
        for number, (topic, kind, cdr) in enumerate(messages):
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, kind, typestore=store)
            writer.write(connections[topic], number, cdr)
    return path


@pytest.mark.parametrize(
    ("topics", "zed", "storage"), [(REALSENSE, False, StoragePlugin.SQLITE3), (ZED, True, StoragePlugin.MCAP)]
)
def test_a_cable_is_tracked_in_a_bag_of_what_rclpy_has_serialised(
    lab: RosNetwork,
    tf: None,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    topics: dict[str, str],
    zed: bool,
    storage: StoragePlugin,
) -> None:
    bag = written(tmp_path / "bag", lab.environment.distribution, recorded(lab, topics, zed=zed), storage)
    arguments = ["track", "--headless", "--camera", "recorded", "--camera.path", str(bag), "--rate-hz", "1000"]
    assert execute([*arguments, "--camera.colour", topics["colour"], "--camera.depth", topics["depth"]]) == 0
    assert f"{LOOKS} of {LOOKS} frames followed" in capsys.readouterr().out


def test_rclpy_reads_every_message_of_an_exported_run(lab: RosNetwork, tmp_path: Path) -> None:
    out = tmp_path / "bags"
    assert execute(["export", str(REFERENCE), "--to", "rosbag2", "--out", str(out)]) == 0
    (bag,) = (one for one in out.iterdir() if one.is_dir())
    definitions, reader = definitions_of(lab.environment.distribution), lab.listener()
    last: dict[str, tuple[str, bytes]] = {}
    with Reader(bag) as opened:
        for connection, _, cdr in opened.messages():
            last[connection.topic] = connection.msgtype, bytes(cdr)
    file, again = tmp_path / "cdr", tmp_path / "again"
    assert {"/dlokit/dlo", "/dlokit/goal", "/dlokit/markers", "/dlokit/status", "/diagnostics"} <= set(last)
    for kind, cdr in last.values():
        if kind == TF and lab.environment.why_not("tf2_msgs"):
            continue
        file.write_bytes(cdr)
        reader.order("read", path=str(file), type=kind, again=str(again))
        assert reader.hear("read")["fields"] == told(definitions.decode(kind, cdr))
